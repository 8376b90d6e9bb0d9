"""Re-projection statistics, every one with its definition.

"Mean re-projection error < 0.05 px" beside "sigma0 = 0.156 px" of the same
adjustment cannot be compared: one may be a mean distance, the other a standard
deviation per coordinate that counts the redundancy. Here each number is named.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from videogrammetry.types import FloatArray, IntArray, Measurement

#: Field of :class:`ReprojectionStatistics` -> what it is. v = (vx, vy): measured - projected.
DEFINITIONS: Mapping[str, str] = {
    "rms_coordinate_px": "sqrt(sum(vx^2 + vy^2) / 2n): RMS of one image coordinate",
    "rms_distance_px": "sqrt(sum(vx^2 + vy^2) / n): RMS distance, sqrt(2) times the former",
    "mean_distance_px": "sum(sqrt(vx^2 + vy^2)) / n: mean distance",
    "median_distance_px": "half of the distances are smaller",
    "p95_distance_px": "95 % of the distances are smaller",
    "max_distance_px": "the largest distance",
    "sigma0_px": "sqrt(sum(vx^2 + vy^2) / redundancy): estimated standard deviation of one "
    "measured coordinate; the redundancy is 2n less what the unknowns have taken",
}


@dataclass(frozen=True, kw_only=True)
class ReprojectionStatistics:
    """Residuals v = measured - projected of one camera or of all; px, see ``DEFINITIONS``.

    ``count`` is n, the number of image points; ``redundancy`` the coordinates
    that are left over (NaN where it is not known, as then is ``sigma0_px``).
    """

    name: str
    count: int
    redundancy: float
    rms_coordinate_px: float
    rms_distance_px: float
    mean_distance_px: float
    median_distance_px: float
    p95_distance_px: float
    max_distance_px: float
    sigma0_px: float


def reprojection_statistics(
    residual_px: FloatArray, *, redundancy: float = float("nan"), name: str = "all"
) -> ReprojectionStatistics:
    """Statistics of residuals (N, 2); rows with NaN are left out.

    Examples
    --------
    >>> s = reprojection_statistics(np.array([[3.0, 4.0], [0.0, 0.0]]), redundancy=1.0)
    >>> s.rms_coordinate_px, s.mean_distance_px, s.sigma0_px, s.max_distance_px
    (2.5, 2.5, 5.0, 5.0)
    """
    residual = np.asarray(residual_px, dtype=float)
    if residual.ndim != 2 or residual.shape[1] != 2:
        raise ValueError(f"residual_px: expected (N, 2), got {residual.shape}")
    residual = residual[np.isfinite(residual).all(axis=1)]
    n, total = len(residual), float((residual**2).sum())
    distance = np.linalg.norm(residual, axis=1) if n else np.array([np.nan])
    return ReprojectionStatistics(
        name=name,
        count=n,
        redundancy=float(redundancy),
        rms_coordinate_px=float(np.sqrt(total / (2 * n))) if n else float("nan"),
        rms_distance_px=float(np.sqrt(total / n)) if n else float("nan"),
        mean_distance_px=float(distance.mean()),
        median_distance_px=float(np.median(distance)),
        p95_distance_px=float(np.percentile(distance, 95)),
        max_distance_px=float(distance.max()),
        sigma0_px=float(np.sqrt(total / redundancy)) if redundancy > 0 else float("nan"),
    )


def camera_statistics(
    residual_px: FloatArray, camera: IntArray, redundancy: FloatArray, names: tuple[str, ...]
) -> tuple[ReprojectionStatistics, ...]:
    """One row a camera and one of all.

    Parameters
    ----------
    residual_px : (N, 2). camera : (N,) index into ``names``.
    redundancy : (N,) each image point's share of the redundancy.
    """
    rows = [
        reprojection_statistics(
            residual_px[camera == c], redundancy=float(redundancy[camera == c].sum()), name=name
        )
        for c, name in enumerate(names)
    ]
    return (*rows, reprojection_statistics(residual_px, redundancy=float(redundancy.sum())))


def measurement_reprojection(measurement: Measurement) -> tuple[ReprojectionStatistics, ...]:
    """Statistics of the triangulated targets of a measurement, by camera and of all.

    The cameras are held: a point seen by n of them has 2n coordinates and three
    unknowns, so that each picture keeps 2 - 3/n; the unknowns of the
    calibration are not counted, they came from other pictures.
    """
    targets = measurement.targets
    used = (targets.point_id >= 0) & np.isfinite(targets.residual_px).all(axis=1)
    keys = np.stack([targets.stage[used], targets.point_id[used]], axis=1)
    _, inverse, rays = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    share = 2.0 - 3.0 / rays[inverse.reshape(-1)] if used.any() else np.empty(0)
    return camera_statistics(
        targets.residual_px[used],
        targets.camera[used],
        np.maximum(share, 0.0),
        measurement.trajectories.camera_names,
    )
