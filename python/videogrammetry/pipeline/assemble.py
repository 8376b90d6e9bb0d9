"""From the records of chunks to trajectories and motion, part by part."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from videogrammetry.motion import (
    MotionOptions,
    MotionPlan,
    constant_set,
    flag_mask,
    motion_part,
    motion_rows,
    plan_motion,
    trajectory_rows,
)
from videogrammetry.pipeline.chunk_record import ChunkRecord
from videogrammetry.pipeline.chunk_store import Chunk, ChunkStore
from videogrammetry.pipeline.numbering import Numbering
from videogrammetry.pipeline.stability import Stability, StabilityCheck
from videogrammetry.pipeline.totals import Totals
from videogrammetry.types import (
    POINT_FLAGS,
    FloatArray,
    IntArray,
    Motion,
    TargetRecords,
    Trajectories,
)

#: Stages times points that are looked at for the centroid's points; of more
#: points than that those seen most often.
_MOST_PLACES = 50_000_000


class Sink(Protocol):
    """What takes a measurement part by part, in the order of the stages."""

    def points(self, row: int, columns: IntArray, part: Trajectories, motion: Motion) -> None:
        """Stages from ``row`` on, of the points at ``columns``; the others were not measured."""
        ...

    def targets(self, row: int, part: TargetRecords) -> None:
        """Targets from ``row`` on."""
        ...


@dataclass
class Linked:
    """What the stages say together.

    Attributes
    ----------
    point_id : (P,) numbers of all points, ascending.
    numbers : of every chunk the numbers of its points. unsure : whether another number
        is not much less likely.
    first, last : (P,) the first and last chunk that has the point.
    stages : (P,) at how many stages it was measured.
    num_targets : of all stages. totals : what is said of them. stability : of the cameras.
    """

    point_id: IntArray
    numbers: list[IntArray]
    unsure: list[npt.NDArray[np.bool_]]
    first: IntArray
    last: IntArray
    stages: IntArray
    num_targets: int
    totals: Totals
    stability: Stability | None = None

    def flags(self, record: ChunkRecord) -> npt.NDArray[np.uint8]:
        """(P,) those of a record's points, with what all stages say of the cameras."""
        if self.stability is None:
            return record.flags
        moved = record.stage[:, None] >= self.stability.unstable_from
        of_point = np.repeat(moved, record.point_count, axis=0) & record.cameras_used
        flag = np.uint8(1 << POINT_FLAGS.index("unstable_camera"))
        return record.flags | np.where(of_point.any(axis=1), flag, np.uint8(0))


def link_chunks(
    store: ChunkStore,
    chunks: Sequence[Chunk],
    first_free_id: int,
    check: StabilityCheck | None = None,
) -> Linked:
    """Numbers for the points of all stages, and whether the cameras stood."""
    totals, numbering = Totals(), Numbering(first_free_id)
    num_targets = 0
    for chunk in chunks:
        record = store.get(chunk)
        totals.add(record)
        numbering.add(record)
        if check is not None:
            check.add(record)
        num_targets += len(record.code_id)
    stability = None if check is None else check.result()
    return _linked(numbering.numbers, numbering.unsure, num_targets, totals, stability)


def _linked(
    of_chunk: list[IntArray],
    unsure: list[npt.NDArray[np.bool_]],
    num_targets: int,
    totals: Totals,
    stability: Stability | None,
) -> Linked:
    sizes = [len(numbers) for numbers in of_chunk]
    point_id, column = np.unique(np.concatenate(of_chunk), return_inverse=True)
    chunk_of = np.repeat(np.arange(len(sizes), dtype=np.int32), sizes)
    first = np.full(len(point_id), len(sizes), dtype=np.int32)
    last = np.full(len(point_id), -1, dtype=np.int32)
    np.minimum.at(first, column, chunk_of)
    np.maximum.at(last, column, chunk_of)
    count = np.bincount(column, minlength=len(point_id)).astype(np.int32)
    return Linked(point_id, of_chunk, unsure, first, last, count, num_targets, totals, stability)


