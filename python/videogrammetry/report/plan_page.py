"""The plan's page: what a rig will measure how well, where, and what would be better."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from videogrammetry.accuracy import PairGeometry
from videogrammetry.pipeline.plan_types import Plan, Section
from videogrammetry.report.chart import Series, chart
from videogrammetry.report.colours import colour_of
from videogrammetry.report.html import Cell, count, escape, facts, figure, page, table
from videogrammetry.report.plan_layout import layout_figure
from videogrammetry.report.section_map import MapRow, Panel, even_levels, map_rows
from videogrammetry.types import FloatArray

SOURCE_TITLES = {
    "image": "from the image noise alone",
    "calibration": "from the calibration alone",
    "together": "both together",
}
#: Groups whose cameras meet at less than this are told of a better base.
_NARROW_RAD = math.radians(50.0)
#: Above this part of the way from "falls as 1 / sqrt(n)" to "does not fall" more does not help.
_HARDLY_PART = 0.5
_MOST_PAIRS = 12
#: A source that gives more than this part of the variance is named as the cause.
_MAIN_PART = 0.6


def plan_page(plan: Plan, title: str = "", how: Mapping[str, Any] | None = None) -> str:
    """The page as text; ``how``: its provenance."""
    name = title or "Plan"
    body = (
        f"<header><h1>{escape(name)}</h1>"
        f'<p class="sub">Predicted uncertainty of {len(plan.rig.cameras)} cameras over '
        f"{escape(volume_text(plan))}</p></header>\n"
        + _verdict(plan)
        + _facts(plan)
        + '<h2>Where the cameras stand</h2><div class="card">'
        + figure("", layout_figure(plan.rig, plan.volume), "Dark: the measuring volume.")
        + "</div>\n"
        + _statistics(plan)
        + _maps(plan)
        + _positions(plan)
        + _pairs(plan)
        + _how(plan, how)
    )
    return page(f"{name}: plan", body)


def volume_text(plan: Plan) -> str:
    """The volume in words."""
    at = ", ".join(f"{v:.0f}" for v in plan.volume.centre_mm)
    if plan.volume.shape == "sphere":
        return f"a ball of {plan.volume.size_mm[0]:.0f} mm around ({at}) mm"
    size = " x ".join(f"{v:.0f}" for v in plan.volume.size_mm)
    return f"a box of {size} mm around ({at}) mm"


def verdict_text(plan: Plan) -> str:
    """One sentence: what can be expected at 95 % of the volume."""
    position, distance = (plan.statistics[q]["together"].most_mm for q in ("position", "distance"))
    text = f"A position is known to {position:.3g} mm"
    if math.isfinite(distance):
        text += f", a distance of {plan.options.length_mm:g} mm to {distance:.3g} mm"
    return f"{text} (standard deviations, 95 % of the volume)."


def advice(plan: Plan) -> list[str]:
    """What limits the accuracy, and what would be better."""
    reasons = list(plan.warnings)
    for quantity in ("position", "distance"):
        by = plan.statistics[quantity]
        total = by["together"].rms_mm ** 2
        if not total > 0:
            continue
        part = by["calibration"].rms_mm ** 2 / total
        if part > _MAIN_PART:
            reasons.append(f"the calibration makes {100 * part:.0f} % of a {quantity}'s variance")
        elif part < 1 - _MAIN_PART:
            reasons.append(
                f"the image noise makes {100 * (1 - part):.0f} % of a {quantity}'s variance: a "
                "better calibration hardly helps"
            )
    reasons += _stalled(plan)
    for pair in _widest_pairs(plan):
        if pair.angle_rad < _NARROW_RAD:
            reasons.append(
                f"{pair.cameras[0]} and {pair.cameras[1]} meet at "
                f"{math.degrees(pair.angle_rad):.0f} degrees (base {pair.base_mm:.0f} mm): at "
                f"{math.degrees(pair.better_angle_rad[0]):.0f} degrees, base "
                f"{pair.better_base_mm[0]:.0f} mm, their image noise alone gives "
                f"{pair.better_sigma_mm[0]:.3g} instead of {pair.sigma_mm:.3g} mm"
            )
    if plan.needed is not None:
        wanted = f"{plan.needed.wanted_mm:g} mm of a {plan.options.wanted_of}"
        if plan.needed.count is None:
            reasons.append(f"{wanted} cannot be reached: {plan.needed.reason}")
        else:
            reasons.append(
                f"{wanted} at 95 % of the volume needs {plan.needed.count} positions of the target "
                f"({plan.needed.sigma_mm:.3g} mm)"
            )
    return reasons


def _stalled(plan: Plan) -> list[str]:
    """A word where many more positions hardly make the calibration better."""
    known = [row for row in plan.counts if math.isfinite(row.distance_calibration_mm)]
    if len(known) < 2 or known[-1].count < 2 * known[0].count:
        return []
    gain = known[-1].distance_calibration_mm / known[0].distance_calibration_mm
    # With n times the positions noise falls to 1 / sqrt(n).
    if gain < _HARDLY_PART + (1 - _HARDLY_PART) * math.sqrt(known[0].count / known[-1].count):
        return []
    return [
        f"from {known[0].count} to {known[-1].count} positions the calibration's part of a "
        f"distance falls from {known[0].distance_calibration_mm:.3g} to "
        f"{known[-1].distance_calibration_mm:.3g} mm only: the target's own coordinates (sigma "
        f"{plan.options.target_sigma_mm:g} mm), its scale above all, remain"
    ]


def _widest_pairs(plan: Plan) -> list[PairGeometry]:
    """Of each group the two cameras that meet at the angle nearest to 90 degrees."""
    groups = plan.options.groups or (tuple(plan.rig.cameras),)
    widest = []
    for group in groups:
        mine = [p for p in plan.pairs if set(p.cameras) <= set(group)]
        if mine:
            widest.append(min(mine, key=lambda p: abs(p.angle_rad - math.pi / 2)))
    return widest


def _verdict(plan: Plan) -> str:
    reasons = advice(plan)
    unreached = plan.needed is not None and plan.needed.count is None
    style = "card verdict look" if plan.warnings or unreached else "card verdict"
    items = "".join(f"<li>{escape(reason)}</li>" for reason in reasons)
    more = f"<ul>{items}</ul>" if items else ""
    return f'<div class="{style}"><b>{escape(verdict_text(plan))}</b>{more}</div>\n'


def _facts(plan: Plan) -> str:
    angle = plan.places.convergence_rad
    known = angle[np.isfinite(angle)]
    positions = "its own" if plan.design is None else str(len(plan.design.world_from_target))
    return facts(
        {
            "cameras": str(len(plan.rig.cameras)),
            "image noise, px": f"{plan.options.sigma_px:g}",
            "target positions": positions,
            "target points": count(plan.target_points),
            "of the volume seen by two": f"{100 * plan.part_seen:.0f} %",
            "convergence, median": f"{math.degrees(float(np.median(known))):.0f}°",
        }
    )


def _statistics(plan: Plan) -> str:
    names = {
        "sigma_x": "x",
        "sigma_y": "y",
        "sigma_z": "z",
        "position": "position (x, y, z together)",
        "distance": f"distance of {plan.options.length_mm:g} mm",
    }
    header: list[str | Cell] = ["standard deviation, mm"]
    for source in SOURCE_TITLES:
        header += [f"{source}: median", "95 %", "worst"]
    rows = []
    for quantity, title in names.items():
        row = [title]
        for source in SOURCE_TITLES:
            s = plan.statistics[quantity][source]
            row += [millimetres(v) for v in (s.median_mm, s.most_mm, s.worst_mm)]
        rows.append(row)
    frame = (
        "in the frame of the calibrated volume: what an error of the calibration moves or turns "
        "as a whole is not in them"
        if plan.options.frame == "volume"
        else "in the rig's axes, the first camera's errors included"
    )
    note = (
        f"Positions are {frame}. Distances lie wholly in the volume, in seven directions; the "
        "calibration's common part is counted with its correlation. 95 %: of the volume seen by "
        "two cameras."
    )
    return (
        f'<h2>Over the volume</h2><div class="card">{table(header, rows)}'
        f'<p class="note">{escape(note)}</p></div>\n'
    )


def millimetres(value: float) -> str:
    """Three digits, or a dash.

    Examples
    --------
    >>> millimetres(0.01234), millimetres(12.34), millimetres(math.nan)
    ('0.0123', '12.3', '-')
    """
    return f"{value:.3g}" if math.isfinite(value) else "-"


def _maps(plan: Plan) -> str:
    total = [
        _row(
            plan, f"Position, {title}", [s.places.position_sigma_mm(source) for s in plan.sections]
        )
        for source, title in SOURCE_TITLES.items()
    ]
    parts = [_component_rows(plan, source) for source in SOURCE_TITLES]
    note = "Sections through the volume's middle; every row has its own scale."
    card = '<div class="card">'
    hidden = "".join(
        f"<details><summary>x, y and z {SOURCE_TITLES[source]}</summary>"
        + map_rows(rows, f"sigma x, y, z {SOURCE_TITLES[source]}")
        + "</details>"
        for source, rows in zip(SOURCE_TITLES, parts, strict=True)
        if source != "together"
    )
    return (
        f"<h2>Where it is how sure</h2>{card}"
        + figure("", map_rows(total, "uncertainty of the position"), note)
        + f"</div>\n<h2>Coordinates</h2>{card}"
        + figure("", map_rows(parts[2], "uncertainty of x, y, z together"), note)
        + hidden
        + f"</div>\n<h2>Cameras and angles</h2>{card}"
        + figure("", map_rows(_sight_rows(plan), "cameras and convergence"))
        + "</div>\n"
    )


def _component_rows(plan: Plan, source: str) -> list[MapRow]:
    return [
        _row(
            plan,
            f"{axis}, {SOURCE_TITLES[source]}",
            [s.places.sigma_mm(source)[:, k] for s in plan.sections],
        )
        for k, axis in enumerate("xyz")
    ]


def _sight_rows(plan: Plan) -> list[MapRow]:
    cameras = [s.places.cameras.astype(float) for s in plan.sections]
    most = int(max(c.max() for c in cameras))
    angles = [np.degrees(s.places.convergence_rad) for s in plan.sections]
    levels: FloatArray = np.arange(most + 2, dtype=np.float64) - 0.5
    colours = ["#f3d6d2", "#f0e3c4", *(colour_of(k / max(1, most - 1)) for k in range(1, most))]
    return [
        _row(plan, "Cameras that see a place together", cameras, levels, "cameras", colours),
        _row(plan, "Largest angle between two rays", angles, unit="degrees"),
    ]


def _row(
    plan: Plan,
    title: str,
    values: list[FloatArray],
    levels: FloatArray | None = None,
    unit: str = "mm",
    colours: list[str] | None = None,
) -> MapRow:
    panels = [_panel(plan, s, v) for s, v in zip(plan.sections, values, strict=True)]
    inside = [p.values[p.inside] for p in panels]
    return MapRow(
        title=title,
        panels=panels,
        levels=even_levels(inside) if levels is None else levels,
        unit=unit,
        whole=levels is not None,
        colours=(colours or [])[: None if levels is None else len(levels) - 1],
    )


def _panel(plan: Plan, section: Section, values: FloatArray) -> Panel:
    across, up, held = ("xyz"[k] for k in section.axes)
    at = plan.volume.centre_mm[section.axes[2]]
    return Panel(
        title=f"{across}{up} at {held} = {at:.0f} mm",
        values=values.reshape(section.inside.shape),
        inside=section.inside,
        across=(float(section.across_mm[0]), float(section.across_mm[-1])),
        up=(float(section.up_mm[0]), float(section.up_mm[-1])),
        across_label=f"{across} mm",
        up_label=f"{up} mm",
    )


def _positions(plan: Plan) -> str:
    """How the number of the target's positions tells."""
    rows = [[str(row.count), *map(millimetres, row.columns_mm())] for row in plan.counts]
    length = f"distance of {plan.options.length_mm:g} mm"
    header = ["positions", f"{length}: calibration", "together", "near middle"]
    header += ["position: calibration", "together"]
    x = [row.count for row in plan.counts]
    image = plan.statistics
    series = [
        Series(name="distance", x=x, y=[r.distance_mm for r in plan.counts], points=True),
        Series(name="position", x=x, y=[r.position_mm for r in plan.counts], points=True),
        *(
            Series(
                name=f"{q}, image noise alone",
                x=[min(x), max(x)],
                y=[image[q]["image"].most_mm] * 2,
                dashed=True,
                colour=colour,
            )
            for q, colour in (("distance", "#1f6fb2"), ("position", "#d1661a"))
        ),
    ]
    levels = [] if plan.needed is None else [plan.needed.wanted_mm]
    drawn = chart(
        series,
        x_label="positions of the target",
        y_label="standard deviation, mm",
        levels=levels,
        y_range=(0.0, 1.08 * _largest(series, levels)),
        label="accuracy over the number of positions",
        height=250,
        width=900,
    )
    note = (
        "mm at 95 % of the volume. Near middle: the distance, calibration alone, if the target is "
        "kept near the volume's middle, whole in the pictures and hardly tilted."
    ) + ("" if plan.needed is None else f" Dotted: the wanted {plan.needed.wanted_mm:g} mm.")
    return (
        '<h2>How many positions of the target</h2><div class="card">'
        + f"{table(header, rows)}<p class='note'>{escape(note)}</p>{_tried(plan)}{drawn}</div>\n"
    )


