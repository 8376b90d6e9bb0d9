"""The CSV tables of results: trajectories and motion, one row a point and stage."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from videogrammetry.project.csv_table import CsvTable, format_csv, read_csv
from videogrammetry.types import FloatArray, IntArray

TRAJECTORY_COLUMNS = (
    *("stage", "time_s", "point", "x_mm", "y_mm", "z_mm"),
    *("sigma_x_mm", "sigma_y_mm", "sigma_z_mm", "cameras"),
)
MOTION_COLUMNS = (
    *("stage", "time_s", "point"),
    *("dx_mm", "dy_mm", "dz_mm", "vx_mm_s", "vy_mm_s", "vz_mm_s"),
    *("sigma_dx_mm", "sigma_dy_mm", "sigma_dz_mm"),
    *("sigma_vx_mm_s", "sigma_vy_mm_s", "sigma_vz_mm_s"),
)
#: The name that stands for the centroid in the column ``point``.
CENTROID = "centroid"


@dataclass(frozen=True, kw_only=True)
class TrajectoryTable:
    """A trajectories CSV.

    Attributes
    ----------
    stage : (N,) from 1. time_s : (N,), NaN where there is no frame rate.
    point : (N,) names. position_mm, sigma_mm : (N, 3), sigma NaN where unknown.
    cameras : (N,) tuples of the names of the cameras that saw the point.
    """

    stage: IntArray
    time_s: FloatArray
    point: tuple[str, ...]
    position_mm: FloatArray
    sigma_mm: FloatArray
    cameras: tuple[tuple[str, ...], ...]

    def __post_init__(self) -> None:
        _check_lengths(self)

    def __len__(self) -> int:
        return len(self.stage)


@dataclass(frozen=True, kw_only=True)
class MotionTable:
    """A motion CSV; NaN where a value does not exist (velocity at both ends).

    ``point`` is ``centroid`` for the centroid. Arrays are (N, 3).
    """

    stage: IntArray
    time_s: FloatArray
    point: tuple[str, ...]
    displacement_mm: FloatArray
    velocity_mm_s: FloatArray
    sigma_displacement_mm: FloatArray
    sigma_velocity_mm_s: FloatArray

    def __post_init__(self) -> None:
        _check_lengths(self)

    def __len__(self) -> int:
        return len(self.stage)


def _check_lengths(table: TrajectoryTable | MotionTable) -> None:
    lengths = {f.name: len(getattr(table, f.name)) for f in fields(table)}
    if len(set(lengths.values())) > 1:
        raise ValueError(f"columns: expected equal lengths, got {lengths}")


def format_trajectories(table: TrajectoryTable) -> str:
    """The text of a trajectories CSV.

    Examples
    --------
    >>> table = TrajectoryTable(stage=np.array([1]), time_s=np.array([0.0]), point=("7",),
    ...     position_mm=np.array([[1.5, 2.0, 3.0]]), sigma_mm=np.full((1, 3), np.nan),
    ...     cameras=(("left", "right"),))
    >>> print(format_trajectories(table).splitlines()[1])
    1,0,7,1.5,2,3,,,,left+right
    """
    columns = [
        table.stage,
        table.time_s,
        table.point,
        *table.position_mm.T,
        *table.sigma_mm.T,
        ["+".join(names) for names in table.cameras],
    ]
    return format_csv(TRAJECTORY_COLUMNS, columns)


def format_motion(table: MotionTable) -> str:
    """The text of a motion CSV."""
    columns = [
        table.stage,
        table.time_s,
        table.point,
        *table.displacement_mm.T,
        *table.velocity_mm_s.T,
        *table.sigma_displacement_mm.T,
        *table.sigma_velocity_mm_s.T,
    ]
    return format_csv(MOTION_COLUMNS, columns)


def read_trajectories(path: str | os.PathLike[str]) -> TrajectoryTable:
    """Reads a trajectories CSV; a point may stand once in a stage."""
    table = read_csv(path, TRAJECTORY_COLUMNS)
    points = _points(table)
    return TrajectoryTable(
        stage=table.integers("stage", minimum=1),
        time_s=table.floats("time_s", empty=np.nan),
        point=points,
        position_mm=_three(table, TRAJECTORY_COLUMNS[3:6], None),
        sigma_mm=_three(table, TRAJECTORY_COLUMNS[6:9], np.nan),
        cameras=tuple(tuple(c.split("+")) if c else () for c in table.texts("cameras")),
    )


def read_motion(path: str | os.PathLike[str]) -> MotionTable:
    """Reads a motion CSV; a point may stand once in a stage."""
    table = read_csv(path, MOTION_COLUMNS[:9], MOTION_COLUMNS[9:])
    points = _points(table)
    return MotionTable(
        stage=table.integers("stage", minimum=1),
        time_s=table.floats("time_s", empty=np.nan),
        point=points,
        displacement_mm=_three(table, MOTION_COLUMNS[3:6], np.nan),
        velocity_mm_s=_three(table, MOTION_COLUMNS[6:9], np.nan),
        sigma_displacement_mm=_three(table, MOTION_COLUMNS[9:12], np.nan),
        sigma_velocity_mm_s=_three(table, MOTION_COLUMNS[12:15], np.nan),
    )


def _points(table: CsvTable) -> tuple[str, ...]:
    for row, name in enumerate(table.texts("point")):
        if not name:
            raise table.error(row, "point", "is empty: name the point")
    table.refuse_repeats(["stage", "point"], "stage and point")
    return tuple(table.texts("point"))


def _three(table: CsvTable, columns: Sequence[str], empty: float | None) -> FloatArray:
    missing = np.full(len(table), np.nan)
    return np.stack(
        [table.floats(c, empty=empty) if c in table else missing for c in columns], axis=1
    )
