"""Measuring recordings while they are being written.

The chunks are those of :func:`measure_to_file`, measured as soon as they are whole, so that
the file at the end is the one that measuring afterwards gives. What is published meanwhile
comes from pieces of a chunk: some stages measured by themselves, which costs them twice.
"""

from __future__ import annotations

import dataclasses
import hashlib
import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from videogrammetry.errors import ProjectFileError, SequenceError
from videogrammetry.pipeline.chunk_job import (
    CHUNK_STAGES,
    ChunkOptions,
    ChunkWorker,
    chunks_of,
    fingerprint,
    learn_models,
)
from videogrammetry.pipeline.chunk_record import ChunkRecord
from videogrammetry.pipeline.chunk_store import FolderStore
from videogrammetry.pipeline.frames import Progress, map_bounded, silent
from videogrammetry.pipeline.measure import PARTS_FOLDER, Threads, finish_file, lock_path
from videogrammetry.pipeline.measure_job import (
    Models,
    chunk_options,
    fingerprint_of,
    job_of,
    read_project_rig,
    rig_in_order,
)
from videogrammetry.pipeline.measure_sources import frame_rate
from videogrammetry.pipeline.sinks import StageTable
from videogrammetry.project import Project, one_at_a_time
from videogrammetry.sequence import GrowingSource, LenientSource, RangeSource, open_growing
from videogrammetry.types import FrameSource, RigData

#: How often the recordings are looked at.
_POLL_S = 0.05


@dataclass(frozen=True, kw_only=True)
class FollowOptions:
    """How recordings are followed.

    Attributes
    ----------
    idle_s : the end: no camera has had a new frame for so long, since the first came.
    piece_stages, piece_s : stages are published when there are so many, or the oldest of
        them has waited so long; > 0.
    num_threads : chunks at a time where many wait; 0 = one a core.
    skip_unreadable : as :func:`measure_to_file`.
    """

    idle_s: float = 10.0
    piece_stages: int = 25
    piece_s: float = 1.0
    num_threads: int = 0
    skip_unreadable: bool = False


class Publisher(Protocol):
    """Takes pieces of the measurement as they come."""

    def __call__(self, record: ChunkRecord, delay_s: float) -> None:
        """Consecutive stages; ``delay_s`` after the first of them was complete in all cameras."""
        ...


@dataclass
class _Recordings:
    """The cameras' growing sequences, and when their stages were complete."""

    growing: Mapping[str, GrowingSource]
    skip: Mapping[str, int]
    skip_unreadable: bool = False
    sources: dict[str, FrameSource] = field(default_factory=dict)
    count: int = 0
    changed_s: float = 0.0
    _counts: dict[str, int] = field(default_factory=dict)
    _came: list[tuple[int, float]] = field(default_factory=list)

    def look(self) -> None:
        """Looks again: ``count`` frames all cameras have, ``sources`` are these."""
        counts = {name: source.available() for name, source in self.growing.items()}
        if counts != self._counts:
            self._counts, self.changed_s = counts, time.monotonic()
        count = max(0, min(n - self.skip[name] for name, n in counts.items()))
        if count > self.count:
            self.count = count
            self._came.append((count, time.monotonic()))
            for name, source in self.growing.items():
                frames = LenientSource(source) if self.skip_unreadable else source
                self.sources[name] = RangeSource(frames, self.skip[name], count)

    def waited_s(self, stage: int) -> float:
        """How long ago a stage was complete."""
        while self._came and len(self._came) > 1 and self._came[0][0] < stage:
            self._came.pop(0)
        return time.monotonic() - self._came[0][1]


