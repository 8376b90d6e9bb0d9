"""Displacements in space from the front and from the right: the paper's Fig. 15."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from videogrammetry.report.colours import NIGHT, NIGHT_INK, NIGHT_SOFT, colour_of
from videogrammetry.report.html import escape
from videogrammetry.report.labels import Labels
from videogrammetry.report.space import Scene, row_of_stage
from videogrammetry.report.svg import drawing, round_down
from videogrammetry.types import FloatArray, Measurement

VIEWS = ("front", "right")
_MARGIN, _HEAD, _FOOT, _GAP = 30.0, 44.0, 38.0, 8.0
_BAR = 44.0


@dataclass(frozen=True)
class _Box:
    """Values at the edges of a view, in mm: to the right and upwards."""

    left: float
    bottom: float
    right: float
    top: float

    @property
    def size(self) -> tuple[float, float]:
        return self.right - self.left, self.top - self.bottom


@dataclass(frozen=True)
class _Panel:
    """A view's place in the drawing."""

    box: _Box
    left: float
    top: float
    scale: float
    axes: FloatArray

    @property
    def width(self) -> float:
        return self.box.size[0] * self.scale + 2 * _MARGIN

    @property
    def height(self) -> float:
        return self.box.size[1] * self.scale + _HEAD + _FOOT

    def height_at(self, up_mm: float) -> float:
        return self.top + _HEAD + (self.box.top - up_mm) * self.scale

    def __call__(self, points: FloatArray) -> FloatArray:
        """x, y in the drawing and depth (larger = farther)."""
        flat: FloatArray = np.atleast_2d(points) @ self.axes.T
        x = self.left + _MARGIN + (flat[:, 0] - self.box.left) * self.scale
        return np.stack([x, self.height_at(0.0) - flat[:, 1] * self.scale, flat[:, 2]], axis=1)


def displacement_view(
    measurement: Measurement,
    stage: int,
    *,
    view: str = "front",
    scene: Scene | None = None,
    largest_mm: float | None = None,
    width: float = 520.0,
    height: float = 620.0,
) -> str:
    """The points of one stage from one side, a colour ray each for its displacement.

    Parameters
    ----------
    measurement : what ``measure`` found; displacements are against its reference stage.
    stage : number.
    view : "front" (from camera 1's side) or "right".
    scene : what is up, ground, outline; a level camera's frame where None.
    largest_mm : the displacement at the end of the colours; None = the stage's own.
    width, height : at most, of the drawing.

    Raises
    ------
    ValueError
        If the stage was not measured or there is no such view.
    """
    return displacement_figure(
        measurement,
        (stage,),
        views=(view,),
        scene=scene,
        largest_mm=largest_mm,
        width=width,
        height=height,
    )


def displacement_figure(
    measurement: Measurement,
    stages: Sequence[int],
    *,
    views: Sequence[str] = VIEWS,
    scene: Scene | None = None,
    largest_mm: float | None = None,
    width: float = 1130.0,
    height: float = 620.0,
) -> str:
    """Some stages side by side, from the front and from the right, on one scale.

    Parameters as in :func:`displacement_view`; the colours end at the largest
    displacement of all ``stages``.

    Raises
    ------
    ValueError
        If a stage was not measured or there is no such view.
    """
    scene = scene or Scene()
    table, motion = measurement.trajectories, measurement.motion
    rows = [row_of_stage(table.stage, stage) for stage in stages]
    length = np.linalg.norm(motion.displacement_mm[rows], axis=2)
    largest = largest_mm or (float(np.nanmax(length)) if np.isfinite(length).any() else 1.0) or 1.0
    boxes = {view: _extent(measurement, rows, scene, view) for view in views}
    free = width - len(rows) * len(views) * 2 * _MARGIN
    free -= (len(rows) * len(views) - 1) * _GAP
    across = len(rows) * sum(box.size[0] for box in boxes.values())
    tall = max(box.size[1] for box in boxes.values())
    scale = min(free / across, (height - _HEAD - _FOOT - _BAR) / tall)
    narrowest = min(box.size[0] for box in boxes.values()) + 2 * _MARGIN / scale
    bar_mm = round_down(narrowest / 2.6)
    parts, left = [], 0.0
    panel = None
    for row in rows:
        for view in views:
            panel = _Panel(boxes[view], left, 0.0, scale, scene.side_axes(view))
            parts += _panel(measurement, row, panel, scene, view, largest, bar_mm)
            left += panel.width + _GAP
    bottom = panel.height if panel else 0.0
    parts += _colour_bar(0.0, bottom + 12, largest, motion.reference_stage)
    named = ", ".join(str(s) for s in stages)
    return drawing(
        max(left - _GAP, 340.0),
        bottom + _BAR,
        parts,
        f"Displacement of the points at stages {named}, {' and '.join(views)} view",
        enlarge=False,
    )


