"""Pipeline: the only place that knows the order of the rooms."""

from videogrammetry.pipeline.calibrate import calibrate_frames, calibrate_project
from videogrammetry.pipeline.frames import Progress
from videogrammetry.pipeline.measure import measure_frames, measure_project

__all__ = [
    "Progress",
    "calibrate_frames",
    "calibrate_project",
    "measure_frames",
    "measure_project",
]
