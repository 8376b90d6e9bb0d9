"""What the residuals of points say of their cameras' poses: score and information."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from videogrammetry._core import reconstruction as _reconstruction
from videogrammetry.geometry import CAMERA_PARAMETERS, full_covariance, rig_model

if TYPE_CHECKING:
    import numpy.typing as npt

    from videogrammetry.types import FloatArray, IntArray, RigCamera, RigData

_POSE = 6
_ALL = len(CAMERA_PARAMETERS)
#: Directions of the calibration's covariance that are kept, against the largest in
#: units of their own standard deviations.
_SMALLEST = 1e-9


@dataclass(frozen=True, kw_only=True)
class PointResiduals:
    """Residuals of points of some looks.

    Attributes
    ----------
    look : (P,) which look, from 0. position_mm : (P, 3) where they were computed.
    residual_px : (P, C, 2) measured - computed, NaN where not seen.
    variance_px2 : (P, C, 2) of the measured coordinates. systematic : (P, C) share of it
        that stays from look to look (lens, target, stated coordinates).
    cov_mm2 : (P, 3, 3): the points are known with this covariance; None: they are not, and
        the residuals are those of their own intersection.
    """

    look: IntArray
    position_mm: FloatArray
    residual_px: FloatArray
    variance_px2: FloatArray
    systematic: FloatArray
    cov_mm2: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.look)

    def select(self, rows: npt.NDArray[np.bool_] | npt.NDArray[np.intp]) -> PointResiduals:
        """Some of the points, by a mask or an index."""
        names = (n for n in self.__dataclass_fields__ if getattr(self, n) is not None)
        return replace(self, **{n: getattr(self, n)[rows] for n in names})


@dataclass(frozen=True, kw_only=True)
class CameraScores:
    """Sums over the points of every look, for the six pose parameters of all cameras.

    Attributes
    ----------
    score : (K, 6 C) g = B'W r. normal : (K, 6 C, 6 C) N = B'W P B; of every camera a turn
        about its projection centre (rad, rotation vector on the left of cam_from_world) and
        a shift of that centre (mm, in the rig's frame).
    by_calibration : (K, 6 C, R): B'W P A F, what R independent standard errors of the
        calibration do to g; R = 0 where the rig has no covariance.
    chi2, redundancy : (K, C) of the residuals, of all cameras together for points that
        are not known, of every camera by itself for known ones.
    systematic : (K, C) share of the variance that stays from look to look.
    points : (K, C) seen.
    """

    score: FloatArray
    normal: FloatArray
    by_calibration: FloatArray
    chi2: FloatArray
    redundancy: FloatArray
    systematic: FloatArray
    points: IntArray

    def __len__(self) -> int:
        return len(self.score)

    def then(self, other: CameraScores) -> CameraScores:
        """These looks and then those of ``other``."""
        return CameraScores(
            **{
                name: np.concatenate([getattr(self, name), getattr(other, name)])
                for name in self.__dataclass_fields__
            }
        )


def calibration_factor(rig: RigData) -> FloatArray:
    """F (16 C, R) with F F' = the covariance of all parameters; R = 0 where none is known."""
    cov = full_covariance(rig)
    if not len(cov):
        return np.zeros((_ALL * len(rig.cameras), 0))
    sigma = np.sqrt(np.diag(cov))
    held = sigma == 0
    scale = np.where(held, 1.0, sigma)
    value, vector = np.linalg.eigh(cov / np.outer(scale, scale))
    kept = value > _SMALLEST * value[-1]
    factor: FloatArray = scale[:, None] * vector[:, kept] * np.sqrt(value[kept])
    # What is held stays so: rounding errors times the 20th power of ten, of A3, are large.
    factor[held] = 0.0
    return factor


def pose_of_motion(camera: RigCamera) -> FloatArray:
    """(6, 6) derivatives of rx, ry, rz, tx, ty, tz by turn about and shift of the centre.

    With t = -R c a turn w and a shift d of the centre c make dt = w x t - R d.
    """
    x, y, z = camera.translation_mm
    by_motion = np.eye(_POSE)
    by_motion[3:, :3] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
    by_motion[3:, 3:] = -camera.rotation
    return by_motion


def camera_scores(
    rig: RigData,
    residuals: PointResiduals,
    num_looks: int,
    factor: FloatArray | None = None,
) -> CameraScores:
    """Score and information of the cameras' poses, the points eliminated.

    With J, A the derivatives of the pictures by point and cameras and B those columns of
    A that are poses, r = P (B d + A' p + e), P = I - J (J'WJ)^-1 J'W for points that are
    not known and P = I, W = (C_px + J C_X J')^-1 for known ones; d motions of the
    cameras, p errors of the calibration, e noise. Then g = B'W r has the expectation
    N d and, without motion, the covariance N + (B'W P A) C (B'W P A)' with N = B'W P B.

    Parameters
    ----------
    rig : the cameras. residuals : the points, ``num_looks`` looks of them.
    factor : F (16 C, R), :func:`calibration_factor`; None: not looked at.
    """
    if (np.diff(residuals.look) < 0).any():
        order = np.argsort(residuals.look, kind="stable")
        residuals = residuals.select(order)
    offsets = np.searchsorted(residuals.look, np.arange(num_looks + 1))
    count, redundancy, systematic = _counts(residuals, offsets)
    if factor is None:
        factor = np.zeros((_ALL * len(rig.cameras), 0))
    given = (
        residuals.position_mm,
        residuals.residual_px,
        residuals.variance_px2,
        np.empty(0) if residuals.cov_mm2 is None else residuals.cov_mm2,
    )
    sums = _reconstruction.pose_scores(
        rig_model(rig),
        offsets.astype(np.int64),
        *(np.ascontiguousarray(values, dtype=np.float64) for values in given),
        np.ascontiguousarray(factor),
    )
    return CameraScores(
        score=sums["score"],
        normal=sums["normal"],
        by_calibration=sums["by_calibration"],
        chi2=sums["chi2"],
        redundancy=redundancy,
        systematic=systematic,
        points=count,
    )


def _counts(
    residuals: PointResiduals, offsets: npt.NDArray[np.intp]
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Points, redundancy and systematic share of every look and camera."""
    seen = np.isfinite(residuals.residual_px[..., 0])
    points = _summed(seen.astype(np.int32), offsets)
    share = _summed(np.where(seen, residuals.systematic, 0.0), offsets)
    redundancy: FloatArray = 2.0 * points.astype(np.float64)
    if residuals.cov_mm2 is None:
        total = redundancy.sum(axis=1) - 3.0 * np.diff(offsets)
        redundancy = np.repeat(total[:, None], points.shape[1], axis=1)
    return points, redundancy, share / np.maximum(points, 1)


def _summed(values: npt.NDArray[Any], offsets: npt.NDArray[np.intp]) -> npt.NDArray[Any]:
    """(K, C) of (P, C): sums over the points of every look, exactly as one after the other."""
    sums = np.zeros((len(offsets) - 1, values.shape[1]), values.dtype)
    some = np.flatnonzero(np.diff(offsets))
    if len(some):
        sums[some] = np.add.reduceat(values, offsets[some], axis=0)
    return sums
