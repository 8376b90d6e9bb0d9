"""A picture with the targets found in it: outlines, centres and IDs, and a legend below.

Outlines are smooth and at their true sub-pixel place; pixel (0, 0) is the
centre of the top-left pixel.
"""

from __future__ import annotations

import json
import math
import os
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont
from PIL.PngImagePlugin import PngInfo

from videogrammetry.project import atomic_path, plain
from videogrammetry.recognition.options import RING_STATUS
from videogrammetry.types import Targets

CODED, PLAIN, DOUBTFUL = "coded", "un-coded", "doubtful"
#: Told apart by people who see red and green alike, too.
COLOURS = {CODED: (64, 224, 130), PLAIN: (90, 190, 255), DOUBTFUL: (255, 168, 38)}

_LINE_PX = 1.6
_SMALLEST_WIDTH = 1400
_LARGEST_ENLARGEMENT = 4
_FONT_PX = 16
#: A code ring's outer radius over its dot's: 3 (Schneider) to 3.5 (Metashape).
_RING = 3.3
_LEGEND_PX = 34
_GAP_PX = 3
_Box = tuple[float, float, float, float]
_GROUND = (24, 26, 30)


def write_overlay(
    path: str | os.PathLike[str],
    frame: npt.NDArray[Any],
    targets: Targets,
    title: str = "",
    origin: Mapping[str, Any] | None = None,
) -> None:
    """Writes :func:`draw_overlay`'s picture as PNG, all of it or nothing.

    ``origin`` is its provenance, kept as JSON in the text chunk ``provenance``.
    """
    chunks = PngInfo()
    if origin is not None:
        chunks.add_text("provenance", json.dumps(plain(origin)))
    with atomic_path(path) as beside:
        draw_overlay(frame, targets, title).save(beside, "PNG", compress_level=4, pnginfo=chunks)


