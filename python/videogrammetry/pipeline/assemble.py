"""From the records of chunks to trajectories and motion, part by part."""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Protocol

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
from videogrammetry.pipeline.frames import map_bounded
from videogrammetry.pipeline.linking import FilledPlaces, Linked
from videogrammetry.types import (
    POINT_FLAGS,
    IntArray,
    Motion,
    TargetRecords,
    Trajectories,
)

#: Stages times points that are looked at for the centroid's points; of more
#: points than that those seen most often.
_MOST_PLACES = 50_000_000


#: Of a point at a stage, trajectory and motion, and how much of that may wait to be written.
_PART_BYTES, _MOST_BYTES = 500, 20_000_000


class Sink(Protocol):
    """What takes a measurement part by part, in the order of the stages."""

    def points(self, row: int, columns: IntArray, part: Trajectories, motion: Motion) -> None:
        """Stages from ``row`` on, of the points at ``columns``; the others were not measured."""
        ...

    def targets(self, row: int, part: TargetRecords) -> None:
        """Targets from ``row`` on."""
        ...


class _Shared:
    """A record that several threads need, read by the first of them."""

    def __init__(self, store: ChunkStore, chunk: Chunk) -> None:
        self._store, self._chunk, self._lock = store, chunk, threading.Lock()
        self._record: ChunkRecord | None = None

    def get(self) -> ChunkRecord:
        with self._lock:
            if self._record is None:
                self._record = self._store.get(self._chunk)
            return self._record


def _with_neighbours(
    store: ChunkStore, chunks: Sequence[Chunk]
) -> Iterator[tuple[int, list[_Shared | None]]]:
    """The place of every chunk, with its record and those before and after it."""
    window: list[_Shared | None] = [None, None, _Shared(store, chunks[0])]
    for k in range(len(chunks)):
        after = _Shared(store, chunks[k + 1]) if k + 1 < len(chunks) else None
        window = [*window[1:], after]
        yield k, window


