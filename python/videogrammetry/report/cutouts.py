"""Pieces of pictures around observations: what was measured, and where it was expected."""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image

from videogrammetry.report.html import escape
from videogrammetry.report.svg import drawing, text_width

MOST_CUTOUTS = 24
#: Half a side of a piece, px: of a small error, and at most.
_HALF, _LARGEST_HALF = 24, 96
#: Side of a piece in the page.
_DRAWN = 160.0
_MEASURED, _EXPECTED = "#ff4d3d", "#3ce07f"

CUTOUT_STYLE = """
.cutouts{display:grid;grid-template-columns:repeat(auto-fill,minmax(158px,1fr));gap:14px 12px;
margin:10px 0 6px}
.cutouts figure{margin:0;break-inside:avoid}
.cutouts svg{border-radius:6px;max-width:200px}
.cutouts figcaption{font-size:12px;line-height:1.35;color:var(--soft);margin-top:4px;
overflow-wrap:anywhere}
.cutouts figcaption b{color:var(--ink)}
"""


@dataclass(frozen=True, kw_only=True)
class Cutout:
    """An observation in a picture (height, width); pixel (0, 0) is the centre of the first."""

    picture: npt.NDArray[Any]
    measured_px: tuple[float, float]
    expected_px: tuple[float, float]
    title: str
    text: str


def cutouts(items: Sequence[Cutout]) -> str:
    """The first :data:`MOST_CUTOUTS` pieces with their captions; "" of none."""
    if not items:
        return ""
    pieces = "".join(
        f"<figure>{_piece(item)}<figcaption><b>{escape(item.title)}</b><br/>{escape(item.text)}"
        "</figcaption></figure>"
        for item in items[:MOST_CUTOUTS]
    )
    note = (
        f'<p class="note"><b style="color:{_MEASURED}">Cross</b>: measured; '
        f'<b style="color:#1b8a4b">circle</b>: expected, where the others say (dashed: '
        "outside of the piece). Grey values are stretched.</p>"
    )
    return f'<div class="cutouts">{pieces}</div>{note}'


def _piece(item: Cutout) -> str:
    height, width = item.picture.shape[:2]
    x, y = item.measured_px
    reach = max(abs(item.expected_px[0] - x), abs(item.expected_px[1] - y))
    half = int(min(max(_HALF, math.ceil(1.25 * reach + 6)), _LARGEST_HALF))
    left, top = round(x) - half, round(y) - half
    size = 2 * half + 1
    zoom = _DRAWN / size
    x0, y0 = max(0, left), max(0, top)
    part = item.picture[
        y0 : max(y0, min(height, top + size)), x0 : max(x0, min(width, left + size))
    ]
    parts = [f'<rect width="{_DRAWN:.0f}" height="{_DRAWN:.0f}" fill="#2a3340"/>']
    if part.size:
        parts.append(
            f'<image x="{(x0 - left) * zoom:.1f}" y="{(y0 - top) * zoom:.1f}" '
            f'width="{part.shape[1] * zoom:.1f}" height="{part.shape[0] * zoom:.1f}" '
            'preserveAspectRatio="none" style="image-rendering:pixelated" '
            f'href="{_png(part)}"/>'
        )
    # The centre of pixel 0 is at half a pixel from the drawing's edge.
    cx, cy = (x - left + 0.5) * zoom, (y - top + 0.5) * zoom
    ex, ey = (item.expected_px[0] - left + 0.5) * zoom, (item.expected_px[1] - top + 0.5) * zoom
    parts.append(_expected(ex, ey, cx, cy, math.hypot(item.expected_px[0] - x,
                                                      item.expected_px[1] - y)))  # fmt: skip
    parts.append(
        f'<path d="M{cx - 7:.1f} {cy - 7:.1f}l14 14m0 -14l-14 14" stroke="#000" stroke-width="3.4" '
        f'opacity="0.45"/><path d="M{cx - 7:.1f} {cy - 7:.1f}l14 14m0 -14l-14 14" '
        f'stroke="{_MEASURED}" stroke-width="1.8"/>'
    )
    parts.append(_scale(zoom))
    return drawing(_DRAWN, _DRAWN, parts, f"{item.title}: cut-out of the picture")


def _expected(ex: float, ey: float, cx: float, cy: float, away_px: float) -> str:
    if 0 <= ex <= _DRAWN and 0 <= ey <= _DRAWN:
        ring = f'cx="{ex:.1f}" cy="{ey:.1f}" r="8" fill="none"'
        return (
            f'<circle {ring} stroke="#000" stroke-width="3.4" opacity="0.45"/>'
            f'<circle {ring} stroke="{_EXPECTED}" stroke-width="1.8"/>'
        )
    # Outside: an arrow to the edge says where, with the way in pixels.
    length = math.hypot(ex - cx, ey - cy)
    dx, dy = (ex - cx) / length * 0.38 * _DRAWN, (ey - cy) / length * 0.38 * _DRAWN
    tip = f"{cx + dx:.1f} {cy + dy:.1f}"
    words = f"{away_px:.0f} px"
    x = min(max(cx + 1.14 * dx, text_width(words) / 2 + 2), _DRAWN - text_width(words) / 2 - 2)
    return (
        f'<path d="M{cx:.1f} {cy:.1f}L{tip}" stroke="{_EXPECTED}" stroke-width="1.6" '
        f'stroke-dasharray="4 3"/><circle cx="{cx + dx:.1f}" cy="{cy + dy:.1f}" r="3" '
        f'fill="{_EXPECTED}"/><text x="{x:.1f}" y="{cy + 1.14 * dy + 4:.1f}" '
        f'text-anchor="middle" style="fill:{_EXPECTED};paint-order:stroke;stroke:#000;'
        f'stroke-width:2.5px">{words}</text>'
    )


def _scale(zoom: float) -> str:
    """A bar of ten pixels, to tell pieces of different size apart."""
    return (
        f'<rect x="2" y="{_DRAWN - 16}" width="{44 + 10 * zoom:.1f}" height="15" rx="3" '
        f'opacity="0.55"/><path d="M6 {_DRAWN - 7}h{10 * zoom:.1f}" stroke="#fff" '
        'stroke-width="2"/>'
        f'<text x="{10 + 10 * zoom:.1f}" y="{_DRAWN - 4}" style="fill:#fff">10 px</text>'
    )


def _png(part: npt.NDArray[Any]) -> str:
    """A grey picture, stretched from its 1st to its 99th percentile, as a data address."""
    low, high = np.percentile(part, (1, 99))
    grey = (np.asarray(part, dtype=float) - low) / max(float(high - low), 1.0)
    shown = np.rint(255 * np.clip(grey, 0, 1)).astype(np.uint8)
    stream = io.BytesIO()
    Image.fromarray(shown).save(stream, "PNG", optimize=True)
    return "data:image/png;base64," + base64.b64encode(stream.getvalue()).decode("ascii")
