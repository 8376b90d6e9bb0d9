"""A plain renderer for tests: targets on a plane, 6x6 samples a pixel, blur, noise.

Slow and simple on purpose; it shares only the pinhole with the product.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from videogrammetry.types import RigCamera, RigData

SAMPLES = 6


def arc_rig(count=2, *, f_px=1400.0, size=(640, 480), distance_mm=2000.0, angle_rad=0.35):
    """Cameras on an arc, looking at (0, 0, distance) of the first camera's frame turned out."""
    cameras = {}
    for k in range(count):
        # Off the arc's plane by turns, so that not all epipolar lines are parallel.
        turn = Rotation.from_rotvec([0.12 * (k % 2), (k - (count - 1) / 2) * angle_rad, 0])
        rotation = turn.as_matrix()
        target = np.array([0.0, 0.0, distance_mm])
        cameras[f"cam{k + 1}"] = RigCamera(
            image_size_px=size,
            interior=np.r_[f_px, 4.0, -3.0, np.zeros(7)],
            r0_px=250.0,
            rotation=rotation,
            translation_mm=target - rotation @ target,
        )
    first = next(iter(cameras.values()))
    for name, c in cameras.items():
        rotation = c.rotation @ first.rotation.T
        translation = c.translation_mm - rotation @ first.translation_mm
        cameras[name] = RigCamera(
            image_size_px=size,
            interior=c.interior,
            r0_px=c.r0_px,
            rotation=rotation,
            translation_mm=translation,
        )
    return RigData(cameras=cameras)


def _white(u, v, radius_mm, bits, code):
    r = np.hypot(u, v)
    white = r <= radius_mm
    if code is not None:
        sector = np.floor(np.arctan2(v, u) / (2 * np.pi) * bits).astype(int) % bits
        lit = (code >> (bits - 1 - sector)) & 1
        white |= (r >= 2 * radius_mm) & (r <= 3 * radius_mm) & (lit == 1)
    return white


def render(camera, targets, rng, *, radius_mm=6.0, bits=14, noise=1.0, psf_px=0.6):
    """One picture, uint8; ``targets``: list of (centre (3,), x axis, y axis, code or None).

    Axes as printed: x right and y down on the sticker seen from the front.
    """
    width, height = camera.image_size_px
    f, x0, y0 = camera.interior[:3]
    centre = np.array([(width - 1) / 2 + x0, (height - 1) / 2 + y0])
    picture = np.full((height, width), 25.0)
    offsets = (np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5
    for position, x_axis, y_axis, code in targets:
        p = camera.rotation @ position + camera.translation_mm
        a, b = camera.rotation @ x_axis, camera.rotation @ y_axis
        normal = np.cross(a, b)
        reach = int(np.ceil(3.6 * radius_mm * f / p[2])) + 2
        cx, cy = (centre + f * p[:2] / p[2]).round().astype(int)
        xs = np.arange(max(cx - reach, 0), min(cx + reach + 1, width))
        ys = np.arange(max(cy - reach, 0), min(cy + reach + 1, height))
        if not len(xs) or not len(ys):
            continue
        sx = (xs[:, None] + offsets).ravel()
        sy = (ys[:, None] + offsets).ravel()
        gx, gy = np.meshgrid((sx - centre[0]) / f, (sy - centre[1]) / f)
        rays = np.stack([gx, gy, np.ones_like(gx)], axis=-1)
        hit = rays * ((p @ normal) / (rays @ normal))[..., None] - p
        white = _white(hit @ a, hit @ b, radius_mm, bits, code).astype(float)
        share = white.reshape(len(ys), SAMPLES, len(xs), SAMPLES).mean(axis=(1, 3))
        window = picture[ys[0] : ys[-1] + 1, xs[0] : xs[-1] + 1]
        np.maximum(window, 25 + 175 * share, out=window)
    blurred = gaussian_filter(picture, psf_px)
    return np.clip(blurred + rng.normal(0, noise, blurred.shape), 0, 255).round().astype(np.uint8)
