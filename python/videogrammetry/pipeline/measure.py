"""From a project's sequences to trajectories and motion."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from videogrammetry.errors import MeasurementError, ProjectFileError
from videogrammetry.geometry import select_cameras
from videogrammetry.matching import TARGET_STATUS, MatchingOptions
from videogrammetry.motion import MotionOptions, compute_motion
from videogrammetry.pipeline.eccentricity import circle_summary
from videogrammetry.pipeline.frames import (
    Progress,
    input_files,
    map_bounded,
    not_applied_yet,
    open_cameras,
    read_and_recognize,
    recognition_options,
    silent,
)
from videogrammetry.pipeline.stages import (
    StageResult,
    measure_stage,
    nothing_measured,
    refuse_senseless,
    stage_warnings,
    target_records,
)
from videogrammetry.project import Project, provenance, read_rig
from videogrammetry.recognition import RING_STATUS, RecognitionOptions, code_family
from videogrammetry.reconstruction import CalibrationField, Triangulator
from videogrammetry.sequence import as_source, check_same_length
from videogrammetry.sequence.source import JoinedSource
from videogrammetry.tracking import build_trajectories, link_stages
from videogrammetry.types import FrameSource, IntArray, Measurement, RigData


def measure_frames(
    rig: RigData,
    frames: Mapping[str, FrameSource | Sequence[npt.NDArray[Any]]],
    *,
    frame_rate_hz: float | None = None,
    stages: tuple[int, int] | None = None,
    recognition: RecognitionOptions | None = None,
    matching: MatchingOptions | None = None,
    motion: MotionOptions | None = None,
    diameter_mm: float | None = None,
    thickness_mm: float = 0.0,
    progress: Progress = silent,
    num_threads: int = 0,
) -> Measurement:
    """Measure sequences of calibrated cameras, from files or from memory.

    Stage by stage: recognition in every camera's frame, matching, triangulation
    with covariance; then numbers for un-coded points over all stages, and motion.

    Parameters
    ----------
    rig : the calibrated cameras.
    frames : camera -> sequence, or array (S, height, width); the n-th frames of
        all cameras belong to one stage.
    frame_rate_hz : None: times and velocities stay empty.
    stages : first and last stage, inclusive, from 1; None: all.
    recognition, matching, motion : options; None: the defaults.
    diameter_mm : of all targets' circles: what has another size is left out, and
        positions are those of the circles' centres instead of the ellipses'. None:
        neither.
    thickness_mm : height of the circles over the object: positions move by it from
        the stickers' surface into the object.
    progress : told about each stage.
    num_threads : stages at a time; 0 = one a core.

    Raises
    ------
    SequenceError, MeasurementError
        Naming camera or picture, and what to do.
    """
    recognition = recognition or RecognitionOptions()
    matching = matching or MatchingOptions()
    motion = motion or MotionOptions()
    sources = {name: as_source(source) for name, source in frames.items()}
    rig = _rig_in_order(rig, sources)
    first, last = stages or (1, check_same_length(sources))
    stage = np.arange(first, last + 1, dtype=np.int32)
    _check_circles(diameter_mm, thickness_mm)
    stage_options = (recognition, matching, diameter_mm, thickness_mm)
    results = _measure_stages(rig, sources, stage, stage_options, progress, num_threads)
    numbers = link_stages([r.points for r in results], first_free_id(recognition))
    if not any(len(n) for n in numbers):
        raise MeasurementError(nothing_measured(results, diameter_mm))
    time_s = (stage - 1) / frame_rate_hz if frame_rate_hz else np.full(len(stage), np.nan)
    trajectories = build_trajectories(
        [r.points for r in results], numbers, stage, time_s, list(rig.cameras)
    )
    names = (tuple(s.name(i - 1) for i in stage.tolist()) for s in sources.values())
    options = {
        "recognition": recognition,
        "matching": matching,
        "motion": motion,
        "diameter_mm": diameter_mm,
        "thickness_mm": thickness_mm,
        "eccentricity": circle_summary([r.points for r in results]),
    }
    return Measurement(
        trajectories=trajectories,
        motion=compute_motion(trajectories, motion),
        targets=target_records(results, numbers, stage),
        image_name=tuple(names),
        frame_rate_hz=frame_rate_hz,
        provenance=provenance({"stages": [first, last], **options, "rig": rig.how}),
        warnings=tuple(stage_warnings(results, stage, list(rig.cameras), diameter_mm)),
        flag_meanings={"match_status": TARGET_STATUS, "ring_status": RING_STATUS},
    )


def _check_circles(diameter_mm: float | None, thickness_mm: float) -> None:
    if diameter_mm is not None and not (np.isfinite(diameter_mm) and diameter_mm > 0):
        raise ValueError(f"diameter_mm: expected a positive length, got {diameter_mm}")
    if not (np.isfinite(thickness_mm) and thickness_mm >= 0):
        raise ValueError(f"thickness_mm: expected 0 or more, got {thickness_mm}")


def _measure_stages(
    rig: RigData,
    sources: Mapping[str, FrameSource],
    stage: IntArray,
    options: tuple[RecognitionOptions, MatchingOptions, float | None, float],
    progress: Progress,
    num_threads: int,
) -> list[StageResult]:
    """Every stage by itself, several at a time."""
    recognition, matching, diameter_mm, thickness_mm = options
    triangulator = Triangulator(rig)
    field = CalibrationField(triangulator)

    def work(index: int) -> StageResult:
        targets = [read_and_recognize(source, index, recognition) for source in sources.values()]
        return measure_stage(triangulator, targets, matching, field, diameter_mm, thickness_mm)

    results: list[StageResult] = []
    for result in map_bounded(work, (stage - 1).tolist(), num_threads):
        results.append(result)
        progress(len(results), len(stage), "measuring")
    refuse_senseless(results)
    return results


def measure_project(
    project: Project,
    *,
    rig: RigData | None = None,
    progress: Progress = silent,
    num_threads: int = 0,
) -> Measurement:
    """Measure the sequences of a calibrated project; see :func:`measure_frames`.

    Parameters
    ----------
    project : as ``read_project`` gives it.
    rig : the calibrated cameras; None: rig.json beside the project.
    progress : told about each stage.
    num_threads : stages at a time; 0 = one a core.

    Raises
    ------
    ProjectFileError, SequenceError, MeasurementError
        Naming file or picture, and what to do.
    """
    refuse_filter(project)
    if rig is None:
        rig = read_project_rig(project)
    sources = open_cameras(project, "sequence", lambda camera: camera.sequence)
    stages = _stage_range(project, check_same_length(sources))
    rate, warnings = _frame_rate(project, sources)
    warnings += not_applied_yet(project)
    recognition = recognition_options(project.targets)
    measurement = measure_frames(
        rig,
        sources,
        frame_rate_hz=rate,
        stages=stages,
        recognition=recognition,
        motion=MotionOptions(reference_stage=reference_stage(project, stages)),
        diameter_mm=project.targets.diameter_mm,
        thickness_mm=project.targets.thickness_mm,
        progress=progress,
        num_threads=num_threads,
    )
    origin = provenance(
        measurement.provenance["options"], _inputs(project, sources), project.folder
    )
    return dataclasses.replace(
        measurement, provenance=origin, warnings=(*warnings, *measurement.warnings)
    )


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


def _rig_in_order(rig: RigData, sources: Mapping[str, FrameSource]) -> RigData:
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


def _stage_range(project: Project, count: int) -> tuple[int, int]:
    first = project.sequence.first
    last = count if project.sequence.last is None else project.sequence.last
    if last > count or first > count:
        raise ProjectFileError(
            f"{project.path}: [sequence] asks for the stages {first} to {last}, but the sequences "
            f"have {count}: correct first and last"
        )
    return first, last


def _frame_rate(
    project: Project, sources: dict[str, JoinedSource]
) -> tuple[float | None, list[str]]:
    """The project's rate over the files' own, with a warning where they differ."""
    rates = {name: source.frame_rate_hz for name, source in sources.items()}
    stated = {name: rate for name, rate in rates.items() if rate is not None}
    wanted = project.sequence.frame_rate_hz
    warnings = []
    if wanted is not None:
        for name, rate in stated.items():
            if not np.isclose(rate, wanted, rtol=1e-9):
                warnings.append(
                    f"camera {name!r}: its file says {rate:g} frames a second, the project "
                    f"{wanted:g}: the project's is taken"
                )
        return wanted, warnings
    for name, source in sources.items():
        if source.save_step > 1 and name in stated:
            apart = source.save_step / stated[name]
            warnings.append(
                f"camera {name!r}: its file says that only every {source.save_step}th frame was "
                f"saved: if so, the frames are {apart:g} s apart, and [sequence] frame_rate_hz = "
                f"{1 / apart:g} must be given; {stated[name]:g} Hz is taken"
            )
    if len(set(stated.values())) > 1:
        raise MeasurementError(
            f"the cameras' files state different frame rates ({stated}): synchronous cameras have "
            "one; say which with [sequence] frame_rate_hz"
        )
    if not stated:
        warnings.append(
            "no frame rate: times and velocities are left empty; give [sequence] frame_rate_hz"
        )
        return None, warnings
    return next(iter(stated.values())), warnings


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


def _inputs(project: Project, sources: dict[str, JoinedSource]) -> list[str | os.PathLike[str]]:
    files: list[str | os.PathLike[str]] = [*input_files(project, sources)]
    rig_files = (project.rig_path, project.rig_path.with_suffix(".npz"))
    return [*files, *(path for path in rig_files if path.is_file())]
