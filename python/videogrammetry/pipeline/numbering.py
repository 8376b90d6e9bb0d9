"""Numbers for the points of chunks of stages, one after the other."""

from __future__ import annotations

import itertools
from collections import deque

import numpy as np
import numpy.typing as npt

from videogrammetry.pipeline.chunk_record import SURE_LOG_ODDS, ChunkRecord
from videogrammetry.tracking import LinkOptions, ManyLinks, Tracker
from videogrammetry.types import IntArray


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
        links = self._tracker.add_stages(
            offsets, record.point_code, record.position_mm, record.cov_image_mm2
        )
        numbers = links.number
        unsure = links.log_odds < SURE_LOG_ODDS  # NaN, where a number begins, is not
        self.numbers.append(numbers)
        self.unsure.append(unsure)
        if len(links.renames) or len(links.revised_at):
            self._change(links, offsets)
        last = len(self.numbers) - 1
        for number in np.unique(numbers).tolist():
            self._begins(number, last)
        rows = list(itertools.pairwise(offsets.tolist()))
        self._recent.extend((numbers[a:b], unsure[a:b]) for a, b in rows)
        self._stages += len(rows)

    def _change(self, links: ManyLinks, offsets: npt.NDArray[np.int64]) -> None:
        """Applies what the last chunk's stages say of those before, in their order."""
        first, rename_at = self._stages - len(self._recent), links.renames[:, 0]
        revised = np.stack([links.revised_stage, links.revised_row, links.revised_number], axis=1)
        for s in np.union1d(rename_at, links.revised_at).tolist():
            for _, old, new in links.renames[rename_at == s].tolist():
                self._rename(old, new, int(offsets[s]))
            now = np.flatnonzero(links.revised_at == s)
            for (stage, row, number), odds in zip(
                revised[now].tolist(), links.revised_log_odds[now].tolist(), strict=True
            ):
                if stage >= self._stages:
                    row += int(offsets[stage - self._stages])
                    of_stage, marks = self.numbers[-1], self.unsure[-1]
                else:
                    of_stage, marks = self._recent[stage - first]
                of_stage[row], marks[row] = number, odds < SURE_LOG_ODDS
                self._begins(number, max(len(self.numbers) - 2, 0))

    def _begins(self, number: int, chunk: int) -> None:
        if chunk < self._begun.get(number, chunk + 1):
            self._begun[number] = chunk

    def _rename(self, old: int, new: int, until: int) -> None:
        """At all stages before, of the last chunk the points before ``until``."""
        last = len(self.numbers) - 1
        first = self._begun.pop(old, last)
        for of_chunk in (*self.numbers[first:last], self.numbers[last][:until]):
            of_chunk[of_chunk == old] = new
        self._begins(new, first)
