"""Identity of points over stages: coded by number, un-coded by the motion around them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from videogrammetry.types import FloatArray, IntArray, StagePoints, Trajectories, cov6_from_matrix

_MIN_COMMON = 4  # three points fix a rigid motion, the fourth checks it
_MAX_ROUNDS = 6
_NO_LINK = 1e9
_RECENT = 3  # stages over which a point's own motion is taken for even


@dataclass(frozen=True, kw_only=True)
class LinkOptions:
    """How un-coded points are linked from stage to stage.

    Attributes
    ----------
    gate_sigma : where the coded points move as a rigid body, a prediction may
        be missed by this many of its standard deviations.
    max_share_of_spacing : and by at most this share of the distance to the
        nearest other point, so that neighbours are never exchanged; in (0, 0.5).
    neighbours : where the object bends, a point follows the coded points
        around it: this many lie within the weight's reach.
    """

    gate_sigma: float = 5.0
    max_share_of_spacing: float = 0.4
    neighbours: int = 6


def fit_rigid(
    a: FloatArray, b: FloatArray, weight: FloatArray | None = None
) -> tuple[FloatArray, FloatArray, float]:
    """Best-fit motion a_from_b of points (N, 3): rotation, translation, RMS per coordinate.

    Weighted least squares over rotation and translation (Kabsch); the RMS
    counts the six unknowns.

    Examples
    --------
    >>> b = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    >>> rotation, translation, rms = fit_rigid(b + [1, 2, 3], b)
    >>> translation.round(9).tolist(), round(rms, 9)
    ([1.0, 2.0, 3.0], 0.0)
    """
    w = np.full(len(a), 1.0) if weight is None else weight / weight.mean()
    mean_a, mean_b = (w @ a) / w.sum(), (w @ b) / w.sum()
    u, _, vt = np.linalg.svd((a - mean_a).T @ (w[:, None] * (b - mean_b)))
    sign = np.diag([1.0, 1.0, np.linalg.det(u @ vt)])
    rotation = u @ sign @ vt
    translation = mean_a - rotation @ mean_b
    residual = a - (b @ rotation.T + translation)
    redundancy = max(3 * len(a) - 6, 1)
    return rotation, translation, float(np.sqrt((w[:, None] * residual**2).sum() / redundancy))


@dataclass
class _Snapshot:
    """The points of one stage; ``id`` -1 where not yet identified."""

    id: IntArray
    position_mm: FloatArray
    sigma_mm: FloatArray


@dataclass
class _Predictions:
    id: IntArray
    position_mm: FloatArray
    gate_mm: FloatArray  # NaN: the spacing alone decides


def _rows(snapshot: _Snapshot, numbers: Iterable[int]) -> list[int]:
    """Where the numbers stand in a stage."""
    row_of = {int(n): i for i, n in enumerate(snapshot.id)}
    return [row_of[int(n)] for n in numbers]


class _Linker:
    def __init__(self, first_free_id: int, options: LinkOptions) -> None:
        self.options = options
        self.next_id = first_free_id
        self.stages: list[_Snapshot] = []
        self.first_free_id = first_free_id
        self.seen: dict[int, list[int]] = {}  # number -> indices into stages, ascending

    def add(self, points: StagePoints) -> IntArray:
        """Numbers for the points of the next stage."""
        sigma = np.sqrt(np.trace(points.cov_image_mm2, axis1=1, axis2=2) / 3)
        now = _Snapshot(points.id.astype(np.int32).copy(), points.position_mm, sigma)
        # What is linked guides what is not: bending is followed from the coded
        # points outwards.
        for _ in range(_MAX_ROUNDS):
            links = self._assign(now, self._predict(now))
            for linked, number in links:
                now.id[linked] = number
            if not links:
                break
        self._name_by_code(now)
        for row in np.flatnonzero(now.id < 0):
            now.id[row] = self.next_id
            self.next_id += 1
        for number in now.id.tolist():
            self.seen.setdefault(number, []).append(len(self.stages))
        self.stages.append(now)
        return now.id

    def _name_by_code(self, now: _Snapshot) -> None:
        """Un-coded numbers that turn out to be a coded point whose ring was not read so far."""
        predicted = self._predict(now)
        loose = predicted.id >= self.first_free_id
        coded = np.flatnonzero((now.id >= 0) & (now.id < self.first_free_id))
        if not loose.any() or not len(coded):
            return
        gate = self._limit_by_spacing(predicted, now.position_mm)
        found = cKDTree(now.position_mm[coded]).query(predicted.position_mm)
        distance, nearest = np.asarray(found[0]), np.asarray(found[1])
        for k in np.flatnonzero(loose & (distance <= gate)):
            number, code = int(predicted.id[k]), int(now.id[coded[nearest[k]]])
            stages = self.seen[number]
            if set(stages) & set(self.seen.get(code, [])):
                continue  # seen side by side: two points
            for stage in stages:
                ids = self.stages[stage].id
                ids[ids == number] = code
            del self.seen[number]
            self.seen[code] = sorted([*self.seen.get(code, []), *stages])

    def _predict(self, now: _Snapshot) -> _Predictions:
        """Where every missing known point should be, from the stage that saw it last."""
        found = set(now.id.tolist())
        by_stage: dict[int, list[int]] = {}
        for number, stages in self.seen.items():
            if number not in found:
                by_stage.setdefault(stages[-1], []).append(number)
        parts = [self._predict_from(s, now, np.array(n)) for s, n in by_stage.items()]
        if not parts:
            return _Predictions(np.empty(0, np.int32), np.empty((0, 3)), np.empty(0))
        return _Predictions(
            np.concatenate([p.id for p in parts]),
            np.concatenate([p.position_mm for p in parts]),
            np.concatenate([p.gate_mm for p in parts]),
        )

    def _predict_from(self, stage: int, now: _Snapshot, numbers: IntArray) -> _Predictions:
        old = self.stages[stage]
        start = old.position_mm[_rows(old, numbers)]
        identified = np.flatnonzero(now.id >= 0)
        _, i, j = np.intersect1d(old.id, now.id[identified], return_indices=True)
        if len(i) < _MIN_COMMON:
            ahead = start + (len(self.stages) - stage) * self._steps(stage, numbers)
            return _Predictions(numbers, ahead, np.full(len(numbers), np.nan))
        j = identified[j]
        before, after = old.position_mm[i], now.position_mm[j]
        noise = float(np.sqrt(np.median(old.sigma_mm[i]) ** 2 + np.median(now.sigma_mm[j]) ** 2))
        rotation, translation, rms = fit_rigid(after, before)
        if rms < 5 * noise:  # the object moves rigidly within its noise
            gate = self.options.gate_sigma * max(rms, noise) * np.sqrt(3)
            moved = start @ rotation.T + translation
            return _Predictions(numbers, moved, np.full(len(numbers), gate))
        return self._predict_locally(numbers, start, before, after)

    def _steps(self, stage: int, numbers: IntArray) -> FloatArray:
        """(N, 3) how far the points moved a stage when last seen twice within a few stages.

        A point seen once moves as those in the middle of the others do.
        """
        steps = np.full((len(numbers), 3), np.nan)
        now = self.stages[stage].position_mm[_rows(self.stages[stage], numbers)]
        by_before: dict[int, list[int]] = {}  # stage that saw them before -> rows of steps
        for k, number in enumerate(numbers.tolist()):
            last_two = self.seen[number][-2:]  # the last of them is ``stage``
            if len(last_two) == 2 and stage - last_two[0] <= _RECENT:
                by_before.setdefault(last_two[0], []).append(k)
        for before, rows in by_before.items():
            old = self.stages[before]
            moved = now[rows] - old.position_mm[_rows(old, numbers[rows])]
            steps[rows] = moved / (stage - before)
        known = np.isfinite(steps[:, 0])
        steps[~known] = np.median(steps[known], axis=0) if known.any() else 0.0
        return steps

    def _predict_locally(
        self, numbers: IntArray, start: FloatArray, before: FloatArray, after: FloatArray
    ) -> _Predictions:
        """The rigid motion of the coded points around, the nearer the heavier.

        How far the object bends between them is not known: the spacing alone
        limits the gate. All points keep some weight, because the nearest may
        stand in one line and then leave the turn about it open.
        """
        position = np.empty_like(start)
        count = min(self.options.neighbours, len(before))
        for k, point in enumerate(start):
            distance = np.linalg.norm(before - point, axis=1)
            reach = np.partition(distance, count - 1)[count - 1]
            weight = 1 / (1 + (distance / reach) ** 2) ** 2
            rotation, translation, _ = fit_rigid(after, before, weight)
            position[k] = rotation @ point + translation
        return _Predictions(numbers, position, np.full(len(start), np.nan))

    def _assign(self, now: _Snapshot, predicted: _Predictions) -> list[tuple[int, int]]:
        loose = np.flatnonzero(now.id < 0)
        if not len(loose) or not len(predicted.id):
            return []
        gate = self._limit_by_spacing(predicted, now.position_mm)
        distance = np.linalg.norm(
            predicted.position_mm[:, None] - now.position_mm[loose][None], axis=2
        )
        cost = np.where(distance <= gate[:, None], distance, _NO_LINK)
        known, found = linear_sum_assignment(cost)
        return [
            (int(loose[f]), int(predicted.id[k]))
            for k, f in zip(known, found, strict=True)
            if cost[k, f] < _NO_LINK
        ]

    def _limit_by_spacing(self, predicted: _Predictions, positions: FloatArray) -> FloatArray:
        """Never reach over to a neighbour: the gate ends before half the spacing."""
        share = self.options.max_share_of_spacing
        limit = np.full(len(predicted.id), np.inf)
        # The second nearest of either cloud is the nearest point that could be
        # confused with the predicted one.
        for cloud in (predicted.position_mm, positions):
            if len(cloud) > 1:
                spacing = np.asarray(cKDTree(cloud).query(predicted.position_mm, k=2)[0])
                limit = np.minimum(limit, share * spacing[:, 1])
        gate: FloatArray = np.fmin(predicted.gate_mm, limit)
        return gate


def link_stages(
    stages: Sequence[StagePoints], first_free_id: int, options: LinkOptions | None = None
) -> list[IntArray]:
    """Number the points of every stage: codes keep theirs, un-coded get numbers that stay.

    An un-coded point is predicted from the stage that saw it last: by the
    rigid motion of the identified points that both stages share; where the
    object deforms, by that of the points around it; without any, by its
    own motion so far. It is linked to the measured point within the prediction's gate,
    never farther than a share of the distance to the next point. A coded point
    whose ring could not be read is followed alike, and an un-coded number whose
    ring is read later becomes that code at all stages.

    Parameters
    ----------
    stages : the points of each stage, in order.
    first_free_id : the first number for un-coded points: above the family's
        largest code.

    Returns
    -------
    list of (P_s,) arrays
        The number of every point of every stage.
    """
    linker = _Linker(first_free_id, options or LinkOptions())
    return [linker.add(points) for points in stages]


def build_trajectories(
    stages: Sequence[StagePoints],
    numbers: Sequence[IntArray],
    stage_number: IntArray,
    time_s: FloatArray,
    camera_names: Sequence[str],
) -> Trajectories:
    """Trajectories (S, P, ...) of the numbered points; NaN where a stage lacks a point."""
    point_id = np.unique(np.concatenate([*numbers, np.empty(0, np.int32)])).astype(np.int32)
    shape = (len(stages), len(point_id))
    position = np.full((*shape, 3), np.nan)
    cov = np.full((*shape, 6), np.nan)
    cov_image = np.full((*shape, 6), np.nan)
    used = np.zeros((*shape, len(camera_names)), dtype=bool)
    rms = np.full(shape, np.nan)
    for s, (points, ids) in enumerate(zip(stages, numbers, strict=True)):
        column = np.searchsorted(point_id, ids)
        position[s, column] = points.position_mm
        cov[s, column] = cov6_from_matrix(points.cov_image_mm2 + points.cov_rig_mm2)
        cov_image[s, column] = cov6_from_matrix(points.cov_image_mm2)
        used[s, column] = points.target >= 0
        rms[s, column] = points.rms_px
    return Trajectories(
        stage=np.asarray(stage_number, dtype=np.int32),
        time_s=np.asarray(time_s, dtype=float),
        point_id=point_id,
        position_mm=position,
        cov_mm2=cov,
        cov_image_mm2=cov_image,
        cameras_used=used,
        rms_px=rms,
        camera_names=tuple(camera_names),
    )
