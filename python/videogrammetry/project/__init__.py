"""Project: the files that people write and keep, read strictly and written whole.

``read_project`` for project.toml, ``read_rig`` and ``write_rig`` for rig.json,
the CSV tables, and what all writers share: atomic replacement and provenance.
"""

from videogrammetry.project.atomic import (
    atomic_folder,
    atomic_path,
    refuse_overwrite,
    write_bytes,
    write_text,
)
from videogrammetry.project.camera_sections import CameraSection, InterfaceSection
from videogrammetry.project.csv_table import format_csv, read_csv, write_csv
from videogrammetry.project.lock import one_at_a_time
from videogrammetry.project.measurement_file import (
    MeasurementLayout,
    MeasurementWriter,
    open_measurement_writer,
    read_measurement,
    write_measurement,
)
from videogrammetry.project.plan_file import PlanFile, PlanTarget, read_plan
from videogrammetry.project.provenance import plain, provenance, sha256_of
from videogrammetry.project.result_tables import (
    CENTROID,
    MotionTable,
    TrajectoryTable,
    format_motion,
    format_trajectories,
    read_motion,
    read_trajectories,
)
from videogrammetry.project.rig_file import read_rig, write_rig
from videogrammetry.project.schema import (
    CalibrationSection,
    MotionSection,
    Project,
    SequenceSection,
    StabilitySection,
    TargetsSection,
    read_project,
)
from videogrammetry.project.tables import (
    ScaleBar,
    TargetTable,
    format_targets,
    read_observations,
    read_points,
    read_scale_bars,
    read_targets,
    target_table,
    write_observations,
    write_points,
    write_scale_bars,
)
from videogrammetry.project.verify_section import VerifySection

__all__ = [
    "CENTROID",
    "CalibrationSection",
    "CameraSection",
    "InterfaceSection",
    "MeasurementLayout",
    "MeasurementWriter",
    "MotionSection",
    "MotionTable",
    "PlanFile",
    "PlanTarget",
    "Project",
    "ScaleBar",
    "SequenceSection",
    "StabilitySection",
    "TargetTable",
    "TargetsSection",
    "TrajectoryTable",
    "VerifySection",
    "atomic_folder",
    "atomic_path",
    "format_csv",
    "format_motion",
    "format_targets",
    "format_trajectories",
    "one_at_a_time",
    "open_measurement_writer",
    "plain",
    "provenance",
    "read_csv",
    "read_measurement",
    "read_motion",
    "read_observations",
    "read_plan",
    "read_points",
    "read_project",
    "read_rig",
    "read_scale_bars",
    "read_targets",
    "read_trajectories",
    "refuse_overwrite",
    "sha256_of",
    "target_table",
    "write_bytes",
    "write_csv",
    "write_measurement",
    "write_observations",
    "write_points",
    "write_rig",
    "write_scale_bars",
    "write_text",
]