def assemble(
    store: ChunkStore,
    chunks: Sequence[Chunk],
    linked: Linked,
    plan: MotionPlan,
    builder: TrajectoryBuilder,
    sink: Sink,
) -> None:
    """Gives trajectories, motion and targets to ``sink``, a few chunks in memory at a time.

    Two threads compute the next parts while the sink takes one.
    """
    Part = tuple[IntArray, Trajectories, Motion, TargetRecords]

    def work(item: tuple[int, list[_Shared | None]]) -> Part:
        k, window = item
        # Points of the neighbours belong to it as well, for a step may begin or end here.
        columns = np.flatnonzero((linked.first <= k + 1) & (linked.last >= k - 1))
        before, record, after = (None if r is None else r.get() for r in window)
        assert record is not None
        pieces = [] if before is None else [(before, k - 1, slice(-1, None))]
        pieces.append((record, k, slice(None)))
        if after is not None:
            pieces.append((after, k + 1, slice(0, 1)))
        padded = builder.trajectories(pieces, columns)
        skip = 0 if before is None else 1
        rows = slice(skip, skip + len(record.stage))
        motion = motion_rows(motion_part(padded, plan), rows)
        part = trajectory_rows(padded, rows)
        return columns.astype(np.int32), part, motion, _target_records(record, linked.numbers[k])

    most = max(len(numbers) for numbers in linked.numbers)
    parts: Iterable[Part]
    if most * _PART_BYTES <= _MOST_BYTES:
        parts = map_bounded(work, _with_neighbours(store, chunks), 2)
    else:
        parts = map(work, _with_neighbours(store, chunks))
    target_row = 0
    for (begin, _), (columns, part, motion, targets) in zip(chunks, parts, strict=True):
        sink.points(begin - chunks[0][0], columns, part, motion)
        sink.targets(target_row, targets)
        target_row += len(targets)


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
    row = reference - chunks[k][0]
    of_stage = builder.trajectories([(store.get(chunks[k]), k, slice(row, row + 1))], every)
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
        point_count = linked.point_count[k]
        stage = np.repeat(np.arange(row, row + len(point_count)), point_count)
        column = at[np.searchsorted(linked.point_id, linked.numbers[k])]
        taken = column >= 0
        if left_out:
            taken &= linked.flags(store.get(chunk)) & left_out == 0
        measured[stage[taken], column[taken]] = True
        if linked.filled and not left_out & _FILLED:
            filled = linked.filled[k]
            known = at[filled.column] >= 0
            measured[row + filled.row[known], at[filled.column[known]]] = True
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
        pieces: Sequence[tuple[ChunkRecord, int, slice]],
        columns: npt.NDArray[np.intp],
    ) -> Trajectories:
        """Of the points at ``columns``, at consecutive stages.

        ``pieces``: a record, the place of its chunk, and which of its stages.
        """
        stage = np.concatenate([record.stage[rows] for record, _, rows in pieces])
        shape = (len(stage), len(columns))
        values = {
            name: np.full((*shape, *count), np.nan)
            for name, count in (("position_mm", (3,)), ("rms_px", ()), *_COVARIANCES)
        }
        values["cameras_used"] = np.zeros((*shape, len(self._cameras)), dtype=bool)
        values["flags"] = np.zeros(shape, dtype=np.uint8)
        place = np.full(len(self._linked.point_id), -1, dtype=np.intp)
        place[columns] = np.arange(len(columns))
        first = 0
        for record, chunk, rows in pieces:
            begin, end, _ = rows.indices(len(record.stage))
            self._put(values, first, record, chunk, (begin, end), place)
            if self._linked.filled:
                filled = self._linked.filled[chunk].between(begin, end)
                _put_filled(values, first, filled, place)
            first += end - begin
        rate = self._rate
        return Trajectories(
            stage=stage,
            time_s=(stage - 1) / rate if rate else np.full(len(stage), np.nan),
            point_id=self._linked.point_id[columns],
            camera_names=self._cameras,
            **values,
        )

    def _put(
        self,
        values: dict[str, npt.NDArray[Any]],
        first: int,
        record: ChunkRecord,
        chunk: int,
        rows: tuple[int, int],
        place: npt.NDArray[np.intp],
    ) -> None:
        """Puts the stages ``rows`` of a record to the rows from ``first`` on."""
        linked, offsets = self._linked, record.point_offsets()
        points = slice(offsets[rows[0]], offsets[rows[1]])
        column = place[np.searchsorted(linked.point_id, linked.numbers[chunk][points])]
        count = record.point_count[rows[0] : rows[1]]
        where = np.repeat(np.arange(first, first + len(count)), count)
        where = where * values["rms_px"].shape[1] + column
        there = column >= 0
        kept = None if there.all() else np.flatnonzero(there)
        unsure = linked.unsure[chunk][points] * np.uint8(_AMBIGUOUS)
        for name, full in values.items():
            own = getattr(record, name)[points]
            if name == "flags":
                own = linked.flags(record)[points] | unsure
            flat = full.reshape(-1, *full.shape[2:])
            if kept is None:
                flat[where] = own
            else:
                flat[where[kept]] = own[kept]


def _put_filled(
    values: dict[str, npt.NDArray[Any]],
    first: int,
    filled: FilledPlaces,
    place: npt.NDArray[np.intp],
) -> None:
    """Puts what fills gaps to the rows from ``first`` on."""
    column = place[filled.column]
    there = column >= 0
    row, column = first + filled.row[there], column[there]
    for name in ("position_mm", "cov_mm2", "cov_image_mm2"):
        values[name][row, column] = getattr(filled, name)[there]
    values["flags"][row, column] = _FILLED


_COVARIANCES = (("cov_mm2", (6,)), ("cov_image_mm2", (6,)))
_AMBIGUOUS = 1 << POINT_FLAGS.index("ambiguous")
_FILLED = 1 << POINT_FLAGS.index("filled")


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
