"""The fall of many points with one acceleration, solved by least squares.

    x_p(t) = s0_p + v0_p t + a t^2/2 + d(t) + e_p(t)

with t from the middle of the fall, d what the air's resistance adds and e_p
what a constant rotation adds beyond first order.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from videogrammetry.types import FloatArray, IntArray

_MAX_ROUNDS = 30
_CONVERGED = 1e-10  # of the acceleration, relative
# A rotation leaves this much of the velocities, while its higher orders are still in them.
_RIGID_SHARE = 0.05
_RIGID_SIGMAS = 5.0


@dataclass(frozen=True, kw_only=True)
class FallModel:
    """Times (n,) s, drag k in 1/mm as given (or as start), and whether to estimate it."""

    time_s: FloatArray
    drag_per_mm: float = 0.0
    estimate_drag: bool = False


@dataclass(frozen=True, kw_only=True)
class FallSolution:
    """Solution over n stages and P points; see :func:`solve_fall`.

    ``cov_image`` (a posteriori) and ``cov_rig`` are (M, M) of the acceleration
    and, where it is estimated, the drag (1/mm); ``time_s`` is the middle, to which
    ``start_mm`` and ``velocity_mm_s`` (P, 3) refer; ``relative_mm`` (n, P, 3) is the
    fitted motion of each point beside the mean of all, ``residual_mm`` (n, P, 3)
    measured - fitted, 0 where missing.
    """

    acceleration_mm_s2: FloatArray
    drag_per_mm: float
    drag_sigma_per_mm: float
    cov_image: FloatArray
    cov_rig: FloatArray
    sigma0: float
    redundancy: int
    observations: int
    residual_rms_mm: float
    point_stages: IntArray
    time_s: float
    start_mm: FloatArray
    velocity_mm_s: FloatArray
    spin_rad_s: FloatArray
    relative_mm: FloatArray
    residual_mm: FloatArray


def drag_path(
    time_s: FloatArray, velocity: FloatArray, acceleration: FloatArray, drag_per_mm: float
) -> FloatArray:
    """(n, 3) mm: what drag adds to v t + a t^2/2, by dv/dt = a - k |v| v, v(0) = velocity.

    Examples
    --------
    Falling from rest with drag: s = ln(cosh(t sqrt(g k))) / k.

    >>> t, g, k = np.array([0.0, 0.5]), 9806.65, 1e-4
    >>> added = drag_path(t, np.zeros(3), np.array([0, 0, -g]), k)[1, 2]
    >>> exact = -np.log(np.cosh(t[1] * np.sqrt(g * k))) / k + g * t[1]**2 / 2
    >>> bool(abs(added - exact) < 1e-5), round(float(added), 3)
    (True, 47.04)
    """
    path = np.zeros((len(time_s), 3))
    if drag_per_mm == 0.0:
        return path

    def slope(t: float, state: FloatArray) -> FloatArray:
        v = velocity + acceleration * t + state[3:]
        return np.concatenate([state[3:], -drag_per_mm * np.linalg.norm(v) * v])

    for side in (time_s >= 0, time_s < 0):
        if not side.any():
            continue
        end = float(time_s[side][np.abs(time_s[side]).argmax()])
        if end == 0.0:
            continue
        solved = solve_ivp(
            slope, (0.0, end), np.zeros(6), method="DOP853", dense_output=True,
            rtol=1e-10, atol=1e-9,
        )  # fmt: skip
        assert solved.sol is not None  # dense_output
        path[side] = solved.sol(time_s[side])[:3].T
    return path


def solve_fall(
    model: FallModel,
    position_mm: FloatArray,
    weight: FloatArray,
    effects_mm: FloatArray,
    *,
    spin: bool = True,
) -> FallSolution:
    """Least squares over s0_p, v0_p of every point and a (and k) of all.

    Gauss-Newton; every point's six unknowns are eliminated, so that the normal
    equations left over are (3, 3) or (4, 4). The solution is linear in the
    positions, theta = sum K_i x_i; the calibration's effects B_i on them
    (``CalibrationPart``), the same at all stages, give
    cov_rig = (sum K_i B_i)(sum K_i B_i)^T.

    Parameters
    ----------
    position_mm : (n, P, 3), NaN where missing; three stages or more a point.
    weight : (n, P, 3, 3) inverse covariances, 0 where missing.
    effects_mm : (n, P, 3, R).
    spin : take a constant rotation out where the points move as a rigid body.
    """
    there = np.asarray(np.isfinite(position_mm).all(axis=2))
    middle = float((model.time_s.min() + model.time_s.max()) / 2)
    time = model.time_s - middle
    count = position_mm.shape[1]
    state = _State(np.zeros((count, 3)), np.zeros((count, 3)), np.zeros(3), model.drag_per_mm)
    path = _path_over(time)
    turn = np.zeros(3)
    for _ in range(_MAX_ROUNDS):
        model_mm = _positions(state, time, path(state)) + _turned(time, state.start, turn)
        residual = np.where(there[..., None], position_mm - model_mm, 0.0)
        # Drag acts on a velocity: the first round finds one.
        estimate = model.estimate_drag and bool(state.acceleration.any())
        design, by_velocity = _design(state, time, path, estimate)
        step = _Step(there, weight, design, by_velocity, residual)
        before = state.acceleration
        state = step.apply(state)
        turn_before, turn = turn, _spin(state, step) if spin else turn
        moved = np.linalg.norm(state.acceleration - before)
        spun = np.linalg.norm(turn - turn_before)
        size = np.linalg.norm(state.acceleration)
        if moved <= _CONVERGED * size and spun <= 1e-9 * max(float(np.linalg.norm(turn)), 1e-3):
            break
    model_mm = _positions(state, time, path(state)) + _turned(time, state.start, turn)
    residual = np.where(there[..., None], position_mm - model_mm, 0.0)
    relative = _relative(state, time) + _turned(time, state.start, turn)
    return _solution(model, state, step, residual, effects_mm, middle, turn, relative)


@dataclass
class _State:
    start: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    drag: float

    @property
    def common_velocity(self) -> FloatArray:
        mean: FloatArray = self.velocity.mean(axis=0)
        return mean


def _path_over(time: FloatArray) -> Callable[[_State], FloatArray]:
    """What drag adds at these times, by the state."""

    def path(state: _State) -> FloatArray:
        return drag_path(time, state.common_velocity, state.acceleration, state.drag)

    return path


def _positions(state: _State, time: FloatArray, path: FloatArray) -> FloatArray:
    common = 0.5 * time[:, None] ** 2 * state.acceleration + path
    positions: FloatArray = (
        state.start[None] + state.velocity[None] * time[:, None, None] + common[:, None]
    )
    return positions


def _relative(state: _State, time: FloatArray) -> FloatArray:
    arm = state.start - state.start.mean(axis=0)
    drift = state.velocity - state.common_velocity
    relative: FloatArray = arm + time[:, None, None] * drift
    return relative


def _turned(time: FloatArray, start: FloatArray, turn: FloatArray) -> FloatArray:
    """(n, P, 3): (R(t) - I - [w]t) r of a constant rotation w about the points' mean."""
    if not turn.any():
        return np.zeros((len(time), *start.shape))
    arm = start - start.mean(axis=0)
    rotated = np.einsum("nij,pj->npi", Rotation.from_rotvec(time[:, None] * turn).as_matrix(), arm)
    added: FloatArray = rotated - arm - time[:, None, None] * np.cross(turn, arm)
    return added


