"""Photogrammetric adjustment: start values, bundle, covariance, data snooping."""

from videogrammetry.adjustment.network import Network
from videogrammetry.adjustment.results import (
    CAMERA_UNKNOWNS,
    INTERFACE_UNKNOWNS,
    Adjustment,
    AdjustOptions,
    CameraVariance,
    Dispersion,
    DroppedParameter,
    PointPriorStatistics,
    ScaleBarStatistics,
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
    "CAMERA_UNKNOWNS",
    "INTERFACE_UNKNOWNS",
    "AdjustOptions",
    "Adjustment",
    "CameraVariance",
    "Dispersion",
    "Dlt",
    "DroppedParameter",
    "Network",
    "PointPriorStatistics",
    "PoseCandidate",
    "RelativeCandidate",
    "RelativeOrientation",
    "ScaleBarStatistics",
    "direct_linear_transform",
    "principal_extents",
    "relative_orientation",
    "resect",
    "robust_bundle",
    "search_focal",
]
