"""Room for labels in a drawing: beside their dot, on no other dot, on no other label."""

from __future__ import annotations

from videogrammetry.report.html import escape
from videogrammetry.report.svg import text_width

_Box = tuple[float, float, float, float]


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
        """The text beside a dot, where it covers least."""
        width, height = text_width(text, self._font), 0.78 * self._font
        best: tuple[float, _Box] | None = None
        for rank, (left, top) in enumerate(_places(x, y, radius + 2.5, width, height)):
            box = (left, top, left + width, top + height)
            cost = sum(_overlap(box, other) for other in self._taken) + self._outside(box)
            if best is None or cost + 0.01 * rank < best[0]:
                best = (cost + 0.01 * rank, box)
        assert best is not None  # there are places
        self._taken.append(best[1])
        left, _, _, bottom = best[1]
        return (
            f'<text x="{left:.1f}" y="{bottom:.1f}" font-size="{self._font:g}" '
            f'style="font-size:{self._font:g}px;{style}">{escape(text)}</text>'
        )

    def _outside(self, box: _Box) -> float:
        left, top, right, bottom = self._bounds
        over = max(0, left - box[0]) + max(0, top - box[1])
        return 100.0 * (over + max(0, box[2] - right) + max(0, box[3] - bottom))


def _overlap(a: _Box, b: _Box) -> float:
    width = min(a[2], b[2]) - max(a[0], b[0])
    height = min(a[3], b[3]) - max(a[1], b[1])
    return width * height if width > 0 and height > 0 else 0.0


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
