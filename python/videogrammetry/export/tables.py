"""CSV tables of a measurement: trajectories, motion, the points of a stage, targets."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from videogrammetry.errors import MeasurementError
from videogrammetry.motion import MotionOptions, compute_motion, without_flagged
from videogrammetry.project import (
    CENTROID,
    MotionTable,
    TrajectoryTable,
    format_csv,
    format_motion,
    format_trajectories,
)
from videogrammetry.project.tables import POINT_COLUMNS, POINT_SIGMAS, TARGET_COLUMNS
from videogrammetry.types import FloatArray, Measurement

_DIAGONAL = [0, 3, 5]  # xx, yy, zz of COV6_ORDER


def _sigmas(cov6: FloatArray) -> FloatArray:
    sigma: FloatArray = np.sqrt(cov6[..., _DIAGONAL])
    return sigma


def trajectories_csv(measurement: Measurement) -> str:
    """The text of a trajectories CSV: a row for every point of every stage that has it."""
    table = measurement.trajectories
    s, p = np.nonzero(np.isfinite(table.position_mm[..., 0]))
    names = np.array(table.camera_names, dtype=object)
    return format_trajectories(
        TrajectoryTable(
            stage=table.stage[s],
            time_s=table.time_s[s],
            point=tuple(str(i) for i in table.point_id[p]),
            position_mm=table.position_mm[s, p],
            sigma_mm=_sigmas(table.cov_mm2[s, p]),
            cameras=tuple(tuple(names[used]) for used in table.cameras_used[s, p]),
        )
    )


def motion_csv(measurement: Measurement) -> str:
    """The text of a motion CSV: displacement against the reference stage, velocity, centroid."""
    table, motion = measurement.trajectories, measurement.motion
    # A point that the reference stage lacks has a velocity all the same.
    known = np.isfinite(motion.displacement_mm) | np.isfinite(motion.velocity_mm_s)
    s, p = np.nonzero(known[..., 0])
    of_centroid = np.isfinite(motion.centroid_displacement_mm)
    c = np.flatnonzero((of_centroid | np.isfinite(motion.centroid_velocity_mm_s))[:, 0])
    points = tuple(str(i) for i in table.point_id[p]) + (CENTROID,) * len(c)
    order = np.argsort(np.concatenate([s, c]), kind="stable")
    stage = np.concatenate([s, c])[order]

    def both(of_points: FloatArray, of_centroid: FloatArray) -> FloatArray:
        joined: FloatArray = np.concatenate([of_points[s, p], of_centroid[c]])[order]
        return joined

    return format_motion(
        MotionTable(
            stage=table.stage[stage],
            time_s=table.time_s[stage],
            point=tuple(points[i] for i in order),
            displacement_mm=both(motion.displacement_mm, motion.centroid_displacement_mm),
            velocity_mm_s=both(motion.velocity_mm_s, motion.centroid_velocity_mm_s),
            sigma_displacement_mm=_sigmas(
                both(motion.displacement_cov_mm2, motion.centroid_displacement_cov_mm2)
            ),
            sigma_velocity_mm_s=_sigmas(
                both(motion.velocity_cov_mm2_s2, motion.centroid_velocity_cov_mm2_s2)
            ),
        )
    )


def points_csv(measurement: Measurement, stage: int | None = None) -> str:
    """The text of a points CSV: the points of one stage, by default the reference stage.

    Raises
    ------
    MeasurementError
        If the stage was not measured or has no point.
    """
    table = measurement.trajectories
    number = measurement.motion.reference_stage if stage is None else stage
    rows = np.flatnonzero(table.stage == number)
    if not len(rows):
        raise MeasurementError(
            f"stage {number} was not measured; measured are {table.stage[0]} to {table.stage[-1]}"
        )
    there = np.flatnonzero(np.isfinite(table.position_mm[rows[0], :, 0]))
    if not len(there):
        raise MeasurementError(f"stage {number} has no point; choose another with --stage")
    columns = [
        table.point_id[there],
        *table.position_mm[rows[0], there].T,
        *_sigmas(table.cov_mm2[rows[0], there]).T,
    ]
    return format_csv((*POINT_COLUMNS, *POINT_SIGMAS), columns)


def targets_csv(measurement: Measurement) -> str:
    """The text of a targets CSV: every target that was recognised in the sequences."""
    targets, table = measurement.targets, measurement.trajectories
    row = np.searchsorted(table.stage, targets.stage)
    images = [
        measurement.image_name[c][s] for c, s in zip(targets.camera.tolist(), row, strict=True)
    ]
    columns = [
        images,
        [table.camera_names[c] for c in targets.camera],
        targets.stage,
        [None if i < 0 else int(i) for i in targets.code_id],
        *targets.centre_px.T,
        *targets.semi_axes_px.T,
        targets.angle_rad,
        *targets.sigma_px.T,
    ]
    return format_csv(TARGET_COLUMNS, columns)


def leave_out_flagged(measurement: Measurement, flags: Sequence[str]) -> Measurement:
    """The measurement without positions that have one of some flags, and their motion anew.

    Raises
    ------
    ValueError
        A name is none of ``types.POINT_FLAGS``.
    """
    if not flags:
        return measurement
    old = measurement.motion
    before = measurement.provenance.get("options", {}).get("motion") or {}
    options = MotionOptions(
        reference_stage=old.reference_stage,
        centroid_points=tuple(old.centroid_points.tolist()),
        leave_out=tuple({*flags, *(before.get("leave_out") or ())}),
    )
    return dataclasses.replace(
        measurement,
        trajectories=without_flagged(measurement.trajectories, flags),
        motion=compute_motion(measurement.trajectories, options),
    )


#: What a CSV can hold: name -> the function that writes its text.
TABLES: Mapping[str, Callable[[Measurement], str]] = {
    "trajectories": trajectories_csv,
    "motion": motion_csv,
    "points": points_csv,
    "targets": targets_csv,
}


def format_table(measurement: Measurement, what: str, stage: int | None = None) -> str:
    """The text of one of the ``TABLES``; ``stage`` goes with "points" alone.

    Raises
    ------
    ValueError
        If ``what`` is none of them, or a stage is given for another.
    """
    if what not in TABLES:
        raise ValueError(f"what: expected one of {', '.join(TABLES)}, got {what!r}")
    if what == "points":
        return points_csv(measurement, stage)
    if stage is not None:
        raise ValueError(f"stage: goes with 'points' alone, not with {what!r}")
    return TABLES[what](measurement)
