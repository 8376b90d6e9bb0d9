"""What pages of a calibration and an adjustment share: advice, angles, reliability, groups."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from videogrammetry.calibration.advice import BAR_CRITICAL, Advice
from videogrammetry.calibration.network_result import AdjustedBars
from videogrammetry.calibration.quality import (
    WEAK_REDUNDANCY,
    CameraQuality,
    NetworkQuality,
    VarianceComponent,
)
from videogrammetry.report.html import Cell, count, deviation, escape, table

_MOST_PICTURES, _MOST_BARS = 400, 60

QUALITY_STYLE = """
.advice ul{margin:0;padding:0;list-style:none}
.advice li{display:grid;grid-template-columns:104px 1fr;gap:12px;margin:5px 0}
.advice .topic{font-weight:600;color:var(--amber)}
.advice.none{border-left:6px solid var(--green)}
@media print{main{zoom:.68;max-width:none;padding:0}*{print-color-adjust:exact}
tr{break-inside:avoid}}
"""


def advice_card(advice: tuple[Advice, ...]) -> str:
    """What to do better next time, a line for each number that asks for it."""
    head = "<h2>What to do better next time</h2>"
    if not advice:
        return (
            f'{head}<div class="card advice none">Nothing to improve: coverage, angles, depths, '
            "redundancy and correlations are all as they should be.</div>\n"
        )
    lines = "".join(
        f'<li><span class="topic">{escape(one.topic)}</span><span>{escape(one.text)}</span></li>'
        for one in advice
    )
    return f'{head}<div class="card advice"><ul>{lines}</ul></div>\n'


def angles_table(quality: NetworkQuality) -> str:
    """Depth, tilt and roll of every camera and, to be opened, of every picture."""
    rows = [_camera_row(camera) for camera in quality.cameras]
    tilt = "largest tilt °" if quality.target else "largest angle of views °"
    header = ["camera", "pictures", "depth mm", "farthest / nearest", tilt, "rolls within °"]
    parts = [table(header, rows)]
    every = [(camera.name, camera.pictures) for camera in quality.cameras]
    total = sum(len(pictures) for _, pictures in every)
    lines: list[list[str | Cell]] = []
    for name, pictures in every:
        for i in range(len(pictures)):
            near, mean, far = pictures.depth_mm[i]
            lines.append(
                [
                    pictures.name[i],
                    Cell(name, "l"),
                    str(pictures.points[i]),
                    f"{mean:.0f}",
                    f"{near:.0f} to {far:.0f}",
                    *([_degrees(pictures.tilt_rad[i])] if quality.target else []),
                    _degrees(pictures.roll_rad[i], "+"),
                ]
            )
    heads: list[str | Cell] = [
        "picture",
        Cell("camera", "l"),
        "points",
        "mean depth mm",
        "from, to",
    ]
    heads += ["tilt °"] if quality.target else []
    heads.append("roll °")
    more = (
        f'<p class="note">and {total - _MOST_PICTURES} more</p>' if total > _MOST_PICTURES else ""
    )
    note = (
        "Depth: along the camera's axis. Tilt: of the target's plane against the picture. Roll: "
        "of the target about the camera's axis."
        if quality.target
        else "Depth: along the camera's axis. Roll: about it, against what most pictures take for "
        "up; 90 = upright picture."
    )
    parts.append(
        f'<p class="note">{note}</p><details><summary>{total} pictures</summary>'
        f"{table(heads, lines[:_MOST_PICTURES])}{more}</details>"
    )
    return "".join(parts)


def _camera_row(camera: CameraQuality) -> list[str | Cell]:
    near, far = camera.depth_mm
    known = near > 0
    return [
        camera.name,
        str(len(camera.pictures)),
        f"{near:.0f} to {far:.0f}" if known else "-",
        f"{far / near:.2f}" if known else "-",
        _degrees(camera.tilt_rad),
        _degrees(camera.roll_span_rad),
    ]


def _degrees(angle_rad: float, sign: str = "") -> str:
    return format(math.degrees(angle_rad), f"{sign}.0f") if math.isfinite(angle_rad) else "-"


def reliability_table(quality: NetworkQuality) -> str:
    """Redundancy numbers and detectable errors of the cameras."""
    rows: list[list[str | Cell]] = []
    named = [(camera.name, camera.reliability) for camera in quality.cameras]
    if len(named) > 1:
        named.append(("all", quality.reliability))
    for name, r in named:
        rows.append(
            [
                name,
                count(r.coordinates),
                f"{r.mean:.3f}",
                Cell(str(r.weak), "bad" if r.weak else ""),
                f"{r.median_detectable_px:.3g}",
                f"{r.largest_detectable_px:.3g}" if math.isfinite(r.largest_detectable_px)
                else Cell("not controlled", "bad"),
            ]
        )  # fmt: skip
    header = ["camera", "coordinates", "mean redundancy", f"below {WEAK_REDUNDANCY:g}"]
    header += ["detectable px, median", "largest"]
    note = (
        '<p class="note">Redundancy: the part of an error that shows in its own residual. '
        "Detectable: the smallest error that the test finds with 80 % power.</p>"
    )
    return table(header, rows) + note + _rays(quality)


def _rays(quality: NetworkQuality) -> str:
    rays = quality.rays[quality.rays > 0]
    if not len(rays):
        return ""
    two = int((rays <= 2).sum())
    return (
        f'<p class="note">Pictures a point: {rays.min()} to {rays.max()}, mean {rays.mean():.1f}; '
        f"{two} of {len(rays)} points in only two.</p>"
    )


def components_table(components: tuple[VarianceComponent, ...]) -> str:
    """Variance factors of the groups of observations."""
    rows = [
        [
            one.group,
            f"{one.factor:.3f}" if np.isfinite(one.factor) else "-",
            f"{math.sqrt(one.factor):.3f}" if one.factor >= 0 else "-",
            f"{one.redundancy:.1f}",
        ]
        for one in components
    ]
    header = ["group", "variance component", "residuals / stated", "redundancy"]
    note = (
        '<p class="note">1: the residuals are as large as the standard deviations say. Of little '
        "redundancy it is mostly chance.</p>"
    )
    return table(header, rows) + note


def bars_table(bars: AdjustedBars | None, names: Sequence[str]) -> str:
    """Known lengths: stated and adjusted, the worst first where there are very many.

    ``names``: of the points that ``bars`` counts; "" where there is no bar.
    """
    if bars is None or not len(bars):
        return ""
    order, w = np.arange(len(bars)), bars.normalised
    if len(bars) > _MOST_BARS:
        order = np.argsort(-np.nan_to_num(np.abs(w), nan=np.inf))[:_MOST_BARS]
    rows: list[list[str | Cell]] = [
        [
            f"{names[bars.point_a[i]]} - {names[bars.point_b[i]]}",
            f"{bars.length_mm[i]:.4f}",
            deviation(float(bars.sigma_mm[i])),
            f"{bars.length_mm[i] - bars.residual_mm[i]:.4f}",
            f"{bars.residual_mm[i]:+.4f}",
            Cell(
                f"{bars.normalised[i]:+.2f}",
                "bad" if abs(bars.normalised[i]) > BAR_CRITICAL else "",
            ),
            f"{bars.redundancy[i]:.2f}",
            Cell("used" if bars.used[i] else "rejected", "l" if bars.used[i] else "l bad"),
            Cell(bars.certificate[i], "l"),
        ]
        for i in order.tolist()
    ]
    header: list[str | Cell] = ["scale bar", "stated mm", "sigma mm", "adjusted mm"]
    header += ["residual mm", "w", "redundancy", Cell("", "l"), Cell("certificate", "l")]
    more = f" The worst {len(order)} of {len(bars)} are listed." if len(order) < len(bars) else ""
    return (
        f'<h2>Scale bars</h2><div class="card">{table(header, rows)}<p class="note">Residual: '
        f"stated - adjusted; w: in its own standard deviations.{more}</p></div>\n"
    )
