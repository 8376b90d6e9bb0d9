"""``videogrammetry measure``: project -> measurement.h5."""

from __future__ import annotations

import argparse
import contextlib
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

import numpy as np

from videogrammetry.cli.common import SubParsers, UsageError, add_force, add_verb, text_table
from videogrammetry.cli.progress import Progress
from videogrammetry.errors import VideogrammetryError
from videogrammetry.pipeline.sinks import StageTable
from videogrammetry.project import Project, read_project, refuse_overwrite
from videogrammetry.types import RigData

if TYPE_CHECKING:
    from videogrammetry.pipeline.chunk_job import ChunkOptions
    from videogrammetry.pipeline.chunk_record import ChunkRecord
    from videogrammetry.pipeline.follow import Publisher


def add_parser(verbs: SubParsers) -> None:
    """The verb's arguments."""
    parser = add_verb(
        verbs,
        "measure",
        run,
        help="measure the motion in the sequences",
        description="Recognises, matches, reconstructs and tracks all stages; "
        "writes measurement.h5 beside the project file, which needs its rig.json there. What is "
        "done is kept: after an interruption the same command goes on where it ended.",
        example="videogrammetry measure project.toml --scheduler local --workers 8",
    )
    parser.add_argument(
        "project",
        type=Path,
        nargs="+",
        metavar="PROJECT",
        help="project.toml or its folder; several are measured one after the other, those that "
        "have their measurement.h5 already are passed over",
    )
    parser.add_argument(
        "--threads",
        type=int,
        default=0,
        metavar="N",
        help="chunks of stages at a time (default: 0, one a core)",
    )
    parser.add_argument(
        "--skip-unreadable",
        action="store_true",
        help="leave frames that cannot be read empty, with a warning",
    )
    parser.add_argument(
        "--reorient",
        action="append",
        type=moved_camera,
        default=[],
        metavar="CAMERA[:STAGE]",
        help="a camera that has moved, and from which stage on (default: the first): its pose "
        "from there on is found from [stability] points or from coded points that two other "
        "cameras see; may be given several times",
    )
    _add_cluster(parser)
    _add_follow(parser)
    add_force(parser)


def moved_camera(text: str) -> tuple[str, int | None]:
    """A camera and the stage from which on it stands otherwise.

    Examples
    --------
    >>> moved_camera("cam2:501"), moved_camera("cam2")
    (('cam2', 501), ('cam2', None))
    """
    name, colon, stage = text.rpartition(":")
    if not colon:
        return text, None
    if not stage.isdecimal() or not name:
        raise argparse.ArgumentTypeError(f"expected CAMERA or CAMERA:STAGE, got {text!r}")
    return name, int(stage)


def _add_cluster(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("on several machines (extra: cluster)")
    group.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="a Dask scheduler, tcp://host:port; local: processes of this machine",
    )
    group.add_argument(
        "--workers",
        type=int,
        default=0,
        metavar="N",
        help="processes of --scheduler local (default: 0, one a core)",
    )


