"""Photogrammetric adjustment: start values, bundle, covariance, data snooping."""

from videogrammetry.adjustment.network import (
    Adjustment,
    AdjustOptions,
    CameraVariance,
    Dispersion,
    DroppedParameter,
    Network,
)
from videogrammetry.adjustment.robust import robust_bundle
from videogrammetry.adjustment.start import (
    Dlt,
    PoseCandidate,
    RelativeCandidate,
    RelativeOrientation,
    direct_linear_transform,
    principal_extents,
    relative_orientation,
    resect,
    search_focal,
)

__all__ = [
    "AdjustOptions",
    "Adjustment",
    "CameraVariance",
    "Dispersion",
    "Dlt",
    "DroppedParameter",
    "Network",
    "PoseCandidate",
    "RelativeCandidate",
    "RelativeOrientation",
    "direct_linear_transform",
    "principal_extents",
    "relative_orientation",
    "resect",
    "robust_bundle",
    "search_focal",
]
