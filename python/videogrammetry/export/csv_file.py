"""A measurement as CSV: trajectories, motion, or the points of one stage."""

from __future__ import annotations

import os

import numpy as np

from videogrammetry.errors import MeasurementError
from videogrammetry.export.measurement import MeasurementFile, Series, open_measurement
from videogrammetry.project import (
    CENTROID,
    MotionTable,
    TrajectoryTable,
    format_csv,
    format_motion,
    format_trajectories,
)
from videogrammetry.types import FloatArray


def trajectories_csv(path: str | os.PathLike[str]) -> str:
    """Text of a trajectories CSV; a row for each stage in which a point was measured."""
    with open_measurement(path) as file:
        position = file.series("position_mm", "cov_mm2")
        stages, points = np.nonzero(np.isfinite(position.value).all(axis=2))
        cameras = file.cameras()
        names, stage, time_s = file.point, file.stage, file.time_s
        table = TrajectoryTable(
            stage=stage[stages].astype(np.int32),
            time_s=time_s[stages],
            point=tuple(names[p] for p in points),
            position_mm=position.value[stages, points],
            sigma_mm=position.sigma[stages, points],
            cameras=tuple(cameras[s][p] for s, p in zip(stages, points, strict=True)),
        )
        return format_trajectories(table)


def motion_csv(path: str | os.PathLike[str]) -> str:
    """Text of a motion CSV: all points with a displacement or velocity, then the centroid."""
    with open_measurement(path) as file:
        parts = [_motion_rows(file, "", file.point)]
        if "centroid_displacement_mm" in file:
            parts.append(_motion_rows(file, "centroid_", (CENTROID,)))
    return format_motion(_joined(parts))


def _motion_rows(file: MeasurementFile, prefix: str, names: tuple[str, ...]) -> MotionTable:
    moved = file.series(f"{prefix}displacement_mm", f"{prefix}cov_displacement_mm2")
    speed = file.series(f"{prefix}velocity_mm_s", f"{prefix}cov_velocity_mm2_s2")
    there = np.isfinite(moved.value).all(axis=2) | np.isfinite(speed.value).all(axis=2)
    stages, points = np.nonzero(there)

    def rows(series: Series) -> tuple[FloatArray, FloatArray]:
        return series.value[stages, points], series.sigma[stages, points]

    (displacement, sigma_displacement), (velocity, sigma_velocity) = rows(moved), rows(speed)
    return MotionTable(
        stage=file.stage[stages].astype(np.int32),
        time_s=file.time_s[stages],
        point=tuple(names[p] for p in points),
        displacement_mm=displacement,
        velocity_mm_s=velocity,
        sigma_displacement_mm=sigma_displacement,
        sigma_velocity_mm_s=sigma_velocity,
    )


def _joined(parts: list[MotionTable]) -> MotionTable:
    """Rows of all parts by stage, the points in their order, the centroid last."""
    stage = np.concatenate([part.stage for part in parts])
    order = np.argsort(stage, kind="stable")
    arrays = {
        name: np.concatenate([getattr(part, name) for part in parts])[order]
        for name in MotionTable.__dataclass_fields__
        if name not in ("point",)
    }
    names = [name for part in parts for name in part.point]
    return MotionTable(point=tuple(names[i] for i in order), **arrays)


def points_csv(path: str | os.PathLike[str], stage: int) -> str:
    """Text of a points CSV: the points of one stage with their sigmas.

    Raises
    ------
    MeasurementError
        If the measurement has no such stage, or no point in it.
    """
    with open_measurement(path) as file:
        stages = file.stage
        rows = np.flatnonzero(stages == stage)
        if not len(rows):
            raise MeasurementError(
                f"{file.path}: it has no stage {stage}; it has {stages.min()} to {stages.max()}"
            )
        position = file.series("position_mm", "cov_mm2")
        value, sigma = position.value[rows[0]], position.sigma[rows[0]]
        there = np.flatnonzero(np.isfinite(value).all(axis=1))
        if not len(there):
            raise MeasurementError(f"{file.path}: stage {stage} has no point; choose another")
        names = [file.point[i] for i in there]
    header = ["id", "x_mm", "y_mm", "z_mm", "sigma_x_mm", "sigma_y_mm", "sigma_z_mm"]
    return format_csv(header, [names, *value[there].T, *sigma[there].T])
