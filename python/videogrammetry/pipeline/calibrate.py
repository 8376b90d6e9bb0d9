"""From a project's calibration pictures, or observations, to a calibrated rig."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from videogrammetry.calibration import (
    CalibrationInterface,
    CalibrationOptions,
    CalibrationRun,
    CameraFrames,
    FrameTargets,
    calibrate,
)
from videogrammetry.calibration.free_points import calibrate_free_points
from videogrammetry.calibration.run import KnownLength
from videogrammetry.errors import CalibrationError, ProjectFileError
from videogrammetry.pipeline.frames import (
    Progress,
    input_files,
    open_cameras,
    recognition_options,
    silent,
)
from videogrammetry.project import (
    Project,
    provenance,
    read_observations,
    read_points,
    read_rig,
    read_scale_bars,
)
from videogrammetry.project.camera_sections import START_NAMES
from videogrammetry.recognition import RecognitionOptions, recognize_sequence
from videogrammetry.sequence import as_source, check_same_length
from videogrammetry.types import (
    INTERIOR_NAMES,
    FlatInterface,
    FrameSource,
    Observations,
    PointSet,
    Targets,
)


def calibrate_project(
    project: Project, *, method: str = "joint", progress: Progress = silent, num_threads: int = 0
) -> CalibrationRun:
    """Calibrate the cameras of a project.

    Every camera's ``calibration`` pictures are recognised (or its observations
    CSV is read), the n-th pictures of all cameras belonging to one stage, and
    all are adjusted together.

    Parameters
    ----------
    project : as ``read_project`` gives it.
    method : "joint", or "mean" for the paper's averaging.
    progress : told about each picture.
    num_threads : pictures recognised at a time; 0 = one a core.

    Raises
    ------
    ProjectFileError, SequenceError, TableError, CalibrationError
        Naming file, picture or target, and what to do.
    """
    methods = (method,)
    return calibrate_by(project, methods, progress=progress, num_threads=num_threads)[method]


def calibrate_by(
    project: Project,
    methods: Sequence[str],
    *,
    progress: Progress = silent,
    num_threads: int = 0,
) -> dict[str, CalibrationRun]:
    """Calibrate by several methods, the pictures recognised once; see :func:`calibrate_project`."""
    section = project.calibration
    if section.target is None and section.scale_bars is None:
        raise ProjectFileError(
            f"{project.path}: [calibration] names no target: add target = "
            '"points.csv", a table id,x_mm,y_mm,z_mm of the calibration target\'s points, or '
            'scale_bars = "bars.csv" for a waved bar of known length'
        )
    target = None if section.target is None else read_points(section.target)
    lengths = () if section.scale_bars is None else known_lengths(section.scale_bars)
    tables = [camera.observations is not None for camera in project.cameras.values()]
    if any(tables) and not all(tables):
        raise ProjectFileError(
            f"{project.path}: some cameras have pictures and others an observations CSV as "
            "calibration: which belong together cannot be told; give all the same kind"
        )
    if all(tables):
        cameras, inputs = _from_observations(project)
    else:
        cameras, inputs = _from_pictures(project, progress, num_threads)
    tables_read = (section.target, section.scale_bars, section.rig)
    files: list[str | os.PathLike[str]] = [*inputs, *(path for path in tables_read if path)]
    if section.rig is not None:
        cameras = _from_rig(cameras, section.rig, section.hold_to_rig)
    runs = {}
    for method in methods:
        options = CalibrationOptions(
            method=method,
            sigma_mm=section.sigma_mm,
            diameter_mm=project.targets.diameter_mm,
            interfaces=calibration_interfaces(project),
            time_offset=section.time_offset and method == "joint",
            lengths=lengths if target is not None and method == "joint" else (),
            free_points=section.free_points if method == "joint" else "none",
            num_threads=num_threads,
        )
        progress(0, 1, "adjusting")
        run = (
            calibrate_free_points(cameras, lengths, options, section.still)
            if target is None
            else calibrate(cameras, target, options)
        )
        runs[method] = _with_origin(run, project, options, files)
        progress(1, 1, "adjusting")
    return runs


def calibration_pictures(
    project: Project,
) -> Callable[[str, int], npt.NDArray[Any] | None]:
    """A project's calibration pictures by camera and stage; None where there is no picture.

    For reports that show pieces of them: the files are opened at the first call.
    """

    @lru_cache(maxsize=1)
    def sources() -> Mapping[str, FrameSource]:
        if any(camera.observations is not None for camera in project.cameras.values()):
            return {}
        return open_cameras(project, "calibration", lambda camera: camera.calibration)

    @lru_cache(maxsize=4)
    def picture(camera: str, stage: int) -> npt.NDArray[Any] | None:
        source = sources().get(camera)
        return source.read(stage - 1) if source is not None and 0 < stage <= len(source) else None

    return picture


def known_lengths(path: Path) -> tuple[KnownLength, ...]:
    """The bars of a table, their lengths at the temperature of the measurement."""
    return tuple(
        KnownLength(
            point_a=bar.point_a,
            point_b=bar.point_b,
            length_mm=bar.used_length_mm(),
            sigma_mm=bar.sigma_mm,
        )
        for bar in read_scale_bars(path)
    )


def _from_rig(cameras: Sequence[CameraFrames], path: Path, hold: bool) -> list[CameraFrames]:
    """The cameras with an earlier rig's interior parameters as start values."""
    rig = read_rig(path)
    started = []
    for camera in cameras:
        known = rig.cameras.get(camera.name)
        if known is None:
            started.append(camera)
            continue
        if known.image_size_px != camera.image_size_px:
            raise ProjectFileError(
                f"{path}: camera {camera.name} had pictures of {known.image_size_px} px, now they "
                f"are of {camera.image_size_px} px: its old parameters do not hold; take it out of "
                "the rig, or calibrate without rig"
            )
        if not known.measured:
            raise ProjectFileError(
                f"{path}: camera {camera.name} has its distortion in the ideal direction; a "
                "calibration estimates the measured one: start without rig"
            )
        values = dict(zip(START_NAMES, known.interior.tolist(), strict=True))
        sigma = {n: s for n, s in known.sigma.items() if n in INTERIOR_NAMES and s > 0}
        started.append(
            dataclasses.replace(
                camera,
                start={**values, **camera.start},
                r0_px=known.r0_px,
                prior_sigma=sigma if hold else {},
            )
        )
    return started


