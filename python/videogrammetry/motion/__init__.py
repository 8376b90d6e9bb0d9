"""Motion: trajectories to displacements, velocities and the centroid."""

from videogrammetry.motion.motion import MotionOptions, compute_motion

__all__ = ["MotionOptions", "compute_motion"]
