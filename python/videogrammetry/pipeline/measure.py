"""From a project's sequences to trajectories and motion."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy.typing as npt

from videogrammetry.errors import (
    MeasurementError,
    SequenceError,
    VideogrammetryError,
)
from videogrammetry.matching import TARGET_STATUS, MatchingOptions
from videogrammetry.motion import MotionOptions, MotionPlan
from videogrammetry.pipeline.assemble import (
    Sink,
    TrajectoryBuilder,
    assemble,
    plan_of_chunks,
)
from videogrammetry.pipeline.chunk_job import (
    ChunkOptions,
    ChunkWorker,
    chunks_of,
    learn_models,
)
from videogrammetry.pipeline.chunk_store import Chunk, ChunkStore, FolderStore, MemoryStore
from videogrammetry.pipeline.filling import fill_chunks
from videogrammetry.pipeline.frames import (
    Progress,
    map_bounded,
    silent,
)
from videogrammetry.pipeline.linking import Linked, Linker
from videogrammetry.pipeline.measure_job import (
    MeasureJob,
    Models,
    check_numbers,
    fingerprint_of,
    first_free_id,
    job_of,
    reoriented,
    rig_in_order,
)
from videogrammetry.pipeline.measure_sources import (
    unreadable_frames,
)
from videogrammetry.pipeline.sinks import ArraySink, StageTable, TeeSink, least_bytes
from videogrammetry.pipeline.stability import StabilityCheck
from videogrammetry.pipeline.totals import nothing_measured, refuse_senseless, stage_warnings
from videogrammetry.project import (
    MeasurementLayout,
    Project,
    one_at_a_time,
    open_measurement_writer,
    provenance,
)
from videogrammetry.project.schema import MOST_FILLED
from videogrammetry.recognition import RING_STATUS, RecognitionOptions
from videogrammetry.sequence import as_source, check_same_length
from videogrammetry.types import FrameSource, Measurement, RigData

#: Where the finished chunks of a measurement wait, beside the project.
PARTS_FOLDER = "measurement.parts"

#: Measures chunks of a job into a store: gives each of them when its record is there.
Runner = Callable[[MeasureJob, ChunkStore, Models, Sequence[Chunk]], Iterator[Chunk]]

#: What the values of a measurement's flags mean.
_MEANINGS = {"match_status": TARGET_STATUS, "ring_status": RING_STATUS}


def measure_frames(
    rig: RigData,
    frames: Mapping[str, FrameSource | Sequence[npt.NDArray[Any]]],
    *,
    frame_rate_hz: float | None = None,
    stages: tuple[int, int] | None = None,
    recognition: RecognitionOptions | None = None,
    matching: MatchingOptions | None = None,
    motion: MotionOptions | None = None,
    full_every: int = ChunkOptions.full_every,
    diameter_mm: float | None = None,
    thickness_mm: float = 0.0,
    fill_gaps: int = 0,
    progress: Progress = silent,
    num_threads: int = 0,
) -> Measurement:
    """Measure sequences of calibrated cameras, from files or from memory.

    Chunks of stages, several at a time: recognition in every camera's frames,
    matching, triangulation with covariance; then numbers for un-coded points over
    all stages, and motion. The result does not depend on the number of threads.

    Parameters
    ----------
    rig : the calibrated cameras.
    frames : camera -> sequence, or array (S, height, width); the n-th frames of
        all cameras belong to one stage.
    frame_rate_hz : None: times and velocities stay empty.
    stages : first and last stage, inclusive, from 1; None: all.
    recognition, matching, motion : options; None: the defaults.
    full_every : targets are followed from frame to frame, and every so many frames
        the whole frame is searched (and where one was lost); 1: always.
    diameter_mm : of all targets' circles: what has another size is left out, and
        positions are those of the circles' centres instead of the ellipses'. None:
        neither.
    thickness_mm : height of the circles over the object: positions move by it from
        the stickers' surface into the object.
    fill_gaps : the largest number of consecutive stages that lack a point for which its
        position is estimated from those before and after and from the points around,
        with covariance and the flag ``filled``; 0: none.
    progress : told about the stages done.
    num_threads : chunks at a time; 0 = one a core.

    Raises
    ------
    SequenceError, MeasurementError
        Naming camera or picture, and what to do.
    """
    check_numbers(diameter_mm, thickness_mm, full_every)
    if not 0 <= fill_gaps <= MOST_FILLED:
        raise ValueError(f"fill_gaps: expected 0 to {MOST_FILLED} stages, got {fill_gaps}")
    sources = {name: as_source(source) for name, source in frames.items()}
    rig = rig_in_order(rig, sources)
    job = MeasureJob(
        rig=rig,
        sources=sources,
        stages=stages or (1, check_same_length(sources)),
        options=ChunkOptions(
            recognition=recognition or RecognitionOptions(),
            matching=matching or MatchingOptions(),
            full_every=full_every,
            diameter_mm=diameter_mm,
            thickness_mm=thickness_mm,
        ),
        motion=motion or MotionOptions(),
        frame_rate_hz=frame_rate_hz,
        fill_gaps=fill_gaps,
    )
    return _measure_in_memory(job, progress, num_threads)


def measure_project(
    project: Project,
    *,
    rig: RigData | None = None,
    reorient: Sequence[tuple[str, int | None]] = (),
    progress: Progress = silent,
    num_threads: int = 0,
) -> Measurement:
    """Measure the sequences of a calibrated project; see :func:`measure_frames`.

    Parameters
    ----------
    project : as ``read_project`` gives it.
    rig : the calibrated cameras; None: rig.json beside the project.
    reorient : cameras that have moved, and from which stage on (None: the first): their
        pose from there on is found from the sequence itself, see ``pipeline.reorient``.
    progress : told about the stages done.
    num_threads : chunks at a time; 0 = one a core.

    Raises
    ------
    ProjectFileError, SequenceError, MeasurementError
        Naming file or picture, and what to do.
    """
    job = reoriented(job_of(project, rig), project, reorient)
    return _measure_in_memory(job, progress, num_threads)


def measure_to_file(
    project: Project,
    *,
    rig: RigData | None = None,
    reorient: Sequence[tuple[str, int | None]] = (),
    progress: Progress = silent,
    num_threads: int = 0,
    skip_unreadable: bool = False,
    run: Runner | None = None,
) -> StageTable:
    """Measure a project into its measurement.h5, with bounded memory, and resume.

    Every chunk of stages that is done is kept in the folder measurement.parts beside the
    project until the file is whole. A measurement that was interrupted goes on
    after the last chunk kept, with the same result, byte for byte; where
    pictures, rig or options have changed it begins anew. ``reorient`` as in
    :func:`measure_project`.

    Parameters
    ----------
    project : as ``read_project`` gives it.
    rig : the calibrated cameras; None: the project's rig.json.
    progress : told about the stages done.
    num_threads : chunks at a time; 0 = one a core.
    skip_unreadable : a frame that cannot be read is one without targets, with a warning.
    run : who measures the chunks, ``cluster.ClusterRunner``; None: threads.

    Returns
    -------
    StageTable
        What the stages say in short, and the warnings.

    Raises
    ------
    ProjectFileError, SequenceError, MeasurementError
        Naming file or picture, and what to do; another process is measuring the project.
    """
    with one_at_a_time(lock_path(project), "measured"):
        job = job_of(project, rig, skip_unreadable=skip_unreadable)
        job = reoriented(job, project, reorient)
        models = learn_models(job.sources, job.options.recognition, job.stages)
        store = FolderStore(project.folder / PARTS_FOLDER, fingerprint_of(job, models))
        return finish_file(project, job, store, models, progress, run or Threads(num_threads))


def finish_file(
    project: Project,
    job: MeasureJob,
    store: FolderStore,
    models: Models,
    progress: Progress,
    run: Runner,
) -> StageTable:
    """Measures what the store does not have, and writes the project's measurement.h5."""
    linked = _measure_chunks(job, store, models, progress, run)
    _fill_gaps(job, store, linked, progress)
    plan = _motion_plan(job, store, linked)
    layout = MeasurementLayout(
        stage=linked.totals.stage,
        point_id=linked.point_id,
        camera_names=job.camera_names,
        num_targets=linked.num_targets,
        reference_stage=int(plan.reference.stage[0]),
        centroid_points=plan.centroid_points,
        image_name=_image_names(job),
        frame_rate_hz=job.frame_rate_hz,
        provenance=_provenance(job, linked),
        warnings=_warnings(job, linked),
        flag_meanings=_MEANINGS,
        stability=linked.stability.series if linked.stability else None,
    )
    table = StageTable(linked.totals, layout.warnings)
    # Asked beforehand, so that no minutes are spent on what cannot end well.
    needed = least_bytes(linked, chunks_of(*job.stages))
    if shutil.disk_usage(project.folder).free < needed:
        raise _no_room(project, f"at least {needed / 1e6:.1f} MB are needed")
    try:
        with open_measurement_writer(project.measurement_path, layout) as writer:
            _assemble(job, store, linked, plan, TeeSink(writer, table))
    except VideogrammetryError:
        raise
    except OSError as error:
        raise _no_room(project, error.strerror or str(error).splitlines()[0]) from error
    store.remove()
    return table


