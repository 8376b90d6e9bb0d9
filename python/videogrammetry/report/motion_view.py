"""The measured points in space, with a colour ray a point for its displacement.

The paper's Fig. 15 as one SVG: every point at its place, a ray from where it
was at the reference stage, coloured by the length of the way; the cameras as
small pyramids. Numbers come from the measurement; here they are only drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from videogrammetry.report.colours import colour_of
from videogrammetry.report.space import camera_pyramids, row_of_stage
from videogrammetry.types import FloatArray, Measurement, RigData

_WIDTH, _HEIGHT, _MARGIN = 960, 620, 56


class _Canvas:
    """Orthographic view of the rig's frame: x right, y down, z away, turned and tilted."""

    def __init__(self, points: FloatArray, turn_rad: float, tilt_rad: float) -> None:
        ct, st, ce, se = np.cos(turn_rad), np.sin(turn_rad), np.cos(tilt_rad), np.sin(tilt_rad)
        turn = np.array([[ct, 0, st], [0, 1, 0], [-st, 0, ct]])
        tilt = np.array([[1, 0, 0], [0, ce, -se], [0, se, ce]])
        self._view = tilt @ turn
        flat = points @ self._view.T
        low, high = flat[:, :2].min(axis=0), flat[:, :2].max(axis=0)
        room = np.array([_WIDTH - 2 * _MARGIN, _HEIGHT - 2 * _MARGIN - 40])
        self.scale = float((room / np.maximum(high - low, 1e-9)).min())
        self._shift = np.array([_WIDTH, _HEIGHT + 20]) / 2 - self.scale * (low + high) / 2

    def __call__(self, points: FloatArray) -> FloatArray:
        """x, y in the drawing and depth (larger = farther)."""
        flat: FloatArray = np.atleast_2d(points) @ self._view.T
        flat[:, :2] = self.scale * flat[:, :2] + self._shift
        return flat


def motion_view_svg(
    measurement: Measurement,
    stage: int | None = None,
    rig: RigData | None = None,
    *,
    title: str = "",
    turn_deg: float = -32.0,
    tilt_deg: float = 18.0,
) -> str:
    """An SVG of one stage's points and their displacement since the reference stage.

    Parameters
    ----------
    measurement : what ``measure`` found.
    stage : None: the stage of the largest mean displacement.
    rig : draws the cameras too.
    title : heading.
    turn_deg, tilt_deg : the direction of view, about the vertical and up.

    Raises
    ------
    ValueError
        If the stage was not measured.
    """
    table, motion = measurement.trajectories, measurement.motion
    length = np.linalg.norm(motion.displacement_mm, axis=2)
    row = _row_of(measurement, length, stage)
    here, way = table.position_mm[row], length[row]
    shown = np.flatnonzero(np.isfinite(way))
    start = here[shown] - motion.displacement_mm[row, shown]
    corners = camera_pyramids(rig, here[np.isfinite(here[:, 0])]) if rig is not None else []
    cloud = [here[np.isfinite(here[:, 0])], start, *(c for _, c in corners)]
    canvas = _Canvas(np.concatenate(cloud), np.deg2rad(turn_deg), np.deg2rad(tilt_deg))
    low, high = (float(way[shown].min()), float(way[shown].max())) if len(shown) else (0.0, 1.0)
    body = [
        *_cameras(corners, canvas),
        *_rays(start, here[shown], way[shown], low, high, canvas),
        *_unmoved(here[np.isfinite(here[:, 0]) & ~np.isfinite(way)], canvas),
        *_legend(low, high),
        *_heading(measurement, int(table.stage[row]), len(shown), title),
        *_scale_bar(canvas),
    ]
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {_HEIGHT}" '
        f'width="{_WIDTH}" height="{_HEIGHT}" font-family="system-ui, sans-serif" '
        f'font-size="13"><rect width="100%" height="100%" fill="#11151c"/>{"".join(body)}</svg>\n'
    )


def _row_of(measurement: Measurement, length: FloatArray, stage: int | None) -> int:
    stages = measurement.trajectories.stage
    if stage is None:
        counted = np.isfinite(length)
        mean = np.where(counted, length, 0).sum(axis=1) / np.maximum(counted.sum(axis=1), 1)
        return int(np.argmax(mean))
    return row_of_stage(stages, stage)


