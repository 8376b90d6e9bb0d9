"""A free fall measured against gravity: the paper's regression and a fit with its sigma.

Gravity is a length standard that fills the whole volume: a scale error of the
calibration shows as the same relative error of the measured acceleration.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from videogrammetry.accuracy.calibration_part import CalibrationPart
from videogrammetry.accuracy.fall_model import FallModel, FallSolution, solve_fall
from videogrammetry.types import FloatArray, IntArray, Trajectories, matrix_from_cov6

#: Standard acceleration of free fall, CGPM 1901; the local one lies within 0.3 % of it.
STANDARD_GRAVITY_M_S2 = 9.80665

_DETERMINED = 3.0  # standard deviations from which on an estimated drag is kept
# A normal position is farther off than this once in 10^9 (chi-square, three coordinates).
_WRONG_CHI2 = 45.0
_MEDIAN_CHI2 = 2.366
_MAX_REJECTIONS = 20  # rounds
_MIN_STAGES = 4  # a parabola has three unknowns, the fourth checks it


@dataclass(frozen=True, kw_only=True)
class FreeFallOptions:
    """What is known of the fall.

    Attributes
    ----------
    gravity_m_s2 : the local acceleration of free fall, > 0.
    drag_per_m : k of the air's resistance, dv/dt = g - k |v| v; 0: none.
    estimate_drag : estimate k together with the acceleration; kept only if it
        is three standard deviations or more.
    up : the upward vertical in the rig's frame; None: from the fall itself.
    spin : take out what a constant rotation of the body adds beyond first
        order, if the points move as one rigid body.
    """

    gravity_m_s2: float = STANDARD_GRAVITY_M_S2
    drag_per_m: float = 0.0
    estimate_drag: bool = False
    up: tuple[float, float, float] | None = None
    spin: bool = True

    def __post_init__(self) -> None:
        if not self.gravity_m_s2 > 0:
            raise ValueError(f"gravity_m_s2: expected a positive number, got {self.gravity_m_s2}")
        if not self.drag_per_m >= 0:
            raise ValueError(f"drag_per_m: expected 0 or more, got {self.drag_per_m}")
        if self.up is not None and not np.linalg.norm(self.up) > 0:
            raise ValueError(f"up: expected a direction, got {self.up}")


@dataclass(frozen=True, kw_only=True)
class FallRegression:
    """The paper's test: a straight line y = slope x + offset through all stages.

    x is the measured vertical displacement since the first stage, mean of the
    points (less what each has moved beside the others, so that a lost one makes
    no jump), and y = -g t^2 / 2 with t from that stage; both are negative
    downwards, mm. It supposes that the fall starts from rest there.

    Attributes
    ----------
    slope, offset_mm : of the line. slope_sigma : from the residuals.
    short_percent : (1 - 1/slope) 100: by how much the measured falls are short.
    residual_rms_mm : sqrt(sum(residual^2) / (n - 2)) in y.
    stage : (n,). measured_mm, gravity_mm : (n,) x and y. point_id : the points used.
    """

    slope: float
    offset_mm: float
    slope_sigma: float
    short_percent: float
    residual_rms_mm: float
    stage: IntArray
    measured_mm: FloatArray
    gravity_mm: FloatArray
    point_id: IntArray


@dataclass(frozen=True, kw_only=True)
class FallFit:
    """s = s0 + v0 t + a t^2 / 2 (plus drag): own s0, v0 of every point, one common a.

    Attributes
    ----------
    acceleration_mm_s2 : (3,) in the rig's frame, of the air-free fall.
    cov_image_mm2_s4, cov_rig_mm2_s4 : (3, 3) from the noise (a posteriori) and
        from the calibration, whose errors all stages share.
    g_m_s2 : |a|, or its part along the given vertical.
    sigma_image_m_s2, sigma_rig_m_s2, sigma_m_s2 : its standard deviations.
    deviation_percent : (g / local g - 1) 100. deviation_sigmas : in ``sigma_m_s2``.
    up : (3,) upward vertical of the fall, -a/|a|. up_sigma_rad : the larger of
        its two standard deviations. tilt_rad : angle to the given vertical, NaN
        without one.
    sigma0 : a posteriori, of unit weight; 1 if the predicted noise is right.
    redundancy, observations : coordinates left over, and used.
    residual_rms_mm : per coordinate.
    point_id, point_stages : points used and in how many stages.
    dropped : points with fewer than three stages.
    rejected : (M, 2) stage and number of positions that no noise explains and
        that were left out: beyond chi-square 45 in units of the median's.
    time_s : of the stage to which ``velocity_mm_s`` (P, 3), the points' own, refers.
    spin_rad_s : (3,) rotation taken out, about the mean of the points; zeros: none.
    spin_percent_per_mm : |w|^2 / g: what g is off, in per cent, for every mm that
        the mean of the points lies beside the centre of mass; the fall cannot
        tell the two apart.
    drag_per_m, drag_sigma_per_m : k as used or estimated; sigma NaN if it was given.
    drag_determined : None if it was not to be estimated; False: the estimate
        was smaller than three sigmas and is not applied.
    """

    acceleration_mm_s2: FloatArray
    cov_image_mm2_s4: FloatArray
    cov_rig_mm2_s4: FloatArray
    g_m_s2: float
    sigma_image_m_s2: float
    sigma_rig_m_s2: float
    sigma_m_s2: float
    deviation_percent: float
    deviation_sigmas: float
    up: FloatArray
    up_sigma_rad: float
    tilt_rad: float
    sigma0: float
    redundancy: int
    observations: int
    residual_rms_mm: float
    point_id: IntArray
    point_stages: IntArray
    dropped: IntArray
    rejected: IntArray
    time_s: float
    velocity_mm_s: FloatArray
    spin_rad_s: FloatArray
    spin_percent_per_mm: float
    drag_per_m: float
    drag_sigma_per_m: float
    drag_determined: bool | None


@dataclass(frozen=True, kw_only=True)
class FreeFallTest:
    """Both tests of one fall; ``first``, ``last`` stage, inclusive."""

    first: int
    last: int
    gravity_m_s2: float
    regression: FallRegression
    fit: FallFit


def fall_regression(
    measured_mm: FloatArray, time_s: FloatArray, gravity_m_s2: float = STANDARD_GRAVITY_M_S2
) -> tuple[float, float, float, float]:
    """slope, offset_mm, slope_sigma, residual_rms_mm of y = slope x + offset.

    x = ``measured_mm`` (n,) vertical displacements, negative downwards,
    y = -1000 g t^2 / 2, t = ``time_s`` (n,) since the start from rest.

    Examples
    --------
    >>> t = np.linspace(0, 1, 11)
    >>> slope, offset, _, rms = fall_regression(-9.80665 * 500 * t**2 / 1.0188 - 1.0, t)
    >>> round(slope, 4), round(offset, 4), round((1 - 1 / slope) * 100, 2), round(rms, 9)
    (1.0188, 1.0188, 1.85, 0.0)
    """
    x = np.asarray(measured_mm, dtype=float)
    if len(x) < 3:
        raise ValueError(f"measured_mm: a line with a residual needs 3 stages, got {len(x)}")
    y = -500.0 * gravity_m_s2 * time_s**2
    centred = x - x.mean()
    spread = float(centred @ centred)
    slope = float(centred @ y) / spread
    offset = float(y.mean() - slope * x.mean())
    rms = float(np.sqrt(((y - slope * x - offset) ** 2).sum() / (len(x) - 2)))
    return slope, offset, rms / np.sqrt(spread), rms


def check_free_fall(
    trajectories: Trajectories,
    first: int,
    last: int,
    part: CalibrationPart,
    options: FreeFallOptions | None = None,
    *,
    points: Sequence[int] | None = None,
    sigma_px: FloatArray | None = None,
) -> FreeFallTest:
    """Measure gravity with the points that fall freely from stage ``first`` to ``last``.

    Parameters
    ----------
    trajectories : measured points with times.
    part : of the rig that measured, its cameras as in ``trajectories``.
    points : numbers of the falling points; None: all.
    sigma_px : (S, P, C) weights of the sightings; None: all alike.

    Raises
    ------
    ValueError
        Without times, with too few stages or such as were not measured, if a point
        was never measured, or if the fall is upwards by ``options.up``.
    """
    options = options or FreeFallOptions()
    rows = np.flatnonzero((trajectories.stage >= first) & (trajectories.stage <= last))
    columns = _columns(trajectories, points)
    _check(trajectories, rows, first, last)
    position = trajectories.position_mm[np.ix_(rows, columns)]
    enough = np.isfinite(position[..., 0]).sum(axis=0) >= 3
    if not enough.any():
        raise ValueError(f"free fall: no point was measured in 3 stages of {first} to {last}")
    kept = columns[enough]
    position = position[:, enough]
    effects = part.effects_at(trajectories, rows, kept, sigma_px)
    weight = _weights(trajectories, rows, kept)
    time = trajectories.time_s[rows]
    drag = options.drag_per_m / 1000.0
    model = FallModel(time_s=time, drag_per_mm=drag, estimate_drag=options.estimate_drag)
    solution, good = _without_wrong(model, position, weight, effects, options.spin)
    estimated = solution if options.estimate_drag else None
    if estimated is not None and not _drag_determined(estimated):
        model = FallModel(time_s=time, drag_per_mm=0.0, estimate_drag=False)
        solution, good = _without_wrong(model, position, weight, effects, options.spin)
    fit = _fit(solution, estimated, trajectories.point_id, kept, columns[~enough], options)
    s, p = np.nonzero(~good)
    wrong = np.stack([trajectories.stage[rows[s]], trajectories.point_id[kept[p]]], axis=1)
    fit = dataclasses.replace(fit, rejected=wrong)
    if fit.g_m_s2 <= 0:
        raise ValueError(
            f"free fall: the points are accelerated upwards by the given vertical, "
            f"{np.degrees(fit.tilt_rad):.0f} degrees from that of the fall: give the direction "
            "that points up, in the rig's frame"
        )
    up = fit.up if options.up is None else np.asarray(options.up) / np.linalg.norm(options.up)
    regression = _regression(
        trajectories,
        rows,
        kept,
        np.where(good[..., None], solution.relative_mm, np.nan),
        up,
        options.gravity_m_s2,
    )
    return FreeFallTest(
        first=first,
        last=last,
        gravity_m_s2=options.gravity_m_s2,
        regression=regression,
        fit=fit,
    )


def _without_wrong(
    model: FallModel, position: FloatArray, weight: FloatArray, effects: FloatArray, spin: bool
) -> tuple[FallSolution, npt.NDArray[np.bool_]]:
    """The solution without wrong positions, and (n, P) which were left in or missing."""
    good = np.ones(position.shape[:2], dtype=bool)
    for _ in range(_MAX_REJECTIONS):
        there = good & np.asarray(np.isfinite(position).all(axis=2))
        kept = np.where(there[..., None], position, np.nan)
        kept_weight = np.where(there[..., None, None], weight, 0.0)
        solution = solve_fall(model, kept, kept_weight, effects, spin=spin)
        left = solution.residual_mm
        square = np.einsum("npi,npij,npj->np", left, weight, left)
        unit = float(np.median(square[there])) / _MEDIAN_CHI2
        wrong = there & (square > _WRONG_CHI2 * unit)
        # A wrong position bends its point's own path: the worst of each point goes first.
        wrong &= square == np.where(there, square, 0.0).max(axis=0)
        wrong &= there.sum(axis=0) - wrong.sum(axis=0) >= 3  # or the point would be lost
        if not wrong.any():
            break
        good &= ~wrong
    return solution, good


def _columns(table: Trajectories, points: Sequence[int] | None) -> IntArray:
    if points is None:
        return np.arange(len(table.point_id), dtype=np.int32)
    missing = sorted(set(points) - set(table.point_id.tolist()))
    if missing:
        raise ValueError(
            f"free fall: points {missing} were measured at no stage; measured are "
            f"{', '.join(map(str, table.point_id[:30].tolist()))}"
            f"{', ...' if len(table.point_id) > 30 else ''}"
        )
    return np.flatnonzero(np.isin(table.point_id, list(points))).astype(np.int32)


def _check(table: Trajectories, rows: npt.NDArray[np.intp], first: int, last: int) -> None:
    measured = f"measured are {table.stage[0]} to {table.stage[-1]}"
    if first < table.stage[0] or last > table.stage[-1]:
        raise ValueError(
            f"free fall: stages {first} to {last} were asked for, {measured}; "
            "name stages among these"
        )
    if len(rows) < _MIN_STAGES:
        raise ValueError(
            f"free fall: stages {first} to {last} hold {len(rows)} measured stages, "
            f"{_MIN_STAGES} or more are needed; {measured}"
        )
    if not np.isfinite(table.time_s[rows]).all():
        raise ValueError(
            "free fall: the measurement has no times; give [sequence] frame_rate_hz and measure "
            "again"
        )


def _weights(table: Trajectories, rows: npt.NDArray[np.intp], columns: IntArray) -> FloatArray:
    """(n, P, 3, 3) inverse covariances of the noise, 0 where a point is missing."""
    cov = matrix_from_cov6(table.cov_image_mm2[np.ix_(rows, columns)])
    there = np.isfinite(cov).all(axis=(2, 3))
    weight = np.zeros_like(cov)
    weight[there] = np.linalg.inv(cov[there])
    return weight


def _drag_determined(solution: FallSolution) -> bool:
    return solution.drag_per_mm > _DETERMINED * solution.drag_sigma_per_mm


def _fit(
    solution: FallSolution,
    estimated: FallSolution | None,
    point_id: IntArray,
    kept: IntArray,
    dropped: IntArray,
    options: FreeFallOptions,
) -> FallFit:
    a = solution.acceleration_mm_s2
    size = float(np.linalg.norm(a))
    up = -a / size
    along = up if options.up is None else np.asarray(options.up) / np.linalg.norm(options.up)
    g = float(-a @ along)
    image, rig = solution.cov_image[:3, :3], solution.cov_rig[:3, :3]
    parts = [float(np.sqrt(along @ c @ along)) / 1000 for c in (image, rig)]
    sigma = float(np.hypot(parts[0], parts[1]))
    across = np.eye(3) - np.outer(up, up)
    tilt = float(np.sqrt(np.linalg.eigvalsh(across @ (image + rig) @ across)[-1]) / size)
    drag = estimated or solution
    return FallFit(
        acceleration_mm_s2=a,
        cov_image_mm2_s4=image,
        cov_rig_mm2_s4=rig,
        g_m_s2=g / 1000,
        sigma_image_m_s2=parts[0],
        sigma_rig_m_s2=parts[1],
        sigma_m_s2=sigma,
        deviation_percent=(g / 1000 / options.gravity_m_s2 - 1) * 100,
        deviation_sigmas=(g / 1000 - options.gravity_m_s2) / sigma,
        up=up,
        up_sigma_rad=tilt,
        tilt_rad=float("nan")
        if options.up is None
        else float(np.arctan2(np.linalg.norm(np.cross(up, along)), up @ along)),
        sigma0=solution.sigma0,
        redundancy=solution.redundancy,
        observations=solution.observations,
        residual_rms_mm=solution.residual_rms_mm,
        point_id=point_id[kept],
        point_stages=solution.point_stages,
        dropped=point_id[dropped],
        rejected=np.empty((0, 2), dtype=np.int32),
        time_s=solution.time_s,
        velocity_mm_s=solution.velocity_mm_s,
        spin_rad_s=solution.spin_rad_s,
        spin_percent_per_mm=float(solution.spin_rad_s @ solution.spin_rad_s) / size * 100,
        drag_per_m=drag.drag_per_mm * 1000,
        drag_sigma_per_m=drag.drag_sigma_per_mm * 1000,
        drag_determined=None if estimated is None else _drag_determined(estimated),
    )


def _regression(
    table: Trajectories,
    rows: npt.NDArray[np.intp],
    columns: IntArray,
    relative_mm: FloatArray,
    up: FloatArray,
    gravity: float,
) -> FallRegression:
    """With each point's own motion, as fitted, taken out: a lost point makes no jump.

    Over all points that own motion has the mean zero, so that without lost
    points this is the mean displacement.
    """
    height = (table.position_mm[np.ix_(rows, columns)] - relative_mm) @ up
    whole = np.flatnonzero(np.isfinite(height).any(axis=1))
    level = np.nanmean(height[whole], axis=1)
    fallen, time = level - level[0], table.time_s[rows][whole] - table.time_s[rows[0]]
    slope, offset, sigma, rms = fall_regression(fallen, time, gravity)
    return FallRegression(
        slope=slope,
        offset_mm=offset,
        slope_sigma=sigma,
        short_percent=(1 - 1 / slope) * 100,
        residual_rms_mm=rms,
        stage=table.stage[rows][whole],
        measured_mm=fallen,
        gravity_mm=-500.0 * gravity * time**2,
        point_id=table.point_id[columns],
    )
