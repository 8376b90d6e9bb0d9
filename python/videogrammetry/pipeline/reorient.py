"""A camera that has moved: its new pose from static points, or from the other cameras' rays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from videogrammetry.calibration.reorient import Reorientation, reorient_camera
from videogrammetry.errors import MeasurementError, ProjectFileError
from videogrammetry.pipeline.frames import (
    Progress,
    map_bounded,
    open_cameras,
    read_and_recognize,
    recognition_options,
    silent,
)
from videogrammetry.project import Project, read_points, read_rig
from videogrammetry.recognition import RecognitionOptions
from videogrammetry.reconstruction.camera_scores import pose_of_motion
from videogrammetry.reconstruction.reorientation import RayReorientation, reorient_by_rays
from videogrammetry.types import (
    FloatArray,
    FrameSource,
    PointSet,
    RigData,
    Targets,
    matrix_from_cov6,
)

#: Pictures whose mean is taken; more would only take time.
MAX_PICTURES = 20
#: What a mean of many pictures may still err by: vibration, air, the lens.
_FLOOR_PX = 0.01


def reorient_project(
    project: Project, rig_path: Path, name: str, *, progress: Progress = silent
) -> Reorientation:
    """The new pose of a camera from ``[stability] points`` in its ``sequence``.

    The points' coordinates are of the rig's frame (as ``measure`` gave them before the
    camera moved); their coded targets are read in up to 20 pictures and averaged.

    Raises
    ------
    ProjectFileError, SequenceError, CalibrationError
        Naming file, camera or points, and what to do.
    """
    if name not in project.cameras:
        raise ProjectFileError(
            f"{project.path}: there is no camera {name!r}; it has {', '.join(project.cameras)}"
        )
    if project.stability.points is None:
        raise ProjectFileError(
            f'{project.path}: [stability] names no points: add points = "static.csv", a table '
            "id,x_mm,y_mm,z_mm of targets that stand still, in the rig's frame"
        )
    rig, still = read_rig(rig_path), read_points(project.stability.points)
    source = open_cameras(project, "sequence", lambda camera: camera.sequence)[name]
    options = recognition_options(project.targets)
    rows = np.unique(np.linspace(0, len(source) - 1, MAX_PICTURES).round().astype(int)).tolist()
    found: list[Targets] = []
    for targets in map_bounded(lambda i: read_and_recognize(source, i, options), rows):
        found.append(targets)
        progress(len(found), len(rows), "recognising")
    return _by_static(rig, name, still, found)


def _by_static(rig: RigData, name: str, still: PointSet, pictures: list[Targets]) -> Reorientation:
    xy_px, cov_px2 = mean_pictures(pictures, still.id.tolist())
    cov_mm2 = (
        np.zeros((len(still), 3, 3)) if still.cov_mm2 is None else matrix_from_cov6(still.cov_mm2)
    )
    return reorient_camera(rig, name, still.position_mm, cov_mm2, xy_px, cov_px2)


@dataclass(frozen=True, kw_only=True)
class Reoriented:
    """A camera whose pose was found anew for the stages from ``stage`` on.

    Attributes
    ----------
    by : "static points" or "rays". pictures : stages that were looked at for it.
    turn_rad, shift_mm : (3,) from the pose before, sigma_turn_rad, sigma_shift_mm : theirs.
    significance : of the six together. points : image points used. rms_px : their residuals.
    rotation, translation_mm : the new cam_from_world.
    """

    camera: str
    stage: int
    by: str
    pictures: int
    turn_rad: FloatArray
    sigma_turn_rad: FloatArray
    shift_mm: FloatArray
    sigma_shift_mm: FloatArray
    significance: float
    points: int
    rms_px: float
    rotation: FloatArray
    translation_mm: FloatArray


def reorient_in_sequence(
    rig: RigData,
    sources: Mapping[str, FrameSource],
    stages: tuple[int, int],
    options: RecognitionOptions,
    static: PointSet | None,
    moved: Sequence[tuple[str, int | None]],
) -> tuple[tuple[tuple[int, RigData], ...], tuple[Reoriented, ...]]:
    """Rigs for the parts of a sequence after cameras have moved.

    From up to 20 pictures between a move and the next: the means of the static points,
    where these are known, else coded points that two other cameras see.

    Parameters
    ----------
    rig, sources : the cameras as calibrated. stages : first and last that are measured.
    static : points that do not move. moved : camera and the stage from which on it stands
        otherwise; None: the first.

    Returns
    -------
    Stages, ascending, with the rig from each on; and what was found.

    Raises
    ------
    MeasurementError, CalibrationError
        No such camera or stage, too few points, no pose that fits.
    """
    order = sorted((stages[0] if stage is None else stage, name) for name, stage in moved)
    for stage, name in order:
        if name not in rig.cameras:
            raise MeasurementError(
                f"--reorient {name}: there is no such camera; the rig has {', '.join(rig.cameras)}"
            )
        if not stages[0] <= stage <= stages[1]:
            raise MeasurementError(
                f"--reorient {name}:{stage}: measured are the stages {stages[0]} to {stages[1]}"
            )
    rigs: dict[int, RigData] = {}
    told = []
    for k, (stage, name) in enumerate(order):
        after = [other for other, _ in order[k + 1 :] if other > stage]
        rows = _rows(stage, min([stages[1] + 1, *after]) - 1)
        rig, found = _reorient(rig, sources, rows, options, static, (name, stage))
        rigs[stage] = rig
        told.append(found)
    return tuple(rigs.items()), tuple(told)


def _rows(first: int, last: int) -> list[int]:
    rows = np.unique(np.linspace(first - 1, last - 1, MAX_PICTURES).round().astype(int))
    return [int(row) for row in rows]


def _reorient(
    rig: RigData,
    sources: Mapping[str, FrameSource],
    rows: list[int],
    options: RecognitionOptions,
    static: PointSet | None,
    moved: tuple[str, int],
) -> tuple[RigData, Reoriented]:
    """The rig with one camera's new pose, and what is said of it."""
    name, stage = moved
    if static is not None:
        own = list(map_bounded(lambda i: read_and_recognize(sources[name], i, options), rows))
        by_points = _by_static(rig, name, static, own)
        camera = by_points.rig.cameras[name]
        motion = np.linalg.inv(pose_of_motion(camera))
        cov = motion @ by_points.cov @ motion.T
        result: Reorientation | RayReorientation = by_points
    else:
        every = [(c, i) for i in rows for c in rig.cameras]
        seen = list(map_bounded(lambda k: read_and_recognize(sources[k[0]], k[1], options), every))
        count = len(rig.cameras)
        by_stage = [seen[count * k : count * (k + 1)] for k in range(len(rows))]
        by_rays = reorient_by_rays(rig, name, *coded_pictures(rig, by_stage))
        cov, result = by_rays.cov, by_rays
    camera = result.rig.cameras[name]
    sigma = np.sqrt(np.diag(cov))
    return result.rig, Reoriented(
        camera=name,
        stage=stage,
        by="rays" if static is None else "static points",
        pictures=len(rows),
        turn_rad=result.turn_rad,
        sigma_turn_rad=sigma[:3],
        shift_mm=result.shift_mm,
        sigma_shift_mm=sigma[3:],
        significance=result.significance,
        points=int(result.used.sum()),
        rms_px=result.rms_px,
        rotation=camera.rotation,
        translation_mm=camera.translation_mm,
    )


