"""Correlations of parameters as a grid of colours, and in words."""

from __future__ import annotations

from videogrammetry.calibration.quality import NAMED_CORRELATION, Correlations
from videogrammetry.report.colours import INK, SOFT, diverging_of
from videogrammetry.report.html import escape
from videogrammetry.report.svg import drawing

#: Numbers stand in cells from here on.
_WRITTEN = 0.3
_CELL, _HEAD = 38.0, 34.0


def correlation_grid(correlations: Correlations) -> str:
    """The lower half of the matrix; white 0, red +1, blue -1."""
    names = correlations.names
    size = len(names)
    parts = []
    for row in range(size):
        y = row * _CELL
        parts.append(
            f'<text x="{_HEAD - 6}" y="{y + _CELL / 2 + 4:.0f}" text-anchor="end" '
            f'style="fill:{INK}">{escape(names[row])}</text>'
        )
        parts.append(
            f'<text x="{_HEAD + row * _CELL + _CELL / 2:.0f}" y="{size * _CELL + 15:.0f}" '
            f'text-anchor="middle" style="fill:{INK}">{escape(names[row])}</text>'
        )
        for column in range(row + 1):
            parts.append(_cell(_HEAD + column * _CELL, y, float(correlations.matrix[row, column]),
                               f"{names[row]}, {names[column]}", row == column))  # fmt: skip
    return drawing(
        _HEAD + size * _CELL + 2, size * _CELL + 22, parts, "correlations of the parameters", False
    )


def _cell(x: float, y: float, value: float, pair: str, diagonal: bool) -> str:
    shade = "#e9edf2" if diagonal else diverging_of(value)
    frame = f' stroke="{INK}" stroke-width="1.4"' if abs(value) > NAMED_CORRELATION else ""
    rect = (
        f'<rect x="{x + 1:.0f}" y="{y + 1:.0f}" width="{_CELL - 2:.0f}" height="{_CELL - 2:.0f}" '
        f'fill="{shade}"{"" if diagonal else frame}><title>{escape(pair)}: {value:+.3f}</title>'
        "</rect>"
    )
    if diagonal or abs(value) < _WRITTEN:
        return rect
    ink = "#fff" if abs(value) > 0.75 else INK
    digits = 3 if abs(value) > 0.995 else 2
    text = f"{value:+.{digits}f}".replace("0.", ".", 1).replace("-", "\u2212")
    return (
        f'{rect}<text x="{x + _CELL / 2:.0f}" y="{y + _CELL / 2 + 4:.0f}" text-anchor="middle" '
        f'style="fill:{ink}">{text}</text>'
    )


def correlation_words(correlations: Correlations) -> str:
    """The pairs above the limit, as HTML."""
    pairs = correlations.pairs(NAMED_CORRELATION)
    if not pairs:
        return f'<p class="note">No correlation is above {NAMED_CORRELATION:g}.</p>'
    items = ", ".join(f"{escape(a)} and {escape(b)} {r:+.3f}" for a, b, r in pairs)
    return (
        f'<p class="note">Above {NAMED_CORRELATION:g} (framed): <b style="color:{SOFT}">{items}'
        "</b>.</p>"
    )
