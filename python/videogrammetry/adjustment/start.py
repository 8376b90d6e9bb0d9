"""Start values: DLT, resection, relative orientation, search of the principal distance."""

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


@dataclass(frozen=True, kw_only=True)
class RelativeCandidate:
    """A motion b_from_a between two pictures, the baseline of length 1.

    Attributes
    ----------
    rotation : (3, 3); translation : (3,), of unit length.
    cost_px2 : mean of min(distance, threshold)^2, distances from the epipolar lines.
    inlier : (N,) pairs within the threshold whose rays meet before both cameras.
    convergence_rad : median angle between the inliers' rays.
    """

    rotation: FloatArray
    translation: FloatArray
    cost_px2: float
    inlier: npt.NDArray[np.bool_]
    convergence_rad: float


@dataclass(frozen=True, kw_only=True)
class RelativeOrientation:
    """What two pictures alone say of their motion (see :func:`relative_orientation`).

    Attributes
    ----------
    candidates : at most two, the better first; two where both fit (a plane), none
        without a baseline.
    rotation : (3, 3) of the rotation alone that fits best.
    parallax : what it leaves over the points' noise; near 1 there is no baseline.
    has_baseline : parallax of at least 3.
    """

    candidates: tuple[RelativeCandidate, ...]
    rotation: FloatArray
    parallax: float
    has_baseline: bool


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


def relative_orientation(
    camera_a: Any,
    pixels_a: npt.ArrayLike,
    camera_b: Any,
    pixels_b: npt.ArrayLike,
    *,
    threshold_px: float = 2.0,
    max_samples: int = 600,
    seed: int = 1,
) -> RelativeOrientation:
    """Relative orientation of two pictures of cameras (``camera_model``) of known interior.

    Five points [1]_, [2]_ in a random sampler with a fixed seed, judged by the mean
    of min(e, ``threshold_px``)^2, e = b'E a over the length of its gradient (the
    distance from the epipolar lines, px); then least squares over rotation and
    direction of the baseline. Points in one plane allow two motions: both are given.

    Parameters
    ----------
    camera_a, camera_b : of ``geometry.camera_model``.
    pixels_a, pixels_b : (N, 2) px, a row a point; up to half of the rows may be wrong.
    threshold_px : further from the epipolar line a pair counts as wrong.
    max_samples : fives that are drawn at most.
    seed : of the draws.

    Raises
    ------
    ValueError : unequal counts or other shapes.

    References
    ----------
    .. [1] D. Nister, An efficient solution to the five-point relative pose problem,
       IEEE PAMI 26 (2004).
    .. [2] H. Stewenius, C. Engels, D. Nister, Recent developments on direct relative
       orientation, ISPRS J. 60 (2006).

    Examples
    --------
    >>> from videogrammetry.geometry import camera_model
    >>> from videogrammetry.types import RigCamera
    >>> camera = camera_model(RigCamera(
    ...     image_size_px=(1001, 1001), interior=np.r_[1000.0, np.zeros(9)],
    ...     r0_px=400.0, rotation=np.eye(3), translation_mm=np.zeros(3)))
    >>> points = np.random.default_rng(1).uniform(-1, 1, (20, 3)) + [0, 0, 5]
    >>> moved = points - [1.0, 0, 0]
    >>> found = relative_orientation(camera, 500 + 1000 * points[:, :2] / points[:, 2:],
    ...                              camera, 500 + 1000 * moved[:, :2] / moved[:, 2:])
    >>> np.abs(found.candidates[0].translation.round(6)).tolist()
    [1.0, 0.0, 0.0]
    """
    candidates, rotation, parallax, has_baseline = _adjustment.relative_orientation(
        camera_a,
        rows(pixels_a, 2, "pixels_a"),
        camera_b,
        rows(pixels_b, 2, "pixels_b"),
        threshold_px,
        max_samples,
        seed,
    )
    return RelativeOrientation(
        candidates=tuple(
            RelativeCandidate(
                rotation=r,
                translation=t,
                cost_px2=cost,
                inlier=np.array(inlier, dtype=bool),
                convergence_rad=angle,
            )
            for r, t, cost, inlier, angle in candidates
        ),
        rotation=rotation,
        parallax=float(parallax),
        has_baseline=bool(has_baseline),
    )


def principal_extents(points_mm: npt.ArrayLike) -> FloatArray:
    """Extents along the principal axes over the largest, descending; the third of a plane is 0.

    Examples
    --------
    >>> principal_extents([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.0]]).round(3).tolist()
    [1.0, 1.0, 0.0]
    """
    result: FloatArray = _adjustment.principal_extents(rows(points_mm, 3, "points_mm"))
    return result
