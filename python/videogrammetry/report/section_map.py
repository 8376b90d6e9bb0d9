"""Maps of a quantity over sections of a volume: panels in rows, each row with its scale."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from PIL import Image

from videogrammetry.report.axes import Axes, tick_labels, ticks
from videogrammetry.report.colours import GREY, INK, SOFT, colour_of
from videogrammetry.report.html import escape
from videogrammetry.report.svg import drawing, text_width
from videogrammetry.types import FloatArray

#: Of places for which there is no value.
UNSEEN = "#e4e8ee"
_WIDTH = 1080.0
_GAP, _LEFT, _BOTTOM, _HEAD, _ROW_TITLE = 26.0, 62.0, 38.0, 22.0, 24.0
_LEGEND = 104.0
_TALLEST, _SHORTEST = 320.0, 120.0


@dataclass(frozen=True, kw_only=True)
class Panel:
    """One map.

    Attributes
    ----------
    values : (H, W), NaN = not known. inside : (H, W) what belongs to the volume.
    across, up : values at the middles of the first and last cell.
    """

    title: str
    values: FloatArray
    inside: npt.NDArray[np.bool_]
    across: tuple[float, float]
    up: tuple[float, float]
    across_label: str
    up_label: str


@dataclass(frozen=True, kw_only=True)
class MapRow:
    """Panels that share a scale; ``levels`` (K + 1,) the edges of its K bands."""

    title: str
    panels: Sequence[Panel]
    levels: FloatArray
    unit: str
    whole: bool = False
    colours: Sequence[str] = ()

    def band_colours(self) -> list[str]:
        """A colour for each band."""
        count = len(self.levels) - 1
        return list(self.colours) or [colour_of(k / max(1, count - 1)) for k in range(count)]


def even_levels(values: Sequence[FloatArray], wanted: int = 8) -> FloatArray:
    """Round edges of bands from the smallest value to the 98th percentile.

    Examples
    --------
    >>> even_levels([np.array([0.11, 0.19, np.nan])], 4).tolist()
    [0.1, 0.12, 0.14, 0.16, 0.18, 0.2]
    >>> even_levels([np.array([0.2, 0.2])]).tolist()
    [0.198, 0.2, 0.202]
    """
    known = np.concatenate([v[np.isfinite(v)] for v in values] or [np.zeros(0)])
    if not len(known):
        return np.array([0.0, 1.0])
    low, high = float(known.min()), float(np.percentile(known, 98))
    if high - low <= 1e-3 * abs(high):
        return np.array([0.99, 1.0, 1.01]) * high if high else np.array([0.0, 1.0])
    inner = ticks(low, high, wanted)
    step = inner[1] - inner[0]
    first = inner[0] - step if low < inner[0] - 1e-9 * step else inner[0]
    last = inner[-1] + step if high > inner[-1] + 1e-9 * step else inner[-1]
    count = round((last - first) / step)
    return np.array([float(f"{first + k * step:.12g}") for k in range(count + 1)])


def map_rows(rows: Sequence[MapRow], label: str) -> str:
    """All rows in one drawing, panels of a column as wide as their part of the volume asks."""
    columns = len(rows[0].panels)
    sizes = _sizes(rows[0].panels)
    height = max(max(tall for _, tall in sizes), _SHORTEST)
    parts: list[str] = []
    top = 0.0
    for row in rows:
        parts.append(
            f'<text x="0" y="{top + 15:.1f}" style="font-size:13px;font-weight:600;fill:{INK}">'
            f"{escape(row.title)}</text>"
        )
        y = top + _ROW_TITLE + _HEAD
        x = 0.0
        for k in range(columns):
            x += _LEFT
            parts.append(_panel(row.panels[k], row, x, y, *sizes[k]))
            x += sizes[k][0] + _GAP
        parts.append(_legend(row, x + 6, y, height))
        top = y + height + _BOTTOM + 8
    return drawing(_WIDTH, top, parts, label)


def _sizes(panels: Sequence[Panel]) -> list[tuple[float, float]]:
    """Width and height of the panels, a millimetre as long in each of them."""
    extents = [
        tuple(
            (high - low) * n / (n - 1)
            for (low, high), n in zip((p.across, p.up), p.values.shape[::-1], strict=True)
        )
        for p in panels
    ]
    room = _WIDTH - _LEGEND - len(panels) * (_LEFT + _GAP)
    scale = min(room / sum(w for w, _ in extents), _TALLEST / max(h for _, h in extents))
    return [(w * scale, h * scale) for w, h in extents]


def _panel(panel: Panel, row: MapRow, x: float, y: float, width: float, height: float) -> str:
    cells = panel.values.shape
    half = [
        0.5 * (high - low) / (n - 1)
        for (low, high), n in ((panel.across, cells[1]), (panel.up, cells[0]))
    ]
    axes = Axes(
        left=x,
        top=y,
        width=width,
        height=height,
        x_range=(panel.across[0] - half[0], panel.across[1] + half[0]),
        y_range=(panel.up[0] - half[1], panel.up[1] + half[1]),
    )
    parts = [
        f'<text x="{x + width / 2:.1f}" y="{y - 7:.1f}" text-anchor="middle" '
        f'style="fill:{INK}">{escape(panel.title)}</text>',
        f'<image x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}" '
        f'preserveAspectRatio="none" href="data:image/png;base64,{_png(panel, row)}"/>',
        f'<rect x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}" fill="none" '
        f'stroke="{GREY}" stroke-width="0.8"/>',
    ]
    across = ticks(*axes.x_range, max(2, int(width / 62)))
    for value, text in zip(across, tick_labels(across), strict=True):
        at = float(axes.x(value))
        parts.append(
            f'<path d="M{at:.1f} {y + height:.1f}v4" stroke="{GREY}"/><text x="{at:.1f}" '
            f'y="{y + height + 15:.1f}" text-anchor="middle">{text}</text>'
        )
    up = ticks(*axes.y_range, max(2, int(height / 48)))
    for value, text in zip(up, tick_labels(up), strict=True):
        at = float(axes.y(value))
        parts.append(
            f'<path d="M{x - 4:.1f} {at:.1f}h4" stroke="{GREY}"/><text x="{x - 7:.1f}" '
            f'y="{at + 4:.1f}" text-anchor="end">{text}</text>'
        )
    parts.append(
        f'<text x="{x + width / 2:.1f}" y="{y + height + 30:.1f}" text-anchor="middle">'
        f"{escape(panel.across_label)}</text>"
        f'<text transform="translate({x - 48:.1f} {y + height / 2:.1f}) rotate(-90)" '
        f'text-anchor="middle">{escape(panel.up_label)}</text>'
    )
    return "".join(parts)


def _png(panel: Panel, row: MapRow) -> str:
    """The panel's cells as a picture with a palette, one pixel a cell, the top row first."""
    colours = [UNSEEN, *row.band_colours()]
    known = np.isfinite(panel.values)
    band = np.searchsorted(row.levels, np.where(known, panel.values, row.levels[0]), side="right")
    index = np.where(known, np.clip(band, 1, len(colours) - 1), 0)
    index = np.where(panel.inside, index, len(colours)).astype(np.uint8)
    picture = Image.fromarray(np.ascontiguousarray(index[::-1]), mode="P")
    rgb = [int(c[k : k + 2], 16) for c in [*colours, "#ffffff"] for k in (1, 3, 5)]
    picture.putpalette(rgb)
    data = io.BytesIO()
    picture.save(data, format="PNG", optimize=True)
    return base64.b64encode(data.getvalue()).decode()


