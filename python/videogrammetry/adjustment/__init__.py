"""Photogrammetric adjustment: start values, bundle, covariance, data snooping."""

from videogrammetry.adjustment.network import (
    Adjustment,
    AdjustOptions,
    CameraVariance,
    Dispersion,
    DroppedParameter,
    Network,
)
from videogrammetry.adjustment.start import (
    Dlt,
    PoseCandidate,
    direct_linear_transform,
    principal_extents,
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
    "direct_linear_transform",
    "principal_extents",
    "resect",
    "search_focal",
]
