"""Positions for watching: pieces of a measurement as lines, while it goes on.

A point's number here comes of what was seen so far: one without a code may get another number
after a gap, or in the measurement's file.
"""

from __future__ import annotations

import dataclasses
from collections import deque
from typing import TextIO

import numpy as np

from videogrammetry.pipeline.assemble import link_chunks
from videogrammetry.pipeline.chunk_record import ChunkRecord
from videogrammetry.pipeline.chunk_store import MemoryStore
from videogrammetry.project import TrajectoryTable, format_trajectories

#: Stages before a piece that its points are linked to.
_WINDOW = 20


class LiveTable:
    """Writes the points of pieces of consecutive stages as lines of a trajectories CSV.

    Parameters
    ----------
    streams : where to; a header line first. camera_names : in the records' order.
    first_free_id : the first number for un-coded points.
    frame_rate_hz : None: times stay empty.
    """

    def __init__(
        self,
        streams: list[TextIO],
        camera_names: tuple[str, ...],
        first_free_id: int,
        frame_rate_hz: float | None,
    ) -> None:
        self._streams, self._rate = streams, frame_rate_hz
        self._names = np.array(camera_names, dtype=object)
        self._next_id = first_free_id
        self._window: deque[ChunkRecord] = deque()
        self._begun = False

    def add(self, record: ChunkRecord) -> None:
        """Writes the stages of a record, which follow those of the last one."""
        numbered = self._numbered(record)
        text = self._lines(numbered)
        if self._begun:
            text = text.partition("\n")[2]
        self._begun = True
        for stream in self._streams:
            stream.write(text)
            stream.flush()

    def _numbered(self, record: ChunkRecord) -> ChunkRecord:
        """The record with the points' numbers in place of their codes."""
        store = MemoryStore()
        records = [*self._window, record]
        chunks = [(int(r.stage[0]), int(r.stage[-1])) for r in records]
        for chunk, one in zip(chunks, records, strict=True):
            store.put(chunk, one)
        # Numbers given before stand there as codes, so that they are not changed any more.
        numbers = link_chunks(store, chunks, self._next_id).numbers[-1]
        self._next_id = max(self._next_id, int(numbers.max(initial=-1)) + 1)
        numbered = dataclasses.replace(record, point_code=numbers)
        self._window.append(numbered)
        while sum(len(r.stage) for r in list(self._window)[1:]) >= _WINDOW:
            self._window.popleft()
        return numbered

    def _lines(self, record: ChunkRecord) -> str:
        stage = np.repeat(record.stage, record.point_count)
        time_s = (stage - 1) / self._rate if self._rate else np.full(len(stage), np.nan)
        return format_trajectories(
            TrajectoryTable(
                stage=stage,
                time_s=time_s,
                point=tuple(map(str, record.point_code.tolist())),
                position_mm=record.position_mm,
                sigma_mm=np.sqrt(record.cov_mm2[:, [0, 3, 5]]),
                cameras=tuple(tuple(self._names[used]) for used in record.cameras_used),
            )
        )
