"""Synthetic pictures of dots and code rings with exact truth, for tests."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter


@dataclass(frozen=True)
class Dot:
    """A dot: ellipse in the pixel frame, and the bits of its ring (or None)."""

    x: float
    y: float
    a: float
    b: float
    angle: float = 0.0
    bits: tuple[int, ...] | None = None
    ring: tuple[float, float] = (2.0, 3.0)
    turn: float = 0.0


def code_bits(code: int, n: int) -> tuple[int, ...]:
    """Bits of a code, most significant first."""
    return tuple((code >> (n - 1 - i)) & 1 for i in range(n))


def render(
    shape,
    dots,
    *,
    white=200.0,
    black=20.0,
    psf=0.7,
    noise=0.0,
    gradient=(0.0, 0.0),
    seed=0,
    sampling=8,
):
    """Grey values (float) of white dots on black, blurred by psf, with white noise.

    Coverage of a pixel is the mean of sampling x sampling points; blurring acts
    on the fine grid, so the only approximation is the grid itself (a boundary
    error of about 1 / (4 sampling) px at single points, averaged along it).
    """
    height, width = shape
    out = np.full(shape, black, float)
    for dot in dots:
        reach = dot.a * (dot.ring[1] if dot.bits else 1.0) + 5 * psf + 3
        x0, x1 = max(0, math.floor(dot.x - reach)), min(width, math.ceil(dot.x + reach) + 1)
        y0, y1 = max(0, math.floor(dot.y - reach)), min(height, math.ceil(dot.y + reach) + 1)
        if x0 >= x1 or y0 >= y1:
            continue
        pad = math.ceil(4 * psf) + 1
        fine = (np.arange(-pad * sampling, (x1 - x0 + pad) * sampling) + 0.5) / sampling - 0.5 + x0
        fine_y = (np.arange(-pad * sampling, (y1 - y0 + pad) * sampling) + 0.5) / sampling - 0.5
        dx, dy = np.meshgrid(fine - dot.x, fine_y + y0 - dot.y)
        c, s = math.cos(dot.angle), math.sin(dot.angle)
        u, v = (c * dx + s * dy) / dot.a, (-s * dx + c * dy) / dot.b
        # Back to the circle without a turn: R diag R^T is symmetric.
        p, q = c * u - s * v, s * u + c * v
        radius = np.hypot(p, q)
        mask = radius <= 1
        if dot.bits:
            n = len(dot.bits)
            sector = np.floor((np.arctan2(q, p) - dot.turn) / (2 * math.pi) * n).astype(int) % n
            mask |= (
                (radius >= dot.ring[0]) & (radius <= dot.ring[1]) & np.array(dot.bits, bool)[sector]
            )
        blurred = (
            gaussian_filter(mask.astype(float), psf * sampling) if psf > 0 else mask.astype(float)
        )
        cover = blurred.reshape(blurred.shape[0] // sampling, sampling, -1, sampling).mean((1, 3))
        out[y0:y1, x0:x1] += (white - black) * cover[pad:-pad, pad:-pad]
    y, x = np.mgrid[:height, :width]
    out *= 1 + gradient[0] * (x - width / 2) + gradient[1] * (y - height / 2)
    if noise > 0:
        out += np.random.default_rng(seed).normal(0, noise, shape)
    return out


def quantise(grey, dtype=np.uint8):
    """Rounded and clipped to the type."""
    return np.clip(np.rint(grey), 0, np.iinfo(dtype).max).astype(dtype)


def grid_of_dots(rows, columns, pitch, *, a, aspect=0.8, seed=0):
    """Dots at random sub-pixel places of a grid, all of one shape but turned."""
    random = np.random.default_rng(seed)
    return [
        Dot(
            x=pitch * (j + 1) + random.uniform(-0.5, 0.5),
            y=pitch * (i + 1) + random.uniform(-0.5, 0.5),
            a=a,
            b=a * aspect,
            angle=random.uniform(0, math.pi),
        )
        for i in range(rows)
        for j in range(columns)
    ]