def coded_pictures(
    rig: RigData, stages: Sequence[Sequence[Targets]]
) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Coded targets of all cameras by stage and number, as :func:`reorient_by_rays` takes them.

    Returns
    -------
    xy_px (N, C, 2), variance_px2 (N, C, 2), the share (N, C) of it that a target's pictures
    have in common, and in how many stages a target was seen on average.
    """
    floor = [rig.sigma_floor_px.get(name, 0.0) ** 2 for name in rig.cameras]
    rows: dict[tuple[int, int], int] = {}
    seen = [
        (rows.setdefault((s, int(t.id[i])), len(rows)), c, t, i)
        for s, targets in enumerate(stages)
        for c, t in enumerate(targets)
        for i in np.flatnonzero(t.unique_id >= 0).tolist()
    ]
    xy = np.full((len(rows), len(rig.cameras), 2), np.nan)
    variance, share = np.ones(xy.shape), np.zeros(xy.shape[:2])
    for row, c, targets, i in seen:
        xy[row, c] = targets.centre_px[i]
        variance[row, c] = np.diag(targets.cov[i, :2, :2]) + floor[c]
        share[row, c] = floor[c] / variance[row, c].mean()
    different = len({number for _, number in rows})
    return xy, variance, share, len(rows) / max(different, 1)


def mean_pictures(pictures: list[Targets], numbers: list[int]) -> tuple[FloatArray, FloatArray]:
    """Mean centres (N, 2) of coded targets and covariances (N, 3) xx, xy, yy; NaN: not seen.

    The mean's variance is that of the centres over their number, or their scatter's where
    that is larger, and a floor.
    """
    xy_px, cov_px2 = np.full((len(numbers), 2), np.nan), np.full((len(numbers), 3), np.nan)
    for k, number in enumerate(numbers):
        centres, variances = [], []
        for targets in pictures:
            for i in np.flatnonzero(targets.unique_id == number):
                centres.append(targets.centre_px[i])
                variances.append(np.diag(targets.cov[i, :2, :2]))
        if not centres:
            continue
        stated = np.mean(variances, axis=0)
        scatter = np.var(centres, axis=0, ddof=1) if len(centres) > 2 else stated
        variance = np.maximum(stated, scatter) / len(centres) + _FLOOR_PX**2
        xy_px[k] = np.mean(centres, axis=0)
        cov_px2[k] = variance[0], 0.0, variance[1]
    return xy_px, cov_px2
