"""The real panel end to end: calibrate on five stereo pairs, measure five others, judge.

    python bench/accuracy/panel.py [DATA]

DATA is the folder that holds ``aicon-panel`` (default: ../shared/data or
$VIDEOGRAMMETRY_DATA). Prints one table with ``joint`` and ``mean`` side by side:
re-projection, baseline, the measured points against the panel's points.csv
after best fit (rotation and translation only), the scale that a similarity
would find, the errors over their predicted sigmas, and every measured point
that stands at no known place.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from videogrammetry.pipeline import calibrate_project, measure_project
from videogrammetry.project import read_points, read_project
from videogrammetry.tracking.link import fit_rigid
from videogrammetry.types import matrix_from_cov6

REFERENCE_SIGMA_MM = 0.02  # of points.csv
BASELINE_MM = 591.23
KNOWN_PLACE_MM = 2.0  # far above every error here, far below the dots' spacing of 40 mm
LARGEST_CODE = 516

PROJECT = """schema = 1
name = "hand-held panel"

[cameras.left]
calibration = "{pictures}/left_00{{05,09,13,17,21}}.tif"
sequence = "{pictures}/left_00{{07,11,15,19,23}}.tif"

[cameras.right]
calibration = "{pictures}/right_00{{05,09,13,17,21}}.tif"
sequence = "{pictures}/right_00{{07,11,15,19,23}}.tif"

[calibration]
target = "{pictures}/points.csv"
sigma_mm = 0.02
"""


def default_data() -> Path:
    """The folder of the real pictures."""
    return Path(
        os.environ.get("VIDEOGRAMMETRY_DATA", Path(__file__).parents[3] / "shared" / "data")
    ).resolve()


def write_project(folder: Path, data: Path) -> Path:
    """project.toml of the panel in ``folder``."""
    path = folder / "project.toml"
    path.write_text(PROJECT.format(pictures=(data / "aicon-panel").as_posix()))
    return path


@dataclass
class StageErrors:
    """Measured minus known, in the panel's frame, with the predicted covariance."""

    id: np.ndarray
    known_id: np.ndarray
    error_mm: np.ndarray
    cov_mm2: np.ndarray
    scale: float
    strangers: list


def judge_stage(ids, position, cov, known) -> StageErrors:
    """Best fit of one stage to the known points; un-coded by the nearest known place."""
    row_of = {int(i): k for k, i in enumerate(known.id)}
    coded = np.array([i <= LARGEST_CODE and int(i) in row_of for i in ids])
    known_row = np.array([row_of.get(int(i), -1) if c else -1 for i, c in zip(ids, coded)])
    rotation, translation, _ = fit_rigid(known.position_mm[known_row[coded]], position[coded])
    loose_known = np.flatnonzero(known.id > LARGEST_CODE)
    tree = cKDTree(known.position_mm[loose_known])
    placed = position @ rotation.T + translation
    distance, nearest = tree.query(placed)
    loose = ids > LARGEST_CODE
    at_place = loose & (distance < KNOWN_PLACE_MM)
    known_row[at_place] = loose_known[nearest[at_place]]
    used = known_row >= 0
    strangers = [(int(i), placed[k].round(2).tolist()) for k, i in enumerate(ids) if not used[k]]
    a, b = known.position_mm[known_row[used]], position[used]
    rotation, translation, _ = fit_rigid(a, b)
    spread = [np.linalg.norm(x - x.mean(axis=0)) for x in (a, b)]
    return StageErrors(
        id=ids[used],
        known_id=known.id[known_row[used]],
        error_mm=b @ rotation.T + translation - a,
        cov_mm2=rotation @ cov[used] @ rotation.T,
        scale=spread[1] / spread[0] - 1,
        strangers=strangers,
    )


def rms3(error):
    return float(np.sqrt((error**2).sum(axis=1).mean())) if len(error) else float("nan")


def judge(measurement, known) -> dict:
    """The figures of one measurement."""
    table = measurement.trajectories
    stages = []
    for s in range(len(table.stage)):
        here = np.isfinite(table.position_mm[s, :, 0])
        cov = matrix_from_cov6(table.cov_mm2[s, here])
        stages.append(judge_stage(table.point_id[here], table.position_mm[s, here], cov, known))
    error = np.concatenate([x.error_mm for x in stages])
    cov = np.concatenate([x.cov_mm2 for x in stages]) + REFERENCE_SIGMA_MM**2 * np.eye(3)
    ids = np.concatenate([x.id for x in stages])
    coded = ids <= LARGEST_CODE
    normalised = error / np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
    mahalanobis = np.einsum("ni,nij,nj->n", error, np.linalg.inv(cov), error) / 3
    wrong = [
        (int(s), int(i), int(k))
        for s, x in zip(table.stage, stages)
        for i, k in zip(x.id, x.known_id)
        if i <= LARGEST_CODE and i != k
    ]
    moved = {}
    for x in stages:
        for i, k in zip(x.id.tolist(), x.known_id.tolist()):
            moved.setdefault(i, set()).add(k)
    return {
        "points_coded": int(coded.sum()),
        "points_uncoded": int((~coded).sum()),
        "rms_axis_mm": np.sqrt((error**2).mean(axis=0)).round(4).tolist(),
        "rms_3d_coded_mm": rms3(error[coded]),
        "rms_3d_uncoded_mm": rms3(error[~coded]),
        "rms_3d_mm": rms3(error),
        "largest_mm": float(np.linalg.norm(error, axis=1).max()),
        "scale": float(np.mean([x.scale for x in stages])),
        "scale_per_stage": [float(x.scale) for x in stages],
        "normalised_rms": float(np.sqrt((normalised**2).mean())),
        "normalised_rms_axis": np.sqrt((normalised**2).mean(axis=0)).round(3).tolist(),
        "mahalanobis_rms": float(np.sqrt(mahalanobis.mean())),
        "reprojection_rms_px": float(np.sqrt(np.nanmean(measurement.targets.residual_px**2))),
        "strangers": [(int(s), *x) for s, r in zip(table.stage, stages) for x in r.strangers],
        "wrong_ids": wrong,
        "numbers_on_two_places": {i: sorted(k) for i, k in moved.items() if len(k) > 1},
    }


