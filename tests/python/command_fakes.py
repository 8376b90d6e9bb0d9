"""What the tests of the command share: its runs, its complaints, simple pictures."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np

Run = Callable[..., subprocess.CompletedProcess[str]]


def complaint(result: subprocess.CompletedProcess[str], verb: str) -> str:
    """The message of a failed run: the last line; nothing may have gone to stdout."""
    assert result.stdout == ""
    *before, last = result.stderr.splitlines()
    assert last.startswith(f"videogrammetry {verb}: "), result.stderr
    assert all(line.startswith(("recognize: ", "recognising: ")) for line in before), before
    return last


def dots(places: list[tuple[float, float]], size: tuple[int, int] = (160, 120)) -> np.ndarray:
    """A picture with white dots of 10 px radius on black."""
    x, y = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    image = np.full(size[::-1], 20.0)
    for cx, cy in places:
        image += 200 * np.clip(10.5 - np.hypot(x - cx, y - cy), 0, 1)
    return image.astype(np.uint8)


def spoil_short(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:3000])
