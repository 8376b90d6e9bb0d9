"""Small cameras and quick scenes for the tests of ``simulate``."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from videogrammetry.recognition import code_family
from videogrammetry.rendering.scenes import paper_rig
from videogrammetry.types import RigData

FAMILY = code_family("schneider-14")


def small_rig(size_px: int = 256) -> RigData:
    """The paper's rig with fewer and larger pixels: pictures of ``size_px`` a side."""
    rig = paper_rig()
    scale = size_px / 1024
    powers = np.array([1, 1, 1, -2, -4, -6, -1, -1, 0, 0])
    cameras = {
        name: replace(
            camera,
            image_size_px=(size_px, size_px),
            interior=camera.interior * scale**powers,
            r0_px=camera.r0_px * scale,
        )
        for name, camera in rig.cameras.items()
    }
    return replace(rig, cameras=cameras)
