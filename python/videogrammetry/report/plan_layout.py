"""Where the cameras of a plan stand and what they see, from above and from the side."""

from __future__ import annotations

import math

import numpy as np

from videogrammetry.geometry import MeasuringVolume, rays_through_pixels
from videogrammetry.report.axes import Axes, tick_labels, ticks
from videogrammetry.report.colours import GREY, GRID, INK, PALETTE
from videogrammetry.report.html import escape
from videogrammetry.report.svg import drawing, text_width
from videogrammetry.types import RigCamera, RigData

_WIDTH, _HEIGHT, _LEFT, _BOTTOM, _GAP = 1080.0, 400.0, 66.0, 42.0, 34.0
_BEYOND = 1.12


def layout_figure(rig: RigData, volume: MeasuringVolume) -> str:
    """Two views along axes of the rig's frame, in equal units, cameras with their fields."""
    centres = np.stack([camera.centre_mm for camera in rig.cameras.values()])
    everything = np.concatenate(
        [centres, [volume.centre_mm - volume.size_mm / 2, volume.centre_mm + volume.size_mm / 2]]
    )
    low, high = everything.min(axis=0), everything.max(axis=0)
    # The two views that show most: the axis along which least happens is looked along first.
    order = np.argsort(high - low)
    views = [tuple(sorted({0, 1, 2} - {int(k)})) for k in order[:2]]
    room = (_WIDTH - 2 * _LEFT - _GAP) / 2
    parts = []
    for n, (a, b) in enumerate(views):
        left = _LEFT + n * (room + _LEFT + _GAP)
        margin = 0.08 * float((high - low).max())
        axes = Axes(
            left=left,
            top=14,
            width=room,
            height=_HEIGHT - 14 - _BOTTOM,
            x_range=(low[a] - margin, high[a] + margin),
            y_range=(low[b] - margin, high[b] + margin),
        ).equal()
        parts.append(_view(axes, rig, volume, a, b, n))
    return drawing(_WIDTH, _HEIGHT, parts, "where the cameras stand")


def _view(axes: Axes, rig: RigData, volume: MeasuringVolume, a: int, b: int, number: int) -> str:
    clip = f"layout-{number}"
    bottom = axes.top + axes.height
    parts = [
        f'<clipPath id="{clip}"><rect x="{axes.left:.1f}" y="{axes.top:.1f}" '
        f'width="{axes.width:.1f}" height="{axes.height:.1f}"/></clipPath>'
    ]
    x_ticks = ticks(*axes.x_range, 6)
    for value, text in zip(x_ticks, tick_labels(x_ticks), strict=True):
        at = float(axes.x(value))
        parts.append(
            f'<path d="M{at:.1f} {axes.top:.1f}V{bottom:.1f}" stroke="{GRID}"/><text x="{at:.1f}" '
            f'y="{bottom + 15:.1f}" text-anchor="middle">{text}</text>'
        )
    y_ticks = ticks(*axes.y_range, 6)
    for value, text in zip(y_ticks, tick_labels(y_ticks), strict=True):
        at = float(axes.y(value))
        parts.append(
            f'<path d="M{axes.left:.1f} {at:.1f}h{axes.width:.1f}" stroke="{GRID}"/>'
            f'<text x="{axes.left - 6:.1f}" y="{at + 4:.1f}" text-anchor="end">{text}</text>'
        )
    inside = [_field(axes, camera, volume, a, b, PALETTE[k % len(PALETTE)])
              for k, camera in enumerate(rig.cameras.values())]  # fmt: skip
    inside.append(_outline(axes, volume, a, b))
    parts.append(f'<g clip-path="url(#{clip})">{"".join(inside)}</g>')
    taken: list[tuple[float, float]] = []
    for k, (name, camera) in enumerate(rig.cameras.items()):
        parts.append(_camera(axes, name, camera, a, b, PALETTE[k % len(PALETTE)], taken))
    letters = "XYZ"
    parts.append(
        f'<rect x="{axes.left:.1f}" y="{axes.top:.1f}" width="{axes.width:.1f}" '
        f'height="{axes.height:.1f}" fill="none" stroke="{GREY}" stroke-width="0.8"/>'
        f'<text x="{axes.left + axes.width / 2:.1f}" y="{bottom + 32:.1f}" text-anchor="middle" '
        f'style="fill:{INK}">{letters[a]} mm</text><text transform="translate('
        f'{axes.left - 54:.1f} {axes.top + axes.height / 2:.1f}) rotate(-90)" '
        f'text-anchor="middle" style="fill:{INK}">{letters[b]} mm</text>'
    )
    return "".join(parts)


