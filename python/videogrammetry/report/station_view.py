"""Where cameras stood and points lie: a view to be turned, and two to be printed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from videogrammetry.report.chart import Series, chart
from videogrammetry.report.colours import GREY, INK, PALETTE
from videogrammetry.report.html import figure
from videogrammetry.report.space import Scene, camera_pyramids
from videogrammetry.report.space_view import UNIT_MM, embedded, view_buttons
from videogrammetry.types import FloatArray, RigData

#: Points in the view that turns, and in each that is printed.
_MOST_POINTS, _MOST_PRINTED = 5000, 700

STATION_STYLE = """
.two{display:grid;grid-template-columns:repeat(2,minmax(0,1fr));gap:8px 26px;align-items:start}
@media (max-width:820px){.two{grid-template-columns:1fr}}
@media print{.space-view,.space-view+.note{display:none}
.two{grid-template-columns:repeat(2,minmax(0,1fr))}}
"""


@dataclass(frozen=True, kw_only=True)
class Stations:
    """What stands where.

    Attributes
    ----------
    rig : the cameras, or a camera a picture. scene : what is up and away.
    position_mm : (N, 3) points; name : theirs; value : (N,) what colours them.
    legend : of the colours; unit : of the value beside a point's name, "" = without it.
    lines_mm : lines (K, 3) that show how a target lay.
    """

    rig: RigData
    scene: Scene
    position_mm: FloatArray
    name: Sequence[str]
    value: npt.NDArray[np.int64]
    legend: str
    unit: str = ""
    lines_mm: Sequence[FloatArray] = field(default=())


def scene_towards(up: FloatArray, from_mm: FloatArray, to_mm: FloatArray) -> Scene:
    """A scene looked at from a camera; from any side where that would be from above."""
    away = np.asarray(to_mm - from_mm, dtype=float)
    across = away - (away @ up) * up
    if np.linalg.norm(across) < 0.1 * max(float(np.linalg.norm(away)), 1e-9):
        across = np.cross(up, np.eye(3)[int(np.argmin(np.abs(up)))])
    return Scene(up=tuple(map(float, up)), away=tuple(map(float, across)))


def station_view(stations: Stations) -> str:
    """The part of a page; needs the style of ``space_view`` and its script once, after all."""
    keep = np.flatnonzero(np.isfinite(stations.position_mm).all(axis=1))
    if len(keep) > _MOST_POINTS:
        keep = keep[np.linspace(0, len(keep) - 1, _MOST_POINTS).round().astype(int)]
    axes = stations.scene.axes()
    shown = stations.position_mm[keep] @ axes.T
    pyramids = camera_pyramids(stations.rig, stations.position_mm[keep])

    def whole(lengths_mm: FloatArray) -> list[object]:
        return list(np.rint(lengths_mm / UNIT_MM).astype(np.int64).tolist())

    data = {
        "ids": [stations.name[i] for i in keep.tolist()],
        "stages": [0],
        "times": [None],
        "reference": 0,
        "first": 0,
        "largest": max(1, int(stations.value.max(initial=1))),
        "per_second": 1,
        "points": [whole(shown.ravel())],
        "values": [int(stations.value[i]) for i in keep],
        "radius": 4 if len(keep) <= 300 else 2.2,
        "legend": stations.legend,
        "unit": stations.unit,
        "centroid": [[0, 0, 0]],
        "ground": None,
        "outline": [whole(np.asarray(line) @ axes.T) for line in stations.lines_mm],
        "cameras": [{"name": n, "corners": whole(c @ axes.T)} for n, c in pyramids],
    }
    thinned = (
        f" {len(keep)} of {len(stations.position_mm)} points are shown."
        if len(keep) < len(stations.position_mm)
        else ""
    )
    note = f'<p class="note">Drag to turn, wheel to zoom, shift and drag to move.{thinned}</p>'
    return (
        '<div class="space-view"><canvas tabindex="0" role="img" aria-label="Cameras and points '
        'in space"></canvas><noscript><p>This view needs JavaScript; the figures below do not.'
        '</p></noscript><div class="bar"><label><input type="checkbox" data-is="cameras" checked '
        f'/>cameras</label><label><input type="checkbox" data-is="ids"/>names</label>'
        f"{view_buttons()}</div>{embedded(data)}</div>\n{note}{_flat_views(stations)}"
    )


def _flat_views(stations: Stations) -> str:
    """The same from the front and from above, with millimetres."""
    axes = stations.scene.axes()
    points = stations.position_mm
    if len(points) > _MOST_PRINTED:
        rows = np.linspace(0, len(points) - 1, _MOST_PRINTED).round().astype(int)
        points = points[rows]
    points = points @ axes.T
    names = list(stations.rig.cameras)
    centres = np.array([stations.rig.cameras[n].centre_mm for n in names]) @ axes.T
    lines = [np.asarray(line) @ axes.T for line in stations.lines_mm]
    views = []
    for title, across, up, label in (
        ("From the front", 0, 1, "height, mm"),
        ("From above", 0, 2, "away from the first camera, mm"),
    ):
        joined = [np.vstack([line, np.full((1, 3), np.nan)]) for line in lines]
        series = [
            Series(name="", x=all_[:, across], y=all_[:, up], colour=GREY, width_px=0.7)
            for all_ in ([np.concatenate(joined)] if joined else [])
        ]
        series.append(
            Series(name="points", x=points[:, across], y=points[:, up], line=False, points=True,
                   radius_px=1.6, colour=PALETTE[0])
        )  # fmt: skip
        series.append(
            Series(name="cameras", x=centres[:, across], y=centres[:, up], line=False, points=True,
                   radius_px=4.0, colour=PALETTE[1] if names else INK, tips=names)
        )  # fmt: skip
        drawn = chart(
            series, x_label="to the right, mm", y_label=label, label=title, width=520.0,
            height=380.0, equal_aspect=True,
        )  # fmt: skip
        views.append(figure(title, drawn))
    return f'<div class="two">{"".join(views)}</div>'
