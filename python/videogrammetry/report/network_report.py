"""The page of an adjusted network: counts, cameras, bars, what was rejected, provenance."""

from __future__ import annotations

import numpy as np

from videogrammetry.calibration.network_result import (
    AdjustedCamera,
    NetworkAdjustment,
)
from videogrammetry.report.html import (
    Cell,
    count,
    deviation,
    escape,
    facts,
    number,
    page,
    table,
)
from videogrammetry.report.svg import histogram

_MOST_REJECTIONS = 300


def network_report(result: NetworkAdjustment, title: str) -> str:
    """The page as text.

    Parameters
    ----------
    result : what ``adjust_network`` gave.
    title : the network's name.
    """
    body = (
        f"<header><h1>{escape(title)}</h1>"
        f'<p class="sub">Adjustment of {len(result.images)} pictures and {len(result.points)} '
        f"points, datum {escape(result.summary.datum)}</p></header>\n"
        + _warnings(result)
        + _summary(result)
        + '<section class="card"><h2 style="margin-top:0">Residuals, both coordinates</h2>'
        + histogram(result.observations.residual_px, result.observations.used)
        + "</section>\n"
        + "".join(_camera(camera) for camera in result.cameras)
        + _bars(result)
        + _images(result)
        + _points(result)
        + _rejected(result)
    )
    return page(f"{title}: adjustment", body)


def _warnings(result: NetworkAdjustment) -> str:
    if not result.warnings:
        return '<div class="card verdict"><b>No warnings.</b></div>\n'
    lines = "".join(f"<li>{escape(warning)}</li>" for warning in result.warnings)
    return f'<div class="card verdict look"><b>Look at this</b><ul>{lines}</ul></div>\n'


def _summary(result: NetworkAdjustment) -> str:
    s = result.summary
    return facts(
        {
            "observations": count(s.observations),
            "unknowns": count(s.unknowns),
            "redundancy": count(s.redundancy),
            "sigma0": f"{s.sigma0:.4f}",
            "px sigma0": f"{s.sigma0_px:.4f}",
            "px RMS residual": f"{s.rms_px:.4f}",
            "rejected": count(len(result.rejected)),
        }
    )


def _camera(camera: AdjustedCamera) -> str:
    rows = []
    for name, value in camera.values.items():
        sigma = camera.sigma[name]
        held = name not in camera.free
        significance = camera.significance.get(name)
        rows.append(
            [
                name,
                number(value, None if held else sigma),
                "held" if held else deviation(sigma),
                "" if significance is None else f"{significance:.1f}",
            ]
        )
    header = ["parameter", "value", "sigma", "times its sigma"]
    return (
        f'<section class="card"><h2 style="margin-top:0">Camera {escape(camera.name)}</h2>'
        f'<p class="note">{camera.num_images} pictures, {count(camera.num_points)} image points, '
        f"RMS {camera.rms_px:.4f} px</p>" + table(header, rows) + "</section>\n"
    )


def _bars(result: NetworkAdjustment) -> str:
    bars, names = result.scale_bars, result.points.name
    if not len(bars):
        return ""
    rows = [
        [
            f"{names[bars.point_a[i]]} - {names[bars.point_b[i]]}",
            f"{bars.length_mm[i]:.4f}",
            deviation(float(bars.sigma_mm[i])),
            f"{bars.residual_mm[i]:+.4f}",
            f"{bars.normalised[i]:+.2f}",
            "" if bars.used[i] else "rejected",
        ]
        for i in range(len(bars))
    ]
    header = ["scale bar", "length mm", "sigma mm", "stated - adjusted mm", "w", ""]
    return '<section class="card"><h2 style="margin-top:0">Scale bars</h2>' + (
        table(header, rows) + "</section>\n"
    )


def _images(result: NetworkAdjustment) -> str:
    images = result.images
    rows = [
        [
            images.name[i],
            result.cameras[images.camera[i]].name,
            str(images.points[i]),
            f"{images.rms_px[i]:.4f}",
            *(f"{x:.3f}" for x in images.centre_mm[i]),
        ]
        for i in range(len(images))
    ]
    header = ["picture", "camera", "points", "RMS px", "X mm", "Y mm", "Z mm"]
    return f"<details><summary>Pictures</summary>{table(header, rows)}</details>\n"


def _points(result: NetworkAdjustment) -> str:
    points = result.points
    sigma = points.sigma_mm
    rows = [
        [
            points.name[i],
            str(points.images[i]),
            *(number(float(x), float(s)) for x, s in zip(points.position_mm[i], sigma[i],
                                                        strict=True)),
            *(deviation(float(s)) for s in sigma[i]),
        ]
        for i in range(len(points))
    ]  # fmt: skip
    header = ["point", "pictures", "x mm", "y mm", "z mm", "sigma x", "sigma y", "sigma z"]
    return f"<details><summary>Points</summary>{table(header, rows)}</details>\n"


def _rejected(result: NetworkAdjustment) -> str:
    if not result.rejected:
        return ""
    rows: list[list[str | Cell]] = [
        [
            r.kind,
            r.image,
            r.point,
            f"{r.value:.1f}" if np.isfinite(r.value) else "-",
            Cell(r.reason, "why"),
        ]
        for r in result.rejected[:_MOST_REJECTIONS]
    ]
    header: list[str | Cell] = ["kind", "picture", "point", "value", Cell("why", "l")]
    more = len(result.rejected) - _MOST_REJECTIONS
    note = f'<p class="note">and {more} more, see summary.json</p>' if more > 0 else ""
    return (
        f'<section class="card"><h2 style="margin-top:0">Rejected</h2>{table(header, rows)}{note}'
        "</section>\n"
    )
