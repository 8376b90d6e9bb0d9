"""Whether a camera has moved: a sequential test of the scores of its pose.

From looks at single stages come score g and information N of every camera's pose
(:func:`~videogrammetry.reconstruction.camera_scores.camera_scores`). Over the last 2, 8, 32
and 128 looks the sums G and M are tested:

- against the first looks: s = G - M d0, d0 = (M0 + Q)^-1 G0 the pose's change that the first
  16 looks seem to say (Q a weak prior). What the calibration errs by is in both and cancels
  but for what the object's way through the volume changes, L - M (M0 + Q)^-1 L0;
- against the calibration: s = G with L L', L what its standard errors do to G.

s' cov(s)^-1 s is chi-square with six degrees of freedom while nothing moves. The share of
the variance that stays from look to look is not divided by their number, nor by that of the
points where there are more than 12; all is multiplied by what the residuals left over say
of the noise, if that is more. The level is for all looks, windows and cameras together
(Bonferroni).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import reduce

import numpy as np
import numpy.typing as npt

from videogrammetry.reconstruction.camera_scores import CameraScores
from videogrammetry.types import CameraSeries, FloatArray, IntArray

WINDOWS = (2, 8, 32, 128)
#: First looks, what later ones are compared with, and how many of them at least.
_REFERENCE, _LEAST = 16, 2
#: A camera's motion of which nothing is known before, as its targets' way in the picture.
_PRIOR_PX = 20.0
#: Parts of a picture in each of which a lens' error that no calibration models is its own.
_PATCHES = 12.0
#: Window of the series that are kept.
_SERIES = 8
#: Cameras are told apart by likelihoods of 1000 to 1, and of 1 % of the logarithm, for
#: the model is linear in the motion.
_APART, _APART_SHARE = 2 * math.log(1000.0), 0.01
#: Of three parameters at 0.999: below it the translation says nothing more.
_TURN_ALONE = 16.27
_RIDGE = 1e-9
#: Looks that are tested at once: the same result, in less time.
_TOGETHER = 64


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
    chi2 : of six parameters. critical : what it was held against.
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
    chi2: float
    critical: float


def critical_chi2(level: float) -> float:
    """Where chi-square with six degrees of freedom is exceeded with a probability.

    e^(-x/2) (1 + x/2 + x^2/8) = level, by bisection.

    Examples
    --------
    >>> round(critical_chi2(0.05), 2), round(critical_chi2(1e-8), 1)
    (12.59, 48.4)
    """
    low, high = 0.0, 2000.0
    for _ in range(100):
        x = 0.5 * (low + high)
        tail = math.exp(-x / 2) * (1 + x / 2 + x * x / 8)
        low, high = (x, high) if tail > level else (low, x)
    return high


@dataclass
class _Looks:
    """Looks in units of pixels: (n,) stages and what :class:`CameraScores` says."""

    stage: IntArray
    g: FloatArray
    n: FloatArray
    by: FloatArray
    chi2: FloatArray
    redundancy: FloatArray
    share: FloatArray
    points: FloatArray

    def __len__(self) -> int:
        return len(self.stage)

    def rows(self, index: slice) -> _Looks:
        return _Looks(*(getattr(self, name)[index] for name in self.__dataclass_fields__))

    def then(self, other: _Looks) -> _Looks:
        names = self.__dataclass_fields__
        return _Looks(
            *(np.concatenate([getattr(self, name), getattr(other, name)]) for name in names)
        )


@dataclass
class _Sums:
    """Of one camera each, (m,): window and reference. ``cov0`` is (M0 + Q)^-1."""

    camera: npt.NDArray[np.intp]
    count: FloatArray
    count0: FloatArray
    g: FloatArray
    n: FloatArray
    by: FloatArray
    chi2: FloatArray
    redundancy: FloatArray
    share: FloatArray
    points: FloatArray
    g0: FloatArray
    cov0: FloatArray
    by0: FloatArray


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
        tests = max(num_looks, 1) * self._count * (len(WINDOWS) + 1)
        self.critical = critical_chi2(level / tests)
        self._first: _Looks | None = None
        self._last: _Looks | None = None
        self._raw: _Looks | None = None
        self._raw_first: _Looks | None = None
        self._taken = 0
        self._waiting: list[tuple[IntArray, CameraScores]] = []
        self._moved: list[int] = []
        self._series: list[tuple[FloatArray, ...]] = []
        self.changes: list[PoseChange] = []

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
        self._test(stage, scores)

    def _test(self, stage: IntArray, scores: CameraScores) -> None:
        looks = self._in_pixels(stage, scores)
        self._raw = looks if self._raw is None else self._raw.then(looks)
        self._raw_first = _more(self._raw_first, looks)
        freed = self._without(looks)
        self._last = freed if self._last is None else self._last.then(freed)
        self._first = _more(self._first, freed)
        self._taken += len(looks)
        table = _Cumulated(self._last, self._first, self._taken - len(self._last))
        before, raw = len(self._moved), table
        while (change := self._next_change(table, len(looks))) is not None:
            self.changes.append(change)
            self._moved += change.cameras
            self._last = self._without(self._last)
            self._first = self._without(self._first)
            table = _Cumulated(self._last, self._first, self._taken - len(self._last))
        if before:
            raw = _Cumulated(self._raw, self._raw_first, self._taken - len(self._raw))
        self._series.append(self._of_series(raw, len(looks)))
        keep = slice(-(WINDOWS[-1] - 1), None)
        self._last, self._raw = self._last.rows(keep), self._raw.rows(keep)

    def series(self) -> CameraSeries:
        """Turns and shifts of all looks so far."""
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

    def _without(self, looks: _Looks) -> _Looks:
        return looks if self._known else _without(looks, self._moved)

    def _in_pixels(self, stage: IntArray, scores: CameraScores) -> _Looks:
        size, shape = len(stage), (len(stage), self._count, 6)
        flat = self._scale.reshape(-1)
        return _Looks(
            np.asarray(stage),
            (scores.score * flat).reshape(shape),
            scores.normal * flat[:, None] * flat,
            (scores.by_calibration * flat[:, None]).reshape(
                size, self._count, 6, scores.by_calibration.shape[2]
            ),
            scores.chi2,
            scores.redundancy,
            scores.systematic,
            scores.points.astype(float),
        )

    def _next_change(self, table: _Cumulated, new: int) -> PoseChange | None:
        looks, before = table.looks, table.before
        still = [c for c in range(self._count) if c not in self._moved]
        if not still:
            return None
        end, width = (
            a.reshape(-1)
            for a in np.meshgrid(np.arange(len(looks) - new, len(looks)), WINDOWS, indexing="ij")
        )
        fits = (end - width + 1 >= 0) & (before + end - width + 1 >= _LEAST)
        end, width = end[fits], width[fits]
        alarms = self._alarms(table, end, width, still, "sequence")
        if not alarms and looks.by.shape[3]:
            # What was wrong from the start waits for the end of these looks.
            of_all = np.array([w for w in WINDOWS if w <= len(looks)], dtype=np.intp)
            last = np.full(len(of_all), len(looks) - 1)
            alarms = self._alarms(table, last, of_all, still, "calibration")
            if alarms:
                return self._calibration_change(table, alarms[0])
        if not alarms:
            return None
        return self._sequence_change(table, alarms[0], still)

    def _alarms(
        self,
        table: _Cumulated,
        end: npt.NDArray[np.intp],
        width: npt.NDArray[np.intp],
        still: list[int],
        against: str,
    ) -> list[tuple[int, int, int]]:
        """(end, width, camera), the earliest first, of the largest where several end there."""
        cameras = np.tile(np.array(still, dtype=np.intp), len(end))
        end, width = np.repeat(end, len(still)), np.repeat(width, len(still))
        if not len(end):
            return []
        if against == "sequence":
            quick = table.noise_chi2(end, width, cameras)
            maybe = quick > self.critical
            end, width, cameras = end[maybe], width[maybe], cameras[maybe]
            if not len(end):
                return []
        sums = table.sums(end, width, cameras)
        chi2 = _tested(sums, against)[0]
        found = np.flatnonzero(chi2 > self.critical)
        found = found[np.lexsort((-chi2[found], end[found]))]
        return [
            (int(end[k]), int(width[k]), int(cameras[k]))
            for k in found
            if table.stays(int(end[k]), int(width[k]), int(cameras[k]), against, self.critical / 3)
        ]

    def _sequence_change(
        self, table: _Cumulated, alarm: tuple[int, int, int], still: list[int]
    ) -> PoseChange:
        end, _, camera = alarm
        widths = np.arange(1, min(end + 1, table.before + end + 1 - _LEAST) + 1)
        ends = np.full(len(widths), end)
        best = np.argmax(table.noise_chi2(ends, widths, np.full(len(widths), camera)))
        width = int(widths[best])
        begin = end - width + 1
        stage = table.looks.stage
        after = int(stage[begin - 1]) if begin else int(stage[0]) - 1
        return self._change(
            table, end, width, still, "sequence", after=after, stage=int(stage[begin])
        )

    def _calibration_change(self, table: _Cumulated, alarm: tuple[int, int, int]) -> PoseChange:
        still = [c for c in range(self._count) if c not in self._moved]
        assert self._first is not None
        first = int(self._first.stage[0])
        return self._change(table, alarm[0], alarm[1], still, "calibration", after=0, stage=first)

    def _change(
        self,
        table: _Cumulated,
        end: int,
        width: int,
        still: list[int],
        against: str,
        *,
        after: int,
        stage: int,
    ) -> PoseChange:
        """Names the cameras, the likeliest first, and says how far that one has moved."""
        cameras = np.array(still, dtype=np.intp)
        sums = table.sums(np.full(len(still), end), np.full(len(still), width), cameras)
        chi2, s, cov, noise = _tested(sums, against)
        explained = _quadratic(s, sums.n) / noise.min()
        if against == "calibration":
            explained = chi2
        order = np.argsort(-explained, kind="stable")
        best = order[0]
        margin = max(_APART, _APART_SHARE * float(explained[best]))
        same = [k for k in order if explained[best] - explained[k] <= margin]
        change, sigma = _estimate(s[best], sums.n[best], cov[best], float(chi2[best]))
        scale = self._scale[cameras[best]]
        return PoseChange(
            cameras=tuple(int(cameras[k]) for k in same),
            since=against,
            after=after,
            stage=stage,
            found=int(table.looks.stage[end]),
            turn_rad=(change * scale)[:3],
            shift_mm=(change * scale)[3:],
            sigma_turn_rad=(sigma * scale)[:3],
            sigma_shift_mm=(sigma * scale)[3:],
            chi2=float(chi2[best]),
            critical=self.critical,
        )

    def _of_series(self, table: _Cumulated, new: int) -> tuple[FloatArray, ...]:
        """Stage, change, sigma and chi-square of the new looks, every camera as if alone."""
        looks = table.looks
        end = np.arange(len(looks) - new, len(looks))
        # Of the first looks the later half is compared with the earlier.
        width = np.clip((table.before + end + 1) // 2, 1, _SERIES)
        cameras = np.tile(np.arange(self._count), new)
        sums = table.sums(np.repeat(end, self._count), np.repeat(width, self._count), cameras)
        chi2, s, cov, _ = _tested(sums, "sequence")
        inverse = np.linalg.inv(sums.n + np.eye(6) / _PRIOR_PX**2)
        change = (inverse @ s[..., None])[..., 0]
        sigma = np.sqrt(np.maximum(np.diagonal(inverse @ cov @ inverse, axis1=1, axis2=2), 0.0))
        shape = (new, self._count, 6)
        scale = self._scale
        # The very first is compared with nothing.
        some = np.where(table.before + end > 0, 1.0, np.nan)[:, None]
        return (
            looks.stage[end].astype(float),
            change.reshape(shape) * scale * some[..., None],
            sigma.reshape(shape) * scale * some[..., None],
            chi2.reshape(shape[:2]) * some,
        )


class _Cumulated:
    """Sums of looks over any window, by their cumulated sums."""

    def __init__(self, looks: _Looks, first: _Looks, before: int) -> None:
        self.looks, self.before = looks, before
        blocks = _own(looks.n)
        self._own = blocks
        self._g, self._n = _cumulated(looks.g), _cumulated(blocks)
        self._by, self._chi2 = _cumulated(looks.by), _cumulated(looks.chi2)
        self._redundancy, self._share = _cumulated(looks.redundancy), _cumulated(looks.share)
        self._points = _cumulated(looks.points)
        self._g0, self._by0 = _cumulated(first.g), _cumulated(first.by)
        prior = np.eye(6) / _PRIOR_PX**2
        inverse = np.linalg.inv(_cumulated(_own(first.n)) + prior)
        self._cov0 = np.asarray(inverse, np.float64)
        self._change0 = (self._cov0 @ self._g0[..., None])[..., 0]

    def _reference(
        self, end: npt.NDArray[np.intp], width: npt.NDArray[np.intp]
    ) -> npt.NDArray[np.intp]:
        """How many first looks a window is compared with: those before it, at most 16."""
        begin = self.before + end - width + 1
        count: npt.NDArray[np.intp] = np.clip(begin, 0, len(self._g0) - 1)
        return count

    def noise_chi2(
        self,
        end: npt.NDArray[np.intp],
        width: npt.NDArray[np.intp],
        camera: npt.NDArray[np.intp],
    ) -> FloatArray:
        """Against the first looks with the pictures' noise alone: no less than the whole."""
        lo, hi = end - width + 1, end + 1
        ref = self._reference(end, width)
        n = self._n[hi, camera] - self._n[lo, camera]
        g = self._g[hi, camera] - self._g[lo, camera]
        s = g - (n @ self._change0[ref, camera][..., None])[..., 0]
        return _quadratic(s, n + n @ self._cov0[ref, camera] @ n)

    def sums(
        self,
        end: npt.NDArray[np.intp],
        width: npt.NDArray[np.intp],
        camera: npt.NDArray[np.intp],
    ) -> _Sums:
        """Of windows and what they are compared with."""
        lo, hi, ref = end - width + 1, end + 1, self._reference(end, width)

        def window(cumulated: FloatArray) -> FloatArray:
            return np.asarray(cumulated[hi, camera] - cumulated[lo, camera])

        return _Sums(
            camera, width.astype(float), ref.astype(float), window(self._g), window(self._n),
            window(self._by), window(self._chi2), window(self._redundancy),
            window(self._share) / width, window(self._points) / width, self._g0[ref, camera],
            self._cov0[ref, camera], self._by0[ref, camera],
        )  # fmt: skip

    def stays(self, end: int, width: int, camera: int, against: str, least: float) -> bool:
        """Whether an alarm is there without the look that says most for it."""
        one, where = np.array([end]), np.array([camera])
        sums = self.sums(one, np.array([width]), where)
        rows = slice(end - width + 1, end + 1)
        g, n = self.looks.g[rows, camera], self._own[rows, camera]
        change0 = (sums.cov0[0] @ sums.g0[0]) * (against == "sequence")
        worst = int(np.argmax(_quadratic(g - n @ change0, n)))
        look = end - width + 1 + worst
        sums.count = sums.count - 1
        sums.g, sums.n = sums.g - g[worst], sums.n - n[worst]
        sums.by = sums.by - self.looks.by[look, camera]
        sums.chi2 = sums.chi2 - self.looks.chi2[look, camera]
        sums.redundancy = sums.redundancy - self.looks.redundancy[look, camera]
        return bool(_tested(sums, against)[0][0] > least)


