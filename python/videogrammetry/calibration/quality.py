"""What tells how good a network is: coverage, angles, depths, reliability, correlations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from videogrammetry.calibration.network_result import AdjustedBars
from videogrammetry.calibration.picture_coverage import PictureCoverage
from videogrammetry.types import FloatArray

#: An observation with less redundancy than this hardly controls itself (Förstner 1987).
WEAK_REDUNDANCY = 0.1
#: Correlations above this are named.
NAMED_CORRELATION = 0.9


@dataclass(frozen=True, kw_only=True)
class Correlations:
    """Correlations (K, K) of some parameters."""

    names: tuple[str, ...]
    matrix: FloatArray

    def pairs(self, above: float) -> list[tuple[str, str, float]]:
        """Pairs with an absolute value above a limit, the largest first.

        Examples
        --------
        >>> Correlations(names=("f", "tz"), matrix=np.array([[1, -0.97], [-0.97, 1]])).pairs(0.9)
        [('f', 'tz', -0.97)]
        """
        rows, columns = np.triu_indices(len(self.names), 1)
        found = [
            (self.names[i], self.names[j], float(self.matrix[i, j]))
            for i, j in zip(rows, columns, strict=True)
            if abs(self.matrix[i, j]) > above
        ]
        return sorted(found, key=lambda pair: -abs(pair[2]))


def correlations(names: tuple[str, ...], cov: FloatArray) -> Correlations:
    """Correlations of those parameters of a covariance that have a variance.

    Examples
    --------
    >>> correlations(("f", "x0", "A1"), np.diag([4.0, 0.0, 1.0])).names
    ('f', 'A1')
    """
    variance = np.diag(cov)
    free = np.flatnonzero(variance > 0)
    sigma = np.sqrt(variance[free])
    return Correlations(
        names=tuple(names[i] for i in free),
        matrix=np.asarray(cov)[np.ix_(free, free)] / np.outer(sigma, sigma),
    )


@dataclass(frozen=True, kw_only=True)
class VarianceComponent:
    """A group's variance factor v'Pv / (sum of its redundancy numbers); 1 = as stated."""

    group: str
    factor: float
    redundancy: float


def variance_component(
    group: str, residual: FloatArray, sigma: FloatArray, redundancy: FloatArray
) -> VarianceComponent:
    """The component of the observations of a group (Förstner 1979, Eq. 15, at its fixed point).

    Examples
    --------
    >>> one = variance_component("bars", np.array([2.0, 0.0]), np.ones(2), np.array([0.5, 0.5]))
    >>> one.factor
    4.0
    """
    total = float(np.sum(redundancy))
    squares = float(np.sum((residual / sigma) ** 2))
    return VarianceComponent(
        group=group, factor=squares / total if total > 0 else np.nan, redundancy=total
    )


@dataclass(frozen=True, kw_only=True)
class Reliability:
    """How well observations control each other, of used image coordinates.

    ``mean``: mean redundancy number; ``weak``: coordinates below ``WEAK_REDUNDANCY``;
    ``detectable_px``: the smallest error that a test finds with 80 % power, median and
    largest; largest infinite where a coordinate is not controlled at all.
    """

    coordinates: int
    mean: float
    weak: int
    median_detectable_px: float
    largest_detectable_px: float


def reliability(redundancy: FloatArray, detectable_px: FloatArray) -> Reliability:
    """Summary of redundancy numbers and detectable errors of the same coordinates.

    Examples
    --------
    >>> r = reliability(np.array([0.9, 0.05]), np.array([0.2, 0.8]))
    >>> r.weak, r.largest_detectable_px
    (1, 0.8)
    """
    size = np.where(np.isfinite(detectable_px), detectable_px, np.inf).ravel()
    return Reliability(
        coordinates=int(redundancy.size),
        mean=float(redundancy.mean()) if redundancy.size else np.nan,
        weak=int((redundancy < WEAK_REDUNDANCY).sum()),
        median_detectable_px=float(np.median(size)) if size.size else np.nan,
        largest_detectable_px=float(size.max()) if size.size else np.nan,
    )


@dataclass(frozen=True, kw_only=True)
class PictureFacts:
    """How a camera's used pictures show the object, arrays of length P.

    Attributes
    ----------
    name : of the picture. points : used ones.
    depth_mm : (P, 3) least, mean and largest depth of its points along the camera's axis.
    tilt_rad : of the flat target against the picture; NaN of an object of any shape.
    roll_rad : about the camera's axis; NaN where it has no meaning.
    """

    name: tuple[str, ...]
    points: npt.NDArray[np.int64]
    depth_mm: FloatArray
    tilt_rad: FloatArray
    roll_rad: FloatArray

    def __len__(self) -> int:
        return len(self.name)


@dataclass(frozen=True, kw_only=True)
class CameraQuality:
    """One camera's part.

    Attributes
    ----------
    coverage, pictures : of its used points and pictures.
    points, rejected : image points used and rejected.
    depth_mm : least and largest depth of a used point.
    roll_span_rad : shortest arc that holds the rolls.
    tilt_rad : largest tilt of the target against the picture; for objects of any shape
        the largest angle between two directions of view. NaN, as the rolls, of
        single points without a target.
    free : estimated parameters; undetermined : offered, but the pictures do not tell them.
    correlations : of the interior, and of the exterior where there is one.
    """

    name: str
    image_size_px: tuple[int, int]
    coverage: PictureCoverage
    pictures: PictureFacts
    points: int
    rejected: int
    depth_mm: tuple[float, float]
    roll_span_rad: float
    tilt_rad: float
    free: tuple[str, ...]
    undetermined: tuple[str, ...]
    correlations: Correlations
    reliability: Reliability


@dataclass(frozen=True, kw_only=True)
class NetworkQuality:
    """The whole network.

    Attributes
    ----------
    target : True: fixed cameras and a moved target; False: an object and moved cameras.
    up : (3,) what is up in the network's frame.
    sigma0 : a-posteriori standard deviation of unit weight.
    rays : (N,) pictures that see each point of an object; empty for a target.
    shared : for a rig, camera -> positions of the target that it shares with another.
    scale_free : lengths come from scale bars alone.
    bars : None where the network has none or could have none.
    components : variance factors of the groups of observations.
    """

    target: bool
    up: FloatArray
    sigma0: float
    cameras: tuple[CameraQuality, ...]
    rays: npt.NDArray[np.int64]
    shared: dict[str, int]
    scale_free: bool
    bars: AdjustedBars | None
    components: tuple[VarianceComponent, ...]
    reliability: Reliability
