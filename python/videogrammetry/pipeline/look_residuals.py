"""Targets of single stages and the residuals that they leave, by point and camera."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from videogrammetry.pipeline.chunk_record import ChunkRecord
from videogrammetry.reconstruction.camera_scores import PointResiduals
from videogrammetry.types import FloatArray, IntArray, RigData

#: Residuals of more than so many of their camera's median ones, or standard deviations.
_GROSS = 6.0


class LookTargets:
    """The targets of the stages looked at."""

    def __init__(self, record: ChunkRecord, looked: npt.NDArray[np.intp], rig: RigData) -> None:
        num_stages, cameras = record.target_count.shape
        self.look_of = np.full(num_stages, -1, dtype=np.int32)
        self.look_of[looked] = np.arange(len(looked))
        count = record.target_count[looked].reshape(-1)
        offsets = np.concatenate([[0], np.cumsum(record.target_count.sum(axis=1))])
        begins = offsets[looked] - np.concatenate([[0], np.cumsum(count)])[:-1:cameras]
        place = np.repeat(np.arange(len(count)), count)
        self.look, self.camera = place // cameras, place % cameras
        rows = np.arange(len(place)) + begins[self.look]
        self.point, self.code = record.target_point[rows], record.code_id[rows]
        self.status = record.match_status[rows]
        self.centre_px, self.residual_px = record.centre_px[rows], record.residual_px[rows]
        floor = np.array([rig.sigma_floor_px.get(name, 0.0) for name in rig.cameras]) ** 2
        own = record.sigma_px[rows] ** 2
        self.variance_px2 = own + floor[self.camera, None]
        self.systematic = floor[self.camera] / self.variance_px2.mean(axis=1)

    def unique(self, rows: npt.NDArray[np.intp]) -> npt.NDArray[np.intp]:
        """Those of ``rows`` whose code is there once in their picture."""
        key = (self.look.astype(np.int64) << 32) + (self.camera << 24) + self.code
        values, count = np.unique(key, return_counts=True)
        once = np.flatnonzero(count[np.searchsorted(values, key[rows])] == 1)
        left: npt.NDArray[np.intp] = rows[once]
        return left


class ResidualTable:
    """Residuals by point and camera, filled bit by bit."""

    def __init__(self, look: IntArray, position_mm: FloatArray, cameras: int) -> None:
        self.look, self.position_mm = look, position_mm
        self.residual_px = np.full((len(look), cameras, 2), np.nan)
        self.variance_px2 = np.ones((len(look), cameras, 2))
        self.systematic = np.zeros((len(look), cameras))

    def put(
        self,
        point: npt.NDArray[np.intp],
        targets: LookTargets,
        rows: npt.NDArray[np.intp],
        residual_px: FloatArray,
    ) -> None:
        """The residuals of targets, those of the cameras in which they are seen."""
        place = point * self.systematic.shape[1] + targets.camera[rows]
        self.residual_px.reshape(-1, 2)[place] = residual_px
        self.variance_px2.reshape(-1, 2)[place] = targets.variance_px2[rows]
        self.systematic.reshape(-1)[place] = targets.systematic[rows]

    def more(self, look: IntArray, position_mm: FloatArray) -> None:
        """Further points, not seen yet."""
        other = ResidualTable(look, position_mm, self.residual_px.shape[1])
        for name in ("look", "position_mm", "residual_px", "variance_px2", "systematic"):
            setattr(self, name, np.concatenate([getattr(self, name), getattr(other, name)]))

    def residuals(self) -> PointResiduals:
        """All of it."""
        return PointResiduals(
            look=self.look,
            position_mm=self.position_mm,
            residual_px=self.residual_px,
            variance_px2=self.variance_px2,
            systematic=self.systematic,
        )


def without_gross(points: PointResiduals, *, any_camera: bool) -> PointResiduals:
    """Without points far off from what their cameras' other points are, in all that see them.

    Misread codes and wrong matches; where a camera has moved, all of its residuals are
    large, and none of them is gross.
    """
    with np.errstate(invalid="ignore"):
        size = np.sqrt((points.residual_px**2 / points.variance_px2).mean(axis=2))
        far = size > _GROSS
    if not far.any():
        return points
    for look in np.unique(points.look[far.any(axis=1)]).tolist():
        rows = np.flatnonzero(points.look == look)
        own = size[rows]
        count = np.isfinite(own).sum(axis=0)
        middle = np.sort(own, axis=0)[np.maximum(count - 1, 0) // 2, np.arange(own.shape[1])]
        far[rows] = own > _GROSS * np.maximum(1.0, np.nan_to_num(middle))
    if any_camera:
        points.residual_px[far] = np.nan
        return points
    seen = np.isfinite(size)
    return points.select(~(far | ~seen).all(axis=1) | ~seen.any(axis=1))
