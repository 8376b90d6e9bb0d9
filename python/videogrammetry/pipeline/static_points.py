"""Residuals of points that do not move, in single stages."""

from __future__ import annotations

import numpy as np

from videogrammetry.geometry import project_from_world_with_jacobians
from videogrammetry.pipeline.look_residuals import LookTargets, ResidualTable, without_gross
from videogrammetry.reconstruction.camera_scores import PointResiduals
from videogrammetry.types import PointSet, RigData, matrix_from_cov6


class StaticPoints:
    """Points that do not move, and where every camera should see them."""

    def __init__(self, rig: RigData, static: PointSet) -> None:
        order = np.argsort(static.id)
        self._id, self._position = static.id[order], static.position_mm[order]
        cov = None if static.cov_mm2 is None else matrix_from_cov6(static.cov_mm2)[order]
        self._cov = np.zeros((len(order), 3, 3)) if cov is None else cov
        pictures = [
            project_from_world_with_jacobians(camera, self._position)[:2]
            for camera in rig.cameras.values()
        ]
        self._xy_px = np.stack([xy for xy, _ in pictures], axis=1)
        by = np.stack([j for _, j in pictures], axis=1)
        cov_px2 = by @ self._cov[:, None] @ np.swapaxes(by, 2, 3)
        self._variance = np.trace(cov_px2, axis1=2, axis2=3) / 2

    def residuals(self, targets: LookTargets) -> PointResiduals:
        """A point of every look and static point that any camera sees."""
        rows = targets.unique(np.flatnonzero(np.isin(targets.code, self._id)))
        point = np.searchsorted(self._id, targets.code[rows])
        camera = targets.camera[rows]
        key, group = np.unique(
            targets.look[rows].astype(np.int64) * len(self._id) + point, return_inverse=True
        )
        look, of = (key // len(self._id)).astype(np.int32), key % len(self._id)
        table = ResidualTable(look, self._position[of], self._xy_px.shape[1])
        table.put(group, targets, rows, targets.centre_px[rows] - self._xy_px[point, camera])
        found = table.residuals()
        stays = self._variance[of]
        total = found.variance_px2.mean(axis=2)
        share = (found.systematic * total + stays) / (total + stays)
        found = PointResiduals(
            look=found.look,
            position_mm=found.position_mm,
            residual_px=found.residual_px,
            variance_px2=found.variance_px2,
            systematic=share,
            cov_mm2=self._cov[of],
        )
        return without_gross(found, any_camera=True)