def _cameras(pyramids: Sequence[tuple[str, FloatArray]], canvas: _Canvas) -> list[str]:
    parts = []
    for name, corners in pyramids:
        xy = canvas(corners)
        ring = " ".join(f"{x:.1f},{y:.1f}" for x, y in xy[1:, :2])
        edges = "".join(
            f'<line x1="{xy[0, 0]:.1f}" y1="{xy[0, 1]:.1f}" x2="{x:.1f}" y2="{y:.1f}"/>'
            for x, y in xy[1:, :2]
        )
        parts.append(
            f'<g stroke="#7d8aa0" stroke-width="1.2" fill="none"><polygon points="{ring}" '
            f'fill="#7d8aa0" fill-opacity="0.15"/>{edges}</g>'
            f'<text x="{xy[0, 0]:.1f}" y="{xy[:, 1].max() + 18:.1f}" fill="#aab4c4" '
            f'text-anchor="middle">{escape(name)}</text>'
        )
    return parts


def _rays(
    start: FloatArray, end: FloatArray, way: FloatArray, low: float, high: float, canvas: _Canvas
) -> list[str]:
    if not len(start):
        return []
    a, b = canvas(start), canvas(end)
    parts = []
    for k in np.argsort(-b[:, 2]):  # the farthest first
        colour = colour_of((way[k] - low) / max(high - low, 1e-12))
        parts.append(
            f'<line x1="{a[k, 0]:.1f}" y1="{a[k, 1]:.1f}" x2="{b[k, 0]:.1f}" y2="{b[k, 1]:.1f}" '
            f'stroke="{colour}" stroke-width="1.1" stroke-opacity="0.75"/>'
            f'<circle cx="{a[k, 0]:.1f}" cy="{a[k, 1]:.1f}" r="1.3" fill="#5b6678"/>'
            f'<circle cx="{b[k, 0]:.1f}" cy="{b[k, 1]:.1f}" r="3" fill="{colour}"/>'
        )
    return parts


def _unmoved(points: FloatArray, canvas: _Canvas) -> list[str]:
    if not len(points):
        return []
    return [
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="2.4" fill="none" stroke="#aab4c4"/>'
        for x, y in canvas(points)[:, :2]
    ]


def _legend(low: float, high: float) -> list[str]:
    left, top, width = _WIDTH - 300, 26, 220
    steps = "".join(
        f'<rect x="{left + i * width / 44:.2f}" y="{top}" width="{width / 44 + 0.5:.2f}" '
        f'height="10" fill="{colour_of(i / 43)}"/>'
        for i in range(44)
    )
    return [
        steps,
        f'<text x="{left}" y="{top + 26}" fill="#d7dde6">{low:.1f}</text>',
        f'<text x="{left + width}" y="{top + 26}" fill="#d7dde6" text-anchor="end">'
        f"{high:.1f} mm</text>",
        f'<text x="{left - 10}" y="{top + 9}" fill="#aab4c4" text-anchor="end">displacement</text>',
    ]


def _heading(measurement: Measurement, stage: int, shown: int, title: str) -> list[str]:
    reference = measurement.motion.reference_stage
    line = f"stage {stage} against stage {reference}: {shown} points seen in both"
    return [
        f'<text x="28" y="38" fill="#f2f5f9" font-size="19" font-weight="600">{escape(title)}'
        "</text>",
        f'<text x="28" y="60" fill="#aab4c4">{line}</text>',
    ]


def _scale_bar(canvas: _Canvas) -> list[str]:
    """A length of 1, 2 or 5 times a power of ten, about a sixth of the width."""
    wanted = _WIDTH / 6 / canvas.scale
    power = 10 ** np.floor(np.log10(wanted))
    length = power * max(k for k in (1, 2, 5) if k * power <= wanted)
    right = 28 + length * canvas.scale
    y = _HEIGHT - 26
    return [
        f'<path d="M28 {y - 5}V{y}H{right:.1f}V{y - 5}" stroke="#d7dde6" fill="none"/>',
        f'<text x="{right + 8:.1f}" y="{y + 2}" fill="#d7dde6">{length:g} mm</text>',
    ]
