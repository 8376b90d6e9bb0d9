"""Axes of a drawing: where values are, and which round numbers stand beside them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from videogrammetry.types import FloatArray


@dataclass(frozen=True, kw_only=True)
class Axes:
    """The plot's rectangle in the drawing and the values at its edges."""

    left: float
    top: float
    width: float
    height: float
    x_range: tuple[float, float]
    y_range: tuple[float, float]

    def x(self, value: Any) -> Any:
        """Place of a value in the drawing, from the left."""
        low, high = self.x_range
        return self.left + (np.asarray(value, dtype=float) - low) / (high - low) * self.width

    def y(self, value: Any) -> Any:
        """Place of a value in the drawing, from the top."""
        low, high = self.y_range
        return self.top + (high - np.asarray(value, dtype=float)) / (high - low) * self.height

    @property
    def clip(self) -> str:
        """Name of the rectangle as a clip path; equal names mean equal rectangles."""
        return f"clip-{self.left:.1f}-{self.top:.1f}-{self.width:.1f}-{self.height:.1f}"

    def equal(self) -> Axes:
        """The same rectangle with ranges grown so that units are equally long."""
        x_unit = (self.x_range[1] - self.x_range[0]) / self.width
        y_unit = (self.y_range[1] - self.y_range[0]) / self.height
        unit = max(x_unit, y_unit)
        ranges = []
        for (low, high), room in ((self.x_range, self.width), (self.y_range, self.height)):
            middle, half = (low + high) / 2, unit * room / 2
            ranges.append((middle - half, middle + half))
        return Axes(
            left=self.left,
            top=self.top,
            width=self.width,
            height=self.height,
            x_range=ranges[0],
            y_range=ranges[1],
        )


def ticks(low: float, high: float, wanted: int = 6) -> FloatArray:
    """Round numbers from ``low`` to ``high``, about ``wanted`` of them.

    Examples
    --------
    >>> ticks(-0.3, 10.4).tolist()
    [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]
    """
    raw = (high - low) / max(1, wanted)
    if not (math.isfinite(raw) and raw > 0):
        return np.array([low])
    first = last = 0
    while last <= first:  # at least two, or there is no scale
        power = 10.0 ** math.floor(math.log10(raw))
        step = next(s * power for s in (1, 2, 5, 10) if s * power >= raw * (1 - 1e-9))
        first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
        raw /= 2
    return np.array([float(f"{k * step:.12g}") for k in range(first, last + 1)])


def tick_labels(values: FloatArray) -> list[str]:
    """Texts of ticks, all with the decimals of their step and a true minus sign.

    Examples
    --------
    >>> tick_labels(np.array([-0.5, 0.0, 0.5])), tick_labels(np.array([0.0, 1000.0]))
    (['−0.5', '0.0', '0.5'], ['0', '1000'])
    """
    step = float(values[1] - values[0]) if len(values) > 1 else 1.0
    places = max(0, -math.floor(math.log10(step) + 1e-9))
    return [f"{v + 0.0:.{places}f}".replace("-", "\u2212") for v in values]
