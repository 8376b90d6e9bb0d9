"""Tracking: points of the stages to trajectories."""

from videogrammetry.tracking.gaps import FillOptions, fill_gaps
from videogrammetry.tracking.link import (
    LinkOptions,
    ManyLinks,
    StageLinks,
    Tracker,
    build_trajectories,
    link_stages,
)

__all__ = [
    "FillOptions",
    "LinkOptions",
    "ManyLinks",
    "StageLinks",
    "Tracker",
    "build_trajectories",
    "fill_gaps",
    "link_stages",
]
