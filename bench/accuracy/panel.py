"""The real panel end to end: calibrate on five stereo pairs, measure five others, judge.

    python bench/accuracy/panel.py [DATA] [--recognition edge-pair --estimator model]

DATA is the folder that holds ``aicon-panel`` (default: ../shared/data or
$VIDEOGRAMMETRY_DATA). Prints one table with ``joint`` and ``mean`` side by side:
re-projection, baseline, the measured points against the panel's points.csv
after best fit (rotation and translation only), the scale that a similarity
would find, the errors over their predicted sigmas, and every measured point
that stands at no known place.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from videogrammetry.geometry import fit_rigid
from videogrammetry.pipeline import calibrate_project, measure_project
from videogrammetry.project import read_measurement, read_points, read_project, read_rig
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

[targets]
method = "{method}"
estimator = "{estimator}"
"""


def default_data() -> Path:
    """The folder of the real pictures."""
    return Path(
        os.environ.get("VIDEOGRAMMETRY_DATA", Path(__file__).parents[3] / "shared" / "data")
    ).resolve()


def write_project(
    folder: Path, data: Path, recognition: str = "edge-pair", estimator: str = "auto"
) -> Path:
    """project.toml of the panel in ``folder``."""
    path = folder / "project.toml"
    pictures = (data / "aicon-panel").as_posix()
    path.write_text(PROJECT.format(pictures=pictures, method=recognition, estimator=estimator))
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
    """Best fit of one stage to the known points; un-coded by the nearest known place.

    That may be a coded point's, where its ring was hidden.
    """
    row_of = {int(i): k for k, i in enumerate(known.id)}
    coded = np.array([i <= LARGEST_CODE and int(i) in row_of for i in ids])
    known_row = np.array(
        [row_of.get(int(i), -1) if c else -1 for i, c in zip(ids, coded, strict=False)]
    )
    rotation, translation, _ = fit_rigid(known.position_mm[known_row[coded]], position[coded])
    placed = position @ rotation.T + translation
    distance, nearest = cKDTree(known.position_mm).query(placed)
    at_place = (ids > LARGEST_CODE) & (distance < KNOWN_PLACE_MM)
    known_row[at_place] = nearest[at_place]
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


def strangers(stages, numbers, known) -> list[str]:
    """Every point at no known place, with what tells what it is."""
    lines = []
    plane = known.position_mm[np.abs(known.position_mm[:, 2]) < 5]
    for number, stage in zip(numbers, stages, strict=False):
        for i, place in stage.strangers:
            gap = np.linalg.norm(plane - place, axis=1).min()
            lines.append(
                f"stage {number}, point {i} at {place} mm: {abs(place[2]):.2f} mm off the panel's "
                f"plane, {gap:.0f} mm from the nearest listed point"
            )
    return lines


def reference_sigma(stages) -> np.ndarray:
    """Standard deviation of points.csv per axis, from points measured at several stages.

    Variance components: the mean of a point's errors over its stages holds the
    reference's own error, their scatter holds the measurement's alone.
    """
    errors = {}
    for stage in stages:
        for i, e in zip(stage.known_id.tolist(), stage.error_mm, strict=False):
            errors.setdefault(i, []).append(e)
    repeated = [np.array(e) for e in errors.values() if len(e) > 1]
    within = sum(((e - e.mean(axis=0)) ** 2).sum(axis=0) for e in repeated)
    within = within / sum(len(e) - 1 for e in repeated)
    between = np.mean([e.mean(axis=0) ** 2 - within / len(e) for e in repeated], axis=0)
    return np.sqrt(np.maximum(between, 0))


def normalised_with(stages, sigma) -> float:
    """RMS of error / predicted sigma with the reference's standard deviation per axis."""
    error = np.concatenate([x.error_mm for x in stages])
    variance = np.concatenate([np.diagonal(x.cov_mm2, axis1=1, axis2=2) for x in stages])
    return float(np.sqrt((error**2 / (variance + sigma**2)).mean()))


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
    wrong = [
        (int(s), int(i), int(k))
        for s, x in zip(table.stage, stages, strict=False)
        for i, k in zip(x.id, x.known_id, strict=False)
        if i <= LARGEST_CODE and i != k
    ]
    moved, named = {}, {}
    for x in stages:
        for i, k in zip(x.id.tolist(), x.known_id.tolist(), strict=False):
            moved.setdefault(i, set()).add(k)
            named.setdefault(k, set()).add(i)
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
        "reprojection_rms_px": float(np.sqrt(np.nanmean(measurement.targets.residual_px**2))),
        "strangers": strangers(stages, table.stage, known),
        "reference_sigma_mm": reference_sigma(stages).round(4).tolist(),
        "normalised_rms_own_reference": normalised_with(stages, reference_sigma(stages)),
        "wrong_ids": wrong,
        "places_with_two_numbers": {k: sorted(i) for k, i in named.items() if len(i) > 1},
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
        "rejected": [
            (r.kind, r.camera, r.image, r.point_id, r.reason) for r in calibration.rejected
        ],
        "calibration_warnings": list(calibration.warnings),
        "baseline_mm": float(np.linalg.norm(centres[1] - centres[0])),
        "seconds": [middle - start, end - middle],
        "match_status": {},
    }
    result.update(judge(measurement, known))
    return result


