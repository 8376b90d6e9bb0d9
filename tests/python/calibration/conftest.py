"""A simulated rig around a target: truth, and pictures of it with stated noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pytest

from videogrammetry.calibration import CameraFrames, FrameTargets
from videogrammetry.geometry import project, rotation_from_vector
from videogrammetry.types import PointSet, RigCamera


@dataclass
class Scene:
    """Truth (``cameras``, ``stages``: rig_from_target, ``points_mm``) and what was measured."""

    cameras: dict[str, RigCamera]
    stages: dict[int, tuple[np.ndarray, np.ndarray]]
    points_mm: np.ndarray
    target: PointSet
    frames: list[CameraFrames] = field(default_factory=list)


def look_at(position, aim):
    """cam_from_rig of a camera at ``position`` that looks at ``aim``, x level (y down)."""
    z = (aim - position) / np.linalg.norm(aim - position)
    x = np.cross(np.array([0.0, 1.0, 0.0]), z)
    x /= np.linalg.norm(x)
    rotation = np.stack([x, np.cross(z, x), z])
    return rotation, -rotation @ position


def make_scene(
    *,
    seed=1,
    num_cameras=2,
    num_stages=8,
    f_px=2000.0,
    interior=(0.0, 12.0, -8.0, 2e-8, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    distance_mm=3000.0,
    size_mm=800.0,
    relief_mm=80.0,
    num_points=40,
    noise_px=0.02,
    target_noise_mm=0.02,
    tilt_rad=0.6,
    sigma_px=None,
    free=None,
    start=None,
    image_size_px=(1024, 1024),
    coded=None,
):
    """``coded``: how many of the points carry a number in the pictures (the rest id -1)."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-0.5, 0.5, (num_points, 3)) * [size_mm, size_mm, relief_mm]
    aim = np.array([0.0, 0.0, distance_mm])
    values = np.array(interior)
    values[0] = f_px
    cameras = {}
    base = None
    for c in range(num_cameras):
        angle = 0.45 * (c - (num_cameras - 1) / 2) if num_cameras > 1 else 0.0
        position = aim + distance_mm * np.array([np.sin(angle), 0.05 * c, -np.cos(angle)])
        rotation, shift = look_at(position, aim)
        if base is None:
            base = (rotation, shift)
        relative = rotation @ base[0].T
        cameras[f"c{c + 1}"] = RigCamera(
            image_size_px=image_size_px, interior=values.copy(), r0_px=400.0,
            rotation=relative, translation_mm=shift - relative @ base[1],
        )  # fmt: skip
    stages = {}
    for s in range(1, num_stages + 1):
        turn = rotation_from_vector(rng.uniform(-tilt_rad, tilt_rad, 3))
        place = aim + rng.uniform(-0.1, 0.1, 3) * distance_mm
        stages[s] = (base[0] @ turn, base[0] @ place + base[1])
    numbers = np.arange(1, num_points + 1, dtype=np.int32)
    measured = points + rng.normal(0, target_noise_mm, points.shape)
    scene = Scene(cameras, stages, points, PointSet(id=numbers, position_mm=measured))
    sigma = noise_px if sigma_px is None else sigma_px
    for name, camera in cameras.items():
        frames = []
        for stage, (rotation, shift) in stages.items():
            in_rig = points @ rotation.T + shift
            xy = project(camera, in_rig @ camera.rotation.T + camera.translation_mm)
            inside = ((xy >= 0) & (xy < np.array(image_size_px))).all(axis=1)
            ids = numbers if coded is None else np.where(numbers <= coded, numbers, -1)
            xy = xy + rng.normal(0, noise_px, xy.shape)
            cov = np.tile([sigma**2, 0.0, sigma**2], (int(inside.sum()), 1))
            frames.append(
                FrameTargets(
                    stage=stage,
                    image=f"{name}_{stage:02d}",
                    id=ids[inside],
                    xy_px=xy[inside],
                    cov_px2=cov,
                )
            )
        scene.frames.append(
            CameraFrames(
                name=name,
                image_size_px=image_size_px,
                frames=frames,
                free=free,
                start=start or {},
                r0_px=400.0,
            )
        )
    return scene


@pytest.fixture
def scene() -> Callable[..., Scene]:
    return make_scene
