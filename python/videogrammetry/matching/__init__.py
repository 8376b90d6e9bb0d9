"""Matching: targets of all cameras to points."""

from videogrammetry.matching.match import (
    TARGET_STATUS,
    MatchingOptions,
    image_covariance,
    match_stage,
)

__all__ = ["TARGET_STATUS", "MatchingOptions", "image_covariance", "match_stage"]
