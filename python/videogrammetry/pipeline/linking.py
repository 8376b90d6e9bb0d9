"""What the records of all chunks say together: numbers for their points, the cameras' state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from videogrammetry.pipeline.chunk_record import ChunkRecord
from videogrammetry.pipeline.chunk_store import Chunk, ChunkStore
from videogrammetry.pipeline.numbering import Numbering
from videogrammetry.pipeline.stability import Stability, StabilityCheck
from videogrammetry.pipeline.totals import Totals
from videogrammetry.types import POINT_FLAGS, FloatArray, IntArray


@dataclass(frozen=True, kw_only=True)
class FilledPlaces:
    """Points at stages that lack them, estimated from what is around.

    Attributes
    ----------
    row : (F,) the stage's place. column : (F,) the point's place in ``Linked.point_id``.
    position_mm : (F, 3). cov_mm2, cov_image_mm2 : (F, 6).
    """

    row: npt.NDArray[np.int64]
    column: IntArray
    position_mm: FloatArray
    cov_mm2: FloatArray
    cov_image_mm2: FloatArray

    @classmethod
    def none(cls) -> FilledPlaces:
        """Nothing is filled."""
        nobody = np.empty(0, np.int64)
        return cls(
            row=nobody,
            column=nobody.astype(np.int32),
            position_mm=np.empty((0, 3)),
            cov_mm2=np.empty((0, 6)),
            cov_image_mm2=np.empty((0, 6)),
        )

    @classmethod
    def joined(cls, parts: Sequence[FilledPlaces]) -> FilledPlaces:
        """All of them, by stage and point."""
        joined = {n: np.concatenate([getattr(p, n) for p in parts]) for n in _PLACES}
        order = np.lexsort([joined["column"], joined["row"]])
        return cls(**{name: values[order] for name, values in joined.items()})

    def between(self, first: int, last: int) -> FilledPlaces:
        """Those of the stages from ``first`` to before ``last``, counted from ``first``."""
        a, b = np.searchsorted(self.row, [first, last]).tolist()
        own = {name: getattr(self, name)[a:b] for name in _PLACES}
        return FilledPlaces(**(own | {"row": own["row"] - first}))


_PLACES = tuple(FilledPlaces.__dataclass_fields__)


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
    point_count : of every chunk those of its stages. filled : of every chunk what fills its
        gaps; empty: nothing was to be filled.
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
    point_count: list[IntArray] = field(default_factory=list)
    filled: list[FilledPlaces] = field(default_factory=list)

    def flags(self, record: ChunkRecord) -> npt.NDArray[np.uint8]:
        """(P,) those of a record's points, with what all stages say of the cameras."""
        if self.stability is None:
            return record.flags
        moved = record.stage[:, None] >= self.stability.unstable_from
        of_point = np.repeat(moved, record.point_count, axis=0) & record.cameras_used
        flag = np.uint8(1 << POINT_FLAGS.index("unstable_camera"))
        return record.flags | np.where(of_point.any(axis=1), flag, np.uint8(0))


class Linker:
    """Gives numbers to the points of all stages while later ones are still being measured.

    Parameters
    ----------
    store, chunks : all records, in the order of the stages, those to come too.
    first_free_id : the first number of un-coded points. check : of the cameras, or None.
    """

    def __init__(
        self,
        store: ChunkStore,
        chunks: Sequence[Chunk],
        first_free_id: int,
        check: StabilityCheck | None = None,
    ) -> None:
        self._store, self._chunks, self._check = store, chunks, check
        self._totals, self._numbering = Totals(), Numbering(first_free_id)
        self._num_targets = self._done = 0
        self._there: set[Chunk] = set()
        self._point_count: list[IntArray] = []

    def add(self, *there: Chunk) -> None:
        """More chunks, in any order, whose records the store has."""
        self._there.update(there)
        while self._done < len(self._chunks) and self._chunks[self._done] in self._there:
            self._link(self._store.get(self._chunks[self._done]))
            self._done += 1

    def _link(self, record: ChunkRecord) -> None:
        self._totals.add(record)
        self._numbering.add(record)
        if self._check is not None:
            self._check.add(record)
        self._num_targets += len(record.code_id)
        self._point_count.append(record.point_count)

    def result(self) -> Linked:
        """What all stages say together, when all chunks were added."""
        if self._done < len(self._chunks):
            raise ValueError(f"chunks: {self._chunks[self._done]} was not added")
        stability = None if self._check is None else self._check.result()
        return _linked(
            self._numbering, self._point_count, self._num_targets, self._totals, stability
        )


def link_chunks(
    store: ChunkStore,
    chunks: Sequence[Chunk],
    first_free_id: int,
    check: StabilityCheck | None = None,
) -> Linked:
    """Numbers for the points of all stages, and whether the cameras stood."""
    linker = Linker(store, chunks, first_free_id, check)
    linker.add(*chunks)
    return linker.result()


def _linked(
    numbering: Numbering,
    point_count: list[IntArray],
    num_targets: int,
    totals: Totals,
    stability: Stability | None,
) -> Linked:
    # What a chunk knows of its own points first: there are few of them a chunk.
    own = [np.unique(numbers, return_counts=True) for numbers in numbering.numbers]
    number = np.concatenate([n for n, _ in own])
    chunk_of = np.repeat(np.arange(len(own), dtype=np.int32), [len(n) for n, _ in own])
    point_id, column = np.unique(number, return_inverse=True)
    first = np.full(len(point_id), len(own), dtype=np.int32)
    last = np.full(len(point_id), -1, dtype=np.int32)
    np.minimum.at(first, column, chunk_of)
    np.maximum.at(last, column, chunk_of)
    weights = np.concatenate([c for _, c in own])
    count = np.bincount(column, weights, minlength=len(point_id)).astype(np.int32)
    return Linked(
        point_id=point_id,
        numbers=numbering.numbers,
        unsure=numbering.unsure,
        point_count=point_count,
        first=first,
        last=last,
        stages=count,
        num_targets=num_targets,
        totals=totals,
        stability=stability,
    )
