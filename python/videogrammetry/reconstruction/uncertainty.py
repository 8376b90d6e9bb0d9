"""Covariances of projected and intersected points: image noise, calibration, together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from videogrammetry.geometry import (
    CAMERA_PARAMETERS,
    full_covariance,
    project_from_world_with_jacobians,
)
from videogrammetry.reconstruction.triangulate import Triangulator
from videogrammetry.types import FloatArray, IntArray, RigCamera, RigData

_PARAMETERS = len(CAMERA_PARAMETERS)


@dataclass(frozen=True, kw_only=True)
class Projection:
    """Pictures of points in every camera, with covariances by their cause.

    Every mapping is camera -> array. With x a point, p the cameras' parameters
    and J = d(pixel)/dx, A = d(pixel)/dp, the parts are J C_x J^T (the point), A C_p A^T
    (the calibration; with ``frame="volume"`` the point follows the calibration's
    frame, see :class:`~videogrammetry.reconstruction.Triangulator`) and the noise of one
    measurement. They are independent, so that their sum is where the
    measured target will lie.

    Attributes
    ----------
    xy_px : (N, 2), NaN where a camera has no picture of the point.
    cov_image_px2, cov_point_px2, cov_rig_px2 : (N, 2, 2); the point's is 0
        where no ``cov_mm2`` was given.
    rig_known : whether the rig has a covariance; if not, ``cov_rig_px2`` is 0
        and says nothing.
    """

    xy_px: Mapping[str, FloatArray]
    cov_image_px2: Mapping[str, FloatArray]
    cov_point_px2: Mapping[str, FloatArray]
    cov_rig_px2: Mapping[str, FloatArray]
    rig_known: bool

    @property
    def cov_px2(self) -> dict[str, FloatArray]:
        """Camera -> (N, 2, 2): all three parts together."""
        return {
            name: self.cov_image_px2[name] + self.cov_point_px2[name] + self.cov_rig_px2[name]
            for name in self.xy_px
        }


@dataclass(frozen=True, kw_only=True)
class Distance:
    """Distances between pairs of points, and what makes them uncertain.

    Attributes
    ----------
    length_mm : (M,). sigma_image_mm : (M,) from the image noise, which is
        independent in the two ends. sigma_rig_mm : (M,) from the calibration,
        whose error both ends share: what shifts or turns both alike cancels.
    """

    length_mm: FloatArray
    sigma_image_mm: FloatArray
    sigma_rig_mm: FloatArray

    @property
    def sigma_mm(self) -> FloatArray:
        """(M,) both together."""
        return np.asarray(np.hypot(self.sigma_image_mm, self.sigma_rig_mm))


@dataclass(frozen=True, kw_only=True)
class Intersection:
    """Points intersected from their pictures, with covariances by their cause.

    Attributes
    ----------
    position_mm : (N, 3), NaN where it failed (``status``).
    cov_image_mm2, cov_rig_mm2 : (N, 3, 3) from the image noise, (J^T W J)^-1,
        and from the calibration, G C G^T. The first is independent between points,
        the second is common to all: :meth:`rig_covariance`.
    residual_px : camera -> (N, 2) measured - adjusted, NaN where not seen.
    chi2 : (N,) of the rays, 2 n - 3 degrees of freedom for n cameras.
    convergence_rad : (N,) largest angle between two rays.
    status : (N,) index into ``TRIANGULATION_STATUS``.
    cameras_used : (N, C) bool. sigma_px : (N, C) as weighted.
    rig_known : whether the rig has a covariance; if not, ``cov_rig_mm2`` is 0
        and says nothing.
    """

    position_mm: FloatArray
    cov_image_mm2: FloatArray
    cov_rig_mm2: FloatArray
    residual_px: Mapping[str, FloatArray]
    chi2: FloatArray
    convergence_rad: FloatArray
    status: IntArray
    cameras_used: npt.NDArray[np.bool_]
    sigma_px: FloatArray
    rig_known: bool
    triangulator: Triangulator = field(repr=False)

    def __len__(self) -> int:
        return len(self.position_mm)

    @property
    def cov_mm2(self) -> FloatArray:
        """(N, 3, 3) both parts together."""
        return np.asarray(self.cov_image_mm2 + self.cov_rig_mm2)

    def rig_covariance(self, rows: npt.ArrayLike | None = None) -> FloatArray:
        """(3K, 3K) mm^2: the calibration's covariance between the points ``rows`` (None: all).

        G_i C G_j^T for the points i and j, x, y, z of one after the other.
        """
        index = self._rows(rows, "rows")
        derivatives = self._derivatives(index).reshape(3 * len(index), -1)
        if not self.rig_known:
            return np.zeros((3 * len(index),) * 2)
        return np.asarray(derivatives @ full_covariance(self.triangulator.rig) @ derivatives.T)

    def covariance(self, rows: npt.ArrayLike | None = None) -> FloatArray:
        """(3K, 3K) mm^2 of the points ``rows``: the calibration's, and the image noise's blocks."""
        index = self._rows(rows, "rows")
        cov = self.rig_covariance(index)
        for k, i in enumerate(index):
            block = slice(3 * k, 3 * k + 3)
            cov[block, block] += self.cov_image_mm2[i]
        return cov

    def distance(self, a: npt.ArrayLike, b: npt.ArrayLike) -> Distance:
        """Distances between the points of the rows ``a`` and ``b``, (M,) or one number each.

        With e the unit vector from a to b the variance is
        e^T (S_a + S_b) e from the image noise and
        e^T (G_b - G_a) C (G_b - G_a)^T e from the calibration. It is linearised:
        good while the sigmas are small beside the length. NaN where a point is
        missing or both lie at one place.

        Raises
        ------
        ValueError : a row that is not there, or different numbers of rows.
        """
        start, end = self._rows(a, "a"), self._rows(b, "b")
        if len(start) != len(end):
            raise ValueError(f"b: expected {len(start)} rows as in a, got {len(end)}")
        step = self.position_mm[end] - self.position_mm[start]
        length = np.linalg.norm(step, axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            direction = step / length[:, None]
        noise = self.cov_image_mm2[start] + self.cov_image_mm2[end]
        image = np.einsum("ni,nij,nj->n", direction, noise, direction)
        rig = np.zeros(len(start))
        if self.rig_known:
            by = self._derivatives(end) - self._derivatives(start)
            by_length = np.einsum("ni,nij->nj", direction, by)
            rig = np.einsum(
                "ni,ij,nj->n", by_length, full_covariance(self.triangulator.rig), by_length
            )
        return Distance(
            length_mm=length,
            sigma_image_mm=np.sqrt(image),
            sigma_rig_mm=np.sqrt(np.maximum(rig, 0.0)),
        )

    def _derivatives(self, index: npt.NDArray[np.int64]) -> FloatArray:
        return self.triangulator.derivatives(
            self.position_mm[index], self.cameras_used[index], self.sigma_px[index]
        )

    def _rows(self, rows: npt.ArrayLike | None, name: str) -> npt.NDArray[np.int64]:
        if rows is None:
            return np.arange(len(self))
        index = np.atleast_1d(np.asarray(rows)).astype(np.int64)
        bad = (index < 0) | (index >= len(self))
        if bad.any():
            raise ValueError(f"{name}: row {index[bad][0]} is outside the {len(self)} points")
        return index


def cross_matrices(v: FloatArray) -> FloatArray:
    """(N, 3, 3) matrices [v]_x with [v]_x w = v x w."""
    zero = np.zeros(len(v))
    x, y, z = v.T
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.moveaxis(np.array(rows), 2, 0)


def picture_derivatives(
    camera: RigCamera, index: int, points_in_world: FloatArray, count: int, frame: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Pictures of points in one camera, with their derivatives by point and by all parameters.

    Parameters
    ----------
    index, count : the camera's place among the rig's ``count``.
    frame : (6, 16 count) the motion of the frame by the parameters
        (``Triangulator.frame_by_parameters``), empty: the frame is held.

    Returns
    -------
    xy_px (N, 2), by_point (N, 2, 3), by_parameters (N, 2, 16 count).
    """
    xy_px, by_point, own = project_from_world_with_jacobians(camera, points_in_world)
    total = np.zeros((len(points_in_world), 2, _PARAMETERS * count))
    if frame.size:
        # The frame follows the calibration's error by M dp: x' = x + [-[x]_x, I] M dp.
        ones = np.broadcast_to(np.eye(3), (len(points_in_world), 3, 3))
        effect = np.concatenate([-cross_matrices(points_in_world), ones], axis=2)
        total = by_point @ effect @ frame
    total[:, :, _PARAMETERS * index : _PARAMETERS * (index + 1)] += own
    return xy_px, by_point, total


