"""Where the parts of a measurement go besides a file: into arrays, into a table of stages."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from videogrammetry.matching import TARGET_STATUS
from videogrammetry.motion import MotionPlan
from videogrammetry.pipeline.assemble import Sink
from videogrammetry.pipeline.chunk_store import Chunk
from videogrammetry.pipeline.linking import Linked
from videogrammetry.pipeline.totals import Totals
from videogrammetry.types import (
    POINT_FLAGS,
    IntArray,
    Motion,
    TargetRecords,
    Trajectories,
)

#: Of a point at a stage: position, displacement, velocity, four covariances, the residual.
_PLACE_BYTES = 8 * (3 + 3 + 3 + 4 * 6 + 1)
#: Of a target: centre, axes, angle, standard deviations, residuals.
_TARGET_BYTES = 8 * (2 + 2 + 1 + 2 + 2)
_FILLED = np.uint8(1 << POINT_FLAGS.index("filled"))
_COMMON = ("reference_stage", "centroid_points", "point_id", "camera_names")


def least_bytes(linked: Linked, chunks: Sequence[Chunk]) -> int:
    """Bytes that the numbers of a measurement's file take at least; no more than it has."""
    first, last = np.sort(linked.first), np.sort(linked.last)
    places = sum(
        (end - begin + 1) * int(np.searchsorted(first, k, "right") - np.searchsorted(last, k))
        for k, (begin, end) in enumerate(chunks)
    )
    return _PLACE_BYTES * places + _TARGET_BYTES * linked.num_targets


class ArraySink:
    """Gathers a measurement in memory.

    Attributes
    ----------
    trajectories, motion, records : whole when all parts were taken.
    """

    def __init__(self, linked: Linked, plan: MotionPlan, camera_names: tuple[str, ...]) -> None:
        self._linked, self._plan, self._names = linked, plan, camera_names
        self._parts: list[tuple[IntArray, Trajectories, Motion]] = []
        self._targets: list[TargetRecords] = []

    def points(self, row: int, columns: IntArray, part: Trajectories, motion: Motion) -> None:
        """The next stages."""
        self._parts.append((columns, part, motion))

    def targets(self, row: int, part: TargetRecords) -> None:
        """The next targets."""
        self._targets.append(part)

    @property
    def trajectories(self) -> Trajectories:
        """Of all stages and points."""
        names = [n for n in Trajectories.__dataclass_fields__ if n not in _COMMON]
        parts = [(columns, part) for columns, part, _ in self._parts]
        return Trajectories(
            point_id=self._linked.point_id,
            camera_names=self._names,
            **{name: self._joined(name, parts) for name in names},
        )

    @property
    def motion(self) -> Motion:
        """Of all stages and points."""
        names = [n for n in Motion.__dataclass_fields__ if n not in _COMMON]
        parts = [(columns, motion) for columns, _, motion in self._parts]
        return Motion(
            reference_stage=int(self._plan.reference.stage[0]),
            centroid_points=self._plan.centroid_points,
            **{name: self._joined(name, parts) for name in names},
        )

    @property
    def records(self) -> TargetRecords:
        """Of all stages."""
        names = TargetRecords.__dataclass_fields__
        return TargetRecords(
            **{name: np.concatenate([getattr(t, name) for t in self._targets]) for name in names}
        )

    def _joined(self, name: str, parts: Sequence[tuple[IntArray, Trajectories | Motion]]) -> Any:
        values = [(columns, getattr(part, name)) for columns, part in parts]
        if name in ("stage", "time_s") or name.startswith("centroid_"):
            return np.concatenate([value for _, value in values])
        example = values[0][1]
        shape = (sum(len(v) for _, v in values), len(self._linked.point_id), *example.shape[2:])
        whole = np.full(shape, np.nan if example.dtype.kind == "f" else 0, example.dtype)
        row = 0
        for columns, value in values:
            whole[row : row + len(value), columns] = value
            row += len(value)
        return whole


class StageTable:
    """A measurement in short.

    Attributes
    ----------
    totals : counts of its targets. warnings : what is to be said.
    num_points : (S,) points of every stage. rms_px, sigma_mm : (S,) their medians.
    centroid_displacement_mm : (S, 3).
    everywhere : points that were measured at all stages.
    """

    def __init__(self, totals: Totals, warnings: Sequence[str]) -> None:
        count = len(totals.stage)
        self.totals, self.warnings = totals, tuple(warnings)
        self.stage = totals.stage
        self.num_targets = totals.targets.sum(axis=1)
        self.num_points = np.zeros(count, dtype=np.int64)
        self.rms_px = np.full(count, np.nan)
        self.sigma_mm = np.full(count, np.nan)
        self.centroid_displacement_mm = np.full((count, 3), np.nan)
        self._seen: dict[int, int] = {}

    @property
    def points(self) -> int:
        """Number of different points."""
        return len(self._seen)

    @property
    def everywhere(self) -> int:
        """Number of points that were measured at all stages."""
        return sum(n == len(self.stage) for n in self._seen.values())

    def status_counts(self) -> dict[str, int]:
        """How many targets came to which end, also those that none came to."""
        return dict(zip(TARGET_STATUS, self.totals.status.tolist(), strict=True))

    def points_taken(self, row: int, part: Trajectories, motion: Motion) -> None:
        """Counts the stages of a part."""
        rows = slice(row, row + len(part.stage))
        there = np.isfinite(part.position_mm[..., 0]) & (part.flags & _FILLED == 0)
        self.num_points[rows] = there.sum(axis=1)
        sigma = np.sqrt(part.cov_mm2[..., [0, 3, 5]].sum(axis=2))
        for s in np.flatnonzero(there.any(axis=1)).tolist():
            self.rms_px[row + s] = np.median(part.rms_px[s, there[s]])
            self.sigma_mm[row + s] = np.median(sigma[s, there[s]])
        self.centroid_displacement_mm[rows] = motion.centroid_displacement_mm
        for number, count in zip(part.point_id.tolist(), there.sum(axis=0).tolist(), strict=True):
            if count:
                self._seen[number] = self._seen.get(number, 0) + count


class TeeSink:
    """Gives what it takes to another sink, and to a table of stages."""

    def __init__(self, sink: Sink, table: StageTable) -> None:
        self._sink, self._table = sink, table

    def points(self, row: int, columns: IntArray, part: Trajectories, motion: Motion) -> None:
        """The next stages."""
        self._sink.points(row, columns, part, motion)
        self._table.points_taken(row, part, motion)

    def targets(self, row: int, part: TargetRecords) -> None:
        """The next targets."""
        self._sink.targets(row, part)