def _add_follow(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("while it is recorded")
    group.add_argument(
        "--follow", action="store_true", help="measure frames as they are written, until they end"
    )
    group.add_argument(
        "--idle",
        type=float,
        default=10.0,
        metavar="S",
        help="they end when none has come for so many seconds (default: 10), or with Ctrl-C",
    )
    group.add_argument(
        "--live",
        metavar="FILE",
        help="where positions appear meanwhile (default: trajectories.live.csv beside the "
        "project; -: standard output)",
    )
    group.add_argument(
        "--live-stages",
        type=int,
        default=25,
        metavar="N",
        help="when there are so many new stages (default: 25)",
    )
    group.add_argument(
        "--live-seconds",
        type=float,
        default=1.0,
        metavar="S",
        help="or the oldest has waited so long (default: 1)",
    )


def run(args: argparse.Namespace) -> int:
    """Measures the sequences of the projects."""
    _check(args)
    projects = [read_project(path) for path in args.project]
    if len(projects) == 1:
        refuse_overwrite(projects[0].measurement_path, args.force)
        _measure(projects[0], args)
        return 0
    failed = 0
    for project in projects:
        if project.measurement_path.exists() and not args.force:
            print(
                f"{project.measurement_path} is there already: passed over (--force measures it "
                "again)",
                file=sys.stderr,
            )
            continue
        print(f"{project.path}:", file=sys.stderr)
        try:
            refuse_overwrite(project.measurement_path, args.force)
            _measure(project, args)
        except (VideogrammetryError, OSError) as error:
            if args.traceback:
                raise
            text = " ".join(str(error).split())
            print(f"videogrammetry measure: {project.path}: {text}", file=sys.stderr)
            failed += 1
    if failed:
        print(f"{failed} of {len(projects)} projects could not be measured", file=sys.stderr)
    return 1 if failed else 0


def _check(args: argparse.Namespace) -> None:
    if args.follow and (len(args.project) > 1 or args.scheduler):
        raise UsageError("--follow measures one project on this machine: leave out the others")
    if args.workers and args.scheduler != "local":
        raise UsageError("--workers goes with --scheduler local")
    for name in ("threads", "workers"):
        if getattr(args, name) < 0:
            raise UsageError(f"--{name}: expected 0 or more, got {getattr(args, name)}")
    for name in ("idle", "live_stages", "live_seconds"):
        if not getattr(args, name) > 0:
            raise UsageError(f"--{name.replace('_', '-')}: expected more than 0")


def _measure(project: Project, args: argparse.Namespace) -> None:
    from videogrammetry.pipeline import ClusterRunner, measure_to_file

    progress = Progress("measure", "stages")
    try:
        if args.follow:
            table = _follow(project, args, progress)
        else:
            table = measure_to_file(
                project,
                reorient=args.reorient,
                progress=progress,
                num_threads=args.threads,
                skip_unreadable=args.skip_unreadable,
                run=ClusterRunner(args.scheduler, args.workers) if args.scheduler else None,
            )
    finally:
        progress.close()
    for warning in table.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    print(summary(table), end="", file=sys.stderr if args.live == "-" else sys.stdout)
    print(f"wrote {project.measurement_path}", file=sys.stderr)


def _follow(project: Project, args: argparse.Namespace, progress: Progress) -> StageTable:
    from videogrammetry.pipeline import FollowOptions, LiveTable, follow_project
    from videogrammetry.pipeline.measure_job import first_free_id

    options = FollowOptions(
        idle_s=args.idle,
        piece_stages=args.live_stages,
        piece_s=args.live_seconds,
        num_threads=args.threads,
        skip_unreadable=args.skip_unreadable,
    )
    longest = 0.0
    with contextlib.ExitStack() as stack:

        def publisher(rig: RigData, how: ChunkOptions, rate: float | None) -> Publisher:
            stream: TextIO = sys.stdout
            if args.live != "-":
                path = Path(args.live or project.folder / "trajectories.live.csv")
                stream = stack.enter_context(path.open("w", encoding="utf-8", newline=""))
                print(f"positions appear in {path}", file=sys.stderr)
            names = tuple(rig.cameras)
            live = LiveTable([stream], names, first_free_id(how.recognition), rate)

            def publish(record: ChunkRecord, delay_s: float) -> None:
                nonlocal longest
                begun = time.monotonic()
                live.add(record)
                delay_s += time.monotonic() - begun
                longest = max(longest, delay_s)
                first, last = record.stage[0], record.stage[-1]
                print(
                    f"stages {first} to {last}: {len(record.point_code)} points, {delay_s:.2f} s "
                    "after the first of these stages was there",
                    file=sys.stderr,
                )

            return publish

        table = follow_project(
            project,
            options=options,
            publisher=publisher,
            progress=progress,
            tell=lambda text: print(text, file=sys.stderr),
        )
    print(f"longest delay of a stage: {longest:.2f} s", file=sys.stderr)
    return table


#: Of more stages than this, as many are shown, evenly from the first to the last.
_MOST_ROWS = 40


def summary(table: StageTable) -> str:
    """Table of the stages, and what became of the targets."""
    count = len(table.stage)
    shown = np.unique(np.linspace(0, count - 1, min(count, _MOST_ROWS)).round().astype(int))
    rows = []
    for s in shown.tolist():
        moved = table.centroid_displacement_mm[s]
        rows.append(
            [
                str(table.stage[s]),
                str(table.num_targets[s]),
                str(table.num_points[s]),
                *(f"{v:.4f}" if np.isfinite(v) else "-" for v in _quality(table, s)),
                *(f"{v:.3f}" if np.isfinite(v) else "-" for v in moved),
            ]
        )
    header = ["stage", "targets", "points", "RMS px", "sigma mm"]
    header += ["centroid dx mm", "dy mm", "dz mm"]
    left_out = "" if len(shown) == count else f"{len(shown)} of {count} stages are shown\n"
    counts = ", ".join(f"{n} {name}" for name, n in table.status_counts().items())
    return (
        text_table(header, rows)
        + left_out
        + f"{table.points} points, {table.everywhere} of them in every stage; targets: {counts}\n"
    )


def _quality(table: StageTable, row: int) -> tuple[float, float]:
    return float(table.rms_px[row]), float(table.sigma_mm[row])
