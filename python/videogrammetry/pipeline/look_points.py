"""Residuals of the points of single stages, with those targets that matching has left out."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from videogrammetry.geometry import project_from_world
from videogrammetry.matching import TARGET_STATUS
from videogrammetry.pipeline.chunk_record import ChunkRecord
from videogrammetry.pipeline.look_residuals import LookTargets, ResidualTable, without_gross
from videogrammetry.reconstruction import Triangulator
from videogrammetry.reconstruction.camera_scores import PointResiduals
from videogrammetry.types import RigData

#: Targets without a code that are put back to their points: how many at least, how far off.
_LEAST_BACK, _FARTHEST_BACK_PX = 6, 30.0
_MET_WRONGLY = TARGET_STATUS.index("inconsistent ID")


def residuals_of_points(
    record: ChunkRecord, targets: LookTargets, rig: RigData, triangulator: Triangulator
) -> PointResiduals:
    """Residuals of all points, and of coded targets whose rays do not meet their ID's.

    Where a camera has moved, matching leaves its targets out: they say most of all.
    """
    cameras = len(rig.cameras)
    look_of_point = np.repeat(targets.look_of, record.point_count)
    kept = np.flatnonzero(look_of_point >= 0)
    row_of = np.full(len(look_of_point), -1, dtype=np.intp)
    row_of[kept] = np.arange(len(kept))
    seen = np.flatnonzero(targets.point >= 0)
    table = ResidualTable(look_of_point[kept], record.position_mm[kept], cameras)
    table.put(row_of[targets.point[seen]], targets, seen, targets.residual_px[seen])
    lost = np.flatnonzero((targets.status == _MET_WRONGLY) & (targets.point < 0))
    lost = targets.unique(lost[targets.code[lost] >= 0]) if len(lost) else lost
    if len(lost):
        key = (look_of_point[kept].astype(np.int64) << 32) + record.point_code[kept]
        lost = _back_to_points(table, targets, lost, key, rig)
        _as_new_points(table, targets, lost, triangulator)
    _back_by_place(table, targets, rig)
    return without_gross(table.residuals(), any_camera=False)


def _back_to_points(
    table: ResidualTable,
    targets: LookTargets,
    lost: npt.NDArray[np.intp],
    key: npt.NDArray[np.int64],
    rig: RigData,
) -> npt.NDArray[np.intp]:
    """Puts targets to the point of their ID that other cameras made; returns the others."""
    if not len(key):
        return lost
    order = np.argsort(key)
    mine = (targets.look[lost].astype(np.int64) << 32) + targets.code[lost]
    at = order[np.minimum(np.searchsorted(key[order], mine), len(key) - 1)]
    there = key[at] == mine
    rows, point = lost[there], at[there]
    residual = np.full((len(rows), 2), np.nan)
    for c, camera in enumerate(rig.cameras.values()):
        own = targets.camera[rows] == c
        if own.any():
            computed = project_from_world(camera, table.position_mm[point[own]])
            residual[own] = targets.centre_px[rows[own]] - computed
    good = np.isfinite(residual).all(axis=1)
    table.put(point[good], targets, rows[good], residual[good])
    others: npt.NDArray[np.intp] = lost[~there]
    return others


def _back_by_place(table: ResidualTable, targets: LookTargets, rig: RigData) -> None:
    """Puts targets without a code back to points that their camera has lost.

    Where a camera that sees as many targets as the others has part in less than half of
    the points, those of the others are projected into its picture. Its free targets
    nearest to them are theirs if most of them are off by the same way.
    """
    seen = np.isfinite(table.residual_px[..., 0])
    lost = _lost_looks(table, seen)
    if not lost.any():
        return
    free = (targets.point < 0) & (targets.code < 0)
    for look, c in np.argwhere(lost).tolist():
        rows = np.flatnonzero(free & (targets.look == look) & (targets.camera == c))
        points = np.flatnonzero((table.look == look) & ~seen[:, c])
        if len(rows) < _LEAST_BACK:
            continue
        camera = list(rig.cameras.values())[c]
        computed = project_from_world(camera, table.position_mm[points])
        way = targets.centre_px[rows][None] - computed[:, None]
        distance = np.nan_to_num(np.linalg.norm(way, axis=2), nan=np.inf)
        nearest = distance.argmin(axis=1)
        mutual = distance.argmin(axis=0)[nearest] == np.arange(len(points))
        mutual &= distance.min(axis=1) < _FARTHEST_BACK_PX
        mine = np.flatnonzero(mutual)
        off = way[mine, nearest[mine]]
        middle = np.median(off, axis=0) if len(mine) else np.zeros(2)
        near = np.linalg.norm(off - middle, axis=1) < 1.0 + 0.2 * float(np.linalg.norm(middle))
        if near.sum() >= max(_LEAST_BACK, 0.5 * len(mine)):
            table.put(points[mine[near]], targets, rows[nearest[mine[near]]], off[near])


def _lost_looks(table: ResidualTable, seen: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """(K, C) where a camera has part in less than half of a look's points."""
    looks = int(table.look.max(initial=-1)) + 1
    count = np.stack([np.bincount(table.look[of], minlength=looks) for of in seen.T], axis=1)
    total = np.bincount(table.look, minlength=looks)
    return (count < 0.5 * total[:, None]) & (total[:, None] >= _LEAST_BACK)


def _as_new_points(
    table: ResidualTable,
    targets: LookTargets,
    lost: npt.NDArray[np.intp],
    triangulator: Triangulator,
) -> None:
    """Points of targets of one ID that no point was made of."""
    mine = (targets.look[lost].astype(np.int64) << 32) + targets.code[lost]
    _, group, count = np.unique(mine, return_inverse=True, return_counts=True)
    lost, group = lost[count[group] > 1], group[count[group] > 1]
    if not len(lost):
        return
    order = np.argsort(group, kind="stable")
    lost, group = lost[order], np.unique(group[order], return_inverse=True)[1]
    variance = targets.variance_px2[lost]
    cov = np.stack([variance[:, 0], np.zeros(len(lost)), variance[:, 1]], axis=1)
    offsets = np.concatenate([[0], np.cumsum(np.bincount(group))])
    found = triangulator(offsets, targets.camera[lost], targets.centre_px[lost], cov)
    good = np.asarray(found["status"]) == 0
    first = len(table.look)
    table.more(targets.look[lost[offsets[:-1]]][good], found["position_mm"][good])
    row = first + np.cumsum(good) - 1
    kept = good[group]
    table.put(row[group[kept]], targets, lost[kept], found["residual_px"][kept])