def _with_origin(
    run: CalibrationRun,
    project: Project,
    options: CalibrationOptions,
    files: Sequence[str | os.PathLike[str]],
) -> CalibrationRun:
    """The run with what has made it, and what of the project it has not taken into account."""
    used = {"calibration": options, "cameras": project.cameras, "targets": project.targets}
    how = {**provenance(used, files, project.folder), **run.rig.how}
    return dataclasses.replace(
        run,
        rig=dataclasses.replace(run.rig, how=how),
        warnings=run.warnings,
    )


def _frames(
    project: Project, name: str, size: tuple[int, int], frames: list[FrameTargets]
) -> CameraFrames:
    camera = project.cameras[name]
    return CameraFrames(
        name=name,
        image_size_px=size,
        frames=frames,
        start=camera.start,
        free=camera.free,
        r0_px=camera.r0_px,
        interface=camera.interface,
    )


def calibration_interfaces(project: Project) -> tuple[CalibrationInterface, ...]:
    """The windows of ``[interfaces]`` as the calibration takes them."""
    found = []
    for section in project.interfaces.values():
        index, thickness_mm = section.glass or (1.0, 0.0)
        sigma = {}
        if section.sigma_normal_deg is not None:
            sigma["normal"] = float(np.radians(section.sigma_normal_deg))
        if section.sigma_distance_mm is not None:
            sigma["distance"] = section.sigma_distance_mm
        interface = FlatInterface(
            name=section.name, normal=np.array(section.normal), distance_mm=section.distance_mm,
            fluid_index=section.fluid, glass_index=index, glass_thickness_mm=thickness_mm,
        )  # fmt: skip
        found.append(
            CalibrationInterface(
                interface=interface, free=section.free, prior_sigma=sigma, frame=section.frame
            )
        )
    return tuple(found)


def frame_targets(stage: int, image: str, targets: Targets) -> FrameTargets:
    """Recognised targets as the calibration takes them."""
    return FrameTargets(
        stage=stage,
        image=image,
        id=targets.unique_id,
        xy_px=targets.centre_px,
        cov_px2=np.stack(
            [targets.cov[:, 0, 0], targets.cov[:, 0, 1], targets.cov[:, 1, 1]], axis=1
        ),
        ellipse=np.column_stack([targets.semi_axes_px, targets.angle_rad]),
        ellipse_cov=targets.cov[:, 2:, 2:],
    )


