"""A photogrammetric network as tables: what ``adjust`` and ``measure-target`` work on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import numpy.typing as npt

from videogrammetry.types import FloatArray, IntArray

Datum = Literal["free", "weighted", "fixed"]


@dataclass(frozen=True, kw_only=True)
class NetworkCamera:
    """A camera that took pictures of the network; all its pictures share its interior.

    Attributes
    ----------
    name : as in the project or network file.
    image_size_px : (width, height).
    interior : (10,) start values f, x0, y0, A1, ..., E2; f NaN where nothing is known.
    r0_px : radius at which the radial polynomial is zero.
    measured : direction of the distortion (DESIGN: the paper's; False: AICON's and OpenCV's).
    aspect : pixel height over width less 1, applied before the distortion.
    corrected_residual : residuals and stated sigmas are those of the corrected image
        points, as PhotoModeler's; with ``measured`` alone.
    free : names of what is estimated (the ten, "aspect", "time_offset"); None: all ten,
        each kept only if significant.
    sigma : standard deviations with which start values are observed.
    """

    name: str
    image_size_px: tuple[int, int]
    interior: FloatArray
    r0_px: float
    measured: bool = True
    aspect: float = 0.0
    corrected_residual: bool = False
    free: tuple[str, ...] | None = None
    sigma: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class NetworkImage:
    """A picture: its camera (index) and, where known, its pose cam_from_object."""

    name: str
    camera: int
    rotation: FloatArray | None = None
    translation_mm: FloatArray | None = None


@dataclass(frozen=True, kw_only=True)
class NetworkPoints:
    """Object points.

    Attributes
    ----------
    name : unique names as users wrote them; numbers are written without decimals.
    position_mm : (N, 3) start or known values; NaN where nothing is known.
    kind : (N,) "fixed", "weighted" or "free".
    cov_mm2 : (N, 3, 3) of weighted points; NaN elsewhere.
    full_cov_mm2 : (3K, 3K) of the weighted points in their order, where one is known.
    normal : (N, 3) and diameter_mm : (N,), of circular targets; NaN where unknown.
    """

    name: tuple[str, ...]
    position_mm: FloatArray
    kind: npt.NDArray[np.str_]
    cov_mm2: FloatArray | None = None
    full_cov_mm2: FloatArray | None = None
    normal: FloatArray | None = None
    diameter_mm: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.name)


@dataclass(frozen=True, kw_only=True)
class NetworkObservations:
    """Image points, (M,) each: picture and point as indices, (M, 2) px, (M, 3) px2 xx, xy, yy.

    ``point`` is -1 for a target of unknown identity (un-coded): kept for matching.
    """

    image: IntArray
    point: IntArray
    xy_px: FloatArray
    cov_px2: FloatArray

    def __len__(self) -> int:
        return len(self.image)


@dataclass(frozen=True, kw_only=True)
class ScaleBars:
    """Known distances between points, (B,) each; indices into the points."""

    point_a: IntArray
    point_b: IntArray
    length_mm: FloatArray
    sigma_mm: FloatArray
    certificate: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.point_a)


NO_SCALE_BARS = ScaleBars(
    point_a=np.empty(0, np.int32),
    point_b=np.empty(0, np.int32),
    length_mm=np.empty(0),
    sigma_mm=np.empty(0),
)


@dataclass(frozen=True, kw_only=True)
class NetworkInput:
    """Everything that an adjustment of a network starts from.

    ``sigma_px``: a-priori standard deviation of an image coordinate where the
    observations state none (their ``cov_px2`` holds it already); ``datum`` as in
    DESIGN's network file; ``critical_value`` of the data snooping, 0 = none.
    """

    cameras: tuple[NetworkCamera, ...]
    images: tuple[NetworkImage, ...]
    points: NetworkPoints
    observations: NetworkObservations
    scale_bars: ScaleBars = NO_SCALE_BARS
    sigma_px: float = 0.1
    datum: Datum = "free"
    critical_value: float = 3.29
