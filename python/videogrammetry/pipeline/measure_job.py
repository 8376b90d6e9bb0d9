"""The work that a project describes, checked before it begins."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from videogrammetry.errors import (
    MeasurementError,
    ProjectFileError,
)
from videogrammetry.geometry import select_cameras
from videogrammetry.matching import MatchingOptions
from videogrammetry.motion import MotionOptions
from videogrammetry.pipeline.chunk_job import (
    ChunkOptions,
    fingerprint,
)
from videogrammetry.pipeline.chunk_store import Chunk, ChunkStore
from videogrammetry.pipeline.frames import (
    recognition_options,
)
from videogrammetry.pipeline.measure_sources import (
    CameraFrames,
    all_inputs,
    camera_frames,
    common_frames,
    frame_rate,
    open_frames,
    stage_range,
)
from videogrammetry.pipeline.reorient import Reoriented, reorient_in_sequence
from videogrammetry.project import (
    Project,
    read_points,
    read_rig,
)
from videogrammetry.recognition import CameraModel, RecognitionOptions, code_family
from videogrammetry.types import FrameSource, PointSet, RigData

Models = Mapping[str, CameraModel | None]


@dataclass(frozen=True, kw_only=True)
class MeasureJob:
    """All that a measurement needs to begin.

    Attributes
    ----------
    rig : the cameras in the order of ``sources``. stages : first and last, inclusive.
    options, motion : how. frame_rate_hz : None: times and velocities stay empty.
    inputs : files whose hashes the result carries, relative to ``folder``.
    warnings : what is to be said whatever is found.
    frames : how the sequences are opened; empty where they are in memory.
    static : points that do not move, for the check of the cameras; None: none are known.
    reoriented : cameras whose pose was found anew, for ``options.later``.
    fill_gaps : the largest gap, in stages, whose positions are estimated; 0: none.
    """

    rig: RigData
    sources: Mapping[str, FrameSource]
    stages: tuple[int, int]
    options: ChunkOptions
    motion: MotionOptions
    frame_rate_hz: float | None = None
    inputs: tuple[str | os.PathLike[str], ...] = ()
    folder: Path | None = None
    warnings: tuple[str, ...] = ()
    frames: Mapping[str, CameraFrames] = field(default_factory=dict)
    static: PointSet | None = None
    reoriented: tuple[Reoriented, ...] = ()
    fill_gaps: int = 0

    @property
    def camera_names(self) -> tuple[str, ...]:
        """In the order of all results."""
        return tuple(self.rig.cameras)


#: Measures chunks of a job into a store: gives each of them when its record is there.
Runner = Callable[[MeasureJob, ChunkStore, Models, Sequence[Chunk]], Iterator[Chunk]]


def fingerprint_of(job: MeasureJob, models: Models) -> str:
    """The digest of all that a job's records depend on."""
    return fingerprint(job.rig, job.options, models, _file_states(job.inputs))


def _file_states(paths: Sequence[str | os.PathLike[str]]) -> list[tuple[str, int, int]]:
    """Name, size and time of change: what tells that a file is another one now."""
    states = [(os.fspath(path), os.stat(path)) for path in paths]
    return [(name, state.st_size, state.st_mtime_ns) for name, state in states]


def job_of(
    project: Project, rig: RigData | None = None, *, skip_unreadable: bool = False
) -> MeasureJob:
    """The work that a project describes."""
    refuse_filter(project)
    if rig is None:
        rig = read_project_rig(project)
    frames = camera_frames(project, skip_unreadable=skip_unreadable)
    sources = open_frames(frames)
    rate, warnings = frame_rate(project, sources)
    count, said = common_frames(project, sources)
    stages = stage_range(project, count)
    warnings += said
    return MeasureJob(
        rig=rig_in_order(rig, sources),
        sources=sources,
        stages=stages,
        options=chunk_options(project),
        motion=MotionOptions(
            reference_stage=reference_stage(project, stages),
            leave_out=project.motion.leave_out,
        ),
        frame_rate_hz=rate,
        fill_gaps=project.motion.fill_gaps,
        inputs=tuple(all_inputs(project, sources)),
        folder=project.folder,
        frames=frames,
        warnings=tuple(warnings),
        static=None if project.stability.points is None else read_points(project.stability.points),
    )


