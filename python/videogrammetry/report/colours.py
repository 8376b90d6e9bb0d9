"""Colours of the drawings: series told apart by everybody, values on even scales."""

from __future__ import annotations

import numpy as np

from videogrammetry.types import FloatArray

INK, SOFT, GRID, GREY = "#1c2430", "#5b6675", "#e3e8ee", "#9aa5b4"
#: Of the dark panels that show space.
NIGHT, NIGHT_INK, NIGHT_SOFT = "#11151c", "#e6ebf2", "#aab4c4"
#: Told apart by people who see red and green alike, too (Okabe and Ito's, darkened).
PALETTE = ("#1f6fb2", "#d1661a", "#1b8a63", "#a8488f", "#8a6d00", "#3aa0d1", "#c8352b")

# Perceptually even from dark blue over green to yellow (nodes of "viridis").
_EVEN = np.array(
    [
        [68, 1, 84],
        [59, 82, 139],
        [33, 145, 140],
        [94, 201, 98],
        [253, 231, 37],
    ],
    dtype=float,
)
# Blue for less, white for the same, red for more.
_DIVERGING = np.array(
    [
        [24, 62, 125],
        [75, 139, 196],
        [247, 248, 250],
        [226, 122, 84],
        [142, 22, 32],
    ],
    dtype=float,
)


def colour_of(share: float) -> str:
    """The colour of a value between 0 and 1.

    Examples
    --------
    >>> colour_of(0.0), colour_of(1.0)
    ('#440154', '#fde725')
    """
    return _hex(_mixed(np.array([share]), _EVEN)[0])


def diverging_rgb(share: FloatArray) -> FloatArray:
    """Colours (..., 3), 0 to 255, of values between -1 (blue), 0 (white) and 1 (red).

    Examples
    --------
    >>> diverging_rgb(np.array([-1.0, 0.0])).tolist()
    [[24.0, 62.0, 125.0], [247.0, 248.0, 250.0]]
    """
    return _mixed((np.asarray(share, dtype=float) + 1) / 2, _DIVERGING)


def diverging_of(share: float) -> str:
    """The colour of a value between -1 and 1 as text.

    Examples
    --------
    >>> diverging_of(0.0)
    '#f7f8fa'
    """
    return _hex(diverging_rgb(np.array([share]))[0])


def _mixed(share: FloatArray, nodes: FloatArray) -> FloatArray:
    place = np.clip(share, 0.0, 1.0) * (len(nodes) - 1)
    low = np.minimum(place.astype(int), len(nodes) - 2)
    mixed: FloatArray = nodes[low] + (place - low)[..., None] * (nodes[low + 1] - nodes[low])
    return mixed


def _hex(rgb: FloatArray) -> str:
    return "#" + "".join(f"{round(v):02x}" for v in rgb)
