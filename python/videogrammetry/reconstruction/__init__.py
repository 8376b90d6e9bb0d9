"""Reconstruction: matches to points with covariance."""

from videogrammetry.reconstruction.field import CalibrationField
from videogrammetry.reconstruction.rig import Rig
from videogrammetry.reconstruction.triangulate import (
    TRIANGULATION_STATUS,
    Triangulator,
    reconstruct_stage,
    triangulate,
)

__all__ = [
    "TRIANGULATION_STATUS",
    "CalibrationField",
    "Rig",
    "Triangulator",
    "reconstruct_stage",
    "triangulate",
]
