"""What single looks say of the cameras' poses, and sums of it over any of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from videogrammetry.reconstruction.camera_scores import CameraScores
from videogrammetry.reconstruction.small_matrices import quadratic
from videogrammetry.types import FloatArray, IntArray

Index = npt.NDArray[np.intp]

#: A camera's motion of which nothing is known before, as its targets' way in the picture.
PRIOR_PX = 20.0
_RIDGE = 1e-9
#: Numbers a look from which on its sums are made look by look.
_MANY = 200


@dataclass
class Looks:
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

    def rows(self, index: slice) -> Looks:
        """Some that follow one another."""
        return Looks(*(getattr(self, name)[index] for name in self.__dataclass_fields__))

    def then(self, other: Looks) -> Looks:
        """These and then those of ``other``."""
        names = self.__dataclass_fields__
        return Looks(
            *(np.concatenate([getattr(self, name), getattr(other, name)]) for name in names)
        )

    def without(self, moved: list[int]) -> Looks:
        """With the poses of ``moved`` eliminated: whatever these are, at every look."""
        if not moved:
            return self
        count = self.g.shape[1]
        of = np.concatenate([np.arange(6 * c, 6 * c + 6) for c in moved])
        inside = self.n[:, of[:, None], of]
        ridge = _RIDGE * np.trace(inside, axis1=1, axis2=2) / len(of) + 1e-12
        across = self.n[:, :, of] @ np.linalg.inv(inside + ridge[:, None, None] * np.eye(len(of)))
        across[:, of] = np.eye(len(of))
        flat = self.g.reshape(len(self), -1)
        by = self.by.reshape(len(self), 6 * count, -1)
        n = self.n - across @ self.n[:, of]
        n[:, of] = 0.0
        n[:, :, of] = 0.0
        return Looks(
            stage=self.stage,
            g=(flat - (across @ flat[:, of, None])[..., 0]).reshape(self.g.shape),
            n=n,
            by=(by - across @ by[:, of]).reshape(self.by.shape),
            chi2=self.chi2 - quadratic(flat[:, of], inside)[:, None],
            redundancy=self.redundancy - len(of),
            share=self.share,
            points=self.points,
        )


def looks_in_pixels(stage: IntArray, scores: CameraScores, scale: FloatArray) -> Looks:
    """Scores in units of ``scale`` (C, 6), what moves the picture by about a pixel."""
    flat = scale.reshape(-1)
    return Looks(
        stage=np.asarray(stage),
        g=(scores.score * flat).reshape(len(stage), *scale.shape),
        n=scores.normal * flat[:, None] * flat,
        by=(scores.by_calibration * flat[:, None]).reshape(
            len(stage), *scale.shape, scores.by_calibration.shape[2]
        ),
        chi2=scores.chi2,
        redundancy=scores.redundancy,
        share=scores.systematic,
        points=scores.points.astype(float),
    )


@dataclass
class Sums:
    """Of one camera each, (m,): a window's looks, and the first ones. ``cov0`` is (M0 + Q)^-1."""

    camera: Index
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


class Reference:
    """The first looks by their number: what later ones are compared with.

    d0 = (M0 + Q)^-1 G0 is the pose's change that they seem to say, Q a weak prior.
    """

    def __init__(self, first: Looks) -> None:
        self.size, self.first_stage = len(first), int(first.stage[0])
        self.g, self.by = _cumulated(first.g), _cumulated(first.by)
        self.information = _cumulated(own_blocks(first.n)) + np.eye(6) / PRIOR_PX**2
        self.cov = np.asarray(np.linalg.inv(self.information), np.float64)
        self.change = (self.cov @ self.g[..., None])[..., 0]


