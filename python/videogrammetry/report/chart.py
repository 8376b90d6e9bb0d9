"""Line and scatter charts as SVG text: round ticks, legend, bands of +-sigma, gaps at NaN."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from videogrammetry.report.axes import Axes, tick_labels, ticks
from videogrammetry.report.colours import GREY, GRID, INK, PALETTE, SOFT
from videogrammetry.report.html import escape
from videogrammetry.report.svg import drawing, text_width
from videogrammetry.types import FloatArray

_MOST_TIPS = 80
_MOST_CAPS = 30
_LEGEND_ROW = 18.0
_SMALLEST_BAND_PX = 0.6
_BAND_OPACITY = 0.25


@dataclass(frozen=True, kw_only=True)
class Series:
    """One line or cloud of points.

    Attributes
    ----------
    name : in the legend; "" = not there.
    x, y : (N,), NaN = gap.
    colour : of SVG; "" = the next of the palette.
    line, points : what is drawn; ``dashed`` and ``width_px`` are the line's,
        ``radius_px`` the points'.
    sigma : (N,) or None: a band of +-sigma along a line, bars at points.
    sigma_inner : (N,) or None: a second, darker and thicker bar (a part of sigma).
    tips : (N,) texts shown when the pointer rests on a point; made from the
        numbers where empty.
    """

    name: str
    x: npt.ArrayLike
    y: npt.ArrayLike
    colour: str = ""
    line: bool = True
    points: bool = False
    dashed: bool = False
    width_px: float = 1.7
    radius_px: float = 3.2
    sigma: npt.ArrayLike | None = None
    sigma_inner: npt.ArrayLike | None = None
    tips: Sequence[str] = field(default=())


@dataclass(frozen=True)
class Marker:
    """A vertical line at ``x`` with a label at its top."""

    x: float
    label: str


def chart(
    series: Sequence[Series],
    *,
    x_label: str,
    y_label: str,
    label: str = "",
    width: float = 620.0,
    height: float = 300.0,
    x_range: tuple[float, float] | None = None,
    y_range: tuple[float, float] | None = None,
    markers: Sequence[Marker] = (),
    levels: Sequence[float] = (),
    equal_aspect: bool = False,
) -> str:
    """A chart of some series over the same axes.

    Parameters
    ----------
    x_label, y_label : quantities with their units.
    label : what the chart shows, for those who do not see it.
    width, height : of the drawing; it grows and shrinks with its place.
    x_range, y_range : the values at the edges; from the data where None.
    markers : vertical lines with labels. levels : thin horizontal lines.
    equal_aspect : a unit is as long in x as in y; the range of one axis grows.
    """
    coloured = [
        (one, one.colour or PALETTE[number % len(PALETTE)]) for number, one in enumerate(series)
    ]
    legend, rows = _legend(coloured, width)
    axes, y_ticks = _axes(series, width, height, rows, x_range, y_range, levels)
    if equal_aspect:
        axes = axes.equal()
        y_ticks = ticks(*axes.y_range, _wanted(axes.height, 36))
    parts = [_frame(axes, y_ticks, x_label, y_label, width, height), legend]
    parts += [
        f'<path d="M{axes.left:.1f} {axes.y(v):.1f}h{axes.width:.1f}" stroke="{SOFT}" '
        'stroke-dasharray="2 3"/>'
        for v in levels
    ]
    inside = "".join(_series(one, colour, axes) for one, colour in coloured)
    parts.append(f'<g clip-path="url(#{axes.clip})">{inside}</g>')
    parts.append(_markers(axes, markers))
    if not any(_finite(one).any() for one in series):
        parts.append(_nothing(axes))
    return drawing(width, height, parts, label or f"{y_label} over {x_label}")


def _finite(one: Series) -> npt.NDArray[np.bool_]:
    x, y = np.asarray(one.x, dtype=float), np.asarray(one.y, dtype=float)
    return np.asarray(np.isfinite(x) & np.isfinite(y))


def _wanted(room: float, each: float) -> int:
    return max(3, int(room / each))


def _span(values: Sequence[FloatArray], margin: float) -> tuple[float, float]:
    """Smallest and largest of all finite values, with a margin."""
    kept = [v[np.isfinite(v)] for v in values]
    together = np.concatenate([v for v in kept if len(v)] or [np.array([0.0, 1.0])])
    low, high = float(together.min()), float(together.max())
    if high - low <= 1e-12 * max(abs(low), abs(high)):
        grown = max(abs(low) * 0.05, 0.5 if low == 0 else 1e-9)
        return low - grown, high + grown
    return low - margin * (high - low), high + margin * (high - low)


def _axes(
    series: Sequence[Series],
    width: float,
    height: float,
    legend_rows: int,
    x_range: tuple[float, float] | None,
    y_range: tuple[float, float] | None,
    levels: Sequence[float],
) -> tuple[Axes, FloatArray]:
    """The plot's rectangle, with room for labels that are as long as they are."""
    x_values, y_values = [], [np.asarray(levels, dtype=float)]
    for one in series:
        seen = _finite(one)
        y = np.asarray(one.y, dtype=float)[seen]
        x_values.append(np.asarray(one.x, dtype=float)[seen])
        y_values.append(y)
        if one.sigma is not None:
            sigma = np.asarray(one.sigma, dtype=float)[seen]
            y_values += [y - sigma, y + sigma]
    x_range = x_range or _span(x_values, 0.02)
    y_range = y_range or _span(y_values, 0.06)
    top = 10.0 + _LEGEND_ROW * legend_rows
    plot_height = height - top - 44
    y_ticks = ticks(*y_range, _wanted(plot_height, 36))
    left = 32 + max(text_width(t) for t in [*tick_labels(y_ticks), "0"])
    axes = Axes(
        left=left,
        top=top,
        width=width - left - 16,
        height=plot_height,
        x_range=x_range,
        y_range=y_range,
    )
    return axes, y_ticks