def follow_project(
    project: Project,
    *,
    rig: RigData | None = None,
    options: FollowOptions | None = None,
    publisher: Callable[[RigData, ChunkOptions, float | None], Publisher] | None = None,
    progress: Progress = silent,
    tell: Callable[[str], None] = lambda text: None,
) -> StageTable:
    """Measure sequences that are still being written, until they end, into measurement.h5.

    Every camera's ``sequence`` is a folder that receives pictures, or a Photron header whose
    ``.mraw`` is being saved. KeyboardInterrupt ends the following, and what has come is
    measured to its end; a second one interrupts that as any measurement.

    Parameters
    ----------
    project : as ``read_project`` gives it. rig : None: the project's rig.json.
    options : when it ends, how soon is published.
    publisher : given the rig, the options and the frame rate makes what takes the pieces.
    progress : told about the stages at the end. tell : what is waited for, in words.

    Raises
    ------
    ProjectFileError, SequenceError, MeasurementError
        As :func:`measure_to_file`; a camera's sequence is of a kind that cannot be followed.
    """
    options = options or FollowOptions()
    if rig is None:
        rig = read_project_rig(project)
    with one_at_a_time(lock_path(project), "measured"):
        recordings = _open(project, options, tell)
        follower = _Follower(project, rig, recordings, options, publisher)
        try:
            follower.run()
        except KeyboardInterrupt:
            if not recordings.count:
                raise
        tell("no more frames are awaited: the measurement's file is written")
        return _finish(project, rig, follower.store, recordings.count, options, progress)


class _Follower:
    """Goes through the stages as they come."""

    def __init__(
        self,
        project: Project,
        rig: RigData,
        recordings: _Recordings,
        options: FollowOptions,
        publisher: Callable[[RigData, ChunkOptions, float | None], Publisher] | None,
    ) -> None:
        self._project, self._recordings, self._options = project, recordings, options
        self._rig, self._publisher = rig, publisher
        self._chunk_options = chunk_options(project)
        self._publish: Publisher | None = None
        self._models: Models = dict.fromkeys(recordings.growing)
        self.store: FolderStore | None = None
        self._first = project.sequence.first
        self._last = project.sequence.last
        self._published = self._measured = self._first - 1

    def _wait_for_first(self) -> None:
        recordings = self._recordings
        while not recordings.count:
            recordings.look()
            time.sleep(_POLL_S)
        self._rig = rig_in_order(self._rig, recordings.sources)
        rate, _ = frame_rate(self._project, recordings.sources)
        if self._publisher is not None:
            self._publish = self._publisher(self._rig, self._chunk_options, rate)
        self._worker = self._new_worker()

    def _new_worker(self) -> ChunkWorker:
        # The same mapping, which is filled anew as the recordings grow.
        return ChunkWorker(self._rig, self._recordings.sources, self._chunk_options, self._models)

    def run(self) -> None:
        """Until no frame comes any more, or all that are wanted are there."""
        self._wait_for_first()
        while True:
            self._recordings.look()
            there = self._recordings.count
            if self._last is not None:
                there = min(there, self._last)
            self._chunks(there)
            self._piece(there)
            if there == self._last:
                return
            if time.monotonic() - self._recordings.changed_s > self._options.idle_s:
                self._piece(there, at_once=True)
                return
            time.sleep(_POLL_S)

    def _chunks(self, there: int) -> None:
        """Measures the chunks that are whole."""
        whole = (there - self._measured) // CHUNK_STAGES
        if whole <= 0:
            return
        if self.store is None:
            self._begin()
        assert self.store is not None
        store = self.store
        chunks = chunks_of(self._measured + 1, self._measured + whole * CHUNK_STAGES)

        def work(chunk: tuple[int, int]) -> ChunkRecord:
            if not store.missing([chunk]):
                return store.get(chunk)
            record = self._worker(*chunk)
            store.put(chunk, record)
            return record

        for record in map_bounded(work, chunks, self._options.num_threads):
            if self._published < record.stage[0]:
                self._tell(record)
            elif self._published < record.stage[-1]:  # the rest, as its chunk has it
                self._tell(rows_of(record, self._published + 1))
            self._measured = int(record.stage[-1])

    def _piece(self, there: int, at_once: bool = False) -> None:
        """Publishes stages whose chunk is not whole yet."""
        waiting = there - self._published
        if self._publish is None or waiting <= 0:
            return
        enough = waiting >= self._options.piece_stages or at_once
        if enough or self._recordings.waited_s(self._published + 1) >= self._options.piece_s:
            self._tell(self._worker(self._published + 1, there))

    def _tell(self, record: ChunkRecord) -> None:
        delay_s = self._recordings.waited_s(int(record.stage[0]))
        self._published = int(record.stage[-1])
        if self._publish is not None:
            self._publish(record, delay_s)

    def _begin(self) -> None:
        """The first chunk is whole: from now on the records are the final ones."""
        stages = (self._first, self._first + CHUNK_STAGES - 1)
        sources, options = self._recordings.sources, self._chunk_options
        self._models = learn_models(sources, options.recognition, stages)
        digest = fingerprint(self._rig, options, self._models, _beginning(sources, stages))
        self.store = FolderStore(self._project.folder / PARTS_FOLDER, digest)
        self._worker = self._new_worker()


