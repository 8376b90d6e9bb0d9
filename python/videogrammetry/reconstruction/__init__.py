"""Reconstruction: matches to points with covariance."""

from videogrammetry.reconstruction.rig import Rig
from videogrammetry.reconstruction.triangulate import (
    TRIANGULATION_STATUS,
    reconstruct_stage,
    triangulate,
)

__all__ = ["TRIANGULATION_STATUS", "Rig", "reconstruct_stage", "triangulate"]
