"""``videogrammetry measure``: project -> measurement.h5."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from videogrammetry.cli.common import SubParsers, add_force, add_verb, text_table
from videogrammetry.cli.progress import Progress
from videogrammetry.matching import TARGET_STATUS
from videogrammetry.project import read_project, refuse_overwrite, write_measurement
from videogrammetry.types import Measurement


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
        measurement = measure_project(project, progress=progress)
    finally:
        progress.close()
    write_measurement(project.measurement_path, measurement)
    for warning in measurement.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    print(summary(measurement), end="")
    print(f"wrote {project.measurement_path}", file=sys.stderr)
    return 0


def summary(measurement: Measurement) -> str:
    """Table of the stages, and what became of the targets."""
    table, targets = measurement.trajectories, measurement.targets
    there = np.isfinite(table.position_mm[..., 0])
    sigma = np.sqrt(table.cov_mm2[..., [0, 3, 5]].sum(axis=2))
    rows = []
    for s, stage in enumerate(table.stage.tolist()):
        moved = measurement.motion.centroid_displacement_mm[s]
        rows.append(
            [
                str(stage),
                str(int((targets.stage == stage).sum())),
                str(int(there[s].sum())),
                f"{np.nanmedian(table.rms_px[s]):.4f}" if there[s].any() else "-",
                f"{np.nanmedian(sigma[s]):.4f}" if there[s].any() else "-",
                *(f"{v:.3f}" if np.isfinite(v) else "-" for v in moved),
            ]
        )
    header = ["stage", "targets", "points", "RMS px", "sigma mm"]
    header += ["centroid dx mm", "dy mm", "dz mm"]
    counts = ", ".join(
        f"{int((targets.match_status == code).sum())} {name}"
        for code, name in enumerate(TARGET_STATUS)
    )
    everywhere = int(there.all(axis=0).sum())
    return text_table(header, rows) + (
        f"{there.shape[1]} points, {everywhere} of them in every stage; targets: {counts}\n"
    )