def _extent(measurement: Measurement, rows: list[int], scene: Scene, view: str) -> _Box:
    """What a view must hold at all of the rows."""
    table, motion = measurement.trajectories, measurement.motion
    reference = row_of_stage(table.stage, motion.reference_stage)
    held = [table.position_mm[[*rows, reference]].reshape(-1, 3)]
    for row in [*rows, reference]:
        held += scene.outline_at(_centroid_way(measurement, row))
    axes = scene.side_axes(view)
    flat = np.concatenate(held) @ axes.T
    flat = flat[np.isfinite(flat[:, 0])]
    if not len(flat):
        flat = np.zeros((1, 3))
    low, high = flat[:, :2].min(axis=0), flat[:, :2].max(axis=0)
    ground = scene.ground_height_mm()
    if ground is not None:
        low[1] = min(low[1], ground)
    grown = np.maximum(0.0, 60.0 * 1e-3 * max(high - low) - (high - low)) / 2 + 1e-6
    return _Box(*map(float, (*(low - grown), *(high + grown))))


def _centroid_way(measurement: Measurement, row: int) -> FloatArray:
    """The centroid's displacement, else the points' mean; zero where none is known."""
    moved = measurement.motion.centroid_displacement_mm[row]
    if np.isfinite(moved).all():
        return np.asarray(moved)
    ways = measurement.motion.displacement_mm[row]
    known = np.isfinite(ways[:, 0])
    return np.asarray(ways[known].mean(axis=0)) if known.any() else np.zeros(3)


def _panel(
    measurement: Measurement,
    row: int,
    panel: _Panel,
    scene: Scene,
    view: str,
    largest: float,
    bar_mm: float,
) -> list[str]:
    table = measurement.trajectories
    stage, time = int(table.stage[row]), float(table.time_s[row])
    when = f", {time * 1e3:.0f} ms" if np.isfinite(time) else ""
    x = panel.left + 12
    parts = [
        f'<rect x="{panel.left:.1f}" y="{panel.top:.1f}" width="{panel.width:.1f}" '
        f'height="{panel.height:.1f}" rx="8" fill="{NIGHT}"/>',
        _text(x, panel.top + 20, f"stage {stage}", NIGHT_INK, "font-weight:600;font-size:13px"),
        _text(x, panel.top + 35, f"{view}{when}", NIGHT_SOFT),
        *_ground(panel, scene),
        *_outline(panel, scene.outline_at(_centroid_way(measurement, row))),
        *_rays(measurement, row, panel, largest),
        *_scale_bar(panel, bar_mm),
    ]
    return parts


def _text(x: float, y: float, text: str, colour: str, style: str = "", anchor: str = "") -> str:
    turned = f' text-anchor="{anchor}"' if anchor else ""
    return (
        f'<text x="{x:.1f}" y="{y:.1f}"{turned} style="fill:{colour};{style}">{escape(text)}</text>'
    )


def _ground(panel: _Panel, scene: Scene) -> list[str]:
    height = scene.ground_height_mm()
    if height is None:
        return []
    y, left, right = panel.height_at(height), panel.left + 6, panel.left + panel.width - 6
    hatch = "".join(f"M{x:.1f} {y:.1f}l-5 6" for x in np.arange(left + 8, right, 9.0))
    return [
        f'<path d="M{left:.1f} {y:.1f}H{right:.1f}" stroke="{NIGHT_SOFT}" stroke-width="1.4"/>'
        f'<path d="{hatch}" stroke="{NIGHT_SOFT}" stroke-width="0.8" stroke-opacity="0.6"/>'
    ]


