"""Epipolar lines of adjusted pictures, with the standard deviation of a distance from them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from videogrammetry.calibration.network_rays import BoolArray, RowArray
from videogrammetry.geometry import (
    project_with_jacobians,
    rays_through_pixels,
    rotation_from_vector,
)
from videogrammetry.types import INTERIOR_NAMES, FloatArray, IntArray, RigCamera

#: Steps of the interior parameters for derivatives, px and r0 to the power that makes it px.
_STEP_PX = 0.01


@dataclass(frozen=True, kw_only=True)
class View:
    """An adjusted picture with its un-coded image points.

    Attributes
    ----------
    camera : interior. ``camera_index`` of the network.
    rotation, translation : cam_from_object. centre : projection centre.
    row : (n,) rows of the network's observations. xy_px : (n, 2).
    ideal : (n, 3) rays (X/Z, Y/Z, 1); by_interior : (n, 2, 10) their derivatives.
    pose_at, interior_at : places of the unknowns in the covariance, -1 = held.
    sigma_px : standard deviation of an image point; model_px : of a prediction from
        what the adjustment determines.
    """

    camera: RigCamera
    camera_index: int
    rotation: FloatArray
    translation: FloatArray
    row: RowArray
    xy_px: FloatArray
    ideal: FloatArray
    by_interior: FloatArray
    pose_at: int
    interior_at: IntArray
    sigma_px: float
    model_px: float

    @property
    def centre(self) -> FloatArray:
        """(3,) projection centre in the object's frame."""
        result: FloatArray = -self.rotation.T @ self.translation
        return result

    @property
    def f_px(self) -> float:
        """Principal distance."""
        return float(self.camera.interior[0])

    @property
    def total_px(self) -> float:
        """Standard deviation of measured less predicted."""
        return float(np.hypot(self.sigma_px, self.model_px))

    def directions(self, index: RowArray) -> FloatArray:
        """(k, 3) unit rays in the object's frame."""
        ray = self.ideal[index] / np.linalg.norm(self.ideal[index], axis=1, keepdims=True)
        result: FloatArray = ray @ self.rotation
        return result

    def predict(self, points: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Pictures (k, 2), derivatives by the point (k, 2, 3), whether inside the picture."""
        in_cam = points @ self.rotation.T + self.translation
        xy, by_point, _ = project_with_jacobians(self.camera, in_cam)
        width, height = self.camera.image_size_px
        with np.errstate(invalid="ignore"):
            inside = (xy > -0.5).all(axis=1) & (xy[:, 0] < width - 0.5) & (xy[:, 1] < height - 0.5)
        return xy, by_point @ self.rotation, inside & (in_cam[:, 2] > 0)


def ideal_rays(camera: RigCamera, xy_px: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rays (n, 3) (X/Z, Y/Z, 1) and derivatives of X/Z, Y/Z by the interior (n, 2, 10)."""
    if len(xy_px) == 0:
        return np.zeros((0, 3)), np.zeros((0, 2, len(INTERIOR_NAMES)))
    rays = rays_through_pixels(camera, xy_px)
    power = np.array([0, 0, 0, -2, -4, -6, -1, -1, 0, 0])
    step = (
        _STEP_PX
        * np.array([1, 1, 1, 1, 1, 1, 1, 1, 1e-3, 1e-3])
        * camera.r0_px**power
        * (np.where(power < 0, 1.0 / camera.r0_px, 1.0))
    )
    by = np.empty((len(xy_px), 2, len(INTERIOR_NAMES)))
    for k in range(len(INTERIOR_NAMES)):
        moved = camera.interior.copy()
        moved[k] += step[k]
        other = RigCamera(
            image_size_px=camera.image_size_px, interior=moved, r0_px=camera.r0_px,
            rotation=camera.rotation, translation_mm=camera.translation_mm,
            measured=camera.measured,
        )  # fmt: skip
        by[:, :, k] = (rays_through_pixels(other, xy_px) - rays)[:, :2] / step[k]
    return rays, by


@dataclass(frozen=True, kw_only=True)
class EpipolarPairs:
    """Pairs of image points near each other's epipolar lines: places in the two views."""

    first: RowArray
    second: RowArray
    distance_sigmas: FloatArray


def epipolar_pairs(
    a: View,
    b: View,
    cov: FloatArray,
    open_a: RowArray,
    open_b: RowArray,
    critical_value: float,
) -> EpipolarPairs:
    """Pairs whose distance from the epipolar lines is within ``critical_value`` sigmas.

    d = b'E a / sqrt(|(E a)_xy|^2 / f_b^2 + |(E'b)_xy|^2 / f_a^2) in px; its variance
    is that of the image points plus J cov J' over both poses and interiors.
    """
    rotation = b.rotation @ a.rotation.T
    translation = b.translation - rotation @ a.translation
    essential = _cross(translation) @ rotation
    xa, xb = a.ideal[open_a], b.ideal[open_b]
    line_b, line_a = xa @ essential.T, xb @ essential
    norm = np.sqrt(
        np.sum(line_b[:, None, :2] ** 2, axis=2) / b.f_px**2
        + np.sum(line_a[None, :, :2] ** 2, axis=2) / a.f_px**2
    )
    distance = (line_b @ xb.T) / norm
    # A coarse gate first: the exact sigma is dear.
    widest = 3.0 * critical_value * np.hypot(a.total_px, b.total_px) + 1.0
    i, j = np.nonzero(np.abs(distance) < widest)
    sigma = _sigma_px(a, b, cov, (open_a[i], open_b[j]), essential, norm[i, j])
    ratio = np.abs(distance[i, j]) / sigma
    near = ratio < critical_value
    return EpipolarPairs(first=open_a[i[near]], second=open_b[j[near]], distance_sigmas=ratio[near])


def _sigma_px(
    a: View,
    b: View,
    cov: FloatArray,
    index: tuple[RowArray, RowArray],
    essential: FloatArray,
    norm: FloatArray,
) -> FloatArray:
    """Standard deviations of the distances, from image points, poses and interiors."""
    xa, xb = a.ideal[index[0]], b.ideal[index[1]]
    places: list[int] = []
    columns: list[FloatArray] = []
    for view, moved in ((a, 0), (b, 1)):
        if view.pose_at < 0:
            continue
        for k in range(6):
            turned = _moved_essential(a, b, moved, k, essential)
            columns.append(np.einsum("ni,ij,nj->n", xb, turned, xa) / norm)
            places.append(view.pose_at + k)
    line_b, line_a = xa @ essential.T, xb @ essential
    for view, line, at in ((a, line_a, index[0]), (b, line_b, index[1])):
        for k in np.flatnonzero(view.interior_at >= 0).tolist():
            change = np.sum(line[:, :2] * view.by_interior[at, :, k], axis=1) / norm
            columns.append(change)
            places.append(int(view.interior_at[k]))
    variance = np.full(len(xa), 0.5 * (a.sigma_px**2 + b.sigma_px**2))
    if places:
        # (an interior that both share occurs twice: the sum below adds the two)
        j = np.stack(columns, axis=1)
        variance = variance + np.einsum("np,pq,nq->n", j, cov[np.ix_(places, places)], j)
    sigma: FloatArray = np.sqrt(np.maximum(variance, 1e-12))
    return sigma


def _moved_essential(
    a: View, b: View, which: int, unknown: int, essential: FloatArray
) -> FloatArray:
    """dE by a rotation vector on the left of a pose's R, or by its shift."""
    scale = float(np.linalg.norm(b.translation - b.rotation @ a.rotation.T @ a.translation))
    step = 1e-6 if unknown < 3 else 1e-6 * scale
    vector = np.zeros(3)
    vector[unknown % 3] = step
    poses = [(a.rotation, a.translation), (b.rotation, b.translation)]
    r, t = poses[which]
    poses[which] = (rotation_from_vector(vector) @ r, t) if unknown < 3 else (r, t + vector)
    rotation = poses[1][0] @ poses[0][0].T
    moved = _cross(poses[1][1] - rotation @ poses[0][1]) @ rotation
    result: FloatArray = (moved - essential) / step
    return result


def _cross(t: FloatArray) -> FloatArray:
    result: FloatArray = np.array([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0.0]])
    return result


