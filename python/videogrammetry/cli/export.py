"""``videogrammetry export``: a measurement or its cameras in another format, by the suffix."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from videogrammetry.cli import exchange
from videogrammetry.cli.common import (
    SubParsers,
    UsageError,
    add_force,
    add_verb,
    refuse_overwrite_table,
)
from videogrammetry.project import provenance, read_measurement, read_project
from videogrammetry.project.provenance import write_with_provenance
from videogrammetry.types import POINT_FLAGS

SUFFIXES = (".csv",)


def add_parser(verbs: SubParsers) -> None:
    """The verb's arguments."""
    parser = add_verb(
        verbs,
        "export",
        run,
        help="write a measurement or cameras in another format",
        description="The suffix of FILE is the format. A project to .csv: trajectories, motion, "
        "the points of one stage or the targets seen. A rig.json (or a project's) to the files of "
        "OpenCV (.yaml, .json), ROS, Kalibr (.yaml with --format), mrcal (.cameramodel) and COLMAP "
        "(a folder with --format colmap), and OpenCV's, ROS' or mrcal's files to a rig.json; what "
        "each conversion leaves is printed. Provenance goes to FILE.provenance.json.",
        example="videogrammetry export project.toml motion.csv --what motion\n"
        "  videogrammetry export rig.json cameras.yaml\n"
        "  videogrammetry export left.cameramodel right.cameramodel rig.json",
    )
    parser.add_argument(
        "inputs",
        nargs="+",
        type=Path,
        metavar="INPUT",
        help="project.toml or its folder; rig.json; other programs' camera files",
    )
    parser.add_argument("file", type=Path, metavar="FILE", help="file or folder to write")
    parser.add_argument(
        "--what",
        choices=("trajectories", "motion", "points", "targets"),
        default="trajectories",
        help="what to write (default: %(default)s)",
    )
    parser.add_argument(
        "--stage", type=int, metavar="N", help="stage for --what points (default: the reference's)"
    )
    parser.add_argument(
        "--leave-out",
        nargs="+",
        choices=POINT_FLAGS,
        default=[],
        metavar="FLAG",
        help="leave out positions that have one of these flags, and what is derived from them: "
        + ", ".join(POINT_FLAGS),
    )
    exchange.add_options(parser)
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    """Exports the project's measurement, or exchanges cameras."""
    if exchange.is_exchange(args):
        return exchange.run(args)
    if args.file.suffix.lower() not in SUFFIXES:
        raise UsageError(
            f"{args.file}: {args.file.suffix or 'no suffix'!r} is no format known here; "
            f"known: {', '.join(SUFFIXES)}, for cameras .yaml, .json, .cameramodel"
        )
    if args.stage is not None and args.what != "points":
        raise UsageError("--stage goes with --what points only; leave one of them out")
    if len(args.inputs) != 1:
        raise UsageError("one project is exported at a time")
    project = read_project(args.inputs[0])
    refuse_overwrite_table(args.file, args.force)

    from videogrammetry.export import format_table, leave_out_flagged

    if args.leave_out and args.what == "targets":
        raise UsageError("--leave-out goes with positions, not with --what targets")
    measurement = leave_out_flagged(read_measurement(project.measurement_path), args.leave_out)
    text = format_table(measurement, args.what, args.stage)
    origin = provenance(
        {"what": args.what, "stage": args.stage}
        | ({"leave_out": args.leave_out} if args.leave_out else {}),
        [project.path, project.measurement_path],
        project.folder,
    )
    write_with_provenance(args.file, text, origin)
    print(f"wrote {args.file}: {text.count(chr(10)) - 1} rows", file=sys.stderr)
    return 0
