"""The paper's experiments as scenes: cameras, targets, and where they are at any time."""

from videogrammetry.rendering.scenes.base import Marks, Placement, Scene
from videogrammetry.rendering.scenes.calibration import calibration_scene
from videogrammetry.rendering.scenes.cross import CrossTarget, cross_target
from videogrammetry.rendering.scenes.paper_rig import LabFrame, lab_frame, paper_rig
from videogrammetry.rendering.scenes.photos import PhotoScene, photos_scene
from videogrammetry.rendering.scenes.scale_bar import scale_bar_scene
from videogrammetry.rendering.scenes.tyre import tyre_scene

__all__ = [
    "CrossTarget",
    "LabFrame",
    "Marks",
    "PhotoScene",
    "Placement",
    "Scene",
    "calibration_scene",
    "cross_target",
    "lab_frame",
    "paper_rig",
    "photos_scene",
    "scale_bar_scene",
    "tyre_scene",
]
