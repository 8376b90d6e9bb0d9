"""Whether a camera has moved: a sequential test of the scores of its pose.

From looks at single stages come score g and information N of every camera's pose
(:func:`~videogrammetry.reconstruction.camera_scores.camera_scores`). Over windows of looks
that end at the present one, from 2 to 256 of them, the sums G and M are tested:

- against the first looks: s = G - M d0, d0 = (M0 + Q)^-1 G0 the pose's change that the first
  40 looks seem to say (Q a weak prior). What the calibration errs by is in both and cancels
  but for what the object's way through the volume changes, L - M (M0 + Q)^-1 L0;
- against the calibration: s = G with L L', L what its standard errors do to G.

s' cov(s)^-1 s is chi-square with six degrees of freedom while nothing moves, and s_z^2 over
its variance, z the turn about the optical axis, with one: a roll moves the picture least of
all, and five parameters that do not change would hide it the longer. The share of
the variance that stays from look to look is not divided by their number, nor by that of the
points where there are more than 12; all is multiplied by what the residuals left over say
of the noise, if that is more.

This is a generalised likelihood ratio test with a window of limited lengths (Willsky and
Jones 1976; Lai 1995). A window of w looks is tested at every (w / 4)-th look: what it says
changes no faster. The level is shared by all tests that are made, looks, windows, cameras and
both numbers of parameters (Bonferroni): a false alarm in a whole sequence has no more than it.
"""

from __future__ import annotations

import math
from functools import reduce

import numpy as np

from videogrammetry.reconstruction.camera_scores import CameraScores
from videogrammetry.reconstruction.pose_change import (
    Alarm,
    PoseChange,
    change_of,
    estimate,
    tested,
)
from videogrammetry.reconstruction.pose_looks import (
    CumulatedLooks,
    Index,
    Looks,
    Reference,
    looks_in_pixels,
)
from videogrammetry.types import CameraSeries, FloatArray, IntArray

__all__ = ["WINDOWS", "PoseChange", "PoseWatch", "critical_chi2", "num_tests"]

WINDOWS = (2, 3, 4, 5, 8, 16, 32, 64, 128, 256)
#: Against the calibration: its own errors are in no longer sum the smaller.
_AGAINST_CALIBRATION = (2, 5, 16, 32)
#: First looks, what later ones are compared with, and how many of them at least.
_REFERENCE, _LEAST = 40, 2
#: Window of the series that are kept, and every how many looks.
_SERIES, _SERIES_EVERY = 16, 4
#: Looks that are tested at once: the same result, in less time.
_TOGETHER = 128


def critical_chi2(level: float, freedom: int = 6) -> float:
    """Where chi-square with one or six degrees of freedom is exceeded with a probability.

    erfc(sqrt(x/2)) = level, or e^(-x/2) (1 + x/2 + x^2/8) = level, by bisection.

    Examples
    --------
    >>> round(critical_chi2(0.05), 2), round(critical_chi2(1e-8), 1)
    (12.59, 48.4)
    >>> round(critical_chi2(0.05, 1), 2), round(critical_chi2(1e-8, 1), 1)
    (3.84, 32.8)
    """
    low, high = 0.0, 2000.0
    for _ in range(100):
        x = 0.5 * (low + high)
        if freedom == 1:
            tail = math.erfc(math.sqrt(x / 2))
        else:
            tail = math.exp(-x / 2) * (1 + x / 2 + x * x / 8)
        low, high = (x, high) if tail > level else (low, x)
    return high