def _tested(sums: _Sums, against: str) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Chi-square (m,), s (m, 6) with its covariance (m, 6, 6), and the noise's factor (m,)."""
    n, share = sums.n, sums.share
    left = sums.chi2 - _quadratic(sums.g, n)
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
    return _quadratic(s, cov), s, cov, noise


def _estimate(
    s: FloatArray, n: FloatArray, cov: FloatArray, chi2: float
) -> tuple[FloatArray, FloatArray]:
    """(6,) turn and shift with standard deviations; the turn alone where that says it all."""
    of_turn = _quadratic(s[None, :3], cov[None, :3, :3])[0]
    size = 3 if chi2 - of_turn < _TURN_ALONE else 6
    inverse = np.linalg.inv(n[:size, :size] + np.eye(size) / _PRIOR_PX**2)
    change, sigma = np.zeros(6), np.full(6, np.nan)
    change[:size] = inverse @ s[:size]
    sigma[:size] = np.sqrt(np.diag(inverse @ cov[:size, :size] @ inverse))
    return change, sigma


def _quadratic(s: FloatArray, cov: FloatArray) -> FloatArray:
    """s' cov^-1 s of every row; directions of which nothing is known say nothing."""
    size = cov.shape[-1]
    ridge = _RIDGE * np.trace(cov, axis1=1, axis2=2) / size + 1e-12
    solved = np.linalg.solve(cov + ridge[:, None, None] * np.eye(size), s[..., None])
    return np.asarray((s[:, None, :] @ solved)[:, 0, 0])


