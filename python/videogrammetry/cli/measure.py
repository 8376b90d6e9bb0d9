"""``videogrammetry measure``: project -> measurement.h5."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from videogrammetry.cli.common import SubParsers, add_force, add_verb, text_table
from videogrammetry.cli.progress import Progress
from videogrammetry.pipeline.sinks import StageTable
from videogrammetry.project import read_project, refuse_overwrite


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
        example="videogrammetry measure project.toml",
    )
    parser.add_argument("project", type=Path, metavar="PROJECT", help="project.toml or its folder")
    parser.add_argument(
        "--threads",
        type=int,
        default=0,
        metavar="N",
        help="chunks of stages at a time (default: 0, one a core)",
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


def run(args: argparse.Namespace) -> int:
    """Measures the project's sequences."""
    project = read_project(args.project)
    refuse_overwrite(project.measurement_path, args.force)

    from videogrammetry.pipeline import measure_to_file

    progress = Progress("measure", "stages")
    try:
        table = measure_to_file(
            project, reorient=args.reorient, progress=progress, num_threads=args.threads
        )
    finally:
        progress.close()
    for warning in table.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    print(summary(table), end="")
    print(f"wrote {project.measurement_path}", file=sys.stderr)
    return 0


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
