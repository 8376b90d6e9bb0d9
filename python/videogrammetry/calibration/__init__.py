"""Calibration of the cameras from pictures of a known target."""

from videogrammetry.calibration.calibrate import calibrate
from videogrammetry.calibration.design import (
    CalibrationDesign,
    DesignOptions,
    design_at_positions,
    design_calibration,
    flat_board,
)
from videogrammetry.calibration.run import (
    CalibrationInterface,
    CalibrationOptions,
    CalibrationRun,
    CameraFrames,
    FrameTargets,
    ObservationTable,
    Rejection,
)

__all__ = [
    "CalibrationDesign",
    "CalibrationInterface",
    "CalibrationOptions",
    "CalibrationRun",
    "CameraFrames",
    "DesignOptions",
    "FrameTargets",
    "ObservationTable",
    "Rejection",
    "calibrate",
    "design_at_positions",
    "design_calibration",
    "flat_board",
]