def assemble(
    store: ChunkStore,
    chunks: Sequence[Chunk],
    linked: Linked,
    plan: MotionPlan,
    builder: TrajectoryBuilder,
    sink: Sink,
) -> None:
    """Gives trajectories, motion and targets to ``sink``, two chunks in memory at a time."""
    before: Trajectories | None = None
    record = store.get(chunks[0])
    target_row = 0
    for k, (begin, _) in enumerate(chunks):
        after = store.get(chunks[k + 1]) if k + 1 < len(chunks) else None
        # Points of the neighbours belong to it as well, for a step may begin or end here.
        columns = np.flatnonzero((linked.first <= k + 1) & (linked.last >= k - 1))
        part = builder.trajectories(record, k, columns)
        padded = [] if before is None else [_at_columns(before, part)]
        padded.append(part)
        if after is not None:
            padded.append(builder.trajectories(after, k + 1, columns, 1))
        motion = motion_part(_joined(padded), plan)
        skip = 0 if before is None else 1
        motion = motion_rows(motion, slice(skip, skip + len(part.stage)))
        sink.points(begin - chunks[0][0], columns.astype(np.int32), part, motion)
        targets = _target_records(record, linked.numbers[k])
        sink.targets(target_row, targets)
        target_row += len(targets)
        before = trajectory_rows(part, slice(-1, None))
        if after is not None:
            record = after


def plan_of_chunks(
    store: ChunkStore,
    chunks: Sequence[Chunk],
    linked: Linked,
    camera_names: tuple[str, ...],
    options: MotionOptions,
) -> MotionPlan:
    """What the motion of all stages has in common.

    Raises
    ------
    ValueError
        The reference stage or a centroid's point was not measured.
    """
    reference = options.reference_stage if options.reference_stage is not None else chunks[0][0]
    where = [k for k, (a, b) in enumerate(chunks) if a <= reference <= b]
    if not where:
        raise ValueError(
            f"[motion] reference_stage {reference}: measured are {chunks[0][0]} to "
            f"{chunks[-1][1]}; name one of these"
        )
    k = where[0]
    builder = TrajectoryBuilder(linked, None, camera_names)
    every = np.arange(len(linked.point_id))
    part = builder.trajectories(store.get(chunks[k]), k, every)
    row = reference - chunks[k][0]
    of_stage = trajectory_rows(part, slice(row, row + 1))
    if options.centroid_points is None:
        candidates, measured = _measured(store, chunks, linked, flag_mask(options.leave_out))
        chosen = candidates[constant_set(measured)]
        options = dataclasses.replace(
            options, centroid_points=tuple(linked.point_id[chosen].tolist())
        )
    return plan_motion(of_stage, np.zeros((0, 0), bool), options)