def run(method: str, project_path: Path) -> dict:
    """Calibrate and measure with one method."""
    project = read_project(project_path)
    known = read_points(project.calibration.target)
    start = time.perf_counter()
    calibration = calibrate_project(project, method=method)
    middle = time.perf_counter()
    measurement = measure_project(project, rig=calibration.rig)
    end = time.perf_counter()
    right = calibration.rig.cameras["right"]
    left = calibration.rig.cameras["left"]
    centres = [-c.rotation.T @ c.translation_mm for c in (left, right)]
    result = {
        "method": method,
        "calibration_rms_px": calibration.rms_px,
        "sigma0": calibration.sigma0,
        "sigma_floor_px": dict(calibration.rig.sigma_floor_px),
        "f_px": {n: float(c.interior[0]) for n, c in calibration.rig.cameras.items()},
        "parameters": {n: list(p) for n, p in calibration.parameters_kept.items()},
        "observations": calibration.num_observations,
        "rejected": [(r.kind, r.camera, r.image, r.point_id, r.reason) for r in calibration.rejected],
        "calibration_warnings": list(calibration.warnings),
        "baseline_mm": float(np.linalg.norm(centres[1] - centres[0])),
        "seconds": [middle - start, end - middle],
        "match_status": {},
    }
    result.update(judge(measurement, known))
    return result


ROWS = (
    ("re-projection RMS of the calibration, px", "calibration_rms_px", "<= 0.06"),
    ("re-projection RMS of the measured stages, px", "reprojection_rms_px", "<= 0.06"),
    ("baseline, mm", "baseline_mm", "591.23 +- 0.25"),
    ("measured coded points", "points_coded", ""),
    ("measured un-coded points", "points_uncoded", ""),
    ("3-D RMS coded, mm", "rms_3d_coded_mm", "<= 0.05"),
    ("3-D RMS un-coded, mm", "rms_3d_uncoded_mm", "<= 0.05"),
    ("3-D RMS all, mm", "rms_3d_mm", "<= 0.05"),
    ("largest 3-D error, mm", "largest_mm", ""),
    ("scale - 1", "scale", "|.| <= 5e-5"),
    ("normalised errors, RMS per axis value", "normalised_rms", "0.8 ... 1.3"),
    ("normalised errors, RMS with correlations", "mahalanobis_rms", ""),
)


def print_table(results: list[dict]) -> None:
    """The table for docs/verification.md."""
    print(f"{'':46} {'bar':>15} " + " ".join(f"{r['method']:>12}" for r in results))
    for title, key, bar in ROWS:
        cells = []
        for r in results:
            value = r[key]
            cells.append(f"{value:12d}" if isinstance(value, int) else f"{value:12.3g}" if
                         abs(value) < 1e-3 else f"{value:12.4f}")
        print(f"{title:46} {bar:>15} " + " ".join(cells))
    for r in results:
        print(f"\n{r['method']}: RMS per axis {r['rms_axis_mm']} mm, normalised per axis "
              f"{r['normalised_rms_axis']}; floors {r['sigma_floor_px']} px; parameters "
              f"{r['parameters']}; {r['seconds'][0]:.1f} s calibrating, {r['seconds'][1]:.1f} s "
              "measuring")
        print(f"  wrong IDs: {r['wrong_ids'] or 'none'}; numbers that moved between places: "
              f"{r['numbers_on_two_places'] or 'none'}")
        print(f"  points at no known place: {r['strangers'] or 'none'}")
        print(f"  rejected in the calibration: {len(r['rejected'])}")
        for item in r["rejected"]:
            print("   ", *item)
        for warning in r["calibration_warnings"]:
            print("  warning:", warning)


def main() -> None:
    data = Path(sys.argv[1]).resolve() if len(sys.argv) > 1 else default_data()
    if not (data / "aicon-panel").is_dir():
        sys.exit(f"{data}: no folder aicon-panel here; give the folder of the real pictures")
    with tempfile.TemporaryDirectory() as folder:
        path = write_project(Path(folder), data)
        results = [run(method, path) for method in ("joint", "mean")]
    print_table(results)
    out = Path(__file__).parents[1] / "results"
    out.mkdir(exist_ok=True)
    (out / "panel.json").write_text(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
