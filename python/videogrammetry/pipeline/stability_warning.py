"""What is said of a camera that has moved: in words, and in numbers for the provenance."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from videogrammetry.reconstruction.stability import PoseChange
from videogrammetry.types import FloatArray


def change_in_numbers(cameras: list[str], change: PoseChange, by: str) -> dict[str, Any]:
    """A change as the provenance keeps it."""
    return {
        "cameras": cameras,
        "by": by,
        "since": change.since,
        "after_stage": change.after,
        "stage": change.stage,
        "found_at_stage": change.found,
        "turn_mrad": (1e3 * change.turn_rad).tolist(),
        "sigma_turn_mrad": (1e3 * change.sigma_turn_rad).tolist(),
        "shift_mm": change.shift_mm.tolist(),
        "sigma_shift_mm": [None if np.isnan(s) else s for s in change.sigma_shift_mm.tolist()],
        "parameters": change.parameters,
        "chi2": change.chi2,
        "critical_chi2": change.critical,
    }


def change_in_words(
    cameras: Sequence[str], change: PoseChange, by: str, calibrated: bool, reoriented: bool
) -> str:
    """A change as the user reads it.

    Parameters
    ----------
    cameras : names, the likeliest first. by : what shows it. calibrated : with the
        calibration's covariance. reoriented : since a pose was found anew.
    """
    quoted = [f"{name!r}" for name in cameras]
    if len(cameras) > 1:
        who = f"camera {quoted[0]} or {', '.join(quoted[1:])} (their rays do not tell which)"
    else:
        who = f"camera {quoted[0]}"
    if change.since == "calibration":
        basis = "the reorientation" if reoriented else "the calibration"
        when = f"since {basis}, or this holds less well than it says"
    else:
        when = f"between the stages {change.after} and {change.stage}"
    turn = 1e3 * np.linalg.norm(change.turn_rad)
    size = f"turned by {turn:.3f} mrad ({_along(1e3 * change.turn_rad, change.sigma_turn_rad)})"
    if np.isfinite(change.sigma_shift_mm).all():
        shift = float(np.linalg.norm(change.shift_mm))
        size += (
            f" and shifted by {shift:.3f} mm "
            f"(+- {float(np.linalg.norm(change.sigma_shift_mm)):.3f})"
        )
    alone = "" if calibrated else "; without the calibration's covariance"
    begin = change.after + 1
    stage = f":{begin}" if change.since == "sequence" else ""
    return (
        f"{who} has moved {when}: {size}, by {by}, chi-square {change.chi2:.0f} where "
        f"{change.critical:.0f} is not exceeded by chance in one of 1000 measurements{alone}. "
        f"Points that it sees are flagged unstable_camera from stage {max(begin, 1)} on: measure "
        f"again with --reorient {cameras[0]}{stage}, or calibrate again"
    )


def _along(turn_mrad: FloatArray, sigma_rad: FloatArray) -> str:
    """Standard deviation of a turn's size, those of its parts taken as independent."""
    length = float(np.linalg.norm(turn_mrad))
    unit = turn_mrad / length if length else np.full(3, 3**-0.5)
    return f"+- {1e3 * float(np.linalg.norm(unit * sigma_rad)):.3f}"
