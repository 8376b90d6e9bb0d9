"""What a rig will measure how well, over a volume, before anything is measured."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from videogrammetry.geometry import MeasuringVolume
from videogrammetry.reconstruction import Rig
from videogrammetry.types import FloatArray, IntArray

#: What the uncertainty comes from.
SOURCES = ("image", "calibration", "together")
#: What is predicted, in the order of the tables.
QUANTITIES = ("sigma_x", "sigma_y", "sigma_z", "position", "distance")
#: Directions of the distances: along the axes and the volume's diagonals.
_DIRECTIONS = np.array(
    [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1], [1, 1, -1], [1, -1, 1], [-1, 1, 1]], dtype=float
)
_PER_CENT = 95.0


@dataclass(frozen=True, kw_only=True)
class PlacesPrediction:
    """The uncertainty of points at some places.

    Where cameras stand in groups (an opaque object hides what one group sees from the
    other), a place is that of the worst group of those that see it.

    Attributes
    ----------
    position_mm : (N, 3). seen : (N, C) whether a camera has the place in its picture.
    cameras : (N,) of the group taken, how many see the place; of the best group where
        none has two.
    convergence_rad : (N,) largest angle between two rays; NaN below two cameras,
        like the covariances.
    cov_image_mm2, cov_calibration_mm2 : (N, 3, 3).
    """

    position_mm: FloatArray
    seen: npt.NDArray[np.bool_]
    cameras: IntArray
    convergence_rad: FloatArray
    cov_image_mm2: FloatArray
    cov_calibration_mm2: FloatArray

    def __len__(self) -> int:
        return len(self.position_mm)

    def covariance(self, source: str) -> FloatArray:
        """(N, 3, 3) mm^2 from "image", "calibration" or "together"."""
        if source not in SOURCES:
            raise ValueError(f"source: expected one of {', '.join(SOURCES)}, got {source!r}")
        if source == "image":
            return self.cov_image_mm2
        if source == "calibration":
            return self.cov_calibration_mm2
        return np.asarray(self.cov_image_mm2 + self.cov_calibration_mm2)

    def sigma_mm(self, source: str) -> FloatArray:
        """(N, 3) standard deviations of x, y, z."""
        return np.sqrt(np.diagonal(self.covariance(source), axis1=1, axis2=2))

    def position_sigma_mm(self, source: str) -> FloatArray:
        """(N,) of the position: the root of the three variances' sum."""
        return np.asarray(np.sqrt(np.trace(self.covariance(source), axis1=1, axis2=2)))


@dataclass(frozen=True, kw_only=True)
class DistancesPrediction:
    """The uncertainty of distances of one length, in many places and directions.

    Attributes
    ----------
    length_mm : nominal. sigma_image_mm, sigma_calibration_mm : (M,), no entry
        for distances that are not wholly seen.
    """

    length_mm: float
    sigma_image_mm: FloatArray
    sigma_calibration_mm: FloatArray

    def sigma_mm(self, source: str) -> FloatArray:
        """(M,) from one source, or together."""
        if source not in SOURCES:
            raise ValueError(f"source: expected one of {', '.join(SOURCES)}, got {source!r}")
        if source == "image":
            return self.sigma_image_mm
        if source == "calibration":
            return self.sigma_calibration_mm
        return np.asarray(np.hypot(self.sigma_image_mm, self.sigma_calibration_mm))


@dataclass(frozen=True, kw_only=True)
class Spread:
    """A standard deviation over the volume, mm: its middle, 95th percentile, largest and RMS."""

    median_mm: float
    most_mm: float
    worst_mm: float
    rms_mm: float


@dataclass(frozen=True, kw_only=True)
class PairGeometry:
    """How two cameras meet in the volume's centre, and what another base would give.

    Of two cameras at the distance D that see a point under the angle g between their rays, an
    image noise s gives the standard deviations, with q = s D / f,

        across, out of their plane  q / sqrt(2)
        across, in their plane      q / (sqrt(2) cos(g / 2))
        in depth                    q / (sqrt(2) sin(g / 2))

    so that the position's is least at 90 degrees, and the base that has it is D sqrt(2).

    Attributes
    ----------
    angle_rad, base_mm, distance_mm : as they stand (distance: mean of both).
    sigma_mm : of a position, from the image noise of these two alone, by the equations.
    better_angle_rad, better_base_mm, better_sigma_mm : (K,) what other angles would give.
    """

    cameras: tuple[str, str]
    angle_rad: float
    base_mm: float
    distance_mm: float
    sigma_mm: float
    better_angle_rad: tuple[float, ...]
    better_base_mm: tuple[float, ...]
    better_sigma_mm: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class NeededPositions:
    """How many positions of the target reach a wanted standard deviation.

    Attributes
    ----------
    count : the fewest that do; None: no number does (``reason``).
    sigma_mm : what they give; of the largest tried where there is none.
    tried : count -> sigma_mm (inf where the calibration is not determined).
    """

    wanted_mm: float
    count: int | None
    sigma_mm: float
    tried: Mapping[int, float]
    reason: str = ""