def draw_overlay(frame: npt.NDArray[Any], targets: Targets, title: str = "") -> Image.Image:
    """The frame, its contrast stretched, with all targets drawn in.

    Small pictures are enlarged by a whole factor, so that IDs can be read. An
    ID stands beside its dot, where it hides no other dot and no other ID.

    Parameters
    ----------
    frame : (height, width), uint8 or uint16.
    targets : green where coded, blue where un-coded, orange where a ring is
        there but was not read (``ring_status``).
    title : stands in the legend.
    """
    height, width = frame.shape
    scale = min(_LARGEST_ENLARGEMENT, max(1, -(-_SMALLEST_WIDTH // width)))
    picture = Image.fromarray(stretched(frame)).convert("RGB")
    if scale > 1:
        picture = picture.resize((width * scale, height * scale), Image.Resampling.BICUBIC)
    kinds = [_kind(targets, i) for i in range(len(targets))]
    ellipses = [_ellipse(targets, i, scale) for i in range(len(targets))]
    for kind, ellipse in zip(kinds, ellipses, strict=True):
        _draw_ellipse(picture, ellipse, COLOURS[kind])
    # Where a ring is, the ID stands outside of it: ring and ID can be compared.
    boxes = [
        (ellipse if kind == PLAIN else ellipse.grown(_RING)).box
        for kind, ellipse in zip(kinds, ellipses, strict=True)
    ]
    labels = _Labels(picture, boxes)
    order = sorted(range(len(targets)), key=lambda i: (kinds[i] != CODED, i))
    for i in order:
        text = {CODED: str(targets.id[i]), DOUBTFUL: "?"}.get(kinds[i])
        if text:
            labels.place(text, boxes[i], COLOURS[kinds[i]])
    return _with_legend(picture, targets, kinds, title)


def _kind(targets: Targets, index: int) -> str:
    if targets.id[index] >= 0:
        return CODED
    return PLAIN if targets.ring_status[index] in (0, 1) else DOUBTFUL


def stretched(frame: npt.NDArray[Any]) -> npt.NDArray[np.uint8]:
    """8-bit picture in which the dark parts can be seen."""
    low, high = np.percentile(frame, (1, 99.8))
    values = np.clip((frame.astype(np.float32) - low) / max(high - low, 1), 0, 1)
    return np.asarray(np.rint(225 * values**0.6), dtype=np.uint8)


@dataclass(frozen=True)
class _Ellipse:
    """An ellipse in the coordinates of the drawing, whose first pixel spans 0 to 1."""

    x: float
    y: float
    major: float
    minor: float
    angle_rad: float = 0.0

    @property
    def box(self) -> tuple[float, float, float, float]:
        """Left, top, right, bottom."""
        cos, sin = math.cos(self.angle_rad), math.sin(self.angle_rad)
        half_w = math.hypot(self.major * cos, self.minor * sin)
        half_h = math.hypot(self.major * sin, self.minor * cos)
        return self.x - half_w, self.y - half_h, self.x + half_w, self.y + half_h

    def grown(self, factor: float) -> _Ellipse:
        """The same, larger by a factor."""
        return replace(self, major=self.major * factor, minor=self.minor * factor)


def _ellipse(targets: Targets, index: int, scale: int) -> _Ellipse:
    x, y = (targets.centre_px[index] + 0.5) * scale
    major, minor = np.maximum(targets.semi_axes_px[index] * scale, 1.0)
    return _Ellipse(float(x), float(y), major, minor, float(targets.angle_rad[index]))


def _draw_ellipse(picture: Image.Image, ellipse: _Ellipse, colour: tuple[int, int, int]) -> None:
    """Blends in the ellipse and a cross in its centre, smooth at sub-pixel place.

    A pixel's share of the line follows from its distance to the ellipse, to
    first order: with q = (u/a)^2 + (v/b)^2 in the ellipse's axes, the distance
    is (q - 1) / |grad q|.
    """
    left, top, right, bottom = ellipse.box
    left, top = max(0, math.floor(left) - _GAP_PX), max(0, math.floor(top) - _GAP_PX)
    right = min(picture.width, math.ceil(right) + _GAP_PX)
    bottom = min(picture.height, math.ceil(bottom) + _GAP_PX)
    if left >= right or top >= bottom:
        return
    # Pixel i of the drawing spans i to i + 1.
    x = np.arange(left, right)[None, :] + 0.5 - ellipse.x
    y = np.arange(top, bottom)[:, None] + 0.5 - ellipse.y
    cos, sin = math.cos(ellipse.angle_rad), math.sin(ellipse.angle_rad)
    u, v = (cos * x + sin * y) / ellipse.major, (cos * y - sin * x) / ellipse.minor
    slope = 2 * np.hypot(u / ellipse.major, v / ellipse.minor)
    distance = (u**2 + v**2 - 1) / np.maximum(slope, 1e-9)
    share = np.clip(_LINE_PX / 2 + 0.5 - np.abs(distance), 0, 1)
    halo = 0.5 * np.clip(_LINE_PX / 2 + 1.5 - np.abs(distance), 0, 1)
    arm = min(0.3 * 2 * ellipse.minor, 6.0)
    if arm >= 2.5:
        bars = np.minimum(np.clip(1.0 - np.abs(y), 0, 1), np.clip(arm + 0.5 - np.abs(x), 0, 1))
        across = np.minimum(np.clip(1.0 - np.abs(x), 0, 1), np.clip(arm + 0.5 - np.abs(y), 0, 1))
        share = np.maximum(share, np.maximum(bars, across))
    for paint, part in (((0, 0, 0), halo), (colour, share)):
        mask = Image.fromarray(np.rint(255 * part).astype(np.uint8))
        picture.paste(paint, (left, top), mask)


class _Labels:
    """Finds room for IDs: beside their dot, on no other dot, on no other ID."""

    def __init__(self, picture: Image.Image, boxes: list[_Box]) -> None:
        self._draw = ImageDraw.Draw(picture)
        self._size = picture.size
        self._taken = np.zeros((picture.height, picture.width), dtype=bool)
        self._font = _font(_FONT_PX)
        for box in boxes:
            self._take(*box)

    def _take(self, left: float, top: float, right: float, bottom: float) -> None:
        self._taken[
            max(0, int(top)) : max(0, int(bottom) + 1), max(0, int(left)) : int(right) + 1
        ] = True

    def place(self, text: str, box: _Box, colour: tuple[int, int, int]) -> None:
        """Writes ``text`` where least is hidden."""
        x0, y0, x1, y1 = self._draw.textbbox((0, 0), text, font=self._font, stroke_width=2)
        width, height = x1 - x0, y1 - y0
        best, cost = (0.0, 0.0), np.inf
        for distance in (0, 6, 14):
            for left, top in _places(box, width, height, _GAP_PX + distance):
                hidden = self._cost(left, top, width, height)
                if hidden < cost:
                    best, cost = (left, top), hidden
            if cost == 0:
                break
        left, top = best
        self._draw.text(
            (left - x0, top - y0),
            text,
            font=self._font,
            fill=colour,
            stroke_width=2,
            stroke_fill=(0, 0, 0),
        )
        self._take(left, top, left + width, top + height)

    def _cost(self, left: float, top: float, width: float, height: float) -> float:
        if left < 0 or top < 0 or left + width > self._size[0] or top + height > self._size[1]:
            return 1e9
        y, x = int(top), int(left)
        return float(self._taken[y : y + int(height) + 1, x : x + int(width) + 1].sum())


def _places(box: _Box, width: float, height: float, gap: float) -> list[tuple[float, float]]:
    """Top-left corners of a label around a box, the favoured first."""
    left, top, right, bottom = box
    middle_x, middle_y = (left + right - width) / 2, (top + bottom - height) / 2
    near = 0.15 * (right - left)
    return [
        (right + gap - near, top - gap - height + near),
        (right + gap, middle_y),
        (right + gap - near, bottom + gap - near),
        (middle_x, bottom + gap),
        (middle_x, top - gap - height),
        (left - gap - width, middle_y),
        (left - gap - width + near, top - gap - height + near),
        (left - gap - width + near, bottom + gap - near),
    ]


@lru_cache
def _font(size: int) -> Any:
    return ImageFont.load_default(size)


def _with_legend(
    picture: Image.Image, targets: Targets, kinds: list[str], title: str
) -> Image.Image:
    """The picture with a strip below it that explains the colours."""
    result = Image.new("RGB", (picture.width, picture.height + _LEGEND_PX), _GROUND)
    result.paste(picture, (0, 0))
    draw = ImageDraw.Draw(result)
    font, middle = _font(_FONT_PX), picture.height + _LEGEND_PX // 2
    counts = Counter(kinds)
    reasons = Counter(
        RING_STATUS[targets.ring_status[i]] for i, kind in enumerate(kinds) if kind == DOUBTFUL
    )
    why = ", ".join(f"{reason} {count}" for reason, count in reasons.most_common())
    x = 14.0
    for kind, colour in COLOURS.items():
        _draw_ellipse(result, _Ellipse(x + 7, middle, 6, 6), colour)
        text = f"{kind} {counts[kind]}" + (f" ({why})" if kind == DOUBTFUL and why else "")
        draw.text((x + 20, middle), text, font=font, fill=colour, anchor="lm")
        x += 20 + draw.textlength(text, font=font) + 26
    room = picture.width - 14 - x
    if title and draw.textlength(title, font=font) <= room:
        draw.text((picture.width - 14, middle), title, font=font, fill=(190, 194, 200), anchor="rm")
    return result
