"""Positions for watching: pieces of a measurement as lines, while it goes on.

A point's number here comes of what was seen so far: in the measurement's file one without a code
may have another, where later stages tell more.
"""

from __future__ import annotations

import itertools
from typing import TextIO

import numpy as np

from videogrammetry.pipeline.chunk_record import ChunkRecord
from videogrammetry.project import TrajectoryTable, format_trajectories
from videogrammetry.tracking import Tracker
from videogrammetry.types import IntArray, matrix_from_cov6


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
        self._tracker = Tracker(first_free_id)
        self._begun = False

    def add(self, record: ChunkRecord) -> None:
        """Writes the stages of a record, which follow those of the last one."""
        text = self._lines(record, self._numbers(record))
        if self._begun:
            text = text.partition("\n")[2]
        self._begun = True
        for stream in self._streams:
            stream.write(text)
            stream.flush()

    def _numbers(self, record: ChunkRecord) -> IntArray:
        """The points' numbers, as far as the stages until then tell."""
        cov = matrix_from_cov6(record.cov_image_mm2)
        numbers = np.empty(len(record.point_code), np.int32)
        for a, b in itertools.pairwise(record.point_offsets().tolist()):
            links = self._tracker.add(record.point_code[a:b], record.position_mm[a:b], cov[a:b])
            numbers[a:b] = links.number
        return numbers

    def _lines(self, record: ChunkRecord, numbers: IntArray) -> str:
        stage = np.repeat(record.stage, record.point_count)
        time_s = (stage - 1) / self._rate if self._rate else np.full(len(stage), np.nan)
        return format_trajectories(
            TrajectoryTable(
                stage=stage,
                time_s=time_s,
                point=tuple(map(str, numbers.tolist())),
                position_mm=record.position_mm,
                sigma_mm=np.sqrt(record.cov_mm2[:, [0, 3, 5]]),
                cameras=tuple(tuple(self._names[used]) for used in record.cameras_used),
            )
        )
