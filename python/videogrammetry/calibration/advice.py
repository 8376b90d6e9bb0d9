"""What to do better next time: advice that a number of the result asks for."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from videogrammetry.calibration.quality import WEAK_REDUNDANCY, CameraQuality, NetworkQuality

#: Less of the picture's area with points than this leaves its rest to extrapolation.
FEW_COVERED = 0.5
#: x0 and y0 move with the pictures' directions unless pictures are rolled; 90 degrees is best.
SMALL_ROLL_RAD = math.radians(60.0)
#: f and the distance scale together where all points are equally far and nothing is tilted.
SMALL_DEPTH_RATIO = 1.2
SMALL_TILT_RAD = math.radians(20.0)
FEW_PICTURES = 8
#: Positions that two cameras share: with fewer their relative pose hangs on single pictures.
FEW_SHARED = 5
#: Two rays: an error along the epipolar line shows nowhere.
FEW_RAYS = 3
LOW_REDUNDANCY = 0.5
HIGH_CORRELATION = 0.98
MANY_REJECTED = 0.05
#: A stated sigma this many times off weighs a group of observations wrongly.
SIGMA_RATIO = 2.0
#: A component of less redundancy is mostly chance.
ENOUGH_REDUNDANCY = 10.0
BAR_CRITICAL = 3.29
FEW_BARS = 20
_POSE = frozenset({"rx", "ry", "rz", "tx", "ty", "tz"})


@dataclass(frozen=True, kw_only=True)
class Advice:
    """One piece of advice; ``value`` is the number that asked for it."""

    topic: str
    camera: str
    value: float
    text: str


def advise(quality: NetworkQuality) -> tuple[Advice, ...]:
    """What would make the next measurement better; nothing where no number asks for it.

    Parameters
    ----------
    quality : of :func:`quality_of_run` or :func:`quality_of_network`.
    """
    found: list[Advice] = []
    for camera in quality.cameras:
        found += _pictures(camera)
        if not len(camera.pictures):
            continue
        found += _coverage(camera, quality.target)
        found += _angles(camera, quality.target)
        found += _depth(camera, quality.target)
        found += _correlation(camera, quality.target)
        found += _rejected(camera)
    found += _linking(quality)
    found += _reliability(quality)
    found += _bars(quality)
    found += _weights(quality)
    return tuple(found)


def _of(camera: CameraQuality, topic: str, value: float, text: str) -> Advice:
    return Advice(
        topic=topic, camera=camera.name, value=float(value), text=f"Camera {camera.name}: {text}"
    )


def _object(target: bool) -> str:
    return "the target" if target else "the object"


def _coverage(camera: CameraQuality, target: bool) -> list[Advice]:
    coverage = camera.coverage
    if coverage.empty:
        n = len(coverage.empty)
        return [
            _of(
                camera, "coverage", n,
                f"{n} of the nine parts of its picture {'has' if n == 1 else 'have'} no point "
                f"({', '.join(coverage.empty)}); {coverage.share:.0%} of the area is covered. The "
                f"lens is only extrapolated there: bring {_object(target)} into "
                f"{'it' if n == 1 else 'them'}.",
            )
        ]  # fmt: skip
    if coverage.share < FEW_COVERED:
        return [
            _of(
                camera, "coverage", coverage.share,
                f"points cover only {coverage.share:.0%} of its picture's area: fill the picture, "
                "its corners above all.",
            )
        ]  # fmt: skip
    return []


def _pictures(camera: CameraQuality) -> list[Advice]:
    n = len(camera.pictures)
    if n >= FEW_PICTURES:
        return []
    used = f"only {n} picture{' was' if n == 1 else 's were'} used" if n else "no picture was used"
    return [
        _of(
            camera, "pictures", n, f"{used}; {FEW_PICTURES} are the least, 16 and more are good."
        )
    ]  # fmt: skip


def _angles(camera: CameraQuality, target: bool) -> list[Advice]:
    """Roll and tilt, where what they determine was asked for."""
    asked = {*camera.free, *camera.undetermined}
    found = []
    if asked & {"x0", "y0"} and camera.roll_span_rad < SMALL_ROLL_RAD:
        rolls = np.degrees(camera.pictures.roll_rad[np.isfinite(camera.pictures.roll_rad)])
        span = math.degrees(camera.roll_span_rad)
        where = f" ({rolls.min():+.0f} to {rolls.max():+.0f})" if 0 < len(rolls) < 2000 else ""
        found.append(
            _of(
                camera, "roll", span,
                f"its pictures are rolled about its axis by {span:.0f} degrees among each "
                f"other{where}. x0 and y0 need pictures rolled by 90 degrees: turn "
                f"{'the target in its plane' if target else 'the camera'} in a third of them.",
            )
        )  # fmt: skip
    if asked & {"f", "x0", "y0"} and camera.tilt_rad < SMALL_TILT_RAD:
        tilt = math.degrees(camera.tilt_rad)
        what = (
            f"the target was tilted by {tilt:.0f} degrees at most: tilt it by 30 to 45 degrees, "
            "to all four sides"
            if target
            else f"its directions of view differ by {tilt:.0f} degrees at most: take pictures "
            "from the left and right, above and below, 60 to 90 degrees apart"
        )
        found.append(_of(camera, "tilt", tilt, f"{what}; f and x0, y0 are determined by that."))
    return found


def _depth(camera: CameraQuality, target: bool) -> list[Advice]:
    near, far = camera.depth_mm
    if not near > 0 or "f" not in {*camera.free, *camera.undetermined}:
        return []
    ratio = far / near
    if ratio >= SMALL_DEPTH_RATIO:
        return []
    what = (
        "put the target nearer and farther" if target else "take pictures from nearer and farther"
    )
    return [
        _of(
            camera, "depth", ratio,
            f"all points are {near:.0f} to {far:.0f} mm away, the farthest only {ratio:.2f} times "
            f"the nearest: {what} (1.5 times), or f and the distance are hardly told apart.",
        )
    ]  # fmt: skip


def _correlation(camera: CameraQuality, target: bool) -> list[Advice]:
    """Interior parameters that are hardly told apart from each other, or f from the distance.

    The powers of one radius are always alike. So are, of a long lens in a rig, the
    principal point and the camera's place across its axis: no picture changes that.
    """
    pairs = [
        (a, b, r)
        for a, b, r in camera.correlations.pairs(HIGH_CORRELATION)
        if not a[0] == b[0] == "A"
        and ((b not in _POSE and a not in _POSE) or {a, b} <= {"f", "tx", "ty", "tz"})
        and not {a, b} <= _POSE
    ]
    if not pairs:
        return []
    named = ", ".join(f"{a} and {b} ({r:+.3f})" for a, b, r in pairs[:6])
    more = f" and {len(pairs) - 6} more" if len(pairs) > 6 else ""
    rolled = camera.roll_span_rad >= SMALL_ROLL_RAD
    remedies = [
        "more depth and more tilt" if any("f" in pair[:2] for pair in pairs) else "",
        "points farther out in the picture" if rolled else "pictures rolled by 90 degrees",
    ]
    remedy = " and ".join(filter(None, remedies))
    return [
        _of(
            camera, "correlation", abs(pairs[0][2]),
            f"hardly told apart: {named}{more}. {remedy[0].upper()}{remedy[1:]} would separate "
            "them, or free fewer.",
        )
    ]  # fmt: skip


def _rejected(camera: CameraQuality) -> list[Advice]:
    total = camera.points + camera.rejected
    share = camera.rejected / total if total else 0.0
    if share <= MANY_REJECTED:
        return []
    return [
        _of(
            camera, "rejected", share,
            f"{camera.rejected} of {total} image points ({share:.0%}) were rejected, where one "
            "in a hundred is usual: look at them for blur, glare or wrong numbers.",
        )
    ]  # fmt: skip


def _linking(quality: NetworkQuality) -> list[Advice]:
    found = [
        Advice(
            topic="shared", camera=name, value=n,
            text=f"Camera {name}: only {n} positions of the target were seen together with another "
            f"camera; {FEW_SHARED} are the least that tie it to the rig, 16 and more are good.",
        )
        for name, n in quality.shared.items()
        if n < FEW_SHARED
    ]  # fmt: skip
    rays = quality.rays[quality.rays > 0]
    few = int((rays < FEW_RAYS).sum())
    if few:
        found.append(
            Advice(
                topic="rays", camera="", value=few,
                text=f"{few} of {len(rays)} points are seen in only two pictures (mean "
                f"{rays.mean():.1f}): an error along the epipolar line shows nowhere. Take "
                "more pictures of that part, four a point and more.",
            )
        )  # fmt: skip
    return found


def _reliability(quality: NetworkQuality) -> list[Advice]:
    r = quality.reliability
    if not r.coordinates:
        return []
    found = []
    if r.mean < LOW_REDUNDANCY:
        found.append(
            Advice(
                topic="redundancy", camera="", value=r.mean,
                text=f"The mean redundancy of an image coordinate is {r.mean:.2f}: most of an "
                "error hides in the unknowns. More pictures of the same points raise it.",
            )
        )  # fmt: skip
    if r.weak:
        largest = r.largest_detectable_px
        unseen = (
            f"an error of up to {largest:.2g} px there would stay unseen"
            if math.isfinite(largest)
            else "some are not controlled at all"
        )
        found.append(
            Advice(
                topic="reliability", camera="", value=r.weak,
                text=f"{r.weak} of {r.coordinates} image coordinates have a redundancy below "
                f"{WEAK_REDUNDANCY:g}: {unseen} (usual: {r.median_detectable_px:.2g} px). Points "
                "seen in few pictures are the cause.",
            )
        )  # fmt: skip
    return found


def _bars(quality: NetworkQuality) -> list[Advice]:
    """Scale bars: as many as control each other, and none that contradicts."""
    if quality.bars is None:
        if not quality.scale_free:
            return []
        text = (
            "No scale bar gives the scale: lengths are not to be trusted. Put two or more into the "
            "pictures, as long as the object, in different directions."
        )
        return [Advice(topic="scale", camera="", value=0, text=text)]
    bars, found = quality.bars, []
    if quality.scale_free and len(bars) == 1:
        found.append(
            Advice(
                topic="scale", camera="", value=1,
                text="One scale bar gives the scale and nothing controls it: a wrong length would "
                "scale all. Use two or more.",
            )
        )  # fmt: skip
    w = np.abs(bars.normalised)
    # Of very many sightings of a bar one in a thousand is beyond it by chance.
    wrong = np.flatnonzero(~bars.used | ((w > BAR_CRITICAL) & (len(bars) <= FEW_BARS)))
    if len(wrong):
        worst = wrong[np.argmax(np.where(np.isfinite(w[wrong]), w[wrong], np.inf))]
        found.append(
            Advice(
                topic="bar", camera="", value=float(w[worst]),
                text=f"{len(wrong)} of {len(bars)} scale bars "
                f"{'contradicts' if len(wrong) == 1 else 'contradict'} the rest, at worst by "
                f"{abs(bars.residual_mm[worst]):.3g} mm (stated sigma "
                f"{bars.sigma_mm[worst]:.2g} mm): have them measured anew, and do not move them.",
            )
        )  # fmt: skip
    return found


def _weights(quality: NetworkQuality) -> list[Advice]:
    """Groups whose stated standard deviations are far from what their residuals say."""
    found = []
    for component in quality.components:
        ratio = math.sqrt(component.factor) if component.factor >= 0 else math.nan
        off = not 1 / SIGMA_RATIO <= ratio <= SIGMA_RATIO
        if component.redundancy < ENOUGH_REDUNDANCY or not off or not math.isfinite(ratio):
            continue
        size = f"{ratio:.1f} times" if ratio > 1 else f"only {ratio:.2f} of"
        found.append(
            Advice(
                topic="weights", camera="", value=ratio,
                text=f"The residuals of {component.group} are {size} what was stated (redundancy "
                f"{component.redundancy:.0f}): state that standard deviation, or find what is "
                "wrong with them.",
            )
        )  # fmt: skip
    return found