def _design(
    state: _State, time: FloatArray, path: Callable[[_State], FloatArray], estimate: bool
) -> tuple[FloatArray, FloatArray]:
    """Derivatives by (a, k) (n, 3, M) and by the velocity (n, 3, 3); d's numerically."""
    eye = np.eye(3)
    by_a = 0.5 * time[:, None, None] ** 2 * eye
    by_v = time[:, None, None] * eye
    if state.drag > 0:
        for axis in range(3):
            h = eye[axis]
            up, down = (
                path(_State(state.start, state.velocity, state.acceleration + s * h, state.drag))
                for s in (1.0, -1.0)
            )
            by_a[:, :, axis] += (up - down) / 2
            up, down = (
                path(_State(state.start, state.velocity + s * h, state.acceleration, state.drag))
                for s in (1.0, -1.0)
            )
            by_v[:, :, axis] += (up - down) / 2
    if not estimate:
        return by_a, by_v
    h_k = 1e-8  # 1e-5 per metre
    up, down = (
        path(_State(state.start, state.velocity, state.acceleration, state.drag + s * h_k))
        for s in (1.0, -1.0)
    )
    return np.concatenate([by_a, ((up - down) / (2 * h_k))[:, :, None]], axis=2), by_v


class _Step:
    """One linear solution with the points eliminated, and the operator that made it."""

    def __init__(
        self,
        there: npt.NDArray[np.bool_],
        weight: FloatArray,
        design: FloatArray,
        by_velocity: FloatArray,
        residual: FloatArray,
    ) -> None:
        self.there = there
        self.weight = weight
        count = there.shape[1]
        unknowns = design.shape[2]
        own = np.concatenate([np.broadcast_to(np.eye(3), by_velocity.shape), by_velocity], axis=2)
        # Lengths, times and drags differ by many powers of ten: the columns are scaled.
        scale_own = np.linalg.norm(own, axis=(0, 1))
        self.scale = np.linalg.norm(design, axis=(0, 1))
        own, design = own / scale_own, design / self.scale
        # (P, 6, 6), (P, M, 6), and what is left for the common unknowns.
        by_own = np.einsum("nai,npab->npib", own, weight)
        n_own = np.einsum("npib,nbj->pij", by_own, own)
        n_mixed = np.einsum("nai,npab,nbj->pij", design, weight, own)
        inverse = np.linalg.inv(n_own)
        self.own_cov = inverse / np.outer(scale_own, scale_own)
        elimination = n_mixed @ inverse
        # (n, P, M, 3): what each position gives to the reduced normal equations.
        self.gain = np.einsum("nai,npab->npib", design, weight) - np.einsum(
            "pij,npjb->npib", elimination, by_own
        )
        reduced = np.einsum("npib,nbj->ij", self.gain, design)
        self.cov = np.linalg.inv((reduced + reduced.T) / 2)
        common = self.cov @ np.einsum("npib,npb->i", self.gain, residual)
        rest = residual - (design @ common)[:, None]
        single = np.einsum("pij,npjb,npb->pi", inverse, by_own, rest) / scale_own
        self.common = common / self.scale
        self.single = single.reshape(count, 6)
        self.unknowns = unknowns

    def apply(self, state: _State) -> _State:
        drag = state.drag + (float(self.common[3]) if self.unknowns > 3 else 0.0)
        return _State(
            state.start + self.single[:, :3],
            state.velocity + self.single[:, 3:],
            state.acceleration + self.common[:3],
            drag,
        )

    def covariance(self) -> FloatArray:
        cov: FloatArray = self.cov / np.outer(self.scale, self.scale)
        return cov

    def effect(self, effects_mm: FloatArray) -> FloatArray:
        """(M, R): sum K_i B_i."""
        known = np.where(self.there[..., None, None], effects_mm, 0.0)
        total: FloatArray = self.cov @ np.einsum("npib,npbr->ir", self.gain, known)
        scaled: FloatArray = total / self.scale[:, None]
        return scaled