def predict_pictures(
    rig: RigData,
    points_in_world: FloatArray,
    sigma_px: Mapping[str, FloatArray],
    cov_mm2: FloatArray | None,
    frame: str,
) -> Projection:
    """The projection of points (N, 3) with all covariances; see :class:`Projection`."""
    cov = full_covariance(rig)
    motion = Triangulator(rig, frame=frame).frame_by_parameters
    names = list(rig.cameras)
    xy, image, point, of_rig = {}, {}, {}, {}
    for k, (name, camera) in enumerate(rig.cameras.items()):
        pixels, by_point, by_rig = picture_derivatives(
            camera, k, points_in_world, len(names), motion
        )
        xy[name] = pixels
        none = np.where(np.isfinite(pixels).all(axis=1), 0.0, np.nan)[:, None, None] * np.eye(2)
        image[name] = none + sigma_px[name][:, None, None] ** 2 * np.eye(2)
        point[name] = none if cov_mm2 is None else by_point @ cov_mm2 @ _transposed(by_point)
        of_rig[name] = by_rig @ cov @ _transposed(by_rig) if len(cov) else none
    return Projection(
        xy_px=xy,
        cov_image_px2=image,
        cov_point_px2=point,
        cov_rig_px2=of_rig,
        rig_known=rig.cov is not None,
    )


def _transposed(matrices: FloatArray) -> FloatArray:
    return np.swapaxes(matrices, 1, 2)
