"""The interactive view of a measurement in space: data and controls for ``space_view.js``."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from importlib import resources
from typing import Any

import numpy as np

from videogrammetry.report.html import escape
from videogrammetry.report.space import Scene, camera_pyramids, row_of_stage
from videogrammetry.types import FloatArray, Measurement, RigData

#: Lengths in the page are whole numbers of this.
UNIT_MM = 0.01

SPACE_VIEW_STYLE = """
.space-view{background:#11151c;border-radius:10px;overflow:hidden;color:#e6ebf2;margin:0 0 8px}
.space-view canvas{display:block;width:100%;height:560px;cursor:grab;touch-action:none}
.space-view canvas:active{cursor:grabbing}
.space-view .bar{display:flex;flex-wrap:wrap;gap:8px 16px;align-items:center;padding:10px 16px;
background:#1a2029;font-size:13px}
.space-view .bar input[type=range]{flex:1 1 120px}
.space-view button{font:inherit;color:inherit;background:#2a3340;border:1px solid #3a4656;
border-radius:6px;padding:3px 12px;cursor:pointer}
.space-view button:hover{background:#364253}
.space-view output{min-width:150px;font-variant-numeric:tabular-nums}
.space-view label{display:inline-flex;gap:5px;align-items:center}
.space-view noscript p{padding:12px 16px;margin:0}
@media print{.space-view .bar{display:none}}
"""


def interactive_view(
    measurement: Measurement,
    *,
    stage: int | None = None,
    scene: Scene | None = None,
    rig: RigData | None = None,
    stages_per_second: float = 25.0,
) -> str:
    """A part of a page in which the points can be turned, zoomed and played.

    Needs :data:`SPACE_VIEW_STYLE` in the page's style and, once, after all
    views, :func:`space_view_script`.

    Parameters
    ----------
    measurement : what ``measure`` found.
    stage : shown first; None: that of the largest displacement.
    scene : what is up, ground and outline; a level camera's frame where None.
    rig : its cameras can be shown.
    stages_per_second : speed of play.

    Raises
    ------
    ValueError
        If the stage was not measured.
    """
    data = view_data(measurement, stage, scene or Scene(), rig, stages_per_second)
    last = max(0, len(data["stages"]) - 1)
    boxes = [("rays", "rays", True), ("trails", "trails", False), ("ids", "numbers", True)]
    boxes += [("cameras", "cameras", False)] if data["cameras"] else []
    checks = "".join(
        f'<label><input type="checkbox" data-is="{name}"{" checked" if on else ""}/>'
        f"{escape(label)}</label>"
        for name, label, on in boxes
    )
    return (
        '<div class="space-view"><canvas tabindex="0" role="img" aria-label="Measured points in '
        'space with their displacement; arrow keys change the stage"></canvas>'
        "<noscript><p>This view needs JavaScript; the figures around it do not.</p></noscript>"
        '<div class="bar"><button type="button" data-is="play">Play</button>'
        f'<input type="range" min="0" max="{last}" value="{data["first"]}" data-is="stage" '
        f'aria-label="stage"/><output data-is="readout"></output>{checks}{view_buttons()}</div>'
        f"{embedded(data)}</div>\n"
    )


def view_buttons() -> str:
    """Buttons for the directions of view."""
    return "".join(
        f'<button type="button" data-view="{view}">{view}</button>'
        for view in ("front", "right", "top", "free")
    )


def embedded(data: Mapping[str, Any]) -> str:
    """A view's data as an element that the script reads."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False, ensure_ascii=False)
    for mark, code in (("<", "\\u003c"), (">", "\\u003e"), ("&", "\\u0026")):
        text = text.replace(mark, code)
    return f'<script type="application/json">{text}</script>'


@cache
def space_view_script() -> str:
    """The script of all interactive views of a page, as an element."""
    source = resources.files("videogrammetry.report").joinpath("space_view.js")
    return f"<script>\n{source.read_text(encoding='utf-8')}</script>\n"


def view_data(
    measurement: Measurement,
    stage: int | None,
    scene: Scene,
    rig: RigData | None,
    stages_per_second: float,
) -> dict[str, Any]:
    """What the script reads: places to the right, up and away in units of 0.01 mm.

    ``points[row]`` holds three numbers a point, None where it was not measured;
    ``centroid[row]`` the centroid's displacement; ``first`` and ``reference``
    are rows; ``largest`` is the displacement at the end of the colours;
    ``times`` are in ms.
    """
    table, motion = measurement.trajectories, measurement.motion
    axes = scene.axes()
    length = np.linalg.norm(motion.displacement_mm, axis=2)
    known = np.isfinite(length)
    largest = float(length[known].max()) if known.any() else 0.0
    if stage is not None:
        first = row_of_stage(table.stage, stage)
    else:
        first = int(np.argmax(np.where(known, length, -1.0).max(axis=1))) if known.any() else 0
    seen = table.position_mm[np.isfinite(table.position_mm[..., 0])]
    pyramids = camera_pyramids(rig, seen) if rig is not None and len(seen) else []
    ground = scene.ground_height_mm()
    return {
        "ids": table.point_id.tolist(),
        "stages": table.stage.tolist(),
        "times": [round(1e3 * float(t), 3) if np.isfinite(t) else None for t in table.time_s],
        "reference": row_of_stage(table.stage, motion.reference_stage),
        "first": first,
        "largest": max(1, round(largest / UNIT_MM)),
        "per_second": stages_per_second,
        "points": [_whole(p @ axes.T).ravel().tolist() for p in table.position_mm],
        "centroid": [
            w if None not in (w := _whole(m @ axes.T).tolist()) else None
            for m in motion.centroid_displacement_mm
        ],
        "ground": None if ground is None else round(ground / UNIT_MM),
        "outline": [_whole(np.asarray(line) @ axes.T).tolist() for line in scene.outline_mm],
        "cameras": [
            {"name": name, "corners": _whole(corners @ axes.T).tolist()}
            for name, corners in pyramids
        ],
    }


def _whole(lengths_mm: FloatArray) -> Any:
    """Whole numbers of the unit as an object array, None for NaN."""
    known = np.isfinite(lengths_mm)
    whole = np.rint(np.where(known, lengths_mm, 0.0) / UNIT_MM).astype(np.int64).astype(object)
    whole[~known] = None
    return whole
