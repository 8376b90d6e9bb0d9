"""Drawings of residuals as SVG text: vectors over the picture, histogram, coverage."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from videogrammetry.report.html import escape
from videogrammetry.types import FloatArray

BLUE, RED, LINE, SOFT, EMPTY = "#1f6fb2", "#c8352b", "#c9d1db", "#5b6675", "#fbe9e7"
_WIDTH = 620.0
_MOST_VECTORS = 4000
#: Length of a typical vector (95th percentile) as a part of the drawing's width.
_VECTOR_PART = 0.04


def round_down(value: float) -> float:
    """The largest 1, 2 or 5 times a power of ten that is not above ``value``.

    Examples
    --------
    >>> round_down(0.34), round_down(0.021), round_down(7.0)
    (0.2, 0.02, 5.0)
    """
    if not (math.isfinite(value) and value > 0):
        return 1.0
    power = 10.0 ** math.floor(math.log10(value) + 1e-12)
    step = next(s for s in (5, 2, 1) if s * power <= value * (1 + 1e-9))
    return float(f"{step * power:.6g}")


def residual_vectors(
    image_size_px: tuple[int, int],
    xy_px: FloatArray,
    residual_px: FloatArray,
    used: npt.NDArray[np.bool_],
    labels: Sequence[str],
) -> str:
    """Residuals as magnified lines from their points; rejected ones red, with a cross."""
    width, height = image_size_px
    scale = _WIDTH / width
    bottom = height * scale + 34
    length = np.hypot(*residual_px.T)
    typical = float(np.percentile(length[used], 95)) if used.any() else 0.0
    magnification = _VECTOR_PART * _WIDTH / typical if typical > 0 else 1.0
    parts = [
        f'<rect x="0.5" y="0.5" width="{_WIDTH - 1:.1f}" height="{height * scale - 1:.1f}" '
        f'fill="#fbfcfe" stroke="{LINE}"/>',
    ]
    shown = _thinned(used)
    for i in shown:
        x, y = (xy_px[i] + 0.5) * scale
        # A rejected residual may be very long: it is cut, its number stands in the tip.
        stretch = magnification * min(1.0, 6 * typical / length[i] if length[i] > 0 else 1.0)
        dx, dy = residual_px[i] * stretch
        tip = f"<title>{escape(labels[i])}: {length[i]:.3f} px</title>"
        colour, line = (BLUE, 1.1) if used[i] else (RED, 1.5)
        parts.append(
            f'<path d="M{x:.1f} {y:.1f}l{dx:.1f} {dy:.1f}" stroke="{colour}" '
            f'stroke-width="{line}" fill="none">{tip}</path>'
        )
        if not used[i]:
            parts.append(
                f'<path d="M{x - 3:.1f} {y - 3:.1f}l6 6m0 -6l-6 6" stroke="{RED}" '
                'stroke-width="1.3"/>'
            )
        else:
            parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="1.3" fill="{BLUE}"/>')
    parts.append(_scale_bar(magnification, height * scale + 20, typical))
    return drawing(_WIDTH, bottom, parts, "residual vectors")


def _thinned(used: npt.NDArray[np.bool_]) -> npt.NDArray[np.int64]:
    """All rejected observations, and evenly as many used ones as can be drawn."""
    kept = np.flatnonzero(used)
    if len(kept) > _MOST_VECTORS:
        kept = kept[np.linspace(0, len(kept) - 1, _MOST_VECTORS).astype(int)]
    return np.concatenate([kept, np.flatnonzero(~used)])


def _scale_bar(magnification: float, y: float, typical: float) -> str:
    bar_px = round_down(2 * typical if typical > 0 else 1.0)
    length = bar_px * magnification
    return (
        f'<path d="M1 {y - 4:.1f}v8m0 -4h{length:.1f}m0 -4v8" stroke="{SOFT}" fill="none"/>'
        f'<text x="{length + 8:.1f}" y="{y + 4:.1f}">{bar_px:g} px of residual</text>'
        f'<path d="M{_WIDTH - 128:.1f} {y - 3:.1f}l6 6m0 -6l-6 6" stroke="{RED}" '
        f'stroke-width="1.3"/><text x="{_WIDTH - 116:.1f}" y="{y + 4:.1f}">rejected</text>'
        f'<circle cx="{_WIDTH - 52:.1f}" cy="{y:.1f}" r="2" fill="{BLUE}"/>'
        f'<text x="{_WIDTH - 44:.1f}" y="{y + 4:.1f}">used</text>'
    )


def histogram(residual_px: FloatArray, used: npt.NDArray[np.bool_]) -> str:
    """Used residuals, both coordinates, with the normal curve of the same spread."""
    width, height, floor = 470.0, 190.0, 160.0
    values = residual_px[used].ravel()
    if not len(values):
        return drawing(
            width, height, ['<text x="10" y="90">no observation used</text>'], "histogram"
        )
    spread = float(np.sqrt(np.mean(values**2))) or 1.0
    step = round_down(spread / 2)
    half = max(4, min(16, math.ceil(4.2 * spread / step)))
    edges = (np.arange(-half, half + 1)) * step
    counts = np.histogram(np.clip(values, edges[0], edges[-1]), edges)[0]
    curve_x = np.linspace(edges[0], edges[-1], 121)
    normal = np.exp(-0.5 * (curve_x / spread) ** 2) / (spread * math.sqrt(2 * math.pi))
    curve = normal * len(values) * step
    top = max(float(counts.max()), float(curve.max()))

    def x_of(value: Any) -> Any:
        return 8 + (value - edges[0]) / (edges[-1] - edges[0]) * (width - 16)

    def y_of(value: Any) -> Any:
        return floor - value / top * (floor - 12)

    bar = (width - 16) / len(counts)
    parts = [
        f'<rect x="{x_of(edges[k]) + 0.5:.1f}" y="{y_of(n):.1f}" width="{bar - 1:.1f}" '
        f'height="{floor - y_of(n):.1f}" fill="{BLUE}" opacity="0.75">'
        f"<title>{edges[k]:.3g} to {edges[k + 1]:.3g} px: {n}</title></rect>"
        for k, n in enumerate(counts)
    ]
    line = " ".join(f"{x:.1f},{y:.1f}" for x, y in zip(x_of(curve_x), y_of(curve), strict=True))
    parts.append(f'<polyline points="{line}" fill="none" stroke="#1c2430" stroke-width="1.2"/>')
    parts.append(f'<path d="M8 {floor}H{width - 8}" stroke="{SOFT}"/>')
    every = max(1, half // 3)
    for value in np.arange(-(half - 1) // every * every + every, half, every) * step:
        parts.append(
            f'<path d="M{x_of(value):.1f} {floor}v4" stroke="{SOFT}"/><text x="{x_of(value):.1f}" '
            f'y="{floor + 16}" text-anchor="middle">{value:.3g}</text>'
        )
    parts.append(f'<text x="{width - 8}" y="{height - 1}" text-anchor="end">px</text>')
    return drawing(width, height, parts, "histogram of residuals")


def coverage(
    image_size_px: tuple[int, int],
    xy_px: FloatArray,
    used: npt.NDArray[np.bool_],
    cells: tuple[int, int],
) -> tuple[str, float]:
    """Number of used points in each cell of the picture; also the part of cells with any."""
    width, height = image_size_px
    drawn_w = 470.0
    drawn_h = drawn_w * height / width
    columns, rows = cells
    xy = xy_px[used] + 0.5
    counts = np.histogram2d(
        xy[:, 1], xy[:, 0], bins=(rows, columns), range=((0, height), (0, width))
    )[0].astype(int)
    cell_w, cell_h = drawn_w / columns, drawn_h / rows
    most = max(1, int(counts.max()))
    parts = []
    for (row, column), n in np.ndenumerate(counts):
        x, y = column * cell_w, row * cell_h
        shade = f'{BLUE}" opacity="{0.12 + 0.75 * math.sqrt(n / most):.2f}' if n else EMPTY
        parts.append(
            f'<rect x="{x + 0.5:.1f}" y="{y + 0.5:.1f}" width="{cell_w - 1:.1f}" '
            f'height="{cell_h - 1:.1f}" fill="{shade}"/>'
        )
        ink = "#fff" if n and math.sqrt(n / most) > 0.5 else "#1c2430"
        parts.append(
            f'<text x="{x + cell_w / 2:.1f}" y="{y + cell_h / 2 + 4:.1f}" '
            f'text-anchor="middle" style="fill:{ink}">{n}</text>'
        )
    return drawing(drawn_w, drawn_h, parts, "coverage of the picture"), float((counts > 0).mean())


def drawing(
    width: float, height: float, parts: Sequence[str], label: str, enlarge: bool = True
) -> str:
    """An SVG that stands alone or in a page, with ``label`` for those who do not see it.

    It grows and shrinks with its place, beyond ``width`` pixels only if ``enlarge``.
    """
    most = "" if enlarge else f' style="max-width:{width:.0f}px"'
    return (
        f'<svg viewBox="0 0 {width:.0f} {height:.0f}"{most} role="img" '
        f'aria-label="{escape(label)}" '
        'xmlns="http://www.w3.org/2000/svg" font-family="system-ui,Segoe UI,Roboto,Arial,'
        f'sans-serif" font-size="11" fill="{SOFT}">{"".join(parts)}</svg>'
    )


def text_width(text: str, font_px: float = 11.0) -> float:
    """About how wide a text will be: no font is at hand here."""
    narrow = sum(text.count(c) for c in " .,:;il|'()/")
    return font_px * (0.58 * (len(text) - narrow) + 0.32 * narrow)
