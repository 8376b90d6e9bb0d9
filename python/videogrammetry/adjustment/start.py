"""Start values: DLT, homography, space resection, search of the principal distance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from videogrammetry._core import TaskError as _TaskError
from videogrammetry._core import adjustment as _adjustment
from videogrammetry.errors import CalibrationError
from videogrammetry.types import FloatArray


def rows(array: npt.ArrayLike, columns: int, name: str) -> FloatArray:
    """The array as C-contiguous float64 rows; ValueError names what has another shape."""
    result = np.ascontiguousarray(array, dtype=np.float64)
    if result.ndim != 2 or result.shape[1] != columns:
        raise ValueError(f"{name}: expected shape (N, {columns}), got {result.shape}")
    return result


@dataclass(frozen=True, kw_only=True)
class Dlt:
    """A distortion-free camera with its orientation (see :func:`direct_linear_transform`)."""

    calibration: FloatArray
    rotation: FloatArray
    translation_mm: FloatArray
    rms_px: float


@dataclass(frozen=True, kw_only=True)
class PoseCandidate:
    """A pose cam_from_target of one picture.

    ``cost_px2``: mean of min(distance, threshold)^2 over the points;
    ``inliers``: points within the threshold.
    """

    rotation: FloatArray
    translation_mm: FloatArray
    cost_px2: float
    inliers: int


def direct_linear_transform(points_mm: npt.ArrayLike, pixels: npt.ArrayLike) -> Dlt:
    """DLT of >= 6 non-coplanar points (N, 3) mm and pictures (N, 2) px into K, R, t.

    Raises
    ------
    CalibrationError : coplanar points, or a mirrored solution.
    ValueError : fewer than six points.

    References
    ----------
    Abdel-Aziz & Karara 1971; Hartley & Zisserman, Alg. 7.1.

    Examples
    --------
    >>> points = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    >>> in_cam = points + [0.2, -0.3, 5.0]
    >>> dlt = direct_linear_transform(points, 1000 * in_cam[:, :2] / in_cam[:, 2:])
    >>> bool(np.allclose(dlt.calibration, np.diag([1000.0, 1000.0, 1.0]), atol=1e-6))
    True
    """
    try:
        k, rotation, translation, rms = _adjustment.dlt(
            rows(points_mm, 3, "points_mm"), rows(pixels, 2, "pixels")
        )
    except _TaskError as error:
        raise CalibrationError(str(error)) from error
    return Dlt(calibration=k, rotation=rotation, translation_mm=translation, rms_px=rms)


def resect(
    camera: Any,
    points_mm: npt.ArrayLike,
    pixels: npt.ArrayLike,
    *,
    threshold_px: float = 10.0,
    num_samples: int = 60,
) -> list[PoseCandidate]:
    """Poses of one picture of a camera (``camera_model``) with known interior orientation.

    Robust against wrong numbers (points further than ``threshold_px``). At
    most two poses, the better first: of a flat target in a narrow field its
    mirrored twin fits as well. Empty if no pose has four inliers.
    """
    found = _adjustment.resect(
        camera,
        rows(points_mm, 3, "points_mm"),
        rows(pixels, 2, "pixels"),
        threshold_px,
        num_samples,
    )
    return [
        PoseCandidate(rotation=r, translation_mm=t, cost_px2=cost, inliers=inliers)
        for r, t, cost, inliers in found
    ]


def search_focal(
    camera: Any,
    points_mm: Sequence[npt.ArrayLike],
    pixels: Sequence[npt.ArrayLike],
    *,
    threshold_px: float,
) -> tuple[float, float, float]:
    """Principal distance without a start value: (f_px, robust rms_px, contrast).

    ``contrast`` is the cost at half or twice f over that at f: near 1, the
    pictures say little about f.

    Raises
    ------
    CalibrationError : no picture fits at any f.
    """
    try:
        f_px, rms_px, contrast = _adjustment.search_focal(
            camera,
            [rows(p, 3, "points_mm") for p in points_mm],
            [rows(p, 2, "pixels") for p in pixels],
            threshold_px,
        )
    except _TaskError as error:
        raise CalibrationError(str(error)) from error
    return float(f_px), float(rms_px), float(contrast)


def principal_extents(points_mm: npt.ArrayLike) -> FloatArray:
    """Extents along the principal axes over the largest, descending; the third of a plane is 0.

    Examples
    --------
    >>> principal_extents([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.0]]).round(3).tolist()
    [1.0, 1.0, 0.0]
    """
    result: FloatArray = _adjustment.principal_extents(rows(points_mm, 3, "points_mm"))
    return result