def _outline(axes: Axes, volume: MeasuringVolume, a: int, b: int) -> str:
    x, y = (float(axes.x(volume.centre_mm[a])), float(axes.y(volume.centre_mm[b])))
    unit = axes.width / (axes.x_range[1] - axes.x_range[0])
    w, h = volume.size_mm[a] * unit, volume.size_mm[b] * unit
    paint = f'fill="{INK}" fill-opacity="0.10" stroke="{INK}" stroke-width="1.4"'
    if volume.shape == "sphere":
        return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{w / 2:.1f}" {paint}/>'
    return (
        f'<rect x="{x - w / 2:.1f}" y="{y - h / 2:.1f}" width="{w:.1f}" height="{h:.1f}" {paint}/>'
    )


def _field(
    axes: Axes, camera: RigCamera, volume: MeasuringVolume, a: int, b: int, colour: str
) -> str:
    """What the camera sees, to a little beyond the volume: between its outermost corner rays."""
    w, h = (n - 1.0 for n in camera.image_size_px)
    corners = np.array([[0, 0], [w, 0], [w, h], [0, h]])
    rays = rays_through_pixels(camera, corners) @ camera.rotation
    depth = float(camera.rotation[2] @ (volume.centre_mm - camera.centre_mm))
    reach = _BEYOND * (depth + 0.5 * float(volume.size_mm.max()))
    if not np.isfinite(rays).all() or reach <= 0:
        return ""
    ends = camera.centre_mm + reach * rays
    main = camera.rotation[2][[a, b]]
    flat = rays[:, [a, b]]
    across = main[0] * flat[:, 1] - main[1] * flat[:, 0]
    angle = np.arctan2(across, flat @ main)
    chosen = [int(np.argmin(angle)), int(np.argmax(angle))]
    places = [camera.centre_mm, *(ends[k] for k in chosen)]
    text = " ".join(f"{float(axes.x(p[a])):.1f},{float(axes.y(p[b])):.1f}" for p in places)
    return (
        f'<polygon points="{text}" fill="{colour}" fill-opacity="0.09" stroke="{colour}" '
        'stroke-opacity="0.45" stroke-width="0.8"/>'
    )


def _camera(
    axes: Axes,
    name: str,
    camera: RigCamera,
    a: int,
    b: int,
    colour: str,
    taken: list[tuple[float, float]],
) -> str:
    """A triangle that points where the camera looks, and its name beside it."""
    x, y = float(axes.x(camera.centre_mm[a])), float(axes.y(camera.centre_mm[b]))
    dx, dy = float(camera.rotation[2][a]), -float(camera.rotation[2][b])
    length = math.hypot(dx, dy) or 1.0
    turn = math.degrees(math.atan2(dy / length, dx / length))
    room = text_width(name) + 14
    at = x - room if x + room > axes.left + axes.width else x + 12
    row = y - 8
    while any(abs(row - r) < 13 and abs(at - c) < room for c, r in taken):
        row += 13
    taken.append((at, row))
    return (
        f'<path transform="translate({x:.1f} {y:.1f}) rotate({turn:.1f})" d="M9 0L-6 -6L-6 6Z" '
        f'fill="{colour}" stroke="#fff" stroke-width="1"/><text x="{at:.1f}" y="{row:.1f}" '
        f'style="fill:{INK};paint-order:stroke;stroke:#fff;stroke-width:3px">{escape(name)}</text>'
    )
