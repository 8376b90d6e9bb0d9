"""A camera that has moved: its new pose from the project's static points."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from videogrammetry.calibration.reorient import Reorientation, reorient_camera
from videogrammetry.errors import ProjectFileError
from videogrammetry.pipeline.frames import (
    Progress,
    map_bounded,
    open_cameras,
    read_and_recognize,
    recognition_options,
    silent,
)
from videogrammetry.project import Project, read_points, read_rig
from videogrammetry.types import FloatArray, Targets, matrix_from_cov6

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
    xy_px, cov_px2 = mean_pictures(found, still.id.tolist())
    cov_mm2 = (
        np.zeros((len(still), 3, 3)) if still.cov_mm2 is None else matrix_from_cov6(still.cov_mm2)
    )
    return reorient_camera(rig, name, still.position_mm, cov_mm2, xy_px, cov_px2)


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