def _frame(
    axes: Axes, y_ticks: FloatArray, x_label: str, y_label: str, width: float, height: float
) -> str:
    """Grid, ticks and the labels of the axes."""
    bottom, right = axes.top + axes.height, axes.left + axes.width
    x_ticks = ticks(*axes.x_range, _wanted(axes.width, 74))
    parts = [
        f'<clipPath id="{axes.clip}"><rect x="{axes.left:.1f}" y="{axes.top:.1f}" '
        f'width="{axes.width:.1f}" height="{axes.height:.1f}"/></clipPath>'
    ]
    for value, text in zip(x_ticks, tick_labels(x_ticks), strict=True):
        x = float(axes.x(value))
        parts.append(
            f'<path d="M{x:.1f} {axes.top:.1f}V{bottom:.1f}" stroke="{GRID}"/>'
            f'<text x="{x:.1f}" y="{bottom + 15:.1f}" text-anchor="middle">{text}</text>'
        )
    for value, text in zip(y_ticks, tick_labels(y_ticks), strict=True):
        y = float(axes.y(value))
        line = SOFT if value == 0 else GRID
        parts.append(
            f'<path d="M{axes.left:.1f} {y:.1f}H{right:.1f}" stroke="{line}" '
            f'stroke-opacity="{0.5 if value == 0 else 1}"/>'
            f'<text x="{axes.left - 6:.1f}" y="{y + 4:.1f}" text-anchor="end">{text}</text>'
        )
    middle = axes.top + axes.height / 2
    parts.append(
        f'<rect x="{axes.left:.1f}" y="{axes.top:.1f}" width="{axes.width:.1f}" '
        f'height="{axes.height:.1f}" fill="none" stroke="{GREY}" stroke-width="0.8"/>'
        f'<text x="{axes.left + axes.width / 2:.1f}" y="{height - 6:.1f}" text-anchor="middle" '
        f'style="fill:{INK}">{escape(x_label)}</text>'
        f'<text transform="translate(13 {middle:.1f}) rotate(-90)" text-anchor="middle" '
        f'style="fill:{INK}">{escape(y_label)}</text>'
    )
    return "".join(parts)


def _legend(coloured: Sequence[tuple[Series, str]], width: float) -> tuple[str, int]:
    """Names of the series above the plot, in as many rows as they need."""
    parts, x, row = [], 34.0, 0
    for one, colour in coloured:
        if not one.name:
            continue
        room = 30 + text_width(one.name) + 14
        if x > 34 and x + room > width:
            x, row = 34.0, row + 1
        y = 12 + row * _LEGEND_ROW
        dash = ' stroke-dasharray="5 3"' if one.dashed else ""
        if one.line and one.sigma is not None:
            parts.append(
                f'<rect x="{x:.1f}" y="{y - 5:.1f}" width="22" height="10" fill="{colour}" '
                f'fill-opacity="{_BAND_OPACITY}"/>'
            )
        if one.line:
            parts.append(
                f'<path d="M{x:.1f} {y:.1f}h22" stroke="{colour}" '
                f'stroke-width="{one.width_px}"{dash}/>'
            )
        if one.points:
            parts.append(f'<circle cx="{x + 11:.1f}" cy="{y:.1f}" r="3.2" fill="{colour}"/>')
        parts.append(
            f'<text x="{x + 28:.1f}" y="{y + 4:.1f}" style="fill:{INK}">{escape(one.name)}</text>'
        )
        x += room
    return "".join(parts), row + 1 if parts else 0


def _markers(axes: Axes, markers: Sequence[Marker]) -> str:
    """Vertical lines; a label that would cover the one before it stands a row lower."""
    parts: list[str] = []
    ends: list[float] = []
    for marker in sorted(markers, key=lambda m: m.x):
        if not axes.x_range[0] <= marker.x <= axes.x_range[1]:
            continue
        x, room = float(axes.x(marker.x)), text_width(marker.label) + 8
        to_the_left = x + room > axes.left + axes.width
        start = x - room if to_the_left else x
        row = next((k for k, end in enumerate(ends) if start >= end), len(ends))
        ends[row : row + 1] = [start + room]
        at, anchor = (x - 4, "end") if to_the_left else (x + 4, "start")
        parts.append(
            f'<path d="M{x:.1f} {axes.top:.1f}v{axes.height:.1f}" stroke="{SOFT}" '
            f'stroke-dasharray="4 3"/><text x="{at:.1f}" y="{axes.top + 13 + 14 * row:.1f}" '
            f'text-anchor="{anchor}" style="fill:{INK};paint-order:stroke;stroke:#fff;'
            f'stroke-width:3px">{escape(marker.label)}</text>'
        )
    return "".join(parts)


