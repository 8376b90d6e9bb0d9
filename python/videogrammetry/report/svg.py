"""Drawings as SVG text, and the histogram of residuals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from videogrammetry.report.html import escape
from videogrammetry.types import FloatArray

BLUE, RED, LINE, SOFT, EMPTY = "#1f6fb2", "#c8352b", "#c9d1db", "#5b6675", "#fbe9e7"


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
