"""Looks at single stages of a measurement: whether a camera has moved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from videogrammetry.geometry import project_from_world, project_from_world_with_jacobians
from videogrammetry.matching import TARGET_STATUS
from videogrammetry.pipeline.chunk_record import ChunkRecord
from videogrammetry.reconstruction import Triangulator
from videogrammetry.reconstruction.camera_scores import (
    PointResiduals,
    calibration_factor,
    camera_scores,
)
from videogrammetry.reconstruction.stability import PoseChange, PoseWatch
from videogrammetry.types import (
    CameraSeries,
    FloatArray,
    IntArray,
    PointSet,
    RigData,
    matrix_from_cov6,
)

#: Every so many stages of a long sequence are looked at, and of a short one all.
_EVERY, _SHORT = 10, 100
#: Residuals of more than so many of their camera's median ones, or standard deviations.
_GROSS = 6.0
#: Targets without a code that are put back to their points: how many at least, how far off.
_LEAST_BACK, _FARTHEST_BACK_PX = 6, 30.0
_NEVER = np.iinfo(np.int32).max
_MET_WRONGLY = TARGET_STATUS.index("inconsistent ID")


@dataclass(frozen=True, kw_only=True)
class Stability:
    """What the check of the cameras says.

    Attributes
    ----------
    warnings : a sentence for every camera that has moved. found : the same in numbers.
    unstable_from : (C,) the stage from which on a camera's points are flagged; larger than
        any stage: it stands. series : by the points' residuals, of the looks.
    """

    warnings: tuple[str, ...]
    found: tuple[dict[str, Any], ...]
    unstable_from: IntArray
    series: CameraSeries


class StabilityCheck:
    """Takes the records of all stages in their order.

    Parameters
    ----------
    rigs : first stage and rig of every part of the sequence, in their order; where a new
        part begins, so does the comparison with the first stages.
    stages : first and last of the sequence. static : points that do not move, or None.
    """

    def __init__(
        self,
        rigs: Sequence[tuple[int, RigData]],
        stages: tuple[int, int],
        static: PointSet | None = None,
    ) -> None:
        self._first = stages[0]
        total = stages[1] - stages[0] + 1
        self._every = 1 if total <= _SHORT else _EVERY
        begins = [stages[0], *(first for first, _ in rigs[1:]), stages[1] + 1]
        self._parts = [
            _Part(rig, static, -(-(end - begin) // self._every))
            for (_, rig), begin, end in zip(rigs, begins[:-1], begins[1:], strict=True)
        ]
        self._begins = np.array(begins[:-1])

    def add(self, record: ChunkRecord) -> None:
        """The next stages."""
        looked = np.flatnonzero((record.stage - self._first) % self._every == 0)
        number = np.searchsorted(self._begins, record.stage[looked], side="right") - 1
        for k in np.unique(number).tolist():
            self._parts[k].add(record, looked[number == k])

    def result(self) -> Stability:
        """Of all stages taken."""
        names = tuple(self._parts[0].rig.cameras)
        unstable = np.full(len(names), _NEVER, dtype=np.int32)
        warnings: list[str] = []
        found: list[dict[str, Any]] = []
        for number, part in enumerate(self._parts):
            reoriented = number > 0
            for by, watch in part.watches():
                watch.finish()
                for change in watch.changes:
                    cameras = [names[c] for c in change.cameras]
                    said = _warning(cameras, change, by, part.calibrated, reoriented)
                    if by == "rays" or not _same(found, cameras):
                        warnings.append(said)
                    found.append(_numbers(cameras, change, by))
                    for c in change.cameras:
                        unstable[c] = min(unstable[c], change.after + 1)
        series = [part.rays.series() for part in self._parts if part.rays is not None]
        if not series:
            series = [PoseWatch(np.ones((len(names), 6)), 0).series()]
        return Stability(
            warnings=tuple(warnings),
            found=tuple(found),
            unstable_from=unstable,
            series=_joined(series),
        )


class _Part:
    """Stages that are measured with one rig."""

    def __init__(self, rig: RigData, static: PointSet | None, num_looks: int) -> None:
        self.rig, self._num_looks = rig, num_looks
        self.calibrated = rig.cov is not None
        self._triangulator = Triangulator(rig)
        self._factor = calibration_factor(rig)
        self._known = None if static is None else _Known(rig, static)
        self.rays: PoseWatch | None = None
        self._static: PoseWatch | None = None

    def watches(self) -> list[tuple[str, PoseWatch]]:
        both = (("rays", self.rays), ("static points", self._static))
        return [(by, watch) for by, watch in both if watch is not None]

    def add(self, record: ChunkRecord, looked: npt.NDArray[np.intp]) -> None:
        stage = record.stage[looked]
        targets = _Targets(record, looked, self.rig)
        points = _of_points(record, targets, self.rig, self._triangulator)
        if len(points):
            if self.rays is None:
                self.rays = PoseWatch(_scale(self.rig, points.position_mm), self._num_looks)
            self.rays.add(stage, self._scores(points, len(looked)))
        if self._known is None:
            return
        known = self._known.residuals(targets)
        if len(known):
            if self._static is None:
                scale = _scale(self.rig, known.position_mm)
                self._static = PoseWatch(scale, self._num_looks, known=True)
            self._static.add(stage, self._scores(known, len(looked)))

    def _scores(self, points: PointResiduals, num_looks: int) -> Any:
        return camera_scores(self.rig, points, num_looks, self._factor)


class _Targets:
    """The targets of the stages looked at."""

    def __init__(self, record: ChunkRecord, looked: npt.NDArray[np.intp], rig: RigData) -> None:
        num_stages, cameras = record.target_count.shape
        self.look_of = np.full(num_stages, -1, dtype=np.int32)
        self.look_of[looked] = np.arange(len(looked))
        place = np.repeat(np.arange(num_stages * cameras), record.target_count.reshape(-1))
        rows = np.flatnonzero(self.look_of[place // cameras] >= 0)
        place = place[rows]
        self.look, self.camera = self.look_of[place // cameras], place % cameras
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


def _of_points(
    record: ChunkRecord, targets: _Targets, rig: RigData, triangulator: Triangulator
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
    table = _Table(look_of_point[kept], record.position_mm[kept], cameras)
    table.put(row_of[targets.point[seen]], targets, seen, targets.residual_px[seen])
    lost = np.flatnonzero((targets.status == _MET_WRONGLY) & (targets.point < 0))
    lost = targets.unique(lost[targets.code[lost] >= 0]) if len(lost) else lost
    if len(lost):
        key = (look_of_point[kept].astype(np.int64) << 32) + record.point_code[kept]
        lost = _back_to_points(table, targets, lost, key, rig)
        _as_new_points(table, targets, lost, triangulator)
    _back_by_place(table, targets, rig)
    return _without_gross(table.residuals(), any_camera=False)


class _Table:
    """Residuals by point and camera, filled bit by bit."""

    def __init__(self, look: IntArray, position_mm: FloatArray, cameras: int) -> None:
        self.look, self.position_mm = look, position_mm
        self.residual_px = np.full((len(look), cameras, 2), np.nan)
        self.variance_px2 = np.ones((len(look), cameras, 2))
        self.systematic = np.zeros((len(look), cameras))

    def put(
        self,
        point: npt.NDArray[np.intp],
        targets: _Targets,
        rows: npt.NDArray[np.intp],
        residual_px: FloatArray,
    ) -> None:
        camera = targets.camera[rows]
        self.residual_px[point, camera] = residual_px
        self.variance_px2[point, camera] = targets.variance_px2[rows]
        self.systematic[point, camera] = targets.systematic[rows]

    def more(self, look: IntArray, position_mm: FloatArray) -> None:
        other = _Table(look, position_mm, self.residual_px.shape[1])
        for name in ("look", "position_mm", "residual_px", "variance_px2", "systematic"):
            setattr(self, name, np.concatenate([getattr(self, name), getattr(other, name)]))

    def residuals(self) -> PointResiduals:
        return PointResiduals(
            look=self.look,
            position_mm=self.position_mm,
            residual_px=self.residual_px,
            variance_px2=self.variance_px2,
            systematic=self.systematic,
        )


def _back_to_points(
    table: _Table,
    targets: _Targets,
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


def _back_by_place(table: _Table, targets: _Targets, rig: RigData) -> None:
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


def _lost_looks(table: _Table, seen: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """(K, C) where a camera has part in less than half of a look's points."""
    looks = int(table.look.max(initial=-1)) + 1
    count = np.zeros((looks, seen.shape[1]))
    np.add.at(count, table.look, seen)
    total = np.bincount(table.look, minlength=looks)
    return (count < 0.5 * total[:, None]) & (total[:, None] >= _LEAST_BACK)


