"""Displacement, velocity and centroid: the paper's Eqs. (10)-(12), with covariances."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from videogrammetry.types import POINT_FLAGS, FloatArray, IntArray, Motion, Trajectories


@dataclass(frozen=True, kw_only=True)
class MotionOptions:
    """What motion refers to.

    Attributes
    ----------
    reference_stage : displacements are against this stage; None = the first.
    centroid_points : numbers of the points whose mean is the centroid; None =
        those measured at every stage, or, where there is none, the set that
        gives most points over most stages.
    leave_out : names of ``POINT_FLAGS``: a position with one of them takes no part.
    """

    reference_stage: int | None = None
    centroid_points: tuple[int, ...] | None = None
    leave_out: tuple[str, ...] = ()


def flag_mask(names: Sequence[str]) -> np.uint8:
    """The bits of some of the ``POINT_FLAGS``.

    Raises
    ------
    ValueError
        One of the names is none of them.

    Examples
    --------
    >>> int(flag_mask(["two_rays", "outside_volume"]))
    5
    """
    unknown = [name for name in names if name not in POINT_FLAGS]
    if unknown:
        raise ValueError(f"leave_out: {unknown[0]!r} is none of {', '.join(POINT_FLAGS)}")
    return np.uint8(sum(1 << POINT_FLAGS.index(name) for name in set(names)))


def without_flagged(trajectories: Trajectories, leave_out: Sequence[str]) -> Trajectories:
    """The trajectories, NaN where a position has one of the flags ``leave_out``."""
    bad = (trajectories.flags & flag_mask(leave_out)) != 0
    if not bad.any():
        return trajectories

    def kept(values: FloatArray) -> FloatArray:
        return np.where(bad[..., None], np.nan, values)

    return dataclasses.replace(
        trajectories,
        position_mm=kept(trajectories.position_mm),
        cov_mm2=kept(trajectories.cov_mm2),
        cov_image_mm2=kept(trajectories.cov_image_mm2),
    )


def step(position: FloatArray, cov: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Eq. (10): X(i+1) - X(i) at stage i, NaN at the last; covariances (.., 6) add up.

    Examples
    --------
    >>> d, c = step(np.array([[0.0, 0, 0], [1, 2, 3]]), np.ones((2, 6)))
    >>> d.tolist()[0], float(c[0, 0])
    ([1.0, 2.0, 3.0], 2.0)
    """
    difference = np.full_like(position, np.nan)
    variance = np.full_like(cov, np.nan)
    difference[:-1] = position[1:] - position[:-1]
    variance[:-1] = cov[1:] + cov[:-1]
    return difference, variance


def displacement(
    position: FloatArray, cov: FloatArray, reference: int
) -> tuple[FloatArray, FloatArray]:
    """X(i) - X(reference), exactly zero with zero covariance at the reference itself.

    Examples
    --------
    >>> d, c = displacement(np.array([[1.0, 1, 1], [2, 2, 2]]), np.ones((2, 6)), 0)
    >>> d.tolist(), c[:, 0].tolist()
    ([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]], [0.0, 2.0])
    """
    here = np.arange(len(position)) == reference
    return _displacement_from(position, cov, (position[reference], cov[reference]), here)


def _displacement_from(
    position: FloatArray,
    cov: FloatArray,
    reference: tuple[FloatArray, FloatArray],
    at_reference: npt.NDArray[np.bool_],
) -> tuple[FloatArray, FloatArray]:
    difference = position - reference[0]
    variance = cov + reference[1]
    known = np.isfinite(reference[0])[..., :1]
    variance[at_reference] = np.where(known, 0.0, np.nan)
    return difference, variance