def rows_of(record: ChunkRecord, stage: int) -> ChunkRecord:
    """The points of a record from a stage on; of its targets nothing."""
    begin = int(np.searchsorted(record.stage, stage))
    points = slice(int(record.point_offsets()[begin]), None)
    cameras = record.target_count.shape[1]
    of_points = (
        *("point_code", "position_mm", "cov_mm2", "cov_image_mm2", "cameras_used"),
        *("rms_px", "flags"),
    )
    of_targets = (
        *("centre_px", "semi_axes_px", "angle_rad", "sigma_px", "residual_px"),
        *("code_id", "match_status", "ring_status", "target_point"),
    )
    left = len(record.stage) - begin
    return dataclasses.replace(
        record,
        stage=record.stage[begin:],
        target_count=np.zeros((left, cameras), record.target_count.dtype),
        point_count=record.point_count[begin:],
        coded_ends=record.coded_ends[begin:],
        searched_whole=record.searched_whole[begin:],
        eccentricity_px=record.eccentricity_px[points],
        **{name: getattr(record, name)[points] for name in of_points},
        **{name: getattr(record, name)[:0] for name in of_targets},
    )


def _open(project: Project, options: FollowOptions, tell: Callable[[str], None]) -> _Recordings:
    """The recordings, when they are there."""
    growing, skip = {}, {}
    for name, camera in project.cameras.items():
        spec = camera.sequence or ()
        path = project.folder / spec[0] if len(spec) == 1 else None
        if path is None or any(letter in spec[0] for letter in "*?[{"):
            raise ProjectFileError(
                f"{project.path}: [cameras.{name}] sequence: to be followed while it is written "
                "it must be one folder that receives pictures, or one Photron .cihx or .cih with "
                "its .mraw"
            )
        told = False
        while name not in growing:
            try:
                growing[name] = open_growing(path)
            except SequenceError as error:
                if path.exists():
                    raise SequenceError(f"camera {name!r}, sequence: {error}") from error
                if not told:
                    tell(f"waiting for {path}")
                told = True
                time.sleep(10 * _POLL_S)
        skip[name] = (camera.first_frame or 1) - 1
    tell(f"waiting for frames of {', '.join(growing)}")
    return _Recordings(growing, skip, options.skip_unreadable)


def _finish(
    project: Project,
    rig: RigData,
    store: FolderStore | None,
    count: int,
    options: FollowOptions,
    progress: Progress,
) -> StageTable:
    """Measures what is left, as :func:`measure_to_file` does."""
    try:
        job = job_of(project, rig, skip_unreadable=options.skip_unreadable)
    except SequenceError:
        if not count:
            raise
        # A camera has ended before the others: as far as all of them go.
        until = dataclasses.replace(project.sequence, last=count)
        project = dataclasses.replace(project, sequence=until)
        job = job_of(project, rig, skip_unreadable=options.skip_unreadable)
        said = f"the cameras have different numbers of frames: measured are the {count} of all"
        job = dataclasses.replace(job, warnings=(*job.warnings, said))
    models = learn_models(job.sources, job.options.recognition, job.stages)
    digest = fingerprint_of(job, models)
    if store is not None:
        again = fingerprint(job.rig, job.options, models, _beginning(job.sources, job.stages))
        if again == store.fingerprint:
            store.adopt(digest)
    store = FolderStore(project.folder / PARTS_FOLDER, digest)
    return finish_file(project, job, store, models, progress, Threads(options.num_threads))


def _beginning(sources: Mapping[str, FrameSource], stages: tuple[int, int]) -> list[str]:
    """What tells one recording from another while its files still grow: its first frames."""
    first, last = chunks_of(*stages)[0]
    digest = hashlib.sha256()
    for source in sources.values():
        for index in sorted({first - 1, (first + last) // 2 - 1, last - 1}):
            digest.update(np.ascontiguousarray(source.read(index)).tobytes())
            digest.update(os.fsencode(source.name(index)))
    return ["followed", digest.hexdigest()]
