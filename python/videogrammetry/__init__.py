"""videogrammetry: pictures of synchronised cameras to 3-D motion.

The shortest way from files::

    import videogrammetry as vg

    project = vg.read_project("project.toml")
    run = vg.calibrate_project(project)
    measurement = vg.measure_project(project, rig=run.rig)
    measurement.trajectories.position_mm  # (stage, point, 3)

and from arrays, without a file::

    target = vg.read_points("points.csv")
    run = vg.calibrate_frames({"left": left, "right": right}, target)
    measurement = vg.measure_frames(run.rig, {"left": moving_left, "right": moving_right})

:class:`Rig` projects and triangulates, :func:`plan_rig` predicts its accuracy,
:func:`recognize` finds the targets of one picture, :func:`recognize_sequence` those of many.
"""

from videogrammetry.calibration import CalibrationOptions, CalibrationRun, calibrate
from videogrammetry.errors import (
    CalibrationError,
    MeasurementError,
    ProjectFileError,
    SequenceError,
    TableError,
    VideogrammetryError,
)
from videogrammetry.geometry import MeasuringVolume
from videogrammetry.matching import MatchingOptions
from videogrammetry.motion import MotionOptions, compute_motion
from videogrammetry.pipeline import (
    Plan,
    PlanOptions,
    calibrate_frames,
    calibrate_project,
    measure_frames,
    measure_project,
    plan_rig,
    verify_project,
)
from videogrammetry.project import (
    read_measurement,
    read_plan,
    read_points,
    read_project,
    write_measurement,
    write_rig,
)
from videogrammetry.recognition import (
    CameraModel,
    PackedFrame,
    RecognitionOptions,
    TargetSequence,
    TrackedOptions,
    learn_camera,
    recognize,
    recognize_sequence,
)
from videogrammetry.reconstruction import Rig, triangulate
from videogrammetry.sequence import open_sequence
from videogrammetry.types import Measurement, PointSet, Targets, Trajectories
from videogrammetry.version import __version__


def measure(project: str) -> Measurement:
    """Measure the project file ``project`` with the rig beside it: ``measure_project``."""
    return measure_project(read_project(project))


__all__ = [
    "CalibrationError",
    "CalibrationOptions",
    "CalibrationRun",
    "CameraModel",
    "MatchingOptions",
    "Measurement",
    "MeasurementError",
    "MeasuringVolume",
    "MotionOptions",
    "PackedFrame",
    "Plan",
    "PlanOptions",
    "PointSet",
    "ProjectFileError",
    "RecognitionOptions",
    "Rig",
    "SequenceError",
    "TableError",
    "TargetSequence",
    "Targets",
    "TrackedOptions",
    "Trajectories",
    "VideogrammetryError",
    "__version__",
    "calibrate",
    "calibrate_frames",
    "calibrate_project",
    "compute_motion",
    "learn_camera",
    "measure",
    "measure_frames",
    "measure_project",
    "open_sequence",
    "plan_rig",
    "read_measurement",
    "read_plan",
    "read_points",
    "read_project",
    "recognize",
    "recognize_sequence",
    "triangulate",
    "verify_project",
    "write_measurement",
    "write_rig",
]