def intersect_two(
    a: View, b: View, first: RowArray, second: RowArray, min_rad: float
) -> tuple[FloatArray, FloatArray]:
    """Intersections (k, 3) of pairs of rays and their covariances.

    NaN where they diverge, or meet at less than ``min_rad``.
    """
    u, v = a.directions(first), b.directions(second)
    w = b.centre - a.centre
    cosine = np.sum(u * v, axis=1)
    sine2 = np.maximum(1.0 - cosine**2, 1e-12)
    along_u = (u @ w - cosine * (v @ w)) / sine2
    along_v = (cosine * (u @ w) - v @ w) / sine2
    points = 0.5 * (a.centre + along_u[:, None] * u + b.centre + along_v[:, None] * v)
    bad = (along_u <= 0) | (along_v <= 0) | (sine2 < np.sin(min_rad) ** 2)
    points[bad] = np.nan
    normal = np.zeros((len(points), 3, 3))
    for view, direction, depth in ((a, u, along_u), (b, v, along_v)):
        weight = (view.f_px / np.maximum(np.abs(depth), 1e-9) / view.total_px) ** 2
        across = np.eye(3) - direction[:, :, None] * direction[:, None, :]
        normal += weight[:, None, None] * across
    cov: FloatArray = np.asarray(np.linalg.inv(normal), float)
    return points, cov
