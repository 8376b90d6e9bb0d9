"""The work of a measurement, cut into chunks of stages that know nothing of each other."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from videogrammetry.calibration.calibrated_volume import CalibratedVolume
from videogrammetry.matching import MatchingOptions
from videogrammetry.pipeline.chunk import CameraTargets, measure_targets
from videogrammetry.pipeline.chunk_record import ChunkRecord, join_records, make_record
from videogrammetry.project import plain
from videogrammetry.recognition import (
    CameraModel,
    RecognitionOptions,
    TargetSequence,
    TrackedOptions,
    learn_camera,
    recognize_sequence,
)
from videogrammetry.reconstruction import CalibrationField, Triangulator
from videogrammetry.types import FrameSource, RigData

#: Stages of a chunk: a second of work at most, a few megabytes of results. Never
#: changed by the number of threads or workers, because targets are followed within a chunk.
CHUNK_STAGES = 100

#: The method that follows targets and measures by a camera's model.
_FOLLOWS = "edge-pair"


@dataclass(frozen=True, kw_only=True)
class ChunkOptions:
    """How stages are measured.

    Attributes
    ----------
    recognition, matching : options of these rooms.
    full_every : targets are followed from frame to frame, and every so many frames of a
        chunk the whole frame is searched; 1: always.
    diameter_mm, thickness_mm : of all targets' circles, as in :func:`measure_frames`.
    later : stages, ascending, from which on the cameras stand otherwise, with the rig then.
    """

    recognition: RecognitionOptions
    matching: MatchingOptions
    full_every: int = 25
    diameter_mm: float | None = None
    thickness_mm: float = 0.0
    later: tuple[tuple[int, RigData], ...] = ()


class ChunkWorker:
    """Measures chunks of stages; several threads may do so with one worker.

    Parameters
    ----------
    rig : the cameras, in the order of ``sources``.
    sources : camera -> its frames.
    options : how.
    models : camera -> what its pictures have in common, :func:`learn_models`.
    """

    def __init__(
        self,
        rig: RigData,
        sources: Mapping[str, FrameSource],
        options: ChunkOptions,
        models: Mapping[str, CameraModel | None],
    ) -> None:
        self._sources, self._options, self._models = sources, options, models
        triangulators = [Triangulator(r) for r in (rig, *(later for _, later in options.later))]
        self._rigs = [(t, CalibrationField(t)) for t in triangulators]
        self._volume = CalibratedVolume(rig)

    def __call__(self, first: int, last: int) -> ChunkRecord:
        """The stages ``first`` to ``last``, from 1, inclusive."""
        found = [self._recognize(name, first, last) for name in self._sources]
        whole = np.stack(
            [np.ones(len(f), bool) if f.full is None else f.full for f in found], axis=1
        )
        cameras = [CameraTargets(sequence.targets, sequence.offsets) for sequence in found]
        options, records = self._options, []
        for rig, begin, end in self._parts(first, last):
            triangulator, field = self._rigs[rig]
            rows = slice(begin - first, end - first + 1)
            result = measure_targets(
                triangulator,
                [camera.rows(rows) for camera in cameras],
                options.matching,
                field,
                options.diameter_mm,
                options.thickness_mm,
            )
            stage = np.arange(begin, end + 1, dtype=np.int32)
            records.append(make_record(result, stage, self._volume, whole[rows]))
        return join_records(records)

    def _parts(self, first: int, last: int) -> list[tuple[int, int, int]]:
        """Number of the rig, first and last of the stages that are measured with it."""
        begins = [first, *(stage for stage, _ in self._options.later), last + 1]
        parts = []
        for rig, (begin, end) in enumerate(pairwise(begins)):
            begin, end = max(begin, first), min(end - 1, last)
            if begin <= end:
                parts.append((rig, begin, end))
        return parts

    def _recognize(self, name: str, first: int, last: int) -> TargetSequence:
        options = self._options
        follows = options.recognition.method == _FOLLOWS
        track = TrackedOptions(full_every=options.full_every) if follows else None
        return recognize_sequence(
            self._sources[name],
            options.recognition,
            camera=(self._models.get(name) or "learn") if follows else None,
            track=track,
            first=first - 1,
            last=last - 1,
            num_threads=1,
        )


def learn_models(
    sources: Mapping[str, FrameSource], recognition: RecognitionOptions, stages: tuple[int, int]
) -> dict[str, CameraModel | None]:
    """What the pictures of every camera have in common, from a few of the first chunk's.

    Not of all: what a stage gives must not depend on how much is recorded after it, so that
    a recording can be measured while it is written. Of a camera that sees no target there,
    every chunk learns for itself.
    """
    first, last = chunks_of(*stages)[0]
    return {
        name: learn_camera(source, recognition, first=first - 1, last=last - 1)
        for name, source in sources.items()
    }


def chunks_of(first: int, last: int) -> list[tuple[int, int]]:
    """First and last stage of every chunk of the stages from ``first`` to ``last``.

    Examples
    --------
    >>> chunks_of(3, 210)
    [(3, 102), (103, 202), (203, 210)]
    """
    return [
        (begin, min(begin + CHUNK_STAGES - 1, last))
        for begin in range(first, last + 1, CHUNK_STAGES)
    ]


def fingerprint(
    rig: RigData,
    options: ChunkOptions,
    models: Mapping[str, CameraModel | None],
    files: Sequence[Any],
) -> str:
    """A digest of all that a chunk's result depends on: equal ones may share their parts."""
    digest = hashlib.sha256()
    told = {
        "options": plain(options),
        "models": {n: None if m is None else m.to_dict() for n, m in models.items()},
        "rig": plain(rig.cameras),
        "floor": plain(rig.sigma_floor_px),
        "files": plain(files),
        "chunk": CHUNK_STAGES,
    }
    digest.update(json.dumps(told, sort_keys=True).encode())
    for array in (rig.cov, rig.volume_mm, rig.volume_seen):
        if array is not None:
            digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