def _as_new_points(
    table: _Table,
    targets: _Targets,
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


def _without_gross(points: PointResiduals, *, any_camera: bool) -> PointResiduals:
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


class _Known:
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

    def residuals(self, targets: _Targets) -> PointResiduals:
        """A point of every look and static point that any camera sees."""
        rows = targets.unique(np.flatnonzero(np.isin(targets.code, self._id)))
        point = np.searchsorted(self._id, targets.code[rows])
        camera = targets.camera[rows]
        key, group = np.unique(
            targets.look[rows].astype(np.int64) * len(self._id) + point, return_inverse=True
        )
        look, of = (key // len(self._id)).astype(np.int32), key % len(self._id)
        table = _Table(look, self._position[of], self._xy_px.shape[1])
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
        return _without_gross(found, any_camera=True)


def _scale(rig: RigData, points_mm: FloatArray) -> FloatArray:
    """(C, 6) what of every pose parameter moves the picture by about a pixel."""
    middle = np.median(points_mm, axis=0)
    scale = np.empty((len(rig.cameras), 6))
    for c, camera in enumerate(rig.cameras.values()):
        focal = abs(float(camera.interior[0]))
        distance = float(np.linalg.norm(middle - camera.centre_mm))
        scale[c] = [1 / focal] * 3 + [distance / focal] * 3
    return scale


def _joined(parts: Sequence[CameraSeries]) -> CameraSeries:
    names = ("stage", "turn_rad", "shift_mm", "sigma_turn_rad", "sigma_shift_mm", "chi2")
    return CameraSeries(
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in names},
        critical_chi2=parts[0].critical_chi2,
    )


def _same(found: Sequence[dict[str, Any]], cameras: Sequence[str]) -> bool:
    return any(entry["cameras"] == list(cameras) for entry in found)


def _numbers(cameras: list[str], change: PoseChange, by: str) -> dict[str, Any]:
    """A change as the provenance keeps it."""
    return {
        "cameras": cameras,
        "by": by,
        "since": change.since,
        "after_stage": change.after,
        "stage": change.stage,
        "found_at_stage": change.found,
        "turn_mrad": (1e3 * change.turn_rad).tolist(),
        "sigma_turn_mrad": (1e3 * change.sigma_turn_rad).tolist(),
        "shift_mm": change.shift_mm.tolist(),
        "sigma_shift_mm": [None if np.isnan(s) else s for s in change.sigma_shift_mm.tolist()],
        "chi2": change.chi2,
        "critical_chi2": change.critical,
    }


def _warning(
    cameras: Sequence[str], change: PoseChange, by: str, calibrated: bool, reoriented: bool
) -> str:
    quoted = [f"{name!r}" for name in cameras]
    if len(cameras) > 1:
        who = f"camera {quoted[0]} or {', '.join(quoted[1:])} (their rays do not tell which)"
    else:
        who = f"camera {quoted[0]}"
    if change.since == "calibration":
        basis = "the reorientation" if reoriented else "the calibration"
        when = f"since {basis}, or this holds less well than it says"
    else:
        when = f"between the stages {change.after} and {change.stage}"
    turn = 1e3 * np.linalg.norm(change.turn_rad)
    size = f"turned by {turn:.3f} mrad ({_along(1e3 * change.turn_rad, change.sigma_turn_rad)})"
    if np.isfinite(change.sigma_shift_mm).all():
        shift = float(np.linalg.norm(change.shift_mm))
        size += (
            f" and shifted by {shift:.3f} mm "
            f"(+- {float(np.linalg.norm(change.sigma_shift_mm)):.3f})"
        )
    alone = "" if calibrated else "; without the calibration's covariance"
    begin = change.after + 1
    stage = f":{begin}" if change.since == "sequence" else ""
    return (
        f"{who} has moved {when}: {size}, by {by}, chi-square {change.chi2:.0f} where "
        f"{change.critical:.0f} is not exceeded by chance in one of 1000 measurements{alone}. "
        f"Points that it sees are flagged unstable_camera from stage {max(begin, 1)} on: measure "
        f"again with --reorient {cameras[0]}{stage}, or calibrate again"
    )


def _along(turn_mrad: FloatArray, sigma_rad: FloatArray) -> str:
    """Standard deviation of a turn's size, those of its parts taken as independent."""
    length = float(np.linalg.norm(turn_mrad))
    unit = turn_mrad / length if length else np.full(3, 3**-0.5)
    return f"+- {1e3 * float(np.linalg.norm(unit * sigma_rad)):.3f}"
