"""Looks at single stages of a measurement: whether a camera has moved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from videogrammetry.pipeline.chunk_record import ChunkRecord
from videogrammetry.pipeline.look_points import residuals_of_points
from videogrammetry.pipeline.look_residuals import LookTargets
from videogrammetry.pipeline.stability_warning import change_in_numbers, change_in_words
from videogrammetry.pipeline.static_points import StaticPoints
from videogrammetry.reconstruction import Triangulator
from videogrammetry.reconstruction.camera_scores import (
    PointResiduals,
    calibration_factor,
    camera_scores,
)
from videogrammetry.reconstruction.stability import PoseWatch
from videogrammetry.types import CameraSeries, FloatArray, IntArray, PointSet, RigData

#: Every so many stages of a long sequence are looked at, and of a short one all.
_EVERY, _SHORT = 4, 100
_NEVER = np.iinfo(np.int32).max


@dataclass(frozen=True, kw_only=True)
class Stability:
    """What the check of the cameras says.

    Attributes
    ----------
    warnings : a sentence for every camera that has moved. found : the same in numbers.
    unstable_from : (C,) the stage from which on a camera's points are flagged; larger than
        any stage: it stands. series : by the points' residuals, of the looks.
    """

    warnings: tuple[str, ...]
    found: tuple[dict[str, Any], ...]
    unstable_from: IntArray
    series: CameraSeries


class StabilityCheck:
    """Takes the records of all stages in their order.

    Parameters
    ----------
    rigs : first stage and rig of every part of the sequence, in their order; where a new
        part begins, so does the comparison with the first stages.
    stages : first and last of the sequence. static : points that do not move, or None.
    """

    def __init__(
        self,
        rigs: Sequence[tuple[int, RigData]],
        stages: tuple[int, int],
        static: PointSet | None = None,
    ) -> None:
        self._first = stages[0]
        total = stages[1] - stages[0] + 1
        self._every = 1 if total <= _SHORT else _EVERY
        begins = [stages[0], *(first for first, _ in rigs[1:]), stages[1] + 1]
        self._parts = [
            _Part(rig, static, -(-(end - begin) // self._every))
            for (_, rig), begin, end in zip(rigs, begins[:-1], begins[1:], strict=True)
        ]
        self._begins = np.array(begins[:-1])

    def add(self, record: ChunkRecord) -> None:
        """The next stages."""
        looked = np.flatnonzero((record.stage - self._first) % self._every == 0)
        number = np.searchsorted(self._begins, record.stage[looked], side="right") - 1
        for k in np.unique(number).tolist():
            self._parts[k].add(record, looked[number == k])

    def result(self) -> Stability:
        """Of all stages taken."""
        names = tuple(self._parts[0].rig.cameras)
        unstable = np.full(len(names), _NEVER, dtype=np.int32)
        warnings: list[str] = []
        found: list[dict[str, Any]] = []
        for number, part in enumerate(self._parts):
            reoriented = number > 0
            for by, watch in part.watches():
                watch.finish()
                for change in watch.changes:
                    cameras = [names[c] for c in change.cameras]
                    said = change_in_words(cameras, change, by, part.calibrated, reoriented)
                    if by == "rays" or not _same(found, cameras):
                        warnings.append(said)
                    found.append(change_in_numbers(cameras, change, by))
                    for c in change.cameras:
                        unstable[c] = min(unstable[c], change.after + 1)
        series = [part.rays.series() for part in self._parts if part.rays is not None]
        if not series:
            series = [PoseWatch(np.ones((len(names), 6)), 0).series()]
        return Stability(
            warnings=tuple(warnings),
            found=tuple(found),
            unstable_from=unstable,
            series=_joined(series),
        )


class _Part:
    """Stages that are measured with one rig."""

    def __init__(self, rig: RigData, static: PointSet | None, num_looks: int) -> None:
        self.rig, self._num_looks = rig, num_looks
        self.calibrated = rig.cov is not None
        self._triangulator = Triangulator(rig)
        self._factor = calibration_factor(rig)
        self._known = None if static is None else StaticPoints(rig, static)
        self.rays: PoseWatch | None = None
        self._static: PoseWatch | None = None

    def watches(self) -> list[tuple[str, PoseWatch]]:
        both = (("rays", self.rays), ("static points", self._static))
        return [(by, watch) for by, watch in both if watch is not None]

    def add(self, record: ChunkRecord, looked: npt.NDArray[np.intp]) -> None:
        stage = record.stage[looked]
        targets = LookTargets(record, looked, self.rig)
        points = residuals_of_points(record, targets, self.rig, self._triangulator)
        if len(points):
            if self.rays is None:
                self.rays = PoseWatch(_scale(self.rig, points.position_mm), self._num_looks)
            self.rays.add(stage, self._scores(points, len(looked)))
        if self._known is None:
            return
        known = self._known.residuals(targets)
        if len(known):
            if self._static is None:
                scale = _scale(self.rig, known.position_mm)
                self._static = PoseWatch(scale, self._num_looks, known=True)
            self._static.add(stage, self._scores(known, len(looked)))

    def _scores(self, points: PointResiduals, num_looks: int) -> Any:
        return camera_scores(self.rig, points, num_looks, self._factor)


def _scale(rig: RigData, points_mm: FloatArray) -> FloatArray:
    """(C, 6) what of every pose parameter moves the picture by about a pixel."""
    middle = np.median(points_mm, axis=0)
    scale = np.empty((len(rig.cameras), 6))
    for c, camera in enumerate(rig.cameras.values()):
        focal = abs(float(camera.interior[0]))
        distance = float(np.linalg.norm(middle - camera.centre_mm))
        scale[c] = [1 / focal] * 3 + [distance / focal] * 3
    return scale


def _joined(parts: Sequence[CameraSeries]) -> CameraSeries:
    names = ("stage", "turn_rad", "shift_mm", "sigma_turn_rad", "sigma_shift_mm", "chi2")
    return CameraSeries(
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in names},
        critical_chi2=parts[0].critical_chi2,
    )


def _same(found: Sequence[dict[str, Any]], cameras: Sequence[str]) -> bool:
    return any(entry["cameras"] == list(cameras) for entry in found)
