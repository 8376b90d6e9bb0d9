"""Room for labels in a drawing: beside their dot, on no other dot, on no other label."""

from __future__ import annotations

import numpy as np

from videogrammetry.report.html import escape
from videogrammetry.report.svg import text_width
from videogrammetry.types import FloatArray

_Box = tuple[float, float, float, float]
#: A label that would cover more than this part of itself is left out.
_MOST_HIDDEN = 0.6


class Labels:
    """Places texts in a rectangle, one after the other.

    Parameters
    ----------
    bounds : left, top, right, bottom that no label should leave.
    font_px : height of the font.
    """

    def __init__(self, bounds: _Box, font_px: float = 11.0) -> None:
        self._bounds, self._font = bounds, font_px
        self._taken: list[_Box] = []

    def take(self, x: float, y: float, radius: float) -> None:
        """Keeps a dot free of labels."""
        self._taken.append((x - radius, y - radius, x + radius, y + radius))

    def place(self, text: str, x: float, y: float, radius: float, style: str) -> str:
        """The text beside a dot, where it covers least; "" where there is no room."""
        width, height = text_width(text, self._font), 0.78 * self._font
        places = np.array(_places(x, y, radius + 2.5, width, height))
        boxes = np.concatenate([places, places + np.array([width, height])], axis=1)
        cost = self._hidden(boxes) + self._outside(boxes) + 0.01 * np.arange(len(boxes))
        best = boxes[int(np.argmin(cost))]
        if cost.min() > _MOST_HIDDEN * width * height:
            return ""
        self._taken.append(tuple(best))
        left, bottom = best[0], best[3]
        return (
            f'<text x="{left:.1f}" y="{bottom:.1f}" font-size="{self._font:g}" '
            f'style="font-size:{self._font:g}px;{style}">{escape(text)}</text>'
        )

    def _hidden(self, boxes: FloatArray) -> FloatArray:
        """(B,) area of each box that is taken already."""
        taken = np.array(self._taken).reshape(-1, 4)
        low = np.maximum(boxes[:, None, :2], taken[None, :, :2])
        high = np.minimum(boxes[:, None, 2:], taken[None, :, 2:])
        return np.asarray(np.maximum(high - low, 0.0).prod(axis=2).sum(axis=1))

    def _outside(self, boxes: FloatArray) -> FloatArray:
        """(B,) large where a box leaves the bounds."""
        bounds = np.array(self._bounds)
        over = np.maximum(bounds[:2] - boxes[:, :2], 0) + np.maximum(boxes[:, 2:] - bounds[2:], 0)
        return np.asarray(100.0 * over.sum(axis=1))


def _places(
    x: float, y: float, gap: float, width: float, height: float
) -> list[tuple[float, float]]:
    """Top-left corners around a dot, the favoured first, then the same farther off."""
    near = 0.75 * gap
    spots = []
    for far in (0.0, 6.0, 13.0):
        right, left = x + gap + far, x - gap - far - width
        above, below = y - gap - far - height, y + gap + far
        spots += [
            (right, y - height / 2),
            (left, y - height / 2),
            (x + near + far, y - near - far - height),
            (x + near + far, y + near + far),
            (x - near - far - width, y - near - far - height),
            (x - near - far - width, y + near + far),
            (x - width / 2, above),
            (x - width / 2, below),
        ]
    return spots
