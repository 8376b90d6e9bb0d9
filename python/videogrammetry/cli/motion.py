"""``videogrammetry motion``: displacement, velocity and centroid computed again."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from videogrammetry.cli.common import (
    SubParsers,
    UsageError,
    add_force,
    add_verb,
    point_list,
    refuse_overwrite_table,
    text_table,
)
from videogrammetry.motion import MotionOptions
from videogrammetry.project import provenance, read_measurement, read_project, write_measurement
from videogrammetry.project.provenance import write_with_provenance
from videogrammetry.types import FloatArray, Measurement, matrix_from_cov6

_MAX_NAMED = 30


def add_parser(verbs: SubParsers) -> None:
    """The verb's arguments."""
    parser = add_verb(
        verbs,
        "motion",
        run,
        help="compute the motion again, with another reference or centroid",
        description="Computes displacement, velocity and centroid of measurement.h5 again and "
        "writes them into it, the positions stay; prints the centroid's motion.",
        example="videogrammetry motion project.toml --reference-stage 10 "
        "--centroid-points 4-11,21-30 --out motion.csv",
    )
    parser.add_argument("project", type=Path, metavar="PROJECT", help="project.toml or its folder")
    parser.add_argument(
        "--reference-stage",
        type=int,
        metavar="N",
        help="displacements are against this stage (default: the project's)",
    )
    parser.add_argument(
        "--centroid-points",
        type=point_list,
        metavar="LIST",
        help="numbers of the points whose mean is the centroid, like 4-11,21-30 "
        "(default: those measured at every stage)",
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FILE.csv",
        help="motion CSV of all points and the centroid, its provenance beside it",
    )
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    """Recomputes, rewrites the measurement and prints the centroid."""
    if args.out is not None and args.out.suffix.lower() != ".csv":
        raise UsageError(f"--out: expected a name ending in .csv, got {args.out}")
    project = read_project(args.project)
    if args.out is not None:
        refuse_overwrite_table(args.out, args.force)

    from videogrammetry.export import format_table
    from videogrammetry.pipeline import recompute_motion

    options = MotionOptions(
        reference_stage=args.reference_stage, centroid_points=args.centroid_points
    )
    measurement = recompute_motion(project, read_measurement(project.measurement_path), options)
    write_measurement(project.measurement_path, measurement)
    if args.out is not None:
        origin = provenance(
            measurement.provenance["motion"]["options"],
            [project.path, project.measurement_path],
            project.folder,
        )
        write_with_provenance(args.out, format_table(measurement, "motion"), origin)
    print(centroid_table(measurement), end="")
    also = "" if args.out is None else f" and {args.out}"
    print(f"wrote {project.measurement_path}{also}", file=sys.stderr)
    return 0


def centroid_table(measurement: Measurement) -> str:
    """Position, displacement and speed of the centroid at every stage, and of which points."""
    motion, table = measurement.motion, measurement.trajectories
    speed, sigma = _speed(motion.centroid_velocity_mm_s, motion.centroid_velocity_cov_mm2_s2)
    rows = [
        [
            str(stage),
            _number(table.time_s[s], 6),
            *(_number(v, 3) for v in motion.centroid_mm[s]),
            *(_number(v, 3) for v in motion.centroid_displacement_mm[s]),
            _number(speed[s], 2),
            _number(sigma[s], 2),
        ]
        for s, stage in enumerate(table.stage.tolist())
    ]
    header = ["stage", "time s", "x mm", "y mm", "z mm", "dx mm", "dy mm", "dz mm"]
    header += ["speed mm/s", "+-"]
    named = motion.centroid_points.tolist()
    points = ", ".join(map(str, named[:_MAX_NAMED])) + (", ..." if len(named) > _MAX_NAMED else "")
    return text_table(header, rows) + (
        f"centroid of {len(motion.centroid_points)} points ({points or 'none in common'}); "
        f"displacements are against stage {motion.reference_stage}; +- is one standard deviation "
        "from the pictures' noise\n"
    )


def _speed(velocity: FloatArray, cov6: FloatArray) -> tuple[FloatArray, FloatArray]:
    """|v| and its standard deviation along v, (S,)."""
    speed = np.linalg.norm(velocity, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        along = velocity / speed[:, None]
    sigma = np.sqrt(np.einsum("ni,nij,nj->n", along, matrix_from_cov6(cov6), along))
    return speed, sigma


def _number(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if np.isfinite(value) else "-"