def num_tests(num_looks: int, cameras: int) -> int:
    """How many tests are made in a quiet sequence, no more.

    Examples
    --------
    >>> num_tests(2500, 4)
    100000
    """
    in_sequence = sum(num_looks // _stride(width) for width in WINDOWS)
    # Against the calibration the windows end where so many looks have been taken.
    at_ends = (num_looks // _TOGETHER + 1) * len(_AGAINST_CALIBRATION)
    return max(cameras * (2 * in_sequence + at_ends), 1)


class PoseWatch:
    """Takes looks in the order of their stages, and says which cameras have moved.

    Parameters
    ----------
    scale : (C, 6) what of every pose parameter moves the picture by about a pixel.
    num_looks : of the whole sequence. level : probability of a false alarm in it.
    known : the scores are of known points, each camera by itself.
    """

    def __init__(
        self, scale: FloatArray, num_looks: int, level: float = 1e-3, *, known: bool = False
    ) -> None:
        self._scale, self._known = np.asarray(scale, float), known
        self._count = len(scale)
        each = level / num_tests(num_looks, self._count)
        self._criticals = np.array([critical_chi2(each, 1), critical_chi2(each)])
        self._history = _History()
        self._raw = self._history
        self._waiting: list[tuple[IntArray, CameraScores]] = []
        self._moved: list[int] = []
        self._series: list[tuple[FloatArray, ...]] = []
        self.changes: list[PoseChange] = []

    @property
    def critical(self) -> float:
        """What chi-square of six parameters is held against."""
        return float(self._criticals[1])

    def add(self, stage: IntArray, scores: CameraScores) -> None:
        """The next looks; they are tested when enough are there, or with :meth:`finish`."""
        self._waiting.append((np.asarray(stage), scores))
        if sum(len(waiting) for waiting, _ in self._waiting) >= _TOGETHER:
            self.finish()

    def finish(self) -> None:
        """Tests all looks that were added."""
        if not self._waiting:
            return
        stage = np.concatenate([stages for stages, _ in self._waiting])
        scores = reduce(CameraScores.then, (scores for _, scores in self._waiting))
        self._waiting = []
        looks = looks_in_pixels(stage, scores, self._scale)
        table = raw = self._history.add(self._without(looks))
        if self._raw is not self._history:
            raw = self._raw.add(looks)
        while (change := self._next_change(table, len(looks))) is not None:
            if self._raw is self._history and not self._known:
                self._raw = self._history.copy()
            self.changes.append(change)
            self._moved += change.cameras
            table = self._history.without(self._moved if not self._known else [])
        self._series.append(self._of_series(raw, len(looks)))
        self._history.shorten()
        self._raw.shorten()

    def series(self) -> CameraSeries:
        """Turns and shifts at every fourth look so far."""
        self.finish()
        if not self._series:
            empty = np.zeros((0, self._count, 3))
            return CameraSeries(
                stage=np.zeros(0, np.int32), turn_rad=empty, shift_mm=empty,
                sigma_turn_rad=empty, sigma_shift_mm=empty,
                chi2=empty[..., 0], critical_chi2=self.critical,
            )  # fmt: skip
        stage, change, sigma, chi2 = (
            np.concatenate(parts) for parts in zip(*self._series, strict=True)
        )
        return CameraSeries(
            stage=stage.astype(np.int32),
            turn_rad=change[..., :3],
            shift_mm=change[..., 3:],
            sigma_turn_rad=sigma[..., :3],
            sigma_shift_mm=sigma[..., 3:],
            chi2=chi2,
            critical_chi2=self.critical,
        )

    def _without(self, looks: Looks) -> Looks:
        return looks if self._known else looks.without(self._moved)

    def _next_change(self, table: CumulatedLooks, new: int) -> PoseChange | None:
        still = [c for c in range(self._count) if c not in self._moved]
        if not still:
            return None
        alarm = self._alarm(table, *_windows(table, new), still, "sequence")
        if alarm is None and table.looks.by.shape[3]:
            # What was wrong from the start waits for the end of these looks.
            widths = [w for w in _AGAINST_CALIBRATION if w <= len(table.looks)]
            width = np.array(widths, dtype=np.intp)
            end = np.full(len(width), len(table.looks) - 1)
            alarm = self._alarm(table, end, width, still, "calibration")
        if alarm is None:
            return None
        return change_of(table, alarm, still, self._scale, self._criticals)

    def _alarm(
        self, table: CumulatedLooks, end: Index, width: Index, still: list[int], against: str
    ) -> Alarm | None:
        """The earliest alarm, of those that end there the one that exceeds its limit most."""
        cameras = np.tile(np.array(still, dtype=np.intp), len(end))
        end, width = np.repeat(end, len(still)), np.repeat(width, len(still))
        if against == "sequence" and len(end):
            six, roll = table.noise_chi2(end, width, cameras)
            maybe = (six > self._criticals[1]) | (roll > self._criticals[0])
            end, width, cameras = end[maybe], width[maybe], cameras[maybe]
        if not len(end):
            return None
        found = tested(table.sums(end, width, cameras), against)
        roll = found.roll if against == "sequence" else np.zeros(len(end))
        beyond = np.stack([roll - self._criticals[0], found.six - self._criticals[1]])
        which = beyond.argmax(axis=0)
        most = beyond.max(axis=0)
        rows = np.flatnonzero(most > 0)
        for k in rows[np.lexsort((-most[rows], end[rows]))].tolist():
            alarm = Alarm(int(end[k]), int(width[k]), int(cameras[k]), (1, 6)[which[k]], against)
            if self._stays(table, alarm):
                return alarm
        return None

    def _stays(self, table: CumulatedLooks, alarm: Alarm) -> bool:
        """Whether an alarm is there without the look that says most for it."""
        changed = alarm.against == "sequence"
        left = table.without_worst(alarm.end, alarm.width, alarm.camera, changed=changed)
        found = tested(left, alarm.against)
        if alarm.parameters == 1:
            return bool(found.roll[0] > self._criticals[0] / 3)
        return bool(found.six[0] > self._criticals[1] / 3)

    def _of_series(self, table: CumulatedLooks, new: int) -> tuple[FloatArray, ...]:
        """Stage, change, sigma and chi-square of new looks, every camera as if alone."""
        looks = table.looks
        end = np.arange(len(looks) - new, len(looks))
        end = end[(table.before + end) % _SERIES_EVERY == 0]
        # Of the first looks the later half is compared with the earlier.
        width = np.clip((table.before + end + 1) // 2, 1, _SERIES)
        cameras = np.tile(np.arange(self._count), len(end))
        sums = table.sums(np.repeat(end, self._count), np.repeat(width, self._count), cameras)
        found = tested(sums, "sequence")
        change, sigma = estimate(found.s, sums.n, found.cov)
        shape = (len(end), self._count, 6)
        scale = self._scale
        # The very first is compared with nothing.
        some = np.where(table.before + end > 0, 1.0, np.nan)[:, None]
        return (
            looks.stage[end].astype(float),
            change.reshape(shape) * scale * some[..., None],
            sigma.reshape(shape) * scale * some[..., None],
            found.six.reshape(shape[:2]) * some,
        )


class _History:
    """The first looks, and the last ones as far as windows reach."""

    def __init__(self) -> None:
        self._first: Looks | None = None
        self._last: Looks | None = None
        self._reference: Reference | None = None
        self._taken = 0

    def add(self, looks: Looks) -> CumulatedLooks:
        self._last = looks if self._last is None else self._last.then(looks)
        lacking = _REFERENCE - (0 if self._first is None else len(self._first))
        if lacking:
            more = looks.rows(slice(0, lacking))
            self._first = more if self._first is None else self._first.then(more)
            self._reference = None
        self._taken += len(looks)
        return self._table()

    def copy(self) -> _History:
        """The same looks; neither changes with the other."""
        other = _History()
        other.__dict__.update(self.__dict__)
        return other

    def without(self, moved: list[int]) -> CumulatedLooks:
        """From now on with the poses of ``moved`` eliminated."""
        assert self._first is not None
        assert self._last is not None
        self._first, self._last = self._first.without(moved), self._last.without(moved)
        self._reference = None
        return self._table()

    def shorten(self) -> None:
        assert self._last is not None
        self._last = self._last.rows(slice(-(WINDOWS[-1] - 1), None))

    def _table(self) -> CumulatedLooks:
        assert self._first is not None
        assert self._last is not None
        if self._reference is None:
            self._reference = Reference(self._first)
        return CumulatedLooks(self._last, self._reference, self._taken - len(self._last))


def _stride(width: int) -> int:
    """At every how many looks a window is tested."""
    return max(width // 4, 1)


def _windows(table: CumulatedLooks, new: int) -> tuple[Index, Index]:
    """Ends and widths of the windows that are tested at the new looks, by their ends."""
    looks = np.arange(len(table.looks) - new, len(table.looks))
    ends, widths = [], []
    for width in WINDOWS:
        number = table.before + looks + 1
        there = (number % _stride(width) == 0) & (number - width >= _LEAST)
        ends.append(looks[there & (looks - width + 1 >= 0)])
        widths.append(np.full(len(ends[-1]), width))
    return np.concatenate(ends), np.concatenate(widths)
