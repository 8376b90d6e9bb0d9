"""Reconstruction: matches to points with covariance."""

from videogrammetry.reconstruction.field import CalibrationField
from videogrammetry.reconstruction.rig import Rig
from videogrammetry.reconstruction.triangulate import (
    CIRCLE_STATUS,
    TRIANGULATION_STATUS,
    Circles,
    Triangulator,
    reconstruct_stage,
    triangulate,
)
from videogrammetry.reconstruction.uncertainty import Distance, Intersection, Projection

__all__ = [
    "CIRCLE_STATUS",
    "TRIANGULATION_STATUS",
    "CalibrationField",
    "Circles",
    "Distance",
    "Intersection",
    "Projection",
    "Rig",
    "Triangulator",
    "reconstruct_stage",
    "triangulate",
]