class CumulatedLooks:
    """Sums over any of the looks, with the reference that they are compared with.

    ``before`` : how many looks there were before these.
    """

    def __init__(self, looks: Looks, reference: Reference, before: int) -> None:
        self.looks, self.reference, self.before = looks, reference, before
        self._own = own_blocks(looks.n)
        self._g, self._n = _cumulated(looks.g), _cumulated(self._own)
        # From this look on; further back where a window reaches there: they are many numbers.
        self._by, self._by_from = _cumulated(looks.by[:0]), len(looks)
        self._chi2, self._redundancy = _cumulated(looks.chi2), _cumulated(looks.redundancy)
        self._share, self._points = _cumulated(looks.share), _cumulated(looks.points)

    def first_looks(self, end: Index, width: Index) -> Index:
        """How many first looks a window is compared with: those before it, at most all."""
        first: Index = np.clip(self.before + end - width + 1, 0, self.reference.size)
        return first

    def noise_chi2(self, end: Index, width: Index, camera: Index) -> tuple[FloatArray, FloatArray]:
        """Of six parameters and of the roll alone, with the pictures' noise: no less than all.

        s'(M + M C0 M)^-1 s = s' M^-1 s - s' (M + C0^-1)^-1 s.
        """
        lo, hi, ref = end - width + 1, end + 1, self.first_looks(end, width)
        n = self._n[hi, camera] - self._n[lo, camera]
        by_change = (n @ self.reference.change[ref, camera][..., None])[..., 0]
        s = self._g[hi, camera] - self._g[lo, camera] - by_change
        six = quadratic(s, n) - quadratic(s, n + self.reference.information[ref, camera])
        row = n[:, 2]
        variance = row[:, 2] + np.einsum("mi,mij,mj->m", row, self.reference.cov[ref, camera], row)
        return six, s[:, 2] ** 2 / np.maximum(variance, 1e-12)

    def sums(self, end: Index, width: Index, camera: Index) -> Sums:
        """Of windows and what they are compared with."""
        lo, hi, ref = end - width + 1, end + 1, self.first_looks(end, width)
        earliest = int(lo.min(initial=len(self.looks)))
        if earliest < self._by_from:
            self._by, self._by_from = _cumulated(self.looks.by[earliest:]), earliest
        by = self._by[hi - self._by_from, camera] - self._by[lo - self._by_from, camera]

        def window(cumulated: FloatArray) -> FloatArray:
            return np.asarray(cumulated[hi, camera] - cumulated[lo, camera])

        return Sums(
            camera=camera,
            count=width.astype(float),
            count0=ref.astype(float),
            g=window(self._g),
            n=window(self._n),
            by=by,
            chi2=window(self._chi2),
            redundancy=window(self._redundancy),
            share=window(self._share) / width,
            points=window(self._points) / width,
            g0=self.reference.g[ref, camera],
            cov0=self.reference.cov[ref, camera],
            by0=self.reference.by[ref, camera],
        )

    def without_worst(self, end: int, width: int, camera: int, *, changed: bool) -> Sums:
        """As :meth:`sums` of one, but for the look that says most for a motion.

        ``changed``: against the first looks, not against the calibration.
        """
        sums = self.sums(np.array([end]), np.array([width]), np.array([camera]))
        rows = slice(end - width + 1, end + 1)
        looks, g, n = self.looks, self.looks.g[rows, camera], self._own[rows, camera]
        change0 = (sums.cov0[0] @ sums.g0[0]) * changed
        worst = int(np.argmax(quadratic(g - n @ change0, n)))
        look = end - width + 1 + worst
        sums.count = sums.count - 1
        sums.g, sums.n = sums.g - g[worst], sums.n - n[worst]
        sums.by = sums.by - looks.by[look, camera]
        sums.chi2 = sums.chi2 - looks.chi2[look, camera]
        sums.redundancy = sums.redundancy - looks.redundancy[look, camera]
        return sums


def own_blocks(n: FloatArray) -> FloatArray:
    """(n, C, 6, 6) the blocks of every camera by itself."""
    count = n.shape[1] // 6
    blocks = n.reshape(len(n), count, 6, count, 6)
    return np.ascontiguousarray(np.moveaxis(np.diagonal(blocks, axis1=1, axis2=3), -1, 1))


def _cumulated(values: FloatArray) -> FloatArray:
    sums = np.zeros((len(values) + 1, *values.shape[1:]))
    if values[:1].size < _MANY:
        np.cumsum(values, axis=0, out=sums[1:])
    else:  # cumsum goes down the columns, ten times as slowly
        for k in range(len(values)):
            np.add(sums[k], values[k], out=sums[k + 1])
    return sums
