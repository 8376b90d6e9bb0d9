"""Numbers for the points of chunks of stages, one after the other."""

from __future__ import annotations

import itertools
from collections import deque

import numpy as np
import numpy.typing as npt

from videogrammetry.pipeline.chunk_record import SURE_LOG_ODDS, ChunkRecord
from videogrammetry.tracking import LinkOptions, Tracker
from videogrammetry.types import IntArray, matrix_from_cov6


class Numbering:
    """Follows the points over all stages; keeps a number and a mark of each, nothing else.

    Attributes
    ----------
    numbers : of every chunk added the numbers of its points.
    unsure : of every chunk whether another number was not much less likely.
    """

    def __init__(self, first_free_id: int) -> None:
        options = LinkOptions()
        self._tracker = Tracker(first_free_id, options)
        self.numbers: list[IntArray] = []
        self.unsure: list[npt.NDArray[np.bool_]] = []
        self._begun: dict[int, int] = {}  # number -> the first chunk that has it
        # Views of the last stages: no decision is revised further back.
        self._recent: deque[tuple[IntArray, npt.NDArray[np.bool_]]] = deque(
            maxlen=options.window_stages + 1
        )
        self._stages = 0

    def add(self, record: ChunkRecord) -> None:
        """The next chunk."""
        offsets = record.point_offsets()
        cov = matrix_from_cov6(record.cov_image_mm2)
        numbers = np.empty(offsets[-1], np.int32)
        unsure = np.zeros(offsets[-1], bool)
        self.numbers.append(numbers)
        self.unsure.append(unsure)
        for a, b in itertools.pairwise(offsets.tolist()):
            links = self._tracker.add(record.point_code[a:b], record.position_mm[a:b], cov[a:b])
            for old, new in links.renames.tolist():
                self._rename(old, new)
            first = self._stages - len(self._recent)
            for stage, row, number, odds in zip(
                links.revised_stage.tolist(),
                links.revised_row.tolist(),
                links.revised_number.tolist(),
                links.revised_log_odds.tolist(),
                strict=True,
            ):
                of_stage, marks = self._recent[stage - first]
                of_stage[row], marks[row] = number, odds < SURE_LOG_ODDS
                self._begins(number, max(len(self.numbers) - 2, 0))
            numbers[a:b] = links.number
            unsure[a:b] = links.log_odds < SURE_LOG_ODDS  # NaN, where a number begins, is not
            for number in links.number.tolist():
                self._begins(number, len(self.numbers) - 1)
            self._recent.append((numbers[a:b], unsure[a:b]))
            self._stages += 1

    def _begins(self, number: int, chunk: int) -> None:
        if chunk < self._begun.get(number, chunk + 1):
            self._begun[number] = chunk

    def _rename(self, old: int, new: int) -> None:
        first = self._begun.pop(old, 0)
        for of_chunk in self.numbers[first:]:
            of_chunk[of_chunk == old] = new
        self._begins(new, first)