def _no_room(project: Project, why: str) -> MeasurementError:
    free = shutil.disk_usage(project.folder).free
    return MeasurementError(
        f"{project.measurement_path} cannot be written ({why}; {free / 1e6:.1f} MB are free on the "
        "disk); all stages are measured and kept: make room, and run `videogrammetry measure` again"
    )


def lock_path(project: Project) -> Path:
    """The file whose lock says that the project is being measured."""
    return project.folder / ".measurement.lock"


def _measure_in_memory(job: MeasureJob, progress: Progress, num_threads: int) -> Measurement:
    store = MemoryStore()
    models = learn_models(job.sources, job.options.recognition, job.stages)
    linked = _measure_chunks(job, store, models, progress, Threads(num_threads))
    _fill_gaps(job, store, linked, progress)
    plan = _motion_plan(job, store, linked)
    sink = ArraySink(linked, plan, job.camera_names)
    _assemble(job, store, linked, plan, sink)
    return Measurement(
        trajectories=sink.trajectories,
        motion=sink.motion,
        targets=sink.records,
        image_name=_image_names(job),
        frame_rate_hz=job.frame_rate_hz,
        provenance=_provenance(job, linked),
        warnings=_warnings(job, linked),
        flag_meanings=_MEANINGS,
        stability=linked.stability.series if linked.stability else None,
    )


