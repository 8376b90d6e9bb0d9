"""Matching: targets of all cameras to points."""

from videogrammetry.matching.match import (
    TARGET_STATUS,
    MatchEdits,
    MatchingOptions,
    image_covariance,
    match_stage,
    match_stages,
)

__all__ = [
    "TARGET_STATUS",
    "MatchEdits",
    "MatchingOptions",
    "image_covariance",
    "match_stage",
    "match_stages",
]
