"""Accuracy: what measured things show of a measurement, beside what was predicted."""

from videogrammetry.accuracy.acceptance import AcceptanceCheck, acceptance_checks
from videogrammetry.accuracy.calibration_part import CalibrationPart, sighting_sigma_px
from videogrammetry.accuracy.free_fall import (
    STANDARD_GRAVITY_M_S2,
    FallFit,
    FallRegression,
    FreeFallOptions,
    FreeFallTest,
    check_free_fall,
    fall_regression,
)
from videogrammetry.accuracy.plan import (
    SOURCES,
    DistancesPrediction,
    NeededPositions,
    PairGeometry,
    PlacesPrediction,
    Spread,
    needed_positions,
    pair_geometries,
    predict_distances,
    predict_places,
    prediction_statistics,
    spread,
)
from videogrammetry.accuracy.reprojection import (
    DEFINITIONS,
    ReprojectionStatistics,
    camera_statistics,
    measurement_reprojection,
    reprojection_statistics,
)
from videogrammetry.accuracy.scale_bar import (
    KnownLength,
    LengthStatistics,
    ScaleBarTest,
    check_scale_bars,
    length_statistics,
)
from videogrammetry.accuracy.true_points import (
    TruePoints,
    lengths_from_calibration,
    measured_from_true,
)
from videogrammetry.accuracy.truth import (
    CentroidErrors,
    ErrorStatistics,
    TruthComparison,
    WrongPoint,
    compare_with_truth,
)

__all__ = [
    "DEFINITIONS",
    "SOURCES",
    "STANDARD_GRAVITY_M_S2",
    "AcceptanceCheck",
    "CalibrationPart",
    "CentroidErrors",
    "DistancesPrediction",
    "ErrorStatistics",
    "FallFit",
    "FallRegression",
    "FreeFallOptions",
    "FreeFallTest",
    "KnownLength",
    "LengthStatistics",
    "NeededPositions",
    "PairGeometry",
    "PlacesPrediction",
    "ReprojectionStatistics",
    "ScaleBarTest",
    "Spread",
    "TruePoints",
    "TruthComparison",
    "WrongPoint",
    "acceptance_checks",
    "camera_statistics",
    "check_free_fall",
    "check_scale_bars",
    "compare_with_truth",
    "fall_regression",
    "length_statistics",
    "lengths_from_calibration",
    "measured_from_true",
    "measurement_reprojection",
    "needed_positions",
    "pair_geometries",
    "predict_distances",
    "predict_places",
    "prediction_statistics",
    "reprojection_statistics",
    "sighting_sigma_px",
    "spread",
]
