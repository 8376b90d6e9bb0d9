"""``videogrammetry measure``: project -> measurement.h5."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from videogrammetry.cli.common import SubParsers, add_force, add_verb
from videogrammetry.cli.progress import Progress
from videogrammetry.project import read_project, refuse_overwrite


def add_parser(verbs: SubParsers) -> None:
    """The verb's arguments."""
    parser = add_verb(
        verbs,
        "measure",
        run,
        help="measure the motion in the sequences",
        description="Recognises, matches, reconstructs and tracks all stages; "
        "writes measurement.h5 beside the project file, which needs its rig.json there.",
        example="videogrammetry measure project.toml",
    )
    parser.add_argument("project", type=Path, metavar="PROJECT", help="project.toml or its folder")
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    """Measures the project's sequences."""
    project = read_project(args.project)
    refuse_overwrite(project.measurement_path, args.force)

    from videogrammetry.pipeline import measure_project

    progress = Progress("measure", "stages")
    try:
        measure_project(project, progress=progress)
    finally:
        progress.close()
    print(f"wrote {project.measurement_path}", file=sys.stderr)
    return 0