def _legend(row: MapRow, x: float, y: float, height: float) -> str:
    """The bands from below, with the values of their edges (or, of whole numbers, their own)."""
    colours = row.band_colours()
    each = min(26.0, (height - 34) / len(colours))
    low = y + each * len(colours) + 10
    parts = [f'<text x="{x:.1f}" y="{y + 2:.1f}" style="fill:{INK}">{escape(row.unit)}</text>']
    names = tick_labels(row.levels)
    for k, colour in enumerate(colours):
        parts.append(
            f'<rect x="{x:.1f}" y="{low - (k + 1) * each:.1f}" width="16" '
            f'height="{each + 0.4:.1f}" fill="{colour}"/>'
        )
    texts = (
        [(low - (k + 0.5) * each, f"{round(row.levels[k] + 0.5)}") for k in range(len(colours))]
        if row.whole
        else [(low - k * each, name) for k, name in enumerate(names)]
    )
    spare = max(1, round(12 / each)) if not row.whole else 1
    parts += [
        f'<text x="{x + 21:.1f}" y="{at + 4:.1f}">{text}</text>' for at, text in texts[::spare]
    ]
    note = "not seen by two"
    if any(((~np.isfinite(p.values)) & p.inside).any() for p in row.panels) and not row.whole:
        parts.append(
            f'<rect x="{x:.1f}" y="{low + 10:.1f}" width="16" height="12" fill="{UNSEEN}"/>'
            f'<text x="{x + 21:.1f}" y="{low + 20:.1f}" '
            f'textLength="{min(78.0, text_width(note)):.0f}" style="fill:{SOFT}">{note}</text>'
        )
    return "".join(parts)