class Threads:
    """Measures chunks by threads of this process."""

    def __init__(self, num_threads: int = 0) -> None:
        self._num_threads = num_threads

    def __call__(
        self, job: MeasureJob, store: ChunkStore, models: Models, chunks: Sequence[Chunk]
    ) -> Iterator[Chunk]:
        """Chunks whose records the store has, as they come."""
        worker = ChunkWorker(job.rig, job.sources, job.options, models)

        def work(chunk: Chunk) -> Chunk:
            store.put(chunk, worker(*chunk))
            return chunk

        return map_bounded(work, chunks, self._num_threads)


def _measure_chunks(
    job: MeasureJob, store: ChunkStore, models: Models, progress: Progress, run: Runner
) -> Linked:
    """Measures what the store does not have, and gives all points their numbers."""
    chunks = chunks_of(*job.stages)
    missing = store.missing(chunks)
    total = sum(last - first + 1 for first, last in missing)
    # Of those alone that are not there yet: rate and time left are of these.
    kept = job.stages[1] - job.stages[0] + 1 - total
    what = f"measuring ({kept} stages kept)" if kept else "measuring"
    done = 0
    check = StabilityCheck([(job.stages[0], job.rig), *job.options.later], job.stages, job.static)
    # Beside the threads that measure, so that nobody waits for it at the end.
    linker = Linker(store, chunks, first_free_id(job.options.recognition), check)
    linker.add(*set(chunks).difference(missing))
    try:
        for first, last in run(job, store, models, missing):
            linker.add((first, last))
            done += last - first + 1
            progress(done, total, what)
    except SequenceError as error:
        if isinstance(store, FolderStore):
            raise SequenceError(
                f"{error}; all chunks of stages measured before are kept: mend it and run "
                "`videogrammetry measure` again, or leave frames that cannot be read empty with "
                "--skip-unreadable"
            ) from error
        raise
    linked = linker.result()
    refuse_senseless(linked.totals)
    if not len(linked.point_id):
        raise MeasurementError(nothing_measured(linked.totals, job.options.diameter_mm))
    return linked


def _fill_gaps(job: MeasureJob, store: ChunkStore, linked: Linked, progress: Progress) -> None:
    if job.fill_gaps:
        chunks = chunks_of(*job.stages)
        builder = TrajectoryBuilder(linked, job.frame_rate_hz, job.camera_names)
        linked.filled = fill_chunks(store, chunks, linked, builder, job.fill_gaps, progress)


def _motion_plan(job: MeasureJob, store: ChunkStore, linked: Linked) -> MotionPlan:
    return plan_of_chunks(store, chunks_of(*job.stages), linked, job.camera_names, job.motion)


def _assemble(
    job: MeasureJob, store: ChunkStore, linked: Linked, plan: MotionPlan, sink: Sink
) -> None:
    builder = TrajectoryBuilder(linked, job.frame_rate_hz, job.camera_names)
    assemble(store, chunks_of(*job.stages), linked, plan, builder, sink)


def _provenance(job: MeasureJob, linked: Linked) -> dict[str, Any]:
    options = {
        "stages": list(job.stages),
        "recognition": job.options.recognition,
        "full_every": job.options.full_every,
        "matching": job.options.matching,
        "motion": job.motion,
        "fill_gaps": job.fill_gaps,
        "diameter_mm": job.options.diameter_mm,
        "thickness_mm": job.options.thickness_mm,
        "eccentricity": linked.totals.circles(),
        "rig": job.rig.how,
        "stability": linked.stability.found if linked.stability else (),
        "reoriented": job.reoriented,
    }
    return provenance(options, job.inputs, job.folder)


def _warnings(job: MeasureJob, linked: Linked) -> tuple[str, ...]:
    count, stage = linked.totals.targets, linked.totals.stage
    empty = {name: (stage[count[:, c] == 0] - 1).tolist() for c, name in enumerate(job.sources)}
    skipped = unreadable_frames(job.sources, empty)
    said = stage_warnings(linked.totals, job.camera_names, job.options.diameter_mm)
    moved = linked.stability.warnings if linked.stability else ()
    return (*job.warnings, *skipped, *said, *moved)


def _image_names(job: MeasureJob) -> tuple[tuple[str, ...], ...]:
    first, last = job.stages
    return tuple(
        tuple(source.name(i) for i in range(first - 1, last)) for source in job.sources.values()
    )