def velocity(
    position: FloatArray, cov: FloatArray, time_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Eq. (11): (X(i+1) - X(i-1)) / (t(i+1) - t(i-1)); NaN at both ends and at gaps.

    Examples
    --------
    >>> x = np.array([[0.0, 0, 0], [1, 0, 0], [4, 0, 0]])
    >>> v, c = velocity(x, np.ones((3, 6)), np.array([0.0, 1.0, 2.0]))
    >>> v[1].tolist(), float(c[1, 0]), bool(np.isnan(v[[0, 2]]).all())
    ([2.0, 0.0, 0.0], 0.5, True)
    """
    speed = np.full_like(position, np.nan)
    variance = np.full_like(cov, np.nan)
    if len(position) > 2:
        span = (time_s[2:] - time_s[:-2]).reshape(-1, *[1] * (position.ndim - 1))
        speed[1:-1] = (position[2:] - position[:-2]) / span
        variance[1:-1] = (cov[2:] + cov[:-2]) / span**2
    return speed, variance


def constant_set(measured: npt.NDArray[np.bool_]) -> npt.NDArray[np.intp]:
    """Columns of ``measured`` (S, P) whose mean is comparable over the stages.

    The points of every stage that has any; where there is none, points are
    dropped, the rarest first, and the set with the largest number of points
    times stages that hold them all is taken.

    Examples
    --------
    >>> constant_set(np.array([[1, 1, 0], [1, 1, 1]], dtype=bool)).tolist()
    [0, 1]
    """
    stages = measured[measured.any(axis=1)]
    everywhere = np.flatnonzero(stages.all(axis=0)) if len(stages) else np.empty(0, np.intp)
    if len(everywhere) or not measured.any():
        return everywhere
    order = np.argsort(-stages.sum(axis=0), kind="stable")
    complete = np.ones(len(stages), dtype=bool)
    best, size = 0, 0
    for k, column in enumerate(order, start=1):
        complete &= stages[:, column]
        if k * int(complete.sum()) > size:
            best, size = k, k * int(complete.sum())
    return np.sort(order[:best])


def _centroid(trajectories: Trajectories, columns: npt.NDArray[np.intp]) -> tuple[FloatArray, ...]:
    """Eq. (12) with its covariance from the noise and with the calibration's."""
    stages = len(trajectories.stage)
    if not len(columns):
        empty = np.full((stages, 6), np.nan)
        return np.full((stages, 3), np.nan), empty, empty
    n = len(columns)
    mean: FloatArray = trajectories.position_mm[:, columns].mean(axis=1)
    image = trajectories.cov_image_mm2[:, columns]
    noise: FloatArray = image.sum(axis=1) / n**2
    # The calibration moves all points of a neighbourhood together: no 1/n.
    common = (trajectories.cov_mm2[:, columns] - image).mean(axis=1)
    return mean, noise, noise + common


def _columns(point_id: IntArray, points: tuple[int, ...]) -> npt.NDArray[np.intp]:
    missing = sorted(set(points) - set(point_id.tolist()))
    if missing:
        raise ValueError(
            f"[motion] centroid_points: {missing} were measured at no stage; measured are "
            f"{', '.join(map(str, point_id[:30].tolist()))}"
            f"{', ...' if len(point_id) > 30 else ''}"
        )
    return np.searchsorted(point_id, np.array(sorted(points)))


@dataclass(frozen=True, kw_only=True)
class MotionPlan:
    """What all stages of a motion have in common, so that it can be computed part by part.

    Attributes
    ----------
    reference : the trajectories of the reference stage alone, of all points.
    centroid_points : (N,) numbers of the points whose mean is the centroid, ascending.
    leave_out : flags of positions that take no part.
    """

    reference: Trajectories
    centroid_points: IntArray
    leave_out: tuple[str, ...] = ()


def plan_motion(
    reference: Trajectories, measured: npt.NDArray[np.bool_], options: MotionOptions
) -> MotionPlan:
    """The plan of a motion.

    Parameters
    ----------
    reference : the trajectories of the reference stage, one row.
    measured : (S, P) at which stages the points were measured; of ``centroid_points``
        where these are named it is not looked at.
    options : ``reference_stage`` is ``reference``'s.

    Raises
    ------
    ValueError
        A centroid's point was not measured.
    """
    if options.centroid_points is None:
        columns = constant_set(measured)
    else:
        columns = _columns(reference.point_id, options.centroid_points)
    return MotionPlan(
        reference=without_flagged(reference, options.leave_out),
        centroid_points=reference.point_id[columns],
        leave_out=options.leave_out,
    )


def motion_part(part: Trajectories, plan: MotionPlan) -> Motion:
    """The motion of consecutive stages.

    ``part`` may hold fewer points than the plan: those left out are not measured in it.
    Steps and velocities need the stage after and the stages around: give one
    stage more at each end, and leave these rows out of the result
    (:func:`motion_rows`).
    """
    part = without_flagged(part, plan.leave_out)
    stage = int(plan.reference.stage[0])
    of_reference = np.searchsorted(plan.reference.point_id, part.point_id)
    position, cov = part.position_mm, part.cov_image_mm2
    at_reference = part.stage == stage
    start = (
        plan.reference.position_mm[0, of_reference],
        plan.reference.cov_image_mm2[0, of_reference],
    )
    centre, centre_noise, centre_cov = _centroid_of(part, plan.centroid_points)
    first, first_noise, _ = _centroid_of(plan.reference, plan.centroid_points)
    step_mm, step_cov = step(position, cov)
    moved, moved_cov = _displacement_from(position, cov, start, at_reference)
    speed, speed_cov = velocity(position, cov, part.time_s)
    centre_moved, centre_moved_cov = _displacement_from(
        centre, centre_noise, (first[0], first_noise[0]), at_reference
    )
    centre_speed, centre_speed_cov = velocity(centre, centre_noise, part.time_s)
    return Motion(
        reference_stage=stage,
        step_mm=step_mm,
        step_cov_mm2=step_cov,
        displacement_mm=moved,
        displacement_cov_mm2=moved_cov,
        velocity_mm_s=speed,
        velocity_cov_mm2_s2=speed_cov,
        centroid_points=plan.centroid_points,
        centroid_mm=centre,
        centroid_cov_mm2=centre_cov,
        centroid_displacement_mm=centre_moved,
        centroid_displacement_cov_mm2=centre_moved_cov,
        centroid_velocity_mm_s=centre_speed,
        centroid_velocity_cov_mm2_s2=centre_speed_cov,
    )


def motion_rows(motion: Motion, rows: slice) -> Motion:
    """Some of the stages that a motion was computed for."""
    series = (name for name in Motion.__dataclass_fields__ if name not in _COMMON)
    return dataclasses.replace(motion, **{name: getattr(motion, name)[rows] for name in series})


_COMMON = ("reference_stage", "centroid_points")


def _centroid_of(part: Trajectories, points: IntArray) -> tuple[FloatArray, ...]:
    there = np.isin(points, part.point_id)
    if not there.all():  # one is not measured at any of these stages: there is no mean
        return _centroid(part, np.empty(0, np.intp))
    return _centroid(part, np.searchsorted(part.point_id, points))


def compute_motion(trajectories: Trajectories, options: MotionOptions | None = None) -> Motion:
    """Displacement, velocity and centroid series of measured trajectories.

    Without times (no frame rate) the velocities are NaN.

    Raises
    ------
    ValueError
        If the reference stage or a centroid's point was not measured.
    """
    options = options or MotionOptions()
    stage: IntArray = trajectories.stage
    reference = options.reference_stage if options.reference_stage is not None else int(stage[0])
    if reference not in stage:
        raise ValueError(
            f"[motion] reference_stage {reference}: measured are {stage[0]} to {stage[-1]}; name "
            "one of these"
        )
    row = int(np.flatnonzero(stage == reference)[0])
    kept = without_flagged(trajectories, options.leave_out)
    measured = np.isfinite(kept.position_mm[..., 0])
    plan = plan_motion(trajectory_rows(trajectories, slice(row, row + 1)), measured, options)
    return motion_part(trajectories, plan)


def trajectory_rows(trajectories: Trajectories, rows: slice) -> Trajectories:
    """The trajectories of some of the stages."""
    series = (n for n in Trajectories.__dataclass_fields__ if n not in ("point_id", "camera_names"))
    return dataclasses.replace(trajectories, **{n: getattr(trajectories, n)[rows] for n in series})
