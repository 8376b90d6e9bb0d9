"""Positions where stages lack a point, filled chunk by chunk."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from videogrammetry.pipeline.assemble import TrajectoryBuilder
from videogrammetry.pipeline.chunk_store import Chunk, ChunkStore
from videogrammetry.pipeline.frames import Progress, map_bounded, silent
from videogrammetry.pipeline.linking import FilledPlaces, Linked
from videogrammetry.tracking import FillOptions, fill_gaps

#: Stages before and after a gap that say something of it: as in
#: ``cpp/videogrammetry/tracking/smoother.cc``.
_REACH = 12


@dataclass(frozen=True)
class _Window:
    """Consecutive stages around a chunk: the chunk's are rows begin to end of them.

    ``first``: the first of the stages, counted over all chunks. ``pieces``: chunk and its rows.
    """

    first: int
    begin: int
    end: int
    pieces: list[tuple[int, slice]]


def fill_chunks(
    store: ChunkStore,
    chunks: Sequence[Chunk],
    linked: Linked,
    builder: TrajectoryBuilder,
    largest_gap: int,
    progress: Progress = silent,
    num_threads: int = 0,
) -> list[FilledPlaces]:
    """What fills the gaps of at most ``largest_gap`` stages, chunk by chunk.

    A gap is filled once, with the chunk in which it begins, from that chunk's stages and
    those around it as far as they have a say: the same however many threads there are, and
    both sides of a chunk's border fit each other. What motion the points have
    is learnt from these stages too. The model: :func:`videogrammetry.tracking.fill_gaps`.
    """
    offsets = np.concatenate([[0], np.cumsum([b - a + 1 for a, b in chunks])])

    def work(k: int) -> FilledPlaces:
        window = _window(offsets, k, largest_gap)
        return _fill_one(store, chunks, linked, builder, largest_gap, window)

    found = []
    for k, part in enumerate(map_bounded(work, range(len(chunks)), num_threads)):
        found.append(part)
        progress(k + 1, len(chunks), "filling gaps")
    places = FilledPlaces.joined(found)
    return [places.between(int(a), int(b)) for a, b in pairwise(offsets)]


def _window(offsets: npt.NDArray[np.int64], k: int, largest_gap: int) -> _Window:
    first = max(int(offsets[k]) - _REACH, 0)
    last = min(int(offsets[k + 1]) + largest_gap + _REACH, int(offsets[-1]))
    pieces = []
    for j in range(int(np.searchsorted(offsets, first, "right")) - 1, len(offsets) - 1):
        begin, end = int(offsets[j]), int(offsets[j + 1])
        if begin >= last:
            break
        pieces.append((j, slice(max(first, begin) - begin, min(last, end) - begin)))
    return _Window(first, int(offsets[k]) - first, int(offsets[k + 1]) - first, pieces)


def _fill_one(
    store: ChunkStore,
    chunks: Sequence[Chunk],
    linked: Linked,
    builder: TrajectoryBuilder,
    largest_gap: int,
    window: _Window,
) -> FilledPlaces:
    """Gaps that begin in a chunk, their stages counted over all chunks."""
    low, high = window.pieces[0][0], window.pieces[-1][0]
    columns = np.flatnonzero((linked.first <= high) & (linked.last >= low))
    pieces = [(store.get(chunks[j]), j, rows) for j, rows in window.pieces]
    table = builder.trajectories(pieces, columns)
    begin = _begins(np.isfinite(table.position_mm[..., 0]), largest_gap)
    begin[: window.begin] = begin[window.end :] = False
    if not begin.any():
        return FilledPlaces.none()
    filled, mask = fill_gaps(table, FillOptions(largest_gap=largest_gap))
    # Of every filled place the row at which its gap begins.
    rows = np.arange(len(mask))[:, None]
    starts = mask & ~np.concatenate([np.zeros_like(mask[:1]), mask[:-1]])
    start = np.maximum.accumulate(np.where(starts, rows, -1), axis=0)
    row, column = np.nonzero(mask & (start >= window.begin) & (start < window.end))
    return FilledPlaces(
        row=(row + window.first).astype(np.int64),
        column=columns[column].astype(np.int32),
        position_mm=filled.position_mm[row, column],
        cov_mm2=filled.cov_mm2[row, column],
        cov_image_mm2=filled.cov_image_mm2[row, column],
    )


def _begins(seen: npt.NDArray[np.bool_], largest_gap: int) -> npt.NDArray[np.bool_]:
    """(S, P) where gaps of at most ``largest_gap`` stages begin.

    Examples
    --------
    >>> seen = np.array([[1, 0, 0, 1, 0, 1, 0]], dtype=bool).T
    >>> np.flatnonzero(_begins(seen, 2)).tolist(), np.flatnonzero(_begins(seen, 1)).tolist()
    ([1, 4], [4])
    """
    count = len(seen)
    rows = np.where(seen, np.arange(count)[:, None], count + largest_gap + 1)
    after = np.minimum.accumulate(rows[::-1], axis=0)[::-1]
    begin = np.zeros_like(seen)
    begin[1:] = seen[:-1] & ~seen[1:]
    return begin & (after - np.arange(count)[:, None] <= largest_gap)
