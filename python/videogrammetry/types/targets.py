"""What is seen in pictures, and known of points: targets, points, observations."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from videogrammetry.types.arrays import FloatArray, IntArray

#: Stands for confidences that were not given.
_UNKNOWN = np.empty(0)


@dataclass(frozen=True, kw_only=True)
class Targets:
    """The targets recognised in one picture.

    Attributes
    ----------
    centre_px : (N, 2) ellipse centres x, y, not corrected for eccentricity.
    semi_axes_px : (N, 2) semi-major and semi-minor axis.
    angle_rad : (N,) direction of the major axis from x towards y, in [0, pi).
    id : (N,) code number, -1 = un-coded or not read.
    cov : (N, 5, 5) covariance of (x, y, semi-major, semi-minor, angle), in px
        and rad, from the residuals of the edge points.
    edge_rms_px : (N,) RMS distance of the edge points from the ellipse.
    contrast : (N,) grey-value difference across the edge, in grey levels.
    ring_status : (N,) index into ``RING_STATUS``: why a target has no ID.
    id_confidence : (N,) probability that the ID is right, NaN where there is none
        (or where nothing is known of it); what it means: docs/method.md, section 1.
    """

    centre_px: FloatArray
    semi_axes_px: FloatArray
    angle_rad: FloatArray
    id: IntArray
    cov: FloatArray
    edge_rms_px: FloatArray
    contrast: FloatArray
    ring_status: npt.NDArray[np.uint8]
    id_confidence: FloatArray = field(default_factory=lambda: _UNKNOWN)

    def __post_init__(self) -> None:
        if self.id_confidence is _UNKNOWN:
            object.__setattr__(self, "id_confidence", np.full(len(self.id), np.nan))

    def __len__(self) -> int:
        return len(self.id)

    @property
    def sigma_px(self) -> FloatArray:
        """(N, 2) standard deviations of the centre."""
        return np.sqrt(np.stack([self.cov[:, 0, 0], self.cov[:, 1, 1]], axis=1))

    @property
    def unique_id(self) -> IntArray:
        """(N,) ``id``, -1 also where the same number stands at several places."""
        _, inverse, count = np.unique(self.id, return_inverse=True, return_counts=True)
        return np.where(count[inverse] > 1, np.int32(-1), self.id).astype(np.int32)

    def select(self, index: Any) -> Targets:
        """The targets of an index array or mask, in its order."""
        return Targets(**{name: getattr(self, name)[index] for name in _TARGET_FIELDS})


_TARGET_FIELDS = tuple(Targets.__dataclass_fields__)


@dataclass(frozen=True, kw_only=True)
class PointSet:
    """Known or measured points of an object: a points CSV.

    Attributes
    ----------
    id : (N,) numbers, unique.
    position_mm : (N, 3).
    cov_mm2 : (N, 6) in the order of ``COV6_ORDER``, or None where unknown.
    normal : (N, 3) unit normals or None; diameter_mm : (N,) or None.
    full_cov_mm2 : (3N, 3N) with the correlations between points, where they are known.
    """

    id: IntArray
    position_mm: FloatArray
    cov_mm2: FloatArray | None = None
    normal: FloatArray | None = None
    diameter_mm: FloatArray | None = None
    full_cov_mm2: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.id)


@dataclass(frozen=True, kw_only=True)
class Observations:
    """Image points of known identity: an observations CSV, one row a point.

    Attributes
    ----------
    image : names of the pictures, indexed by ``image_index`` (M,).
    point_id : (M,) numbers of the points; -1 = not yet identified.
    xy_px : (M, 2). cov_px2 : (M, 3) xx, xy, yy.
    """

    image: tuple[str, ...]
    image_index: IntArray
    point_id: IntArray
    xy_px: FloatArray
    cov_px2: FloatArray

    def __len__(self) -> int:
        return len(self.point_id)