def predict_places(
    rig: Rig,
    places_mm: FloatArray,
    sigma_px: float,
    *,
    groups: Sequence[Sequence[str]] = (),
    frame: str = "volume",
) -> PlacesPrediction:
    """The uncertainty of points at places (N, 3), from image noise and the rig's covariance.

    A camera sees a place that lies in its picture; nothing hides it but what ``groups``
    says. ``frame`` as for :class:`~videogrammetry.reconstruction.Triangulator`.
    """
    names = list(rig.cameras)
    pixels, seen = _pictures(rig, places_mm)
    n = len(places_mm)
    cameras = np.zeros(n, np.int32)
    angle = np.full(n, np.nan)
    image, calibration = np.full((n, 3, 3), np.nan), np.full((n, 3, 3), np.nan)
    worst = np.full(n, -np.inf)
    for group in groups or [names]:
        columns = [names.index(name) for name in group]
        count = seen[:, columns].sum(axis=1)
        mine = {name: np.where(seen[:, k, None], pixels[name], np.nan)
                for name, k in zip(group, columns, strict=True)}  # fmt: skip
        if len(group) < 2:
            cameras = np.maximum(cameras, np.where(np.isfinite(worst), 0, count)).astype(np.int32)
            continue
        found = rig.intersect(mine, sigma_px, frame=frame)
        size = np.trace(found.cov_mm2, axis1=1, axis2=2)
        taken = np.nan_to_num(size, nan=-np.inf) > worst
        worst[taken] = size[taken]
        cameras[taken] = count[taken]
        blind = ~np.isfinite(worst)
        cameras[blind] = np.maximum(cameras[blind], count[blind])
        angle[taken] = found.convergence_rad[taken]
        image[taken], calibration[taken] = found.cov_image_mm2[taken], found.cov_rig_mm2[taken]
    return PlacesPrediction(
        position_mm=places_mm,
        seen=seen,
        cameras=cameras,
        convergence_rad=angle,
        cov_image_mm2=image,
        cov_calibration_mm2=calibration,
    )


