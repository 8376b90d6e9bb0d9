"""The part of ``videogrammetry export`` that takes rigs to other programs' files, and back."""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
from pathlib import Path
from typing import Any

from videogrammetry.cli.common import UsageError, refuse_overwrite_table, text_table
from videogrammetry.export import (
    RIG_FORMATS,
    LensCamera,
    convert_for,
    format_file,
    format_folder,
    read_lens_cameras,
    rig_of_lenses,
)
from videogrammetry.export.lenses import MODELS
from videogrammetry.geometry import select_cameras
from videogrammetry.project import (
    atomic_folder,
    provenance,
    read_project,
    read_rig,
    refuse_overwrite,
    write_rig,
)
from videogrammetry.project.provenance import plain, write_with_provenance
from videogrammetry.types import RigData

_SUFFIX_FORMAT = {
    ".yaml": "opencv",
    ".yml": "opencv",
    ".json": "opencv",
    ".cameramodel": "mrcal",
}


def add_options(parser: argparse.ArgumentParser) -> None:
    """What goes with rigs alone."""
    group = parser.add_argument_group("cameras, to and from other programs")
    group.add_argument(
        "--format",
        choices=tuple(RIG_FORMATS),
        help="of the cameras (default: opencv for .yaml and .json, mrcal for .cameramodel)",
    )
    group.add_argument("--camera", metavar="NAME", help="this camera of the rig alone")
    group.add_argument(
        "--model",
        choices=tuple(MODELS),
        help="lens model, by its number of coefficients (default: the smallest that the camera "
        "needs and the format has)",
    )
    group.add_argument(
        "--keep-axes",
        action="store_true",
        help="do not turn cameras about their axis to take up half of a shear",
    )
    group.add_argument(
        "--image-size",
        nargs=2,
        type=int,
        metavar=("W", "H"),
        help="to rig.json: size of the pictures, where the file does not say it",
    )
    group.add_argument(
        "--distortion",
        choices=("measured", "ideal"),
        help="to rig.json: direction of the correction (default: ideal where that is exact)",
    )


def is_exchange(args: argparse.Namespace) -> bool:
    """Whether cameras are to be exchanged, not a measurement's tables."""
    return to_rig(args) or args.format is not None or (args.file.suffix.lower() in _SUFFIX_FORMAT)


def to_rig(args: argparse.Namespace) -> bool:
    """Whether the inputs are another program's: everything that is no project and no rig.json."""
    return all(_is_foreign(path) for path in args.inputs)


def _is_foreign(path: Path) -> bool:
    suffix = path.suffix.lower()
    if suffix == ".json":
        try:
            document = json.loads(path.read_text(encoding="utf-8-sig"))
        except (OSError, ValueError):
            return False  # the reader of rigs says what is wrong with it
        return isinstance(document, dict) and "schema" not in document
    return suffix in (".yaml", ".yml", ".cameramodel")


def run(args: argparse.Namespace) -> int:
    """Rig to another program's files, or back."""
    if to_rig(args):
        return _import(args)
    if len(args.inputs) != 1:
        raise UsageError("one rig.json or project is exported at a time")
    if args.image_size or args.distortion:
        raise UsageError("--image-size and --distortion go with what becomes a rig.json")
    path = args.inputs[0]
    rig_path = path if path.suffix.lower() == ".json" else read_project(path).rig_path
    suffix = args.file.suffix.lower()
    name: Any = args.format or _SUFFIX_FORMAT[suffix]
    is_file = suffix in RIG_FORMATS[name].suffixes
    if not is_file and (suffix in _SUFFIX_FORMAT or args.file.is_file()):
        known = ", ".join(RIG_FORMATS[name].suffixes) or "no suffix: it is a folder"
        raise UsageError(f"{args.file}: {name} has {known}")
    if is_file:
        refuse_overwrite_table(args.file, args.force)
    elif args.file.exists():
        raise UsageError(f"{args.file} is there already, and a folder is not overwritten")
    rig = read_rig(rig_path)
    if args.camera is not None:
        if args.camera not in rig.cameras:
            raise UsageError(f"--camera: {rig_path} has {', '.join(rig.cameras)}")
        rig = select_cameras(rig, [args.camera])
    try:
        _check_layout(rig, name, is_file)
        cameras = convert_for(rig, name, args.model, keep_axes=args.keep_axes)
        _write(args, cameras, name, is_file, rig_path)
    except ValueError as error:
        raise UsageError(str(error)) from error
    _say(cameras)
    print(f"wrote {args.file}: {len(cameras)} cameras as {name}", file=sys.stderr)
    return 0


def _check_layout(rig: RigData, name: str, is_file: bool) -> None:
    """Before the work: several cameras in a file for one."""
    if is_file and RIG_FORMATS[name].one is not None and len(rig.cameras) != 1:
        raise ValueError(
            f"a {name} file holds one camera, the rig has {', '.join(rig.cameras)}: give --camera "
            "NAME, or the name of a folder for all"
        )


def _write(
    args: argparse.Namespace, cameras: list[LensCamera], name: Any, is_file: bool, rig_path: Path
) -> None:
    options = {
        "format": name,
        "model": args.model,
        "camera": args.camera,
        "keep_axes": args.keep_axes,
    }
    origin = provenance(options, [rig_path], rig_path.parent)
    origin["cameras"] = {
        c.name: {"model": c.model, "roll_rad": c.roll_rad, "residual": plain(c.residual)}
        for c in cameras
    }
    if is_file:
        text = format_file(cameras, name, args.file.suffix.lower())
        write_with_provenance(args.file, text, origin)
        return
    texts = format_folder(cameras, name)
    with atomic_folder(args.file) as folder:
        for file, text in texts.items():
            (folder / file).write_bytes(text.encode())
        (folder / "provenance.json").write_text(json.dumps(plain(origin), indent=1) + "\n")


def _say(cameras: list[LensCamera]) -> None:
    rows = [
        [
            camera.name,
            camera.model,
            f"{camera.residual.rms_px:.2g}",
            f"{camera.residual.max_px:.2g}",
            f"{camera.roll_rad:.5f}",
        ]
        for camera in cameras
        if camera.residual is not None
    ]
    print(text_table(["camera", "model", "RMS px", "largest px", "roll rad"], rows), end="")


def _import(args: argparse.Namespace) -> int:
    if args.file.suffix.lower() != ".json":
        raise UsageError(f"{args.file}: cameras of other programs become a rig: name a rig.json")
    if args.format or args.model or args.keep_axes or args.camera:
        raise UsageError(
            "--format, --model, --keep-axes and --camera go with the export of a rig.json"
        )
    refuse_overwrite(args.file, args.force)
    size = tuple(args.image_size) if args.image_size else None
    cameras = [camera for path in args.inputs for camera in read_lens_cameras(path, size)]
    measured = None if args.distortion is None else args.distortion == "measured"
    rig, fits = rig_of_lenses(cameras, measured=measured)
    how = provenance({"distortion": args.distortion}, args.inputs, args.file.parent)
    how["residual"] = {name: plain(fit.residual) for name, fit in fits.items()}
    write_rig(args.file, dataclasses.replace(rig, how=how))
    rows = [
        [
            name,
            "measured" if fit.camera.measured else "ideal",
            f"{fit.residual.rms_px:.2g}",
            f"{fit.residual.max_px:.2g}",
        ]
        for name, fit in fits.items()
    ]
    print(text_table(["camera", "distortion of", "RMS px", "largest px"], rows), end="")
    print(f"wrote {args.file}: {len(rig.cameras)} cameras, without covariance", file=sys.stderr)
    return 0