def _series(one: Series, colour: str, axes: Axes) -> str:
    seen = _finite(one)
    x, y = axes.x(one.x), axes.y(one.y)
    sigma = _lengths(one.sigma, axes)
    parts = []
    if sigma is not None and one.line:
        parts.append(_band(x, y, sigma, seen, colour))
    if one.line:
        dash = ' stroke-dasharray="5 3"' if one.dashed else ""
        parts.append(
            f'<path d="{_path(x, y, seen)}" fill="none" stroke="{colour}" '
            f'stroke-width="{one.width_px}" stroke-linejoin="round" stroke-linecap="round"{dash}/>'
        )
    if one.points:
        few = seen.sum() <= _MOST_CAPS
        parts += _bars(x, y, sigma, seen, colour, 1.2, 3.0 if few else 0.0) if not one.line else []
        parts += _bars(x, y, _lengths(one.sigma_inner, axes), seen, colour, 4.0, 0.0)
        parts += _points(one, x, y, seen, colour)
    return "".join(parts)


def _lengths(sigma: npt.ArrayLike | None, axes: Axes) -> FloatArray | None:
    """Standard deviations in the drawing's units."""
    if sigma is None:
        return None
    low, high = axes.y_range
    return np.asarray(np.asarray(sigma, dtype=float) / (high - low) * axes.height)


def _runs(seen: npt.NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Begin and end of each part without a gap."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], seen, [False]]).astype(int)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _path(x: FloatArray, y: FloatArray, seen: npt.NDArray[np.bool_]) -> str:
    parts = []
    for begin, end in _runs(seen):
        places = [f"{x[i]:.1f} {y[i]:.1f}" for i in range(begin, end)]
        # A single place between gaps shows as a dot: the line's ends are round.
        parts.append("M" + "L".join(places) + ("h0.01" if len(places) == 1 else ""))
    return "".join(parts)


def _band(
    x: FloatArray, y: FloatArray, sigma: FloatArray, seen: npt.NDArray[np.bool_], colour: str
) -> str:
    known = seen & np.isfinite(sigma)
    if not known.any() or float(sigma[known].max()) < _SMALLEST_BAND_PX:
        return ""
    parts = []
    for begin, end in _runs(known):
        there = [f"{x[i]:.1f} {y[i] - sigma[i]:.1f}" for i in range(begin, end)]
        back = [f"{x[i]:.1f} {y[i] + sigma[i]:.1f}" for i in reversed(range(begin, end))]
        parts.append("M" + "L".join(there + back) + "Z")
    return (
        f'<path d="{"".join(parts)}" fill="{colour}" fill-opacity="{_BAND_OPACITY}" stroke="none"/>'
    )


def _bars(
    x: FloatArray,
    y: FloatArray,
    sigma: FloatArray | None,
    seen: npt.NDArray[np.bool_],
    colour: str,
    width: float,
    cap: float,
) -> list[str]:
    """Bars of +-sigma at points, with caps of that half length."""
    if sigma is None:
        return []
    ends = f"m{-cap} 0h{2 * cap}" if cap else ""
    return [
        f'<path d="M{x[i]:.1f} {y[i] - sigma[i]:.1f}v{2 * sigma[i]:.1f}{ends}'
        + (f'm{-cap} {-2 * sigma[i]:.1f}m{-cap} 0h{2 * cap}"' if cap else '"')
        + f' stroke="{colour}" stroke-width="{width}" stroke-opacity="0.6" fill="none"/>'
        for i in np.flatnonzero(seen & np.isfinite(sigma))
    ]


def _points(
    one: Series, x: FloatArray, y: FloatArray, seen: npt.NDArray[np.bool_], colour: str
) -> list[str]:
    places = np.flatnonzero(seen)
    few = len(places) <= _MOST_TIPS
    values = np.asarray(one.x, dtype=float), np.asarray(one.y, dtype=float)
    parts = []
    for i in places:
        tip = ""
        if few:
            text = one.tips[int(i)] if len(one.tips) else f"{values[0][i]:.5g}, {values[1][i]:.5g}"
            tip = f"<title>{escape(text)}</title>"
        parts.append(
            f'<circle cx="{x[i]:.1f}" cy="{y[i]:.1f}" r="{one.radius_px}" fill="{colour}">'
            f"{tip}</circle>"
        )
    return parts


def _nothing(axes: Axes) -> str:
    return (
        f'<text x="{axes.left + axes.width / 2:.1f}" y="{axes.top + axes.height / 2:.1f}" '
        'text-anchor="middle">nothing to show</text>'
    )
