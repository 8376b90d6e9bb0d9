"""What the adjustment of a network gives; every standard deviation is a posteriori."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from videogrammetry.types import FloatArray, IntArray

BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class NetworkOptions:
    """How to adjust a network.

    Attributes
    ----------
    significance : of a camera with ``free = None`` a distortion parameter below this
        many standard deviations is dropped (see ``CalibrationOptions``).
    eccentricity : model the ellipses' centres of points whose circle is known.
    robust_start : begin with Cauchy's loss.
    estimate_floor : estimate an additive variance of the image points per camera; for
        observations whose covariances are of recognition alone.
    num_threads : 0 = one a core.
    """

    significance: float = 2.58
    eccentricity: bool = True
    robust_start: bool = True
    estimate_floor: bool = False
    num_threads: int = 0


@dataclass(frozen=True, kw_only=True)
class DroppedUnknown:
    """A camera's parameter that was offered and not kept; held at its start value.

    ``value`` and ``sigma`` are those when it was dropped; ``undetermined``: the
    pictures do not tell it; otherwise it differs too little from its start.
    """

    name: str
    value: float
    sigma: float
    undetermined: bool


@dataclass(frozen=True, kw_only=True)
class AdjustedCamera:
    """A camera's adjusted parameters.

    Attributes
    ----------
    values, sigma : by name, all twelve (f, x0, y0, A1, ..., E2, aspect, time_offset);
        sigma 0 of those that were held.
    free : names of those estimated, the order of ``correlation`` (K, K).
    significance : |value - start| / sigma of the estimated distortion parameters
        and the aspect; start is 0 unless given.
    dropped : what was offered and not kept.
    num_images, num_points, rms_px : used pictures, used image points and their RMS
        residual per coordinate.
    """

    name: str
    image_size_px: tuple[int, int]
    r0_px: float
    measured: bool
    values: Mapping[str, float]
    sigma: Mapping[str, float]
    free: tuple[str, ...]
    cov: FloatArray
    significance: Mapping[str, float]
    dropped: tuple[DroppedUnknown, ...]
    num_images: int
    num_points: int
    rms_px: float

    @property
    def correlation(self) -> FloatArray:
        """(K, K) correlations of the estimated parameters, in the order of ``free``."""
        sigma = np.sqrt(np.diag(self.cov))
        return np.asarray(self.cov / np.outer(sigma, sigma))


@dataclass(frozen=True, kw_only=True)
class AdjustedImages:
    """Poses cam_from_world of the pictures that were adjusted, arrays of length I.

    ``cov`` (I, 6, 6): rotation vector applied on the left of cam_from_world (rad),
    then translation (mm). ``centre_mm``: projection centres, ``cov_centre_mm2``
    (I, 3, 3). ``points``: used image points; ``rms_px`` theirs per coordinate.
    """

    name: tuple[str, ...]
    camera: IntArray
    rotation: FloatArray
    translation_mm: FloatArray
    cov: FloatArray
    centre_mm: FloatArray
    cov_centre_mm2: FloatArray
    points: IntArray
    rms_px: FloatArray

    def __len__(self) -> int:
        return len(self.name)


@dataclass(frozen=True, kw_only=True)
class AdjustedPoints:
    """Object points, arrays of length N.

    ``cov_mm2`` (N, 3, 3), 0 where fixed; ``full_cov_mm2`` (3N, 3N), None where there
    are more than ``MAX_FULL_COVARIANCE`` points; ``kind`` as in the input;
    ``images``: pictures that see the point; ``rms_px``: of its residuals per coordinate.
    """

    name: tuple[str, ...]
    position_mm: FloatArray
    cov_mm2: FloatArray
    full_cov_mm2: FloatArray | None
    kind: npt.NDArray[np.str_]
    images: IntArray
    rms_px: FloatArray
    normal: FloatArray | None = None
    diameter_mm: FloatArray | None = None

    @property
    def sigma_mm(self) -> FloatArray:
        """(N, 3)."""
        return np.sqrt(np.diagonal(self.cov_mm2, axis1=1, axis2=2))

    def __len__(self) -> int:
        return len(self.name)


@dataclass(frozen=True, kw_only=True)
class AdjustedObservations:
    """Every image point of the adjustment, used or rejected; (M, 2) per coordinate.

    Attributes
    ----------
    image, point : indices into the result's images and points.
    sigma_px : a priori. residual_px : measured - adjusted.
    normalised : v / (sigma_v), with the a-posteriori sigma0.
    redundancy : the share of an error that shows in its own residual, 0...1.
    detectable_px : smallest error found with 80 % power: inner reliability.
    external : the effect of that undetected error on the unknowns, in their standard
        deviations: outer reliability delta0 sqrt((1 - r) / r).
    """

    image: IntArray
    point: IntArray
    xy_px: FloatArray
    sigma_px: FloatArray
    residual_px: FloatArray
    normalised: FloatArray
    redundancy: FloatArray
    detectable_px: FloatArray
    external: FloatArray
    used: BoolArray

    def __len__(self) -> int:
        return len(self.image)


@dataclass(frozen=True, kw_only=True)
class AdjustedBars:
    """Scale bars: ``residual_mm`` = stated - adjusted length; ``sigma_mm`` a priori."""

    point_a: IntArray
    point_b: IntArray
    length_mm: FloatArray
    sigma_mm: FloatArray
    residual_mm: FloatArray
    normalised: FloatArray
    redundancy: FloatArray
    used: BoolArray
    certificate: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.point_a)


@dataclass(frozen=True, kw_only=True)
class NetworkRejection:
    """One thing that was given and not used.

    ``kind``: "observation", "image", "point", "scale-bar", "parameter"; ``value`` the
    number that decided, of the ``test`` ("w", "tau", "rays", "significance", ...);
    ``image``, ``point``: names, empty where they do not apply; ``reason`` a sentence.
    """

    kind: str
    value: float
    test: str
    image: str
    point: str
    reason: str


@dataclass(frozen=True, kw_only=True)
class NetworkSummary:
    """Counts and the adjustment's overall quality.

    ``observations``: all scalar observations used: image coordinates, observed
    coordinates of points, observed camera parameters, scale bars. ``unknowns`` those
    estimated; ``redundancy`` = observations - unknowns + datum conditions.
    ``sigma0_px`` = sigma0 times the a-priori sigma of an image coordinate.
    """

    observations: int
    image_coordinates: int
    unknowns: int
    redundancy: int
    sigma0: float
    sigma0_px: float
    sigma_px: float
    rms_px: float
    images: int
    points: int
    datum: str
    rounds: int
    converged: bool


@dataclass(frozen=True, kw_only=True)
class NetworkAdjustment:
    """Result of :func:`~videogrammetry.calibration.network_adjustment.adjust_network`.

    ``known_factor``: variance factor of the coordinates of weighted points, of
    ``known_redundancy``; None where there is none.
    """

    cameras: tuple[AdjustedCamera, ...]
    images: AdjustedImages
    points: AdjustedPoints
    observations: AdjustedObservations
    scale_bars: AdjustedBars
    rejected: tuple[NetworkRejection, ...]
    warnings: tuple[str, ...]
    summary: NetworkSummary
    known_factor: float | None = None
    known_redundancy: float = 0.0
