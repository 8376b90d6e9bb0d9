"""Motion: trajectories to displacements, velocities and the centroid."""

from videogrammetry.motion.motion import (
    MotionOptions,
    MotionPlan,
    compute_motion,
    constant_set,
    flag_mask,
    motion_part,
    motion_rows,
    plan_motion,
    trajectory_rows,
    without_flagged,
)

__all__ = [
    "MotionOptions",
    "MotionPlan",
    "compute_motion",
    "constant_set",
    "flag_mask",
    "motion_part",
    "motion_rows",
    "plan_motion",
    "trajectory_rows",
    "without_flagged",
]
