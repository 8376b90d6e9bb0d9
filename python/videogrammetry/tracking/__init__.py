"""Tracking: points of the stages to trajectories."""

from videogrammetry.tracking.link import LinkOptions, build_trajectories, link_stages

__all__ = ["LinkOptions", "build_trajectories", "link_stages"]
