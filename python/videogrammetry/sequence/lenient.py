"""Frames that cannot be read, where the others are to be measured all the same."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from videogrammetry.errors import SequenceError
from videogrammetry.types import FrameSource, PackedSamples


@dataclass(frozen=True)
class UnreadablePicture:
    """A frame whose file does not open; it keeps its number, so that the others keep theirs."""

    path: Path
    why: str
    frame_rate_hz: float | None = None

    @property
    def image_size_px(self) -> tuple[int, int]:
        """SequenceError: nobody knows."""
        raise SequenceError(self.why)

    def __len__(self) -> int:
        return 1

    def name(self, index: int) -> str:
        """The file's name."""
        return self.path.name

    def read(self, index: int) -> npt.NDArray[Any]:
        """SequenceError."""
        raise SequenceError(self.why)


class LenientSource:
    """A source whose frames that cannot be read are black ones, in which nothing is found.

    Examples
    --------
    >>> from videogrammetry.sequence import ArraySource
    >>> class Broken(ArraySource):
    ...     def read(self, index):
    ...         if index == 1:
    ...             raise SequenceError("frame 2: cut short")
    ...         return super().read(index)
    >>> source = LenientSource(Broken(np.ones((3, 4, 6), np.uint8)))
    >>> [int(source.read(i).sum()) for i in range(3)], source.problem(0), source.problem(1)
    ([24, 0, 24], None, 'frame 2: cut short')
    """

    def __init__(self, source: FrameSource) -> None:
        self._source = source
        self.paths = tuple(getattr(source, "paths", ()))
        self.remarks = tuple(getattr(source, "remarks", ()))
        self.save_step = int(getattr(source, "save_step", 1))
        self.first_frame: int | None = getattr(source, "first_frame", None)
        self.trigger_time: datetime | None = getattr(source, "trigger_time", None)
        deep = (getattr(source, "bit_depth", None) or 8) > 8
        self._dtype = np.uint16 if deep else np.uint8

    @property
    def image_size_px(self) -> tuple[int, int]:
        """(width, height)."""
        return self._source.image_size_px

    @property
    def frame_rate_hz(self) -> float | None:
        """Frames a second as the file says, or None."""
        return self._source.frame_rate_hz

    def times_s(self) -> npt.NDArray[np.float64] | None:
        """(N,) time stamps; None where there are none."""
        times: npt.NDArray[np.float64] | None
        times = getattr(self._source, "times_s", lambda: None)()
        return times

    def __len__(self) -> int:
        return len(self._source)

    def name(self, index: int) -> str:
        """The frame's name."""
        return self._source.name(index)

    def read(self, index: int) -> npt.NDArray[Any]:
        """The frame, or a black one: (height, width), uint8 or uint16."""
        try:
            return self._source.read(index)
        except (SequenceError, OSError):
            width, height = self.image_size_px
            return np.zeros((height, width), self._dtype)

    def packed(self, index: int) -> PackedSamples | None:
        """The packed samples where they stand; None if the frame is to be read."""
        packed = getattr(self._source, "packed", None)
        try:
            samples: PackedSamples | None = None if packed is None else packed(index)
        except (SequenceError, OSError):
            return None
        return samples

    def problem(self, index: int) -> str | None:
        """Why a frame cannot be read; None: it can."""
        try:
            self._source.read(index)
        except (SequenceError, OSError) as error:
            return str(error)
        return None
