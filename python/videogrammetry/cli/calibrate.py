"""``videogrammetry calibrate``: project -> rig.json, rig.npz and a report."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from videogrammetry.calibration.run import CalibrationRun
from videogrammetry.cli.common import SubParsers, UsageError, add_force, add_verb, text_table
from videogrammetry.cli.progress import Progress
from videogrammetry.project import (
    Project,
    read_project,
    refuse_overwrite,
    write_rig,
    write_text,
)

METHODS = ("joint", "mean")


def add_parser(verbs: SubParsers) -> None:
    """The verb's arguments."""
    parser = add_verb(
        verbs,
        "calibrate",
        run,
        help="calibrate the cameras from pictures of a known target",
        description="Writes rig.json with rig.npz and a report beside it; prints a summary.",
        example="videogrammetry calibrate project.toml",
    )
    parser.add_argument("project", type=Path, metavar="PROJECT", help="project.toml or its folder")
    parser.add_argument(
        "--method",
        choices=METHODS,
        default="joint",
        help="joint: one pose a target position for all cameras; mean: each camera by itself, "
        "relative poses averaged (default: %(default)s)",
    )
    parser.add_argument(
        "--out", type=Path, metavar="FILE", help="rig file (default: rig.json beside the project)"
    )
    parser.add_argument(
        "--reorient",
        metavar="CAMERA",
        help="find the pose anew of a camera that has moved, from [stability] points in its "
        "sequence; the rest of rig.json stays (written to --out, or over it with --force)",
    )
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    """Calibrates and writes rig, covariance and report."""
    if args.out is not None and args.out.suffix != ".json":
        raise UsageError(f"--out: expected a name ending in .json, got {args.out}")
    project = read_project(args.project)
    if args.reorient is not None:
        return _reorient(project, args)
    rig_path: Path = args.out or project.rig_path
    report_path = report_path_of(rig_path)
    for path in (rig_path, rig_path.with_suffix(".npz"), report_path):
        refuse_overwrite(path, args.force)

    from videogrammetry.pipeline import calibrate_project
    from videogrammetry.pipeline.calibrate import calibration_pictures
    from videogrammetry.report import calibration_report

    progress = Progress("calibrate")
    try:
        result: CalibrationRun = calibrate_project(project, method=args.method, progress=progress)
    finally:
        progress.close()
    page = calibration_report(result, project.name, calibration_pictures(project))
    write_rig(rig_path, result.rig)
    write_text(report_path, page)
    for warning in result.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    print(summary(result), end="")
    print(f"wrote {rig_path} and {report_path}", file=sys.stderr)
    return 0


def _reorient(project: Project, args: argparse.Namespace) -> int:
    """Writes the rig with one camera's new pose."""
    rig_path: Path = args.out or project.rig_path
    for path in (rig_path, rig_path.with_suffix(".npz")):
        refuse_overwrite(path, args.force)

    from videogrammetry.pipeline.reorient import reorient_project

    progress = Progress("reorient")
    try:
        found = reorient_project(project, project.rig_path, args.reorient, progress=progress)
    finally:
        progress.close()
    write_rig(rig_path, found.rig)
    sigma = np.sqrt(np.diag(found.cov))
    turn, shift = 1e3 * np.linalg.norm(found.turn_rad), np.linalg.norm(found.shift_mm)
    print(
        f"camera {args.reorient}: turned by {turn:.4f} mrad (+- "
        f"{1e3 * np.linalg.norm(sigma[:3]):.4f}), moved by {shift:.3f} mm; "
        f"{found.significance:.1f} standard deviations of the six; {int(found.used.sum())} of "
        f"{len(found.used)} points, RMS {found.rms_px:.4f} px"
    )
    print(f"wrote {rig_path}", file=sys.stderr)
    return 0


def report_path_of(rig_path: Path) -> Path:
    """Where the report lies: beside the rig.

    Examples
    --------
    >>> report_path_of(Path("rig.json")).name
    'rig-report.html'
    """
    return rig_path.with_name(f"{rig_path.stem}-report.html")


def summary(result: CalibrationRun) -> str:
    """Table of the cameras and a line of totals."""
    rows = []
    first = result.rig.cameras[result.camera_names[0]]
    used = result.observations.used
    for index, name in enumerate(result.camera_names):
        camera = result.rig.cameras[name]
        mine = used & (result.observations.camera == index)
        pictures = len(np.unique(result.observations.stage[mine]))
        baseline = np.linalg.norm(camera.centre_mm - first.centre_mm)
        sigma = camera.sigma.get("f")
        floor = result.rig.sigma_floor_px.get(name)
        rows.append(
            [
                name,
                str(pictures),
                str(int(mine.sum())),
                f"{result.camera_rms_px[name]:.4f}",
                "" if floor is None else f"{floor:.4f}",
                f"{camera.interior[0]:.2f}",
                "" if sigma is None else f"{sigma:.2f}",
                f"{baseline:.2f}",
            ]
        )
    header = ["camera", "pictures", "points", "RMS px", "floor px"]
    header += ["f px", "sigma f", "baseline mm"]
    total = (
        f"{result.method}: sigma0 {result.sigma0:.3f}, RMS {result.rms_px:.4f} px, "
        f"{result.num_observations} observations, {result.num_unknowns} unknowns, "
        f"redundancy {result.redundancy}, {int((~used).sum())} points rejected, "
        f"{result.seconds:.1f} s\n"
    )
    if (more := result.additional) is not None:
        total += (
            f"beside the target: {len(more)} free points ({more.mode}) in "
            f"{len(more.observations)} image points, {int((~more.observations.used).sum())} of "
            "them rejected\n"
        )
    return text_table(header, rows) + total
