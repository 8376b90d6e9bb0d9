"""What the residuals of points say of their cameras' poses: score and information."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from videogrammetry.geometry import (
    CAMERA_PARAMETERS,
    full_covariance,
    project_from_world_with_jacobians,
)

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

    def select(self, rows: npt.NDArray[np.bool_]) -> PointResiduals:
        """Some of the points."""
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
    by_calibration : (K, 6 C, R): N' F, what R independent standard errors of the
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
    points, cameras = residuals.residual_px.shape[:2]
    by_point, by_camera = np.zeros((points, cameras, 2, 3)), np.zeros((points, cameras, 2, _ALL))
    residual = np.nan_to_num(residuals.residual_px)
    for c, camera in enumerate(rig.cameras.values()):
        seen = np.flatnonzero(np.isfinite(residuals.residual_px[:, c, 0]))
        if len(seen):
            _, by_point[seen, c], by_camera[seen, c] = project_from_world_with_jacobians(
                camera, residuals.position_mm[seen]
            )
    residual = _whiten(residuals, residual, by_point, by_camera)
    augmented = np.concatenate([by_camera[..., -_POSE:], residual[..., None]], axis=3)
    for c, camera in enumerate(rig.cameras.values()):
        own = by_camera[:, c, :, -_POSE:].reshape(-1, _POSE) @ pose_of_motion(camera)
        augmented[:, c, :, :_POSE] = own.reshape(points, 2, _POSE)
    order = np.argsort(residuals.look, kind="stable")
    ends = np.searchsorted(residuals.look[order], np.arange(num_looks + 1))
    rows = [order[ends[k] : ends[k + 1]] for k in range(num_looks)]
    root = None if residuals.cov_mm2 is not None else _point_root(by_point)
    normal, score, chi2, poses = _sums(augmented, root, rows)
    factor = np.zeros((_ALL * cameras, 0)) if factor is None else factor
    effect = np.zeros((num_looks, _POSE * cameras, factor.shape[1]))
    if factor.size:
        for k, of_look in enumerate(rows):
            if not len(of_look):  # pictures without a target: they say nothing
                continue
            by_pose = augmented[of_look, ..., :_POSE]
            effect[k], pictures = _by_calibration(by_camera[of_look], by_pose, factor)
            if root is not None and poses is not None:
                shared = (root[of_look] @ pictures).reshape(-1, factor.shape[1])
                effect[k] -= poses[of_look].reshape(len(shared), -1).T @ shared
    count, redundancy, systematic = _counts(residuals, num_looks)
    return CameraScores(
        score=score,
        normal=normal,
        by_calibration=effect,
        chi2=chi2,
        redundancy=redundancy,
        systematic=systematic,
        points=count,
    )


def _sums(
    augmented: FloatArray, root: FloatArray | None, rows: list[npt.NDArray[np.intp]]
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray | None]:
    """N, g and chi-square of the looks, and U (P, 3, 6 C), what points take of the poses.

    ``augmented`` (P, C, 2, 7): poses and residual; ``root``: L^-1 J', None: known points.
    """
    points, cameras = augmented.shape[:2]
    normal = np.zeros((len(rows), _POSE * cameras, _POSE * cameras))
    score = np.zeros((len(rows), _POSE * cameras))
    chi2 = np.zeros((len(rows), cameras))
    for c in range(cameras):
        mine = slice(_POSE * c, _POSE * (c + 1))
        for k, of_look in enumerate(rows):
            own = augmented[of_look, c].reshape(-1, _POSE + 1)
            square = own.T @ own
            normal[k, mine, mine] = square[:_POSE, :_POSE]
            score[k, mine] = square[:_POSE, -1]
            chi2[k, c] = square[-1, -1]
    if root is None:
        return normal, score, chi2, None
    # What the points take of it: with L L' = J'J and U = L^-1 J'B, N loses U'U.
    chi2 = np.repeat(chi2.sum(axis=1, keepdims=True), cameras, axis=1)
    shared = root.reshape(points, 3, cameras, 2).transpose(0, 2, 1, 3) @ augmented
    poses = shared[..., :_POSE].transpose(0, 2, 1, 3).reshape(points, 3, -1)
    rest = shared[..., -1].sum(axis=1)
    for k, of_look in enumerate(rows):
        u, v = poses[of_look].reshape(-1, _POSE * cameras), rest[of_look].reshape(-1)
        normal[k] -= u.T @ u
        score[k] -= u.T @ v
        chi2[k] -= v @ v
    return normal, score, chi2, poses


def _whiten(
    residuals: PointResiduals, residual: FloatArray, by_point: FloatArray, by_camera: FloatArray
) -> FloatArray:
    """The residuals in standard deviations; so are the derivatives then, in place."""
    if residuals.cov_mm2 is None:
        seen = np.isfinite(residuals.residual_px)
        weight = np.where(seen, 1 / np.sqrt(np.where(seen, residuals.variance_px2, 1.0)), 0.0)
        by_point *= weight[..., None]
        by_camera *= weight[..., None]
        return np.asarray(residual * weight)
    seen = np.isfinite(residuals.residual_px[..., 0])
    cov = by_point @ residuals.cov_mm2[:, None] @ np.swapaxes(by_point, 2, 3)
    cov[..., [0, 1], [0, 1]] += np.where(seen[..., None], residuals.variance_px2, 1.0)
    inverse = np.linalg.inv(np.linalg.cholesky(cov)) * seen[..., None, None]
    by_point[:] = inverse @ by_point
    by_camera[:] = inverse @ by_camera
    return np.asarray((inverse @ residual[..., None])[..., 0])


def _point_root(by_point: FloatArray) -> FloatArray:
    """(P, 3, 2 C) L^-1 J' with L L' = J'J, written out: thousands of small matrices."""
    j = by_point.reshape(len(by_point), -1, 3)
    h = np.swapaxes(j, 1, 2) @ j
    with np.errstate(divide="ignore", invalid="ignore"):
        a = np.sqrt(h[:, 0, 0])
        b, c = h[:, 1, 0] / a, h[:, 2, 0] / a
        d = np.sqrt(h[:, 1, 1] - b * b)
        e = (h[:, 2, 1] - b * c) / d
        f = np.sqrt(h[:, 2, 2] - c * c - e * e)
        first = j[..., 0] / a[:, None]
        second = (j[..., 1] - b[:, None] * first) / d[:, None]
        third = (j[..., 2] - c[:, None] * first - e[:, None] * second) / f[:, None]
    root: FloatArray = np.stack([first, second, third], axis=1)
    return root


