"""``videogrammetry undistort``: pictures and targets as an ideal camera would have them."""

from __future__ import annotations

import argparse
import dataclasses
import sys
from pathlib import Path
from typing import Any

from videogrammetry.cli.common import (
    SubParsers,
    UsageError,
    add_force,
    add_verb,
    refuse_overwrite_table,
)
from videogrammetry.cli.progress import Progress
from videogrammetry.geometry import (
    INTERPOLATIONS,
    KEEPS,
    Undistortion,
    ideal_camera,
    select_cameras,
)
from videogrammetry.pipeline.frames import open_cameras
from videogrammetry.pipeline.undistort import (
    picture_names,
    undistort_sequence,
    undistort_targets,
)
from videogrammetry.project import (
    atomic_folder,
    format_targets,
    provenance,
    read_project,
    read_rig,
    read_targets,
    refuse_overwrite,
    write_rig,
)
from videogrammetry.project.provenance import write_with_provenance
from videogrammetry.sequence import (
    SEQUENCE_FORMATS,
    JoinedSource,
    SequenceWriter,
    create_sequence,
    open_sequence,
)
from videogrammetry.types import RigData

_RECORDINGS = (".cihx", ".mraw")


def add_parser(verbs: SubParsers) -> None:
    """The verb's arguments."""
    parser = add_verb(
        verbs,
        "undistort",
        run,
        help="take the lens' distortion out of pictures or targets",
        description="Writes pictures, recordings or a targets CSV as a camera without distortion "
        "would have taken them: OUT is a folder of pictures, a recording (OUT.cihx) or a CSV. The "
        "camera without distortion is written too: OUT/rig.json in a folder, else OUT.rig.json "
        "beside. INPUT is pictures, stacks, recordings, folders or patterns of one camera, or a "
        "project: then OUT has a folder or a recording of every camera.",
        example="videogrammetry undistort 'left_*.tif' undistorted --rig rig.json --camera left",
    )
    parser.add_argument("inputs", nargs="+", metavar="INPUT", help="pictures, project or CSV")
    parser.add_argument("out", type=Path, metavar="OUT", help="folder, .cihx or .csv to write")
    parser.add_argument(
        "--rig", type=Path, metavar="FILE", help="rig.json (default: the project's)"
    )
    parser.add_argument("--camera", metavar="NAME", help="camera of the rig, if it has several")
    parser.add_argument(
        "--keep",
        choices=KEEPS,
        default="size",
        help="size of the pictures: as they are, all that was seen, or only what was seen "
        "everywhere (default: %(default)s)",
    )
    parser.add_argument(
        "--interpolation",
        choices=INTERPOLATIONS,
        default="lanczos",
        help="between pixels (default: %(default)s)",
    )
    parser.add_argument(
        "--fill", type=int, default=0, metavar="GREY", help="of what was not seen (default: 0)"
    )
    parser.add_argument(
        "--format",
        choices=SEQUENCE_FORMATS,
        help="of the pictures (default: mraw for OUT.cihx and for a project's recordings, else "
        "tiff)",
    )
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    """Undistorts a table, a project or one camera's pictures."""
    if not 0 <= args.fill <= 65535:
        raise UsageError(f"--fill: expected 0 to 65535, got {args.fill}")
    first = Path(args.inputs[0])
    single = len(args.inputs) == 1
    if single and first.suffix.lower() == ".csv":
        return _run_table(args, first)
    if single and (first.suffix.lower() == ".toml" or (first / "project.toml").is_file()):
        return _run_project(args, first)
    return _run_sequence(args)


def _rigs(args: argparse.Namespace, path: Path | None) -> tuple[RigData, RigData]:
    """The rig, of one camera if that is asked for, and the one without distortion."""
    if path is None:
        raise UsageError("--rig FILE is needed: it says what the lens does")
    rig = read_rig(path)
    if args.camera is not None:
        if args.camera not in rig.cameras:
            raise UsageError(f"--camera: {path} has {', '.join(rig.cameras)}, not {args.camera}")
        rig = select_cameras(rig, [args.camera])
    ideal = RigData(
        cameras={name: ideal_camera(camera, args.keep) for name, camera in rig.cameras.items()},
        reference=rig.reference,
        sigma_floor_px=rig.sigma_floor_px,
    )
    return rig, ideal


def _origin(args: argparse.Namespace, files: list[Path], base: Path) -> dict[str, Any]:
    options = {
        "keep": args.keep,
        "interpolation": args.interpolation,
        "fill": args.fill,
        "camera": args.camera,
    }
    return provenance(options, files, base)