def chunk_options(project: Project) -> ChunkOptions:
    """How the project wants its stages to be measured."""
    targets = project.targets
    check_numbers(targets.diameter_mm, targets.thickness_mm, targets.full_every)
    return ChunkOptions(
        recognition=recognition_options(targets),
        matching=MatchingOptions(),
        full_every=targets.full_every,
        diameter_mm=targets.diameter_mm,
        thickness_mm=targets.thickness_mm,
    )


def reoriented(
    job: MeasureJob, project: Project, reorient: Sequence[tuple[str, int | None]]
) -> MeasureJob:
    """The job with the poses of cameras that have moved found anew."""
    if not reorient:
        return job
    rigs, told = reorient_in_sequence(
        job.rig, job.sources, job.stages, recognition_options(project.targets), job.static, reorient
    )
    options = dataclasses.replace(job.options, later=rigs)
    return dataclasses.replace(job, options=options, reoriented=told)


def check_numbers(diameter_mm: float | None, thickness_mm: float, full_every: int) -> None:
    """ValueError names the option that is out of its range."""
    if diameter_mm is not None and not (np.isfinite(diameter_mm) and diameter_mm > 0):
        raise ValueError(f"diameter_mm: expected a positive length, got {diameter_mm}")
    if not (np.isfinite(thickness_mm) and thickness_mm >= 0):
        raise ValueError(f"thickness_mm: expected 0 or more, got {thickness_mm}")
    if full_every < 1:
        raise ValueError(f"full_every: expected 1 or more, got {full_every}")


def first_free_id(recognition: RecognitionOptions) -> int:
    """The first number for un-coded points: above the family's largest code."""
    return len(code_family(recognition.codes)) + 1


def refuse_filter(project: Project) -> None:
    """ProjectFileError for a filter, none of which is available yet."""
    if project.motion.filter != "none":
        raise ProjectFileError(
            f"{project.path}: [motion] filter = {project.motion.filter!r} is not available yet; "
            'write filter = "none": velocities are central differences of the measured positions'
        )


def read_project_rig(project: Project) -> RigData:
    """rig.json beside the project; ProjectFileError where it has not been calibrated."""
    if not project.rig_path.is_file():
        raise ProjectFileError(
            f"{project.rig_path}: the project has no calibrated rig yet: run "
            f"`videogrammetry calibrate {project.path}` first"
        )
    return read_rig(project.rig_path)


def rig_in_order(rig: RigData, sources: Mapping[str, FrameSource]) -> RigData:
    """The rig's cameras, checked against the sequences, in their order."""
    missing = [name for name in sources if name not in rig.cameras]
    if missing:
        raise MeasurementError(
            f"camera {missing[0]!r} is not in the rig, which has {', '.join(rig.cameras)}: "
            "calibrate again or correct the name"
        )
    if len(sources) < 2:
        raise MeasurementError(
            f"{len(sources)} camera: 3-D points need two cameras or more that see them"
        )
    for name, source in sources.items():
        size = tuple(rig.cameras[name].image_size_px)
        if source.image_size_px != size:
            raise MeasurementError(
                f"camera {name!r}: its sequence has {source.image_size_px[0]}x"
                f"{source.image_size_px[1]} px, but it was calibrated with {size[0]}x{size[1]} px: "
                "record and calibrate with the same format (a cropped read-out moves the "
                "principal point)"
            )
    return select_cameras(rig, list(sources))


def reference_stage(project: Project, stages: tuple[int, int]) -> int:
    """The project's reference stage, checked against the measured ones."""
    reference = project.motion.reference_stage
    if stages[0] <= reference <= stages[1]:
        return reference
    if reference == 1:  # the default where the sequence starts later
        return stages[0]
    raise ProjectFileError(
        f"{project.path}: [motion] reference_stage = {reference} is not among the measured stages "
        f"{stages[0]} to {stages[1]}"
    )