def _by_calibration(
    by_camera: FloatArray, by_pose: FloatArray, factor: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """B'W A F (6 C, R) of one look, and W^1/2 A F (P, 2 C, R)."""
    points, cameras = by_camera.shape[:2]
    parts = factor.reshape(cameras, _ALL, -1)
    pictures = np.empty((points, cameras, 2, factor.shape[1]))
    effect = np.empty((cameras, _POSE, factor.shape[1]))
    for c in range(cameras):
        own = by_camera[:, c].reshape(-1, _ALL) @ parts[c]
        effect[c] = by_pose[:, c].reshape(-1, _POSE).T @ own
        pictures[:, c] = own.reshape(points, 2, -1)
    return effect.reshape(_POSE * cameras, -1), pictures.reshape(points, 2 * cameras, -1)


def _counts(residuals: PointResiduals, num_looks: int) -> tuple[IntArray, FloatArray, FloatArray]:
    """Points, redundancy and systematic share of every look and camera."""
    seen = np.isfinite(residuals.residual_px[..., 0])
    points = np.zeros((num_looks, seen.shape[1]), dtype=np.int32)
    share = np.zeros(points.shape)
    np.add.at(points, residuals.look, seen)
    np.add.at(share, residuals.look, np.where(seen, residuals.systematic, 0.0))
    redundancy: FloatArray = 2.0 * points.astype(np.float64)
    if residuals.cov_mm2 is None:
        of_looks = np.bincount(residuals.look, minlength=num_looks)
        total = redundancy.sum(axis=1) - 3.0 * of_looks
        redundancy = np.repeat(total[:, None], points.shape[1], axis=1)
    share /= np.maximum(points, 1)
    return points, redundancy, share