ROWS = (
    ("sigma0 of the calibration", "sigma0", "1"),
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
    ("the same with points.csv's own sigma, below", "normalised_rms_own_reference", "0.8 ... 1.3"),
)


def cell(value) -> str:
    """A number in twelve characters."""
    if isinstance(value, int):
        return f"{value:12d}"
    return f"{value:12.3g}" if abs(value) < 1e-3 else f"{value:12.4f}"


def print_table(results: list[dict]) -> None:
    """The table for docs/verification.md."""
    print(f"{'':46} {'bar':>15} " + " ".join(f"{r['method']:>12}" for r in results))
    for title, key, bar in ROWS:
        print(f"{title:46} {bar:>15} " + " ".join(cell(r[key]) for r in results))
    for r in results:
        print(
            f"\n{r['method']}: RMS per axis {r['rms_axis_mm']} mm, normalised per axis "
            f"{r['normalised_rms_axis']}; floors {r['sigma_floor_px']} px; parameters "
            f"{r['parameters']}; {r['seconds'][0]:.1f} s calibrating, {r['seconds'][1]:.1f} s "
            "measuring"
        )
        print(
            f"  wrong IDs: {r['wrong_ids'] or 'none'}; numbers that moved between places: "
            f"{r['numbers_on_two_places'] or 'none'}; places with two numbers: "
            f"{r['places_with_two_numbers'] or 'none'}"
        )
        print(f"  standard deviation of points.csv, from repeats: {r['reference_sigma_mm']} mm")
        print("  points at no known place:", *(r["strangers"] or ["none"]), sep="\n    ")
        print(f"  rejected in the calibration: {len(r['rejected'])}, the first of them:")
        for item in r["rejected"][:8]:
            print("   ", *(x for x in item if x is not None))
        for warning in r["calibration_warnings"]:
            print("  warning:", warning)


def judge_folder(folder: Path) -> None:
    """The figures of a project that the command has calibrated and measured."""
    known = read_points(read_project(folder).calibration.target)
    rig = read_rig(folder / "rig.json")
    result = judge(read_measurement(folder / "measurement.h5"), known)
    centres = [-c.rotation.T @ c.translation_mm for c in rig.cameras.values()]
    result["baseline_mm"] = float(np.linalg.norm(centres[1] - centres[0]))
    print(f"{'measured against the panel known from elsewhere':46} {'asked for':>15}")
    for title, key, bar in ROWS:
        if key in result:
            print(f"{title:46} {bar:>15} {cell(result[key])}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("data", nargs="?", type=Path, default=default_data())
    parser.add_argument("--write-project", type=Path, metavar="DIR", help="only write the project")
    parser.add_argument("--judge", type=Path, metavar="DIR", help="only judge a finished project")
    parser.add_argument("--recognition", default="edge-pair", choices=("local-canny", "edge-pair"))
    parser.add_argument(
        "--estimator", default="auto", choices=("auto", "mean-gradient", "dual-conic", "model")
    )
    args = parser.parse_args()
    if args.judge:
        judge_folder(args.judge)
        return
    data = args.data.resolve()
    if not (data / "aicon-panel").is_dir():
        sys.exit(f"{data}: no folder aicon-panel here; give the folder of the real pictures")
    if args.write_project:
        print(write_project(args.write_project, data, args.recognition, args.estimator))
        return
    with tempfile.TemporaryDirectory() as folder:
        path = write_project(Path(folder), data, args.recognition, args.estimator)
        results = [run(method, path) for method in ("joint", "mean")]
    print_table(results)
    out = Path(__file__).parents[1] / "results"
    out.mkdir(exist_ok=True)
    (out / "panel.json").write_text(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
