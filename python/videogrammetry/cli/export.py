"""``videogrammetry export``: a measurement in another format, by the file's suffix."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from videogrammetry.cli.common import (
    SubParsers,
    UsageError,
    add_force,
    add_verb,
    refuse_overwrite_table,
)
from videogrammetry.project import provenance, read_measurement, read_project
from videogrammetry.project.provenance import write_with_provenance

SUFFIXES = (".csv",)


def add_parser(verbs: SubParsers) -> None:
    """The verb's arguments."""
    parser = add_verb(
        verbs,
        "export",
        run,
        help="write a measurement in another format",
        description="Writes trajectories, motion, the points of one stage or the targets seen; "
        "the suffix of FILE is the format (.csv); its provenance goes to "
        "FILE.provenance.json.",
        example="videogrammetry export project.toml motion.csv --what motion",
    )
    parser.add_argument("project", type=Path, metavar="PROJECT", help="project.toml or its folder")
    parser.add_argument("file", type=Path, metavar="FILE", help="file to write")
    parser.add_argument(
        "--what",
        choices=("trajectories", "motion", "points", "targets"),
        default="trajectories",
        help="what to write (default: %(default)s)",
    )
    parser.add_argument(
        "--stage", type=int, metavar="N", help="stage for --what points (default: the reference's)"
    )
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    """Exports the project's measurement."""
    if args.file.suffix.lower() not in SUFFIXES:
        raise UsageError(
            f"{args.file}: {args.file.suffix or 'no suffix'!r} is no format known here; "
            f"known: {', '.join(SUFFIXES)}"
        )
    if args.stage is not None and args.what != "points":
        raise UsageError("--stage goes with --what points only; leave one of them out")
    project = read_project(args.project)
    refuse_overwrite_table(args.file, args.force)

    from videogrammetry.export import format_table

    text = format_table(read_measurement(project.measurement_path), args.what, args.stage)
    origin = provenance(
        {"what": args.what, "stage": args.stage},
        [project.path, project.measurement_path],
        project.folder,
    )
    write_with_provenance(args.file, text, origin)
    print(f"wrote {args.file}: {text.count(chr(10)) - 1} rows", file=sys.stderr)
    return 0