def _run_table(args: argparse.Namespace, table: Path) -> int:
    if args.out.suffix.lower() != ".csv":
        raise UsageError(f"{args.out}: targets are written as CSV; give a name that ends in .csv")
    rig_file = args.out.with_suffix(".rig.json")
    refuse_overwrite_table(args.out, args.force)
    refuse_overwrite(rig_file, args.force)
    rig, ideal = _rigs(args, args.rig)
    pairs = {name: (camera, ideal.cameras[name]) for name, camera in rig.cameras.items()}
    result = undistort_targets(read_targets(table), pairs, args.camera)
    origin = _origin(args, [args.rig, table], Path.cwd())
    write_with_provenance(args.out, format_targets(result), origin)
    write_rig(rig_file, dataclasses.replace(ideal, how=origin))
    print(f"wrote {args.out}: {len(result)} targets; {rig_file}", file=sys.stderr)
    return 0


def _run_sequence(args: argparse.Namespace) -> int:
    recording = args.out.suffix.lower() in _RECORDINGS
    name = args.format or ("mraw" if recording else "tiff")
    if recording != (name == "mraw"):
        raise UsageError(
            f"--format {name} does not go with {args.out}: a recording's name ends in .cihx, a "
            "folder of pictures has no such suffix"
        )
    rig_file = args.out.with_suffix(".rig.json") if recording else args.out / "rig.json"
    for file in [args.out.with_suffix(s) for s in _RECORDINGS] if recording else [args.out]:
        _refuse(file)
    if recording:
        refuse_overwrite(rig_file, args.force)
    rig, ideal = _rigs(args, args.rig)
    if len(rig.cameras) != 1:
        raise UsageError(f"--camera is needed: {args.rig} has {', '.join(rig.cameras)}")
    source = open_sequence(args.inputs)
    [camera] = rig.cameras
    _write(args, source, rig, ideal, camera, args.out, name)
    origin = _origin(args, [args.rig, *source.paths], Path.cwd())
    write_rig(rig_file, dataclasses.replace(ideal, how=origin))
    _say(args.out, len(source), ideal, camera)
    return 0


def _run_project(args: argparse.Namespace, path: Path) -> int:
    project = read_project(path)
    rig_path = args.rig or project.rig_path
    rig, ideal = _rigs(args, rig_path)
    sources = {
        name: source
        for name, source in open_cameras(project, "sequence", lambda c: c.sequence).items()
        if name in rig.cameras and args.camera in (None, name)
    }
    _refuse(args.out)
    with atomic_folder(args.out) as folder:
        for name, source in sources.items():
            is_recording = all(p.suffix.lower() in (*_RECORDINGS, ".cih") for p in source.paths)
            form = args.format or ("mraw" if is_recording else "tiff")
            target = folder / (f"{name}.cihx" if form == "mraw" else name)
            _write(args, source, rig, ideal, name, target, form)
            _say(args.out / target.name, len(source), ideal, name)
        pictures = [p for source in sources.values() for p in source.paths]
        origin = _origin(args, [project.path, rig_path, *pictures], project.folder)
        write_rig(folder / "rig.json", dataclasses.replace(ideal, how=origin))
    return 0


def _refuse(path: Path) -> None:
    """Pictures take long and much room: they are never overwritten, not even with --force."""
    if path.exists():
        raise UsageError(
            f"{path} is there already, and pictures are not overwritten, even with --force: "
            "remove it, or choose another name"
        )


def _write(
    args: argparse.Namespace,
    source: JoinedSource,
    rig: RigData,
    ideal: RigData,
    camera: str,
    target: Path,
    form: Any,
) -> None:
    """One camera's pictures without distortion, to a folder or a recording."""
    undistortion = Undistortion(
        camera=rig.cameras[camera],
        ideal=ideal.cameras[camera],
        interpolation=args.interpolation,
        fill=args.fill,
    )

    def create(bit_depth: int) -> SequenceWriter:
        if args.fill >= 2**bit_depth:
            raise UsageError(f"--fill: {args.fill} is more than {bit_depth} bits hold")
        return create_sequence(
            target,
            format=form,
            image_size_px=ideal.cameras[camera].image_size_px,
            num_frames=len(source),
            bit_depth=bit_depth,
            frame_rate_hz=source.frame_rate_hz,
            exposure_s=source.exposure_s,
            camera_name=camera,
            names=None if form == "mraw" else picture_names(source),
        )

    progress = Progress(f"undistort {camera}", "pictures")
    try:
        undistort_sequence(source, undistortion, create, progress)
    finally:
        progress.close()


def _say(place: Path, count: int, ideal: RigData, camera: str) -> None:
    width, height = ideal.cameras[camera].image_size_px
    print(f"wrote {place}: {count} pictures of {width}x{height} px", file=sys.stderr)
