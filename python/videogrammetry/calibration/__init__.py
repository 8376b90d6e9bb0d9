"""Calibration of the cameras from pictures of a known target."""

from videogrammetry.calibration.calibrate import calibrate
from videogrammetry.calibration.run import (
    CalibrationOptions,
    CalibrationRun,
    CameraFrames,
    FrameTargets,
    ObservationTable,
    Rejection,
)

__all__ = [
    "CalibrationOptions",
    "CalibrationRun",
    "CameraFrames",
    "FrameTargets",
    "ObservationTable",
    "Rejection",
    "calibrate",
]