def _largest(series: list[Series], levels: list[float]) -> float:
    values = np.concatenate([np.asarray(s.y, dtype=float) for s in series] + [np.array(levels)])
    known = values[np.isfinite(values)]
    return float(known.max()) if len(known) else 1.0


def _tried(plan: Plan) -> str:
    if plan.needed is None:
        return ""
    tried = ", ".join(f"{n}: {millimetres(s)}" for n, s in plan.needed.tried.items())
    found = (
        f"{plan.needed.count} positions reach {plan.needed.wanted_mm:g} mm"
        if plan.needed.count is not None
        else f"{plan.needed.wanted_mm:g} mm are not reached: {plan.needed.reason}"
    )
    text = f"{found}. Tried: {tried} mm." if tried else f"{found}."
    return f'<p class="note">{escape(text)}</p>'


def _pairs(plan: Plan) -> str:
    """Angles of the pairs, and the bases that would be better."""
    if not plan.pairs:
        return ""
    better = plan.pairs[0].better_angle_rad
    header = ["cameras", "distance mm", "base mm", "angle °", "position, image noise mm"]
    for angle in better:
        header += [f"base for {math.degrees(angle):.0f}° mm", "position mm"]
    rows = []
    for pair in plan.pairs:
        row = [
            " + ".join(pair.cameras),
            f"{pair.distance_mm:.0f}",
            f"{pair.base_mm:.0f}",
            f"{math.degrees(pair.angle_rad):.1f}",
            millimetres(pair.sigma_mm),
        ]
        for base, sigma in zip(pair.better_base_mm, pair.better_sigma_mm, strict=True):
            row += [f"{base:.0f}", millimetres(sigma)]
        rows.append(row)
    note = (
        "In the volume's middle, two cameras alone, at the distances at which they stand. A "
        "position is surest at 90°; flat targets are seen well by both up to some 60 to 90°."
    )
    return (
        f'<h2>Angles and bases</h2><div class="card">'
        f"<details{' open' if len(rows) <= _MOST_PAIRS else ''}><summary>{len(rows)} pairs of "
        f"cameras</summary>{table(header, rows)}</details>"
        f'<p class="note">{escape(note)}</p></div>\n'
    )


