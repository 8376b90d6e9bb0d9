"""Pictures of targets with exact truth: scene -> images, through the ten-parameter camera."""

from videogrammetry.rendering.options import Background, Illumination, Sensor, SpecularSpot
from videogrammetry.rendering.render import RenderedFrame, Renderer, render_frames
from videogrammetry.rendering.scene import VISIBILITY, SceneTargets, TargetTruth

__all__ = [
    "VISIBILITY",
    "Background",
    "Illumination",
    "RenderedFrame",
    "Renderer",
    "SceneTargets",
    "Sensor",
    "SpecularSpot",
    "TargetTruth",
    "render_frames",
]