def _outline(panel: _Panel, lines: list[FloatArray]) -> list[str]:
    parts = []
    for line in lines:
        places = "L".join(f"{x:.1f} {y:.1f}" for x, y in panel(line)[:, :2])
        parts.append(
            f'<path d="M{places}" fill="#fff" fill-opacity="0.025" stroke="#75839a" '
            'stroke-width="1" stroke-dasharray="4 3"/>'
        )
    return parts


def _rays(measurement: Measurement, row: int, panel: _Panel, largest: float) -> list[str]:
    """Rays, dots and numbers; the farthest first, points without displacement hollow."""
    table = measurement.trajectories
    here, way = table.position_mm[row], measurement.motion.displacement_mm[row]
    seen = np.flatnonzero(np.isfinite(here[:, 0]))
    if not len(seen):
        return [
            _text(panel.left + 12, panel.top + panel.height / 2, "no point measured", NIGHT_SOFT)
        ]
    xy, from_xy = panel(here[seen]), panel(here[seen] - way[seen])
    length = np.linalg.norm(way[seen], axis=1)
    labels = Labels(
        (panel.left, panel.top + _HEAD, panel.left + panel.width, panel.top + panel.height), 10.0
    )
    for x, y, _ in xy:
        labels.take(x, y, 3.0)
    rays, dots, names = [], [], []
    for k in np.argsort(-xy[:, 2]):
        x, y = xy[k, :2]
        point = int(table.point_id[seen[k]])
        if np.isfinite(length[k]):
            colour = colour_of(length[k] / largest)
            x0, y0 = from_xy[k, :2]
            rays.append(
                f'<path d="M{x0:.1f} {y0:.1f}L{x:.1f} {y:.1f}" stroke="{colour}" '
                f'stroke-width="1.4" stroke-opacity="0.85"/><circle cx="{x0:.1f}" cy="{y0:.1f}" '
                'r="1.3" fill="#6b788d"/>'
            )
            fill, tip = f'fill="{colour}"', f"point {point}: {length[k]:.2f} mm"
        else:
            fill, tip = 'fill="none"', f"point {point}: not seen at the reference stage"
        dots.append(
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" {fill} stroke="#dfe6ee" '
            f'stroke-width="0.7"><title>{tip}</title></circle>'
        )
        halo = f"fill:{NIGHT_INK};paint-order:stroke;stroke:{NIGHT};stroke-width:2.5px"
        names.append(labels.place(str(point), x, y, 3.0, halo))
    return rays + dots + names


def _scale_bar(panel: _Panel, length_mm: float) -> list[str]:
    x, y = panel.left + 12, panel.top + panel.height - 10
    end = x + length_mm * panel.scale
    return [
        f'<path d="M{x:.1f} {y - 4:.1f}v4H{end:.1f}v-4" stroke="{NIGHT_INK}" fill="none"/>',
        _text(end + 5, y + 1, f"{length_mm:g} mm", NIGHT_SOFT),
    ]


def _colour_bar(left: float, top: float, largest: float, reference: int) -> list[str]:
    width, steps = 260.0, 52
    bar = "".join(
        f'<rect x="{left + i * width / steps:.2f}" y="{top:.1f}" '
        f'width="{width / steps + 0.4:.2f}" height="10" fill="{colour_of(i / (steps - 1))}"/>'
        for i in range(steps)
    )
    ink: dict[str, Any] = {"colour": "#1c2430"}
    places = 0 if largest >= 100 else 2 if largest >= 1 else 4
    return [
        f'<g shape-rendering="crispEdges">{bar}</g>',
        _text(left, top + 24, "0", **ink),
        _text(left + width / 2, top + 24, f"{largest / 2:.{places}f}", anchor="middle", **ink),
        _text(left + width, top + 24, f"{largest:.{places}f}", anchor="end", **ink),
        _text(left + width + 12, top + 9, f"displacement since stage {reference}, mm", **ink),
    ]