def predict_distances(
    rig: Rig,
    volume: MeasuringVolume,
    length_mm: float,
    sigma_px: float,
    *,
    groups: Sequence[Sequence[str]] = (),
    count: int = 7,
) -> DistancesPrediction:
    """The uncertainty of distances of one length that lie wholly in the volume.

    Their middles lie on a grid of ``count`` along every edge, their directions are the three
    axes and the four diagonals. Both ends are seen by the same group; the calibration's common
    part is counted with its correlation.
    """
    names = list(rig.cameras)
    middles = volume.grid(count)
    image: list[FloatArray] = []
    calibration: list[FloatArray] = []
    for direction in _DIRECTIONS:
        half = 0.5 * length_mm * direction / np.linalg.norm(direction)
        inside = volume.contains(middles - half) & volume.contains(middles + half)
        if not inside.any():
            continue
        ends = np.concatenate([middles[inside] - half, middles[inside] + half])
        pixels, seen = _pictures(rig, ends)
        rows = np.arange(len(ends) // 2)
        for group in groups or [names]:
            if len(group) < 2:
                continue
            mine = {n: np.where(seen[:, names.index(n), None], pixels[n], np.nan) for n in group}
            found = rig.intersect(mine, sigma_px)
            distance = found.distance(rows, rows + len(rows))
            good = np.isfinite(distance.sigma_mm)
            image.append(distance.sigma_image_mm[good])
            calibration.append(distance.sigma_rig_mm[good])
    return DistancesPrediction(
        length_mm=length_mm,
        sigma_image_mm=np.concatenate(image) if image else np.empty(0),
        sigma_calibration_mm=np.concatenate(calibration) if calibration else np.empty(0),
    )


def spread(sigma_mm: FloatArray) -> Spread:
    """Median, 95th percentile, largest and RMS of what is finite; NaN of nothing.

    Examples
    --------
    >>> spread(np.array([1.0, np.nan, 3.0, 2.0]))
    Spread(median_mm=2.0, most_mm=2.9, worst_mm=3.0, rms_mm=2.160246899469287)
    """
    values = sigma_mm[np.isfinite(sigma_mm)]
    if not len(values):
        return Spread(median_mm=math.nan, most_mm=math.nan, worst_mm=math.nan, rms_mm=math.nan)
    return Spread(
        median_mm=float(np.median(values)),
        most_mm=float(np.percentile(values, _PER_CENT)),
        worst_mm=float(values.max()),
        rms_mm=float(np.sqrt(np.mean(values**2))),
    )


def prediction_statistics(
    places: PlacesPrediction, distances: DistancesPrediction
) -> dict[str, dict[str, Spread]]:
    """Quantity -> source -> its spread over the volume."""
    table = {
        f"sigma_{axis}": {s: spread(places.sigma_mm(s)[:, k]) for s in SOURCES}
        for k, axis in enumerate("xyz")
    }
    table["position"] = {s: spread(places.position_sigma_mm(s)) for s in SOURCES}
    table["distance"] = {s: spread(distances.sigma_mm(s)) for s in SOURCES}
    return table


def pair_geometries(
    rig: Rig,
    centre_mm: FloatArray,
    sigma_px: float,
    *,
    groups: Sequence[Sequence[str]] = (),
    angles_rad: Sequence[float] = (math.radians(60), math.radians(90)),
) -> list[PairGeometry]:
    """Angles and bases of all pairs of cameras of a group, and what others would give."""
    pairs = [
        (a, b)
        for group in groups or [list(rig.cameras)]
        for k, a in enumerate(group)
        for b in group[k + 1 :]
    ]
    result = []
    for a, b in dict.fromkeys(pairs):
        one, two = (rig.cameras[n].centre_mm - centre_mm for n in (a, b))
        near, far = float(np.linalg.norm(one)), float(np.linalg.norm(two))
        angle = math.atan2(float(np.linalg.norm(np.cross(one, two))), float(one @ two))
        f_px = 0.5 * float(rig.cameras[a].interior[0] + rig.cameras[b].interior[0])
        q = sigma_px * 0.5 * (near + far) / f_px
        result.append(
            PairGeometry(
                cameras=(a, b),
                angle_rad=angle,
                base_mm=float(np.linalg.norm(one - two)),
                distance_mm=0.5 * (near + far),
                sigma_mm=q * normal_case_sigma(angle),
                better_angle_rad=tuple(angles_rad),
                better_base_mm=tuple(
                    math.sqrt(near**2 + far**2 - 2 * near * far * math.cos(g)) for g in angles_rad
                ),
                better_sigma_mm=tuple(q * normal_case_sigma(g) for g in angles_rad),
            )
        )
    return result


def normal_case_sigma(angle_rad: float) -> float:
    """A position's standard deviation in units of s D / f of two cameras; see PairGeometry.

    Examples
    --------
    >>> [round(normal_case_sigma(math.radians(g)), 3) for g in (20, 30, 60, 90)]
    [4.195, 2.915, 1.78, 1.581]
    """
    half = 0.5 * angle_rad
    if math.sin(half) <= 0 or math.cos(half) <= 1e-12:
        return math.inf
    return math.sqrt(0.5 * (1 + 1 / math.cos(half) ** 2 + 1 / math.sin(half) ** 2))


def needed_positions(
    sigma_of: Callable[[int], float],
    wanted_mm: float,
    *,
    image_mm: float,
    first: int = 4,
    limit: int = 256,
) -> NeededPositions:
    """The fewest positions of the target with which ``sigma_of(count)`` is as wanted.

    ``sigma_of`` falls with the count: it is doubled from ``first`` until it is low enough,
    then the interval is halved.

    Parameters
    ----------
    image_mm : what the image noise alone gives, whatever the calibration.
    limit : no more are tried.

    Examples
    --------
    >>> needed_positions(lambda n: 1 / n**0.5, 0.2, image_mm=0.01).count
    25
    >>> needed_positions(lambda n: 1.0, 0.2, image_mm=0.3).count is None
    True
    """
    if not 0 < wanted_mm < math.inf:
        raise ValueError(f"wanted: expected more than 0 mm, got {wanted_mm}")
    if image_mm >= wanted_mm:
        return NeededPositions(
            wanted_mm=wanted_mm,
            count=None,
            sigma_mm=image_mm,
            tried={},
            reason=f"the image noise alone gives {image_mm:.4g} mm, whatever the calibration; take "
            "more or nearer cameras, longer lenses, a wider base or larger targets",
        )
    tried: dict[int, float] = {}

    def sigma(count: int) -> float:
        if count not in tried:
            tried[count] = sigma_of(count)
        return tried[count]

    high = first
    while sigma(high) > wanted_mm and high < limit:
        high = min(2 * high, limit)
    if sigma(high) > wanted_mm:
        return NeededPositions(
            wanted_mm=wanted_mm,
            count=None,
            sigma_mm=tried[high],
            tried=tried,
            reason=f"{high} positions give {tried[high]:.4g} mm; what is left comes from the image "
            f"noise ({image_mm:.4g} mm) and from what more positions hardly improve: the target's "
            "own coordinates, the cameras' angles",
        )
    low = max((n for n in tried if n < high), default=0)
    while high - low > 1:
        middle = (low + high) // 2
        if middle >= 1 and sigma(middle) <= wanted_mm:
            high = middle
        else:
            low = middle
    return NeededPositions(
        wanted_mm=wanted_mm, count=high, sigma_mm=sigma(high), tried=dict(sorted(tried.items()))
    )


def _pictures(
    rig: Rig, points_mm: FloatArray
) -> tuple[Mapping[str, FloatArray], npt.NDArray[np.bool_]]:
    """Pictures of points in every camera, and (N, C) whether they lie in the picture."""
    pixels = rig.project(points_mm)
    seen = []
    for name, camera in rig.cameras.items():
        with np.errstate(invalid="ignore"):
            inside = (pixels[name] >= 0) & (pixels[name] <= np.array(camera.image_size_px) - 1.0)
        seen.append(inside.all(axis=1))
    return pixels, np.stack(seen, axis=1)