def _measured(
    store: ChunkStore, chunks: Sequence[Chunk], linked: Linked, left_out: np.uint8
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.bool_]]:
    """Points that may be the centroid's, and the stages (S, N) at which they were measured."""
    num_stages = chunks[-1][1] - chunks[0][0] + 1
    count = min(len(linked.point_id), max(1, _MOST_PLACES // num_stages))
    candidates = np.sort(np.argsort(-linked.stages, kind="stable")[:count])
    at = np.full(len(linked.point_id), -1, dtype=np.intp)
    at[candidates] = np.arange(count)
    measured = np.zeros((num_stages, count), dtype=bool)
    row = 0
    for k, chunk in enumerate(chunks):
        record = store.get(chunk)
        point_count = record.point_count
        stage = np.repeat(np.arange(row, row + len(point_count)), point_count)
        column = at[np.searchsorted(linked.point_id, linked.numbers[k])]
        taken = (column >= 0) & (linked.flags(record) & left_out == 0)
        measured[stage[taken], column[taken]] = True
        row += len(point_count)
    return candidates, measured


class TrajectoryBuilder:
    """Makes trajectories, stage by point, of records."""

    def __init__(
        self, linked: Linked, frame_rate_hz: float | None, camera_names: tuple[str, ...]
    ) -> None:
        self._linked, self._rate, self._cameras = linked, frame_rate_hz, camera_names

    def trajectories(
        self,
        record: ChunkRecord,
        chunk: int,
        columns: npt.NDArray[np.intp],
        stages: int | None = None,
    ) -> Trajectories:
        """Of the points at ``columns``, at all or the first so many stages of a record."""
        stage, numbers = record.stage[:stages], self._linked.numbers[chunk]
        row = np.repeat(np.arange(len(record.stage)), record.point_count)
        index = np.flatnonzero(row < len(stage))
        place = np.full(len(self._linked.point_id), -1, dtype=np.intp)
        place[columns] = np.arange(len(columns))
        column = place[np.searchsorted(self._linked.point_id, numbers[index])]
        index, column = index[column >= 0], column[column >= 0]
        row = row[index]
        shape = (len(stage), len(columns))

        def spread(values: npt.NDArray[np.float64]) -> FloatArray:
            full = np.full((*shape, *values.shape[1:]), np.nan)
            full[row, column] = values[index]
            return full

        used = np.zeros((*shape, len(self._cameras)), dtype=bool)
        used[row, column] = record.cameras_used[index]
        flags = np.zeros(shape, dtype=np.uint8)
        unsure = self._linked.unsure[chunk][index] * np.uint8(_AMBIGUOUS)
        flags[row, column] = self._linked.flags(record)[index] | unsure
        rate = self._rate
        return Trajectories(
            stage=stage,
            time_s=(stage - 1) / rate if rate else np.full(len(stage), np.nan),
            point_id=self._linked.point_id[columns],
            position_mm=spread(record.position_mm),
            cov_mm2=spread(record.cov_mm2),
            cov_image_mm2=spread(record.cov_image_mm2),
            cameras_used=used,
            rms_px=spread(record.rms_px),
            camera_names=self._cameras,
            flags=flags,
        )


_AMBIGUOUS = 1 << POINT_FLAGS.index("ambiguous")
_PER_POINT = ("position_mm", "cov_mm2", "cov_image_mm2", "rms_px", "cameras_used", "flags")


def _at_columns(row: Trajectories, like: Trajectories) -> Trajectories:
    """The trajectories ``row`` with the points of ``like``."""
    there = np.isin(row.point_id, like.point_id)
    column = np.searchsorted(like.point_id, row.point_id[there])
    values = {}
    for name in _PER_POINT:
        old = getattr(row, name)
        empty = np.nan if old.dtype.kind == "f" else 0
        new = np.full((len(old), len(like.point_id), *old.shape[2:]), empty, old.dtype)
        new[:, column] = old[:, there]
        values[name] = new
    return Trajectories(
        stage=row.stage,
        time_s=row.time_s,
        point_id=like.point_id,
        camera_names=row.camera_names,
        **values,
    )


def _joined(parts: Sequence[Trajectories]) -> Trajectories:
    names = ("stage", "time_s", *_PER_POINT)
    return Trajectories(
        point_id=parts[0].point_id,
        camera_names=parts[0].camera_names,
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in names},
    )


def _target_records(record: ChunkRecord, numbers: IntArray) -> TargetRecords:
    """Every target of a record with the number of the point it went into."""
    num_stages, num_cameras = record.target_count.shape
    place = np.repeat(np.arange(num_stages * num_cameras), record.target_count.reshape(-1))
    point_id = np.full(len(place), -1, dtype=np.int32)
    seen = record.target_point >= 0
    point_id[seen] = numbers[record.target_point[seen]]
    return TargetRecords(
        stage=record.stage[place // num_cameras],
        camera=(place % num_cameras).astype(np.int32),
        centre_px=record.centre_px,
        semi_axes_px=record.semi_axes_px,
        angle_rad=record.angle_rad,
        sigma_px=record.sigma_px,
        code_id=record.code_id,
        point_id=point_id,
        residual_px=record.residual_px,
        match_status=record.match_status,
        ring_status=record.ring_status,
    )
