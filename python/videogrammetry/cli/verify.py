"""``videogrammetry verify``: a measurement against lengths, gravity and simulated truth."""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import sys
from pathlib import Path
from typing import Any

from videogrammetry.cli.common import SubParsers, UsageError, add_force, add_verb, point_list
from videogrammetry.cli.verify_tables import verification_text
from videogrammetry.project import VerifySection, plain, read_project, refuse_overwrite, write_text


def add_parser(verbs: SubParsers) -> None:
    """The verb's arguments."""
    parser = add_verb(
        verbs,
        "verify",
        run,
        help="check a measurement against known lengths, gravity or simulated truth",
        description="Reads measurement.h5 and rig.json beside the project file and prints tables "
        "of errors beside what was predicted. Options win over the project's [verify].",
        example="videogrammetry verify project.toml --scale-bars bars.csv --free-fall 1 100 "
        "--points 4-11,21-30",
    )
    parser.add_argument("project", type=Path, metavar="PROJECT", help="project.toml or its folder")
    parser.add_argument(
        "--scale-bars",
        type=Path,
        metavar="FILE",
        help="CSV of known lengths, which the calibration has not used",
    )
    parser.add_argument(
        "--free-fall",
        nargs=2,
        type=int,
        metavar=("FIRST", "LAST"),
        help="stages of a free fall, both included",
    )
    parser.add_argument(
        "--points",
        type=point_list,
        metavar="LIST",
        help="numbers of the falling points, like 4-11,21-30 (default: all)",
    )
    parser.add_argument(
        "--gravity", type=float, metavar="G", help="local, m/s^2 (default: 9.80665)"
    )
    parser.add_argument(
        "--drag",
        type=_drag,
        metavar="K|estimate",
        help="the air's resistance, dv/dt = g - K |v| v, K in 1/m (default: 0)",
    )
    parser.add_argument(
        "--vertical",
        nargs=3,
        type=float,
        metavar=("X", "Y", "Z"),
        help="upward direction in the rig's frame (default: that of the fall)",
    )
    parser.add_argument(
        "--truth",
        type=Path,
        metavar="DIR",
        help="folder with rig.json and trajectories.csv of a simulated sequence",
    )
    parser.add_argument(
        "--out", type=Path, metavar="FILE.json", help="write everything as JSON, with provenance"
    )
    add_force(parser)


def _drag(text: str) -> float | str:
    if text == "estimate":
        return text
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 <= value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r}: expected a number of 1/m from 0, or estimate")
    return value


def run(args: argparse.Namespace) -> int:
    """Checks the measurement, prints the tables and writes the document."""
    if args.out is not None and args.out.suffix.lower() != ".json":
        raise UsageError(f"--out: expected a name ending in .json, got {args.out}")
    project = read_project(args.project)
    options = _options(args, project.verify)

    from videogrammetry.pipeline.verify import (
        NOTHING_TO_VERIFY,
        verification_document,
        verify_project,
    )

    if not options.anything:
        raise UsageError(NOTHING_TO_VERIFY)
    if args.out is not None:
        refuse_overwrite(args.out, args.force)
    verification = verify_project(project, options=options)
    if args.out is not None:
        write_text(args.out, json.dumps(plain(verification_document(verification))) + "\n")
    for warning in verification.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    print(verification_text(verification), end="")
    if args.out is not None:
        print(f"wrote {args.out}", file=sys.stderr)
    return 0


def _options(args: argparse.Namespace, section: VerifySection) -> VerifySection:
    """The project's ``[verify]`` with what the command line says instead."""
    given: dict[str, Any] = {}
    if args.free_fall is not None:
        first, last = args.free_fall
        if not 1 <= first < last:
            raise UsageError(
                f"--free-fall {first} {last}: expected the first and a later stage, from 1"
            )
        given["free_fall"] = (first, last)
    if args.gravity is not None:
        if not 0 < args.gravity < float("inf"):
            raise UsageError(f"--gravity {args.gravity}: expected a positive number of m/s^2")
        given["gravity_m_s2"] = args.gravity
    if args.vertical is not None:
        if not any(args.vertical) or not all(map(math.isfinite, args.vertical)):
            raise UsageError(
                f"--vertical {' '.join(f'{v:g}' for v in args.vertical)}: is no direction; give "
                "the one that points upwards"
            )
        given["vertical"] = tuple(args.vertical)
    if args.drag is not None:
        estimate = args.drag == "estimate"
        given |= {"estimate_drag": estimate, "drag_per_m": 0.0 if estimate else args.drag}
    for name in ("scale_bars", "points", "truth"):
        if getattr(args, name) is not None:
            given[name] = getattr(args, name)
    return dataclasses.replace(section, **given)