def _own(n: FloatArray) -> FloatArray:
    """(n, C, 6, 6) the blocks of every camera by itself."""
    count = n.shape[1] // 6
    blocks = n.reshape(len(n), count, 6, count, 6)
    return np.ascontiguousarray(np.moveaxis(np.diagonal(blocks, axis1=1, axis2=3), -1, 1))


def _cumulated(values: FloatArray) -> FloatArray:
    return np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])


def _more(first: _Looks | None, looks: _Looks) -> _Looks:
    if first is None:
        return looks.rows(slice(0, _REFERENCE))
    return first.then(looks.rows(slice(0, _REFERENCE - len(first))))


def _without(looks: _Looks, moved: list[int]) -> _Looks:
    """The looks with the poses of ``moved`` eliminated: whatever these are, at every look."""
    if not moved:
        return looks
    count = looks.g.shape[1]
    of = np.concatenate([np.arange(6 * c, 6 * c + 6) for c in moved])
    inside = looks.n[:, of[:, None], of]
    ridge = _RIDGE * np.trace(inside, axis1=1, axis2=2) / len(of) + 1e-12
    across = looks.n[:, :, of] @ np.linalg.inv(inside + ridge[:, None, None] * np.eye(len(of)))
    across[:, of] = np.eye(len(of))
    flat, by = looks.g.reshape(len(looks), -1), looks.by.reshape(len(looks), 6 * count, -1)
    n = looks.n - across @ looks.n[:, of]
    n[:, of] = 0.0
    n[:, :, of] = 0.0
    explained = _quadratic(flat[:, of], inside)[:, None]
    return _Looks(
        looks.stage,
        (flat - (across @ flat[:, of, None])[..., 0]).reshape(looks.g.shape),
        n,
        (by - across @ by[:, of]).reshape(looks.by.shape),
        looks.chi2 - explained,
        looks.redundancy - len(of),
        looks.share,
        looks.points,
    )
