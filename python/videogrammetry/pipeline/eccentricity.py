"""What a measurement says of its circles: corrected or not, and why."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from videogrammetry.types import FloatArray, RigCamera, StagePoints, Targets


def possible_eccentricity(camera: RigCamera, targets: Targets) -> FloatArray:
    """(N, 3) covariance (xx, xy, yy) of the unknown eccentricity of circles not yet matched.

    A circle whose picture has the semi-major axis a lies at most a^2 / (2 f) from
    the ellipse's centre on the axis (sin t cos t = 1/2); which way, one picture
    does not say. Taken as a standard deviation per axis, it keeps the rays of large
    circles near the camera within the gate.
    """
    bound = targets.semi_axes_px[:, 0] ** 2 / (2 * camera.interior[0])
    return np.stack([bound**2, 0 * bound, bound**2], axis=1)


def circle_summary(points: Sequence[StagePoints]) -> dict[str, Any] | None:
    """Counts of corrected points and the largest eccentricity; None where none was asked for."""
    asked = [p.eccentricity_px for p in points if p.eccentricity_px is not None]
    if not asked:
        return None
    values = np.concatenate(asked)
    corrected = np.isfinite(values)
    return {
        "corrected": int(corrected.sum()),
        "not_corrected": int((~corrected).sum()),
        "largest_px": float(values[corrected].max()) if corrected.any() else 0.0,
    }


def circle_remarks(
    points: Sequence[StagePoints], diameter_mm: float | None, without_normal: int
) -> list[str]:
    """A sentence for points that could not be corrected, or not be moved by the thickness."""
    remarks = []
    summary = circle_summary(points)
    if diameter_mm is not None and summary is not None and summary["not_corrected"]:
        total = summary["corrected"] + summary["not_corrected"]
        remarks.append(
            f"{summary['not_corrected']} of {total} positions are not corrected for the "
            "eccentricity of their ellipses: no ellipse said how the circle is turned"
        )
    if without_normal:
        remarks.append(
            f"{without_normal} positions are left out: [targets] thickness_mm moves points along "
            "their normals, and no ellipse said how the circle is turned"
        )
    return remarks
