"""Rigs to exchange: the paper's, with its shear, and one as lenses usually are."""

from __future__ import annotations

import dataclasses

import numpy as np

from videogrammetry.geometry import rays_through_pixels
from videogrammetry.rendering.scenes.paper_rig import paper_rig
from videogrammetry.types import RigData


def usual_rig(num_cameras: int = 3) -> RigData:
    """The paper's places with lenses of a usual barrel distortion, square pixels, no shear."""
    interior = [
        [2640.0, 12.0, -20.5, 2.2e-8, 3e-15, 0, 3e-7, -2e-7, 0, 0],
        [2610.0, -31.0, 5.25, 2.5e-8, -2e-15, 0, -1e-7, 4e-7, 1e-4, 0],
        [2660.0, 3.0, 41.0, -1.8e-8, 4e-15, 0, 2e-7, 1e-7, 0, 0],
    ]
    cameras = list(paper_rig().cameras.values())[:num_cameras]
    return RigData(
        cameras={
            f"cam{k + 1}": dataclasses.replace(camera, interior=np.array(values, dtype=float))
            for k, (camera, values) in enumerate(zip(cameras, interior, strict=False))
        },
        reference="camera cam1",
    )


def points_seen_by(camera, seed: int, count: int = 500):
    """Points (N, 3) mm of the world at 5 to 25 m whose pictures fill the camera's."""
    rng = np.random.default_rng(seed)
    width, height = camera.image_size_px
    pixels = rng.uniform([-0.5, -0.5], [width - 0.5, height - 0.5], (count, 2))
    in_cam = rays_through_pixels(camera, pixels) * rng.uniform(5000, 25000, (count, 1))
    return (in_cam - camera.translation_mm) @ camera.rotation, pixels


def assert_within(theirs, pixels, residual, message=""):
    """Their pictures are ours within the stated residual.

    The largest distance was found on a grid of 129 x 129; between its points a smooth
    distortion's can be larger by its curvature over half a step, 1/128 of the picture's
    side, not by 3 %. The RMS of 500 random places scatters by about 1/sqrt(1000) of the
    distances' own scatter, at most 20 % for distances of this kind. 1e-6 px is for
    numbers of 1e4 mm, and for models that are exact.
    """
    distance = np.hypot(*(theirs - pixels).T)
    assert np.isfinite(distance).all(), message
    assert distance.max() <= 1.03 * residual.max_px + 1e-6, message
    rms = np.sqrt(np.mean(distance**2))
    assert rms <= 1.2 * residual.rms_px + 1e-6, message
    assert rms >= 0.8 * residual.rms_px - 1e-6, message