def _spread_text(plan: Plan) -> str:
    """Where the target goes, in words."""
    part = plan.options.target_part
    where = "the volume" if part == 1 else f"{100 * part:.0f} % of the volume's extent"
    whole = ", whole in the pictures" if plan.options.target_whole else ""
    return f"{where}, tilted up to {math.degrees(plan.options.target_tilt_rad):.0f}°{whole}"


def _how(plan: Plan, how: Mapping[str, Any] | None) -> str:
    rows = [
        [
            name,
            *(f"{v:.0f}" for v in camera.centre_mm),
            f"{camera.image_size_px[0]} x {camera.image_size_px[1]}",
            f"{camera.interior[0]:.1f}",
            f"{camera.sigma['f']:.3g}" if camera.sigma.get("f") else "-",
            "-" if plan.design is None else str(int((plan.design.points_seen[:, k] > 0).sum())),
        ]
        for k, (name, camera) in enumerate(plan.rig.cameras.items())
    ]
    header = ["camera", "X mm", "Y mm", "Z mm", "picture px", "f px", "s.d. of f px", "pictures"]
    free = ", ".join(plan.options.free or ()) or "none"
    text = (
        "The calibration's covariance is the rig's own."
        if plan.design is None
        else f"Simulated calibration: {len(plan.design.world_from_target)} positions spread evenly "
        f"over {_spread_text(plan)}; estimated: {free}; target coordinates known to "
        f"{plan.options.target_sigma_mm:g} mm. Its covariance follows from the design alone."
    )
    details = json.dumps(dict(how or {}), indent=1, ensure_ascii=False, default=str)
    return (
        f'<h2>How it was made</h2><div class="card"><p>{escape(text)}</p>{table(header, rows)}'
        f"<details><summary>Options and inputs</summary><pre>{escape(details)}</pre></details>"
        "</div>\n"
    )
