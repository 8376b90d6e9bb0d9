"""A camera that has moved: which one, since when, how far."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from videogrammetry.reconstruction.pose_looks import PRIOR_PX, CumulatedLooks, Sums
from videogrammetry.reconstruction.small_matrices import quadratic
from videogrammetry.types import FloatArray

#: Cameras are told apart by likelihoods of 1000 to 1, and of 1 % of the logarithm, for
#: the model is linear in the motion; so are the stages at which a motion may have begun.
_APART, _APART_SHARE = 2 * math.log(1000.0), 0.01
#: Of three parameters at 0.999: below it the translation says nothing more.
_TURN_ALONE = 16.27
#: Parts of a picture in each of which a lens' error that no calibration models is its own.
_PATCHES = 12.0


@dataclass(frozen=True, kw_only=True)
class PoseChange:
    """A camera that has moved.

    Attributes
    ----------
    cameras : their numbers: the likeliest, then those that the residuals cannot tell from it.
    since : "sequence": between the stages ``after`` and ``stage``; "calibration": before
        the first stage, ``after`` is 0.
    found : the stage at which it was noticed.
    turn_rad, shift_mm, sigma_turn_rad, sigma_shift_mm : (3,) of the first of the cameras,
        a turn about its projection centre (rotation vector on the left of cam_from_world)
        and that centre's shift in the rig's frame; a shift that adds nothing is 0 with
        NaN, and the turn then is that without a shift.
    parameters : 6, or 1 where the turn about the optical axis by itself was noticed.
    chi2 : of that many. critical : what it was held against.
    """

    cameras: tuple[int, ...]
    since: str
    after: int
    stage: int
    found: int
    turn_rad: FloatArray
    shift_mm: FloatArray
    sigma_turn_rad: FloatArray
    sigma_shift_mm: FloatArray
    parameters: int
    chi2: float
    critical: float


@dataclass(frozen=True)
class Alarm:
    """A window of looks that says of a camera that it has moved, by 6 or 1 parameters."""

    end: int
    width: int
    camera: int
    parameters: int
    against: str


@dataclass(frozen=True)
class Tested:
    """Of m windows: chi-square of six and of the roll, s (m, 6) with covariance, noise's factor."""

    six: FloatArray
    roll: FloatArray
    s: FloatArray
    cov: FloatArray
    noise: FloatArray


def tested(sums: Sums, against: str) -> Tested:
    """What windows say, with the noise, what stays from look to look, and the calibration."""
    n, share = sums.n, sums.share
    left = sums.chi2 - quadratic(sums.g, n)
    noise = np.maximum(1.0, left / np.maximum(sums.redundancy - 6, 1))
    # What stays from look to look is smooth over the picture: neighbours do not average it.
    stays = share * np.maximum(1.0, sums.points / _PATCHES)
    own = (1 - share) + stays * sums.count
    cov = n * own[:, None, None]
    s, by = sums.g, sums.by
    if against == "sequence":
        by_reference = n @ sums.cov0
        s = s - (by_reference @ sums.g0[..., None])[..., 0]
        reference = (1 - share) + stays * sums.count0
        cov = cov + by_reference @ n * reference[:, None, None]
        by = by - by_reference @ sums.by0
    cov = cov * noise[:, None, None] + by @ np.swapaxes(by, 1, 2)
    roll = s[:, 2] ** 2 / np.maximum(cov[:, 2, 2], 1e-12)
    return Tested(quadratic(s, cov), roll, s, cov, noise)


def change_of(
    table: CumulatedLooks, alarm: Alarm, still: list[int], scale: FloatArray, criticals: FloatArray
) -> PoseChange:
    """Names the cameras of an alarm, the likeliest first, and says how far that one has moved.

    ``criticals`` : of one and of six parameters. ``scale`` (C, 6) : units of the looks.
    """
    looks = table.looks
    end, begin = alarm.end, alarm.end - alarm.width + 1
    after, stage = 0, table.reference.first_stage
    if alarm.against == "sequence":
        first, begin, last = _begins(table, alarm)
        after = int(looks.stage[first - 1]) if first else int(looks.stage[0]) - 1
        stage = int(looks.stage[last])
    cameras = np.array(still, dtype=np.intp)
    ends, widths = np.full(len(still), end), np.full(len(still), end - begin + 1)
    sums = table.sums(ends, widths, cameras)
    found = tested(sums, alarm.against)
    if alarm.against == "calibration":
        explained = found.six
    else:
        # The freedom of six parameters must be worth what it costs in the test.
        noise = found.noise.min()
        roll = found.s[:, 2] ** 2 / np.maximum(sums.n[:, 2, 2], 1e-12) / noise
        six = quadratic(found.s, sums.n) / noise
        explained = np.maximum(six, roll + (criticals[1] - criticals[0]))
    # Where the others' poses are free, nothing may be left that says of one.
    explained = np.nan_to_num(explained, nan=0.0)
    order = np.argsort(-explained, kind="stable")
    best = order[0]
    margin = max(_APART, _APART_SHARE * float(explained[best]))
    same = [k for k in order if explained[best] - explained[k] <= margin]
    change, sigma = _estimate(found.s[best], sums.n[best], found.cov[best], float(found.six[best]))
    of = scale[cameras[best]]
    return PoseChange(
        cameras=tuple(int(cameras[k]) for k in same),
        since=alarm.against,
        after=after,
        stage=stage,
        found=int(looks.stage[end]),
        turn_rad=(change * of)[:3],
        shift_mm=(change * of)[3:],
        sigma_turn_rad=(sigma * of)[:3],
        sigma_shift_mm=(sigma * of)[3:],
        parameters=alarm.parameters,
        chi2=float((found.six if alarm.parameters == 6 else found.roll)[best]),
        critical=float(criticals[0 if alarm.parameters == 1 else 1]),
    )


def _begins(table: CumulatedLooks, alarm: Alarm) -> tuple[int, int, int]:
    """Rows of the first look at which the motion may have begun, the likeliest and the last."""
    ends = alarm.end + 1
    most = min(ends, int(table.before) + ends - 2)
    widths = np.arange(1, most + 1)
    six, roll = table.noise_chi2(
        np.full(most, alarm.end), widths, np.full(most, alarm.camera, dtype=np.intp)
    )
    value = six if alarm.parameters == 6 else roll
    best = float(value.max())
    likely = np.flatnonzero(value >= best - _APART)
    return (
        ends - int(widths[likely[-1]]),
        ends - int(widths[value.argmax()]),
        ends - int(widths[likely[0]]),
    )


def estimate(s: FloatArray, n: FloatArray, cov: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(m, k) motions with standard deviations of scores s, information n, covariance cov."""
    inverse = np.linalg.inv(n + np.eye(n.shape[-1]) / PRIOR_PX**2)
    change = (inverse @ s[..., None])[..., 0]
    spread = np.diagonal(inverse @ cov @ inverse, axis1=-2, axis2=-1)
    return change, np.sqrt(np.maximum(spread, 0.0))


def _estimate(
    s: FloatArray, n: FloatArray, cov: FloatArray, chi2: float
) -> tuple[FloatArray, FloatArray]:
    """(6,) turn and shift with standard deviations; the turn alone where that says it all."""
    of_turn = quadratic(s[None, :3], cov[None, :3, :3])[0]
    size = 3 if chi2 - of_turn < _TURN_ALONE else 6
    change, sigma = np.zeros(6), np.full(6, np.nan)
    change[:size], sigma[:size] = estimate(s[:size], n[:size, :size], cov[:size, :size])
    return change, sigma
