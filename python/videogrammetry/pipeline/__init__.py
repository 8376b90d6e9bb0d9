"""Pipeline: the only place that knows the order of the rooms."""

from videogrammetry.pipeline.calibrate import calibrate_by, calibrate_frames, calibrate_project
from videogrammetry.pipeline.cluster import ClusterRunner
from videogrammetry.pipeline.follow import FollowOptions, follow_project
from videogrammetry.pipeline.frames import Progress
from videogrammetry.pipeline.live import LiveTable
from videogrammetry.pipeline.measure import measure_frames, measure_project, measure_to_file
from videogrammetry.pipeline.motion import recompute_motion
from videogrammetry.pipeline.plan import plan_columns, plan_document, plan_rig
from videogrammetry.pipeline.plan_types import CountRow, Plan, PlanOptions, Section
from videogrammetry.pipeline.sinks import StageTable
from videogrammetry.pipeline.verify import Verification, verify_project

__all__ = [
    "ClusterRunner",
    "CountRow",
    "FollowOptions",
    "LiveTable",
    "Plan",
    "PlanOptions",
    "Progress",
    "Section",
    "StageTable",
    "Verification",
    "calibrate_by",
    "calibrate_frames",
    "calibrate_project",
    "follow_project",
    "measure_frames",
    "measure_project",
    "measure_to_file",
    "plan_columns",
    "plan_document",
    "plan_rig",
    "recompute_motion",
    "verify_project",
]
