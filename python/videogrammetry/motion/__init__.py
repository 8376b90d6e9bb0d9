"""Motion: trajectories to displacements, velocities and the centroid."""

from videogrammetry.motion.motion import (
    MotionOptions,
    MotionPlan,
    compute_motion,
    constant_set,
    motion_part,
    motion_rows,
    plan_motion,
    trajectory_rows,
)

__all__ = [
    "MotionOptions",
    "MotionPlan",
    "compute_motion",
    "constant_set",
    "motion_part",
    "motion_rows",
    "plan_motion",
    "trajectory_rows",
]
