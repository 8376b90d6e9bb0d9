"""Rigs and plans for the tests of planning."""

from __future__ import annotations

import numpy as np

from videogrammetry.geometry import rotation_looking_at
from videogrammetry.types import RigCamera, RigData


def camera(position, look_at=(0, 0, 0), f_px=2000.0, size=(1000, 1000)) -> RigCamera:
    rotation = rotation_looking_at(position, look_at)
    return RigCamera(
        image_size_px=size,
        interior=np.r_[f_px, np.zeros(9)],
        r0_px=400.0,
        rotation=rotation,
        translation_mm=-rotation @ np.asarray(position, dtype=float),
    )


def pair_rig(angle_deg=40.0, distance=4000.0) -> RigData:
    """Two cameras that look at the origin from -y, ``angle_deg`` apart."""
    half = np.radians(angle_deg / 2)
    x, y = distance * np.sin(half), -distance * np.cos(half)
    return RigData(cameras={"left": camera([-x, y, 0]), "right": camera([x, y, 0])})


def facing_rig() -> RigData:
    """Two pairs that face each other."""
    front = pair_rig(30.0).cameras
    back = {
        "left2": camera([-1000, 3900, 200]),
        "right2": camera([1000, 3900, 0]),
    }
    return RigData(cameras={**front, **back})


PLAN = """schema = 1
name = "bench"
sigma_px = 0.03
positions = 8
length_mm = 400
[cameras.left]
image_size_px = [1000, 1000]
f_mm = 20
pixel_mm = 0.01
position_mm = [-1368, -3758, 0]
look_at_mm = [0, 0, 0]
[cameras.right]
image_size_px = [1000, 1000]
f_px = 2000
position_mm = [1368, -3758, 0]
look_at_mm = [0, 0, 0]
[volume]
size_mm = [800, 600, 700]
[target]
kind = "board"
size_mm = [500, 400]
sigma_mm = 0.05
"""