def recognize_frames(
    sources: Mapping[str, FrameSource],
    options: RecognitionOptions,
    progress: Progress = silent,
    num_threads: int = 0,
) -> dict[str, list[FrameTargets]]:
    """The targets of every frame of every camera; the n-th frames belong to stage n."""
    count = check_same_length(sources)
    frames: dict[str, list[FrameTargets]] = {}

    def tell(done: int, _: int) -> None:
        progress(len(frames) * count + done, len(sources) * count, "recognising")

    for name, source in sources.items():
        # The target comes near and goes: focus and light differ from picture to picture.
        found = recognize_sequence(
            source, options, camera=None, num_threads=num_threads, progress=tell
        )
        frames[name] = [frame_targets(i + 1, source.name(i), t) for i, t in enumerate(found)]
    return frames


def calibrate_frames(
    frames: Mapping[str, FrameSource | Sequence[npt.NDArray[Any]]],
    target: PointSet,
    options: CalibrationOptions | None = None,
    *,
    recognition: RecognitionOptions | None = None,
    progress: Progress = silent,
    num_threads: int = 0,
) -> CalibrationRun:
    """Calibrate from pictures of a known target, from files or from memory.

    Parameters
    ----------
    frames : camera -> sequence, or array (S, height, width); the n-th frames of
        all cameras are synchronous.
    target : the known points.
    options, recognition : None: the defaults.
    progress : told about each picture.
    num_threads : pictures at a time; 0 = one a core.

    Raises
    ------
    SequenceError, CalibrationError
        Naming camera, picture or target, and what to do.
    """
    sources = {name: as_source(source) for name, source in frames.items()}
    targets = recognize_frames(sources, recognition or RecognitionOptions(), progress, num_threads)
    cameras = [
        CameraFrames(name=name, image_size_px=source.image_size_px, frames=targets[name])
        for name, source in sources.items()
    ]
    return calibrate(cameras, target, options)


def _from_pictures(
    project: Project, progress: Progress, num_threads: int
) -> tuple[list[CameraFrames], list[str]]:
    sources = open_cameras(project, "calibration", lambda camera: camera.calibration)
    options = recognition_options(project.targets)
    frames = recognize_frames(sources, options, progress, num_threads)
    cameras = [
        _frames(project, name, source.image_size_px, frames[name])
        for name, source in sources.items()
    ]
    return cameras, input_files(project, sources)


def _from_observations(project: Project) -> tuple[list[CameraFrames], list[str]]:
    """Cameras whose targets were detected elsewhere; equal picture names are synchronous."""
    paths = {name: project.folder / str(c.observations) for name, c in project.cameras.items()}
    tables = {name: read_observations(path) for name, path in paths.items()}
    names = dict.fromkeys(image for table in tables.values() for image in table.image)
    _check_common(tables, project)
    stage_of = {image: stage for stage, image in enumerate(sorted(names), start=1)}
    cameras = []
    for name, table in tables.items():
        if not len(table):
            raise CalibrationError(
                f"camera {name!r}: {paths[name]} has no observation; fill it or take the camera "
                "out of the project"
            )
        size = project.cameras[name].image_size_px
        if size is None:
            raise ProjectFileError(f"{project.path}: [cameras.{name}] has no image_size_px")
        frames = [_frame_of(table, i, stage_of[image]) for i, image in enumerate(table.image)]
        cameras.append(_frames(project, name, size, sorted(frames, key=lambda f: f.stage)))
    return cameras, [str(project.path), *(str(path) for path in paths.values())]


def _check_common(tables: Mapping[str, Observations], project: Project) -> None:
    """CalibrationError if a camera's pictures bear names that no other camera's do."""
    for name, table in tables.items():
        others = {image for n, other in tables.items() if n != name for image in other.image}
        if others and len(table) and not others & set(table.image):
            raise CalibrationError(
                f"{project.path}: no picture of camera {name} ({', '.join(table.image[:3])}, ...) "
                f"has the name of a picture of another camera ({', '.join(sorted(others)[:3])}, "
                "...): equal names in the column image are synchronous pictures of one position "
                "of the target; name them alike, by stage"
            )


def _frame_of(table: Observations, index: int, stage: int) -> FrameTargets:
    rows = table.image_index == index
    return FrameTargets(
        stage=stage,
        image=table.image[index],
        id=table.point_id[rows],
        xy_px=table.xy_px[rows],
        cov_px2=table.cov_px2[rows],
    )
