"""Frames that are in memory already, as a sequence."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from videogrammetry.sequence.source import check_index
from videogrammetry.types import FrameSource


class ArraySource:
    """Grey pictures in memory, (height, width) each, uint8 or uint16, as one camera's sequence.

    Examples
    --------
    >>> source = ArraySource(np.zeros((3, 40, 60), np.uint8), frame_rate_hz=100.0)
    >>> len(source), source.image_size_px, source.name(1)
    (3, (60, 40), 'frame 2')
    """

    paths: tuple[Any, ...] = ()

    def __init__(
        self, frames: Sequence[npt.NDArray[Any]], frame_rate_hz: float | None = None
    ) -> None:
        if not len(frames):
            raise ValueError("frames: expected at least one picture, got none")
        for i, frame in enumerate(frames):
            array = np.asarray(frame)
            if array.ndim != 2 or array.dtype not in (np.uint8, np.uint16):
                raise ValueError(
                    f"frames: expected (height, width) uint8 or uint16, got shape {array.shape} "
                    f"{array.dtype} at {i}"
                )
            if array.shape != np.asarray(frames[0]).shape:
                raise ValueError(
                    f"frames: expected one size, got {array.shape} at {i} after "
                    f"{np.asarray(frames[0]).shape}"
                )
        self._frames = frames
        self.frame_rate_hz = frame_rate_hz
        height, width = np.asarray(frames[0]).shape
        self.image_size_px = (int(width), int(height))

    def __len__(self) -> int:
        return len(self._frames)

    def name(self, index: int) -> str:
        """The frame's number, from 1 as stages are."""
        check_index(index, len(self), "the array")
        return f"frame {index + 1}"

    def read(self, index: int) -> npt.NDArray[Any]:
        """The frame, not copied where it is contiguous."""
        check_index(index, len(self), "the array")
        return np.ascontiguousarray(self._frames[index])


def as_source(frames: FrameSource | Sequence[npt.NDArray[Any]]) -> FrameSource:
    """A sequence as it is, or pictures in memory as one."""
    if isinstance(frames, FrameSource):
        return frames
    return ArraySource(frames)
