"""Cameras before the window of a tank of water, and what they see of a block of points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from videogrammetry.geometry import project_from_world, rotation_looking_at
from videogrammetry.types import FlatInterface, FloatArray, RigCamera

SIZE = (1280, 1024)
#: The window of a tank: cameras at z > 100 mm, water at z < 100 mm, 8 mm of glass between.
WINDOW = FlatInterface(
    name="window", normal=np.array([0.0, 0.0, 1.0]), distance_mm=100.0, fluid_index=1.333,
    glass_index=1.5, glass_thickness_mm=8.0,
)  # fmt: skip


def tank_cameras(window: FlatInterface | None = WINDOW) -> dict[str, RigCamera]:
    """Four cameras 700 mm before the block, 15 to 25 degrees beside its normal."""
    cameras = {}
    for k, (x, y) in enumerate(((-260, 180), (240, 200), (-250, -190), (270, -170))):
        centre = np.array([x, y, 700.0])
        rotation = rotation_looking_at(centre, np.array([0.0, 0.0, -20.0]))
        cameras[f"c{k}"] = RigCamera(
            image_size_px=SIZE,
            interior=np.array([4200.0 + 30 * k, 5, -8, 2e-9, 0, 0, 0, 0, 0, 0]),
            r0_px=500.0,
            rotation=rotation,
            translation_mm=-rotation @ centre,
            interface=window,
        )
    return cameras


def block_points(planes: int = 4) -> FloatArray:
    """(N, 3) a block of points, 100 x 80 x 60 mm, in the water."""
    x, y, z = np.meshgrid(
        np.linspace(-50, 50, 6), np.linspace(-40, 40, 5), np.linspace(-60, 0, planes)
    )
    return np.column_stack([x.ravel(), y.ravel(), z.ravel()])


def pictures(cameras: dict[str, RigCamera], points_mm: FloatArray) -> dict[str, FloatArray]:
    """Exact pictures."""
    return {name: project_from_world(camera, points_mm) for name, camera in cameras.items()}


def without_window(cameras: dict[str, RigCamera]) -> dict[str, RigCamera]:
    """The same cameras in air."""
    return {name: replace(camera, interface=None) for name, camera in cameras.items()}