def _spin(state: _State, step: _Step) -> FloatArray:
    """(3,) rad/s by v0_p = v + w x r_p; zeros where it is not determined or not rigid."""
    none = np.zeros(3)
    arm = state.start - state.start.mean(axis=0)
    if len(arm) < 3 or np.linalg.matrix_rank(arm, tol=1e-3 * float(np.abs(arm).max())) < 2:
        return none
    relative = state.velocity - state.common_velocity
    by_spin = np.concatenate([np.cross(np.eye(3), r).T for r in arm])
    turn, *_ = np.linalg.lstsq(by_spin, relative.reshape(-1), rcond=None)
    left = relative - np.cross(turn, arm)
    sigma = np.sqrt(np.einsum("pii->p", step.own_cov[:, 3:, 3:]).mean() / 3)
    share = float(np.sqrt((relative**2).mean()))
    rigid = float(np.sqrt((left**2).mean())) <= _RIGID_SIGMAS * sigma + _RIGID_SHARE * share
    return np.asarray(turn) if rigid and share > _RIGID_SIGMAS * sigma else none


def _solution(
    model: FallModel,
    state: _State,
    step: _Step,
    residual: FloatArray,
    effects_mm: FloatArray,
    middle: float,
    turn: FloatArray,
    relative: FloatArray,
) -> FallSolution:
    observations = 3 * int(step.there.sum())
    redundancy = observations - 6 * step.there.shape[1] - step.unknowns
    square = float(np.einsum("npi,npij,npj->", residual, step.weight, residual))
    variance = square / redundancy if redundancy > 0 else float("nan")
    effect = step.effect(effects_mm)
    cov_image, cov_rig = variance * step.covariance(), effect @ effect.T
    k_sigma = np.sqrt((cov_image + cov_rig)[3, 3]) if model.estimate_drag else np.nan
    return FallSolution(
        acceleration_mm_s2=state.acceleration,
        drag_per_mm=state.drag,
        drag_sigma_per_mm=float(k_sigma),
        cov_image=cov_image,
        cov_rig=cov_rig,
        sigma0=float(np.sqrt(variance)),
        redundancy=redundancy,
        observations=observations,
        residual_rms_mm=float(np.sqrt((residual[step.there] ** 2).mean())),
        point_stages=step.there.sum(axis=0).astype(np.int32),
        time_s=middle,
        start_mm=state.start,
        velocity_mm_s=state.velocity,
        spin_rad_s=turn,
        relative_mm=relative,
        residual_mm=residual,
    )
