"""The page of an adjusted network: what it holds, what to doubt, what to do better."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from videogrammetry.calibration.advice import advise
from videogrammetry.calibration.network_result import AdjustedCamera, NetworkAdjustment
from videogrammetry.calibration.quality import CameraQuality, NetworkQuality
from videogrammetry.calibration.quality_of import quality_of_network
from videogrammetry.report.camera_part import CAMERA_STYLE, CameraPart, Parameter, camera_card
from videogrammetry.report.cutouts import CUTOUT_STYLE, MOST_CUTOUTS, Cutout, cutouts
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
from videogrammetry.report.quality_part import (
    QUALITY_STYLE,
    advice_card,
    angles_table,
    bars_table,
    components_table,
    reliability_table,
)
from videogrammetry.report.space_view import SPACE_VIEW_STYLE, space_view_script
from videogrammetry.report.station_view import (
    STATION_STYLE,
    Stations,
    scene_towards,
    station_view,
)
from videogrammetry.types import INTERIOR_NAMES, RigCamera, RigData

#: A picture by its name: grey values (height, width), or None where there is none.
Pictures = Callable[[str], npt.NDArray[Any] | None] | Mapping[str, npt.NDArray[Any]]

_MOST_REJECTIONS = 300
_MOST_ROWS = 1500
_MOST_PYRAMIDS = 400


def network_report(result: NetworkAdjustment, title: str, pictures: Pictures | None = None) -> str:
    """The page as text.

    Parameters
    ----------
    result : what ``adjust_network`` gave.
    title : the network's name.
    pictures : the pictures by name, for cut-outs around the worst observations.
    """
    quality = quality_of_network(result)
    cameras = zip(result.cameras, quality.cameras, strict=True)
    body = (
        f"<header><h1>{escape(title)}</h1>"
        f'<p class="sub">Adjustment of {len(result.images)} pictures and {len(result.points)} '
        f"points, datum {escape(result.summary.datum)}</p></header>\n"
        + _warnings(result)
        + _summary(result)
        + advice_card(advise(quality))
        + "<h2>Cameras</h2>\n"
        + "".join(_camera(result, c, q, i) for i, (c, q) in enumerate(cameras))
        + f'<h2>Stations and points</h2><div class="card">{_space(result, quality)}'
        + f"{angles_table(quality)}</div>\n"
        + f'<h2>Reliability and weights</h2><div class="card">{reliability_table(quality)}'
        + f"{components_table(quality.components)}</div>\n"
        + bars_table(result.scale_bars, result.points.name)
        + _rejected(result, pictures)
        + _images(result)
        + _points(result)
        + space_view_script()
    )
    style = SPACE_VIEW_STYLE + STATION_STYLE + CAMERA_STYLE + QUALITY_STYLE + CUTOUT_STYLE
    return page(f"{title}: adjustment", body, style)


def _warnings(result: NetworkAdjustment) -> str:
    if not result.warnings:
        return '<div class="card verdict"><b>No warnings.</b></div>\n'
    lines = "".join(f"<li>{escape(warning)}</li>" for warning in result.warnings)
    return f'<div class="card verdict look"><b>Look at this</b><ul>{lines}</ul></div>\n'


def _summary(result: NetworkAdjustment) -> str:
    s = result.summary
    return facts(
        {
            "px RMS residual": f"{s.rms_px:.4f}",
            "sigma0": f"{s.sigma0:.4f}",
            "px sigma0": f"{s.sigma0_px:.4f}",
            "observations": count(s.observations),
            "unknowns": count(s.unknowns),
            "redundancy": count(s.redundancy),
            "rejected": count(sum(r.kind != "parameter" for r in result.rejected)),
        }
    )


def _camera(
    result: NetworkAdjustment, camera: AdjustedCamera, quality: CameraQuality, index: int
) -> str:
    seen = result.observations
    mine = np.flatnonzero(result.images.camera[seen.image] == index)
    labels = [
        f"{result.images.name[i]}, point {result.points.name[p]}"
        for i, p in zip(seen.image[mine], seen.point[mine], strict=True)
    ]
    dropped = {d.name: d for d in camera.dropped}
    parameters = []
    for name, value in camera.values.items():
        free = name in camera.free
        why = "estimated" if free else "held at its start value"
        if not free and name in dropped:
            d = dropped[name]
            why = (
                f"left out: the pictures do not determine it (std. dev. {d.sigma:.3g})"
                if d.undetermined
                else f"left out: {d.value:.3g} is {abs(d.value) / d.sigma if d.sigma else 0:.1f} "
                "times its standard deviation"
            )
        parameters.append(
            Parameter(
                name=name, value=value, sigma=camera.sigma[name] if free else None,
                significance=camera.significance.get(name), why=why,
            )
        )  # fmt: skip
    return camera_card(
        CameraPart(
            quality=quality, rms_px=camera.rms_px, xy_px=seen.xy_px[mine],
            residual_px=seen.residual_px[mine], used=seen.used[mine], labels=labels,
            interior=(camera.values["x0"], camera.values["y0"]), r0_px=camera.r0_px,
            parameters=parameters, cameras=len(result.cameras),
            remark="" if camera.measured else ", distortion of the ideal point",
        )
    )  # fmt: skip


def _space(result: NetworkAdjustment, quality: NetworkQuality) -> str:
    images, points = result.images, result.points
    rows = np.flatnonzero(images.points > 0)
    if len(rows) > _MOST_PYRAMIDS:
        rows = rows[np.linspace(0, len(rows) - 1, _MOST_PYRAMIDS).round().astype(int)]
    rig = RigData(
        cameras={
            images.name[i]: RigCamera(
                image_size_px=result.cameras[images.camera[i]].image_size_px,
                interior=np.array(
                    [result.cameras[images.camera[i]].values[n] for n in INTERIOR_NAMES]
                ),
                r0_px=result.cameras[images.camera[i]].r0_px,
                rotation=images.rotation[i],
                translation_mm=images.translation_mm[i],
            )
            for i in rows
        }
    )
    if not len(rows) or not len(points):
        return ""
    first, middle = images.centre_mm[rows[0]], points.position_mm.mean(axis=0)
    a, b = result.scale_bars.point_a, result.scale_bars.point_b
    return station_view(
        Stations(
            rig=rig,
            scene=scene_towards(quality.up, first, middle),
            position_mm=points.position_mm,
            name=points.name,
            value=points.images.astype(np.int64),
            legend="pictures that see a point",
            unit="pictures",
            lines_mm=[points.position_mm[[i, j]] for i, j in zip(a, b, strict=True)],
        )
    )


def _rejected(result: NetworkAdjustment, pictures: Pictures | None) -> str:
    """What was given and not used, with pieces of the pictures where there are any."""
    items = [r for r in result.rejected if r.kind != "parameter"]
    if not items:
        return '<h2>Rejected</h2><div class="card">Nothing was rejected.</div>\n'
    rows: list[list[str | Cell]] = [
        [
            r.kind.replace("-", " "),
            Cell(r.image, "l"),
            Cell(r.point, "l"),
            f"{r.value:.1f}" if np.isfinite(r.value) else "-",
            Cell(r.test, "l"),
            Cell(r.reason, "why"),
        ]
        for r in items[:_MOST_REJECTIONS]
    ]
    header: list[str | Cell] = [
        "what", Cell("picture", "l"), Cell("point", "l"), "value", Cell("test", "l"),
        Cell("why", "l"),
    ]  # fmt: skip
    more = len(items) - _MOST_REJECTIONS
    note = f'<p class="note">and {count(more)} more</p>' if more > 0 else ""
    return (
        f'<h2>Rejected</h2><div class="card">{_cutouts(result, pictures)}'
        f"<details{' open' if len(items) <= 40 else ''}><summary>{count(len(items))} rejected"
        f"</summary>{table(header, rows)}{note}</details></div>\n"
    )


def _cutouts(result: NetworkAdjustment, pictures: Pictures | None) -> str:
    if pictures is None:
        return ""
    of = pictures.get if isinstance(pictures, Mapping) else pictures
    seen = result.observations
    w = np.nan_to_num(np.abs(seen.normalised).max(axis=1, initial=0.0), nan=np.inf, posinf=np.inf)
    out = np.flatnonzero(~seen.used)
    items = []
    for i in out[np.argsort(-w[out], kind="stable")][:MOST_CUTOUTS]:
        image, point = result.images.name[seen.image[i]], result.points.name[seen.point[i]]
        picture = of(image)
        if picture is None:
            continue
        x, y = map(float, seen.xy_px[i])
        dx, dy = map(float, seen.residual_px[i])
        items.append(
            Cutout(
                picture=picture, measured_px=(x, y), expected_px=(x - dx, y - dy),
                title=f"point {point}", text=f"{image}: {np.hypot(dx, dy):.2f} px, w {w[i]:.1f}",
            )
        )  # fmt: skip
    return cutouts(items)


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
        for i in range(min(len(images), _MOST_ROWS))
    ]
    header = ["picture", "camera", "points", "RMS px", "X mm", "Y mm", "Z mm"]
    return _folded("Pictures", header, rows, len(images), "images.csv")


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
        for i in range(min(len(points), _MOST_ROWS))
    ]  # fmt: skip
    header = ["point", "pictures", "x mm", "y mm", "z mm", "sigma x", "sigma y", "sigma z"]
    return _folded("Points", header, rows, len(points), "points.csv")


def _folded(name: str, header: list[str], rows: list[list[str]], total: int, file: str) -> str:
    """A table to be opened; of very many rows the first."""
    more = total - len(rows)
    note = f'<p class="note">and {count(more)} more, see {file}</p>' if more > 0 else ""
    return (
        f'<h2>{name}</h2><div class="card"><details><summary>{count(total)} {name.lower()}'
        f"</summary>{table(header, rows)}{note}</details></div>\n"
    )
