"""Frame sources that are made of others, and checks that all sources need."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from videogrammetry.errors import SequenceError
from videogrammetry.sequence.lenient import UnreadablePicture
from videogrammetry.types import FrameSource, PackedSamples


@dataclass(frozen=True)
class PictureSource:
    """One picture file as a sequence of one frame, decoded whenever it is read."""

    path: Path
    image_size_px: tuple[int, int]
    decode: Callable[[Path], npt.NDArray[Any]]

    @property
    def frame_rate_hz(self) -> float | None:
        """None: a single picture has no rate."""
        return None

    def __len__(self) -> int:
        return 1

    def name(self, index: int) -> str:
        """The file's name."""
        check_index(index, 1, str(self.path))
        return self.path.name

    def read(self, index: int) -> npt.NDArray[Any]:
        """The picture: (height, width), uint8 or uint16."""
        check_index(index, 1, str(self.path))
        frame = self.decode(self.path)
        width, height = self.image_size_px
        if frame.shape != (height, width):
            raise SequenceError(
                f"{self.path}: {frame.shape[1]}x{frame.shape[0]} px decoded, but its header says "
                f"{width}x{height} px: the file is damaged or has changed; copy it again"
            )
        return frame


class JoinedSource:
    """Several sources, one after the other, as one sequence.

    Attributes
    ----------
    paths : the files, in order; of a recording in several files all of them.
    """

    def __init__(self, sources: Sequence[FrameSource], paths: Sequence[Path]) -> None:
        if not sources or len(sources) != len(paths):
            raise ValueError(
                f"sources: expected one or more, one a path; got {len(sources)} "
                f"and {len(paths)} paths"
            )
        self._sources = tuple(sources)
        self._ends = tuple(accumulate(len(s) for s in sources))
        self._files = tuple(paths)
        self._all_files: tuple[tuple[Path, ...], ...] = tuple(
            getattr(source, "paths", (path,)) for source, path in zip(sources, paths, strict=True)
        )
        self.paths = tuple(file for files in self._all_files for file in files)

    @property
    def image_size_px(self) -> tuple[int, int]:
        """(width, height) of the first frame that opens."""
        return self._known()[0].image_size_px

    @property
    def frame_rate_hz(self) -> float | None:
        """The first source's rate if all of them state it, else None."""
        rate: float | None = self._common("frame_rate_hz")
        return rate

    @property
    def exposure_s(self) -> float | None:
        """Exposure time of a frame if all sources state the same, else None."""
        exposure: float | None = self._common("exposure_s")
        return exposure

    @property
    def bit_depth(self) -> int | None:
        """Bits of a sample that count if all sources state the same, else None."""
        bits: int | None = self._common("bit_depth")
        return bits

    @property
    def origin(self) -> str | None:
        """Camera and date in words if all sources state the same, else None."""
        origin: str | None = self._common("origin")
        return origin

    @property
    def save_step(self) -> int:
        """Every n-th frame that the camera took was saved, if all sources say so; else 1."""
        return int(self._common("save_step") or 1)

    @property
    def first_frame(self) -> int | None:
        """The camera's number of the first frame, counted from the trigger, if it is stated."""
        number: int | None = getattr(self._sources[0], "first_frame", None)
        return number

    @property
    def trigger_time(self) -> datetime | None:
        """When the trigger came if all sources state the same, else None."""
        time: datetime | None = self._common("trigger_time")
        return time

    @property
    def remarks(self) -> tuple[str, ...]:
        """What is wrong with the files though they can be measured in, a paragraph each."""
        return tuple(text for source in self._sources for text in getattr(source, "remarks", ()))

    def times_s(self) -> npt.NDArray[np.float64] | None:
        """(N,) time stamps, from the trigger, if every source has them; else None."""
        parts: list[Any] = [getattr(s, "times_s", lambda: None)() for s in self._sources]
        if any(part is None for part in parts) or self._common("trigger_time") is None:
            return parts[0] if len(parts) == 1 else None
        return np.concatenate(parts)

    @property
    def sources(self) -> tuple[FrameSource, ...]:
        """The sequences that are joined here, with what each of them knows of itself."""
        return self._sources

    def _common(self, name: str) -> Any:
        values = {getattr(source, name, None) for source in self._known()}
        return values.pop() if len(values) == 1 else None

    def _known(self) -> list[FrameSource]:
        """The sources but those that did not open, of which nothing is known."""
        known = [s for s in self._sources if not isinstance(s, UnreadablePicture)]
        return known or list(self._sources)

    def __len__(self) -> int:
        return self._ends[-1]

    def _locate(self, index: int) -> tuple[int, int]:
        """Which source, and which frame of it."""
        check_index(index, len(self), "the sequence")
        which = bisect_right(self._ends, index)
        return which, index - (self._ends[which - 1] if which else 0)

    def file(self, index: int) -> Path:
        """The file that holds a frame; of a recording in two files the header."""
        return self._files[self._locate(index)[0]]

    def files(self, index: int) -> tuple[Path, ...]:
        """All files that a frame depends on: two of a recording, else one."""
        return self._all_files[self._locate(index)[0]]

    def name(self, index: int) -> str:
        """Name of a frame: the file's, with ``#n`` (from 1) where it holds several."""
        which, at = self._locate(index)
        return self._sources[which].name(at)

    def image_size_px_of(self, index: int) -> tuple[int, int]:
        """(width, height) of one frame: pictures need not be of one size."""
        check_index(index, len(self), "frame")
        return self._sources[self._locate(index)[0]].image_size_px

    def read(self, index: int) -> npt.NDArray[Any]:
        """The frame: (height, width), uint8 or uint16, C-contiguous."""
        which, at = self._locate(index)
        return self._sources[which].read(at)

    def packed(self, index: int) -> PackedSamples | None:
        """The frame's packed samples where they stand; None if it is to be read."""
        which, at = self._locate(index)
        packed = getattr(self._sources[which], "packed", None)
        samples: PackedSamples | None = None if packed is None else packed(at)
        return samples


#: Of a picture; larger ones are a damaged header, for which no memory is taken.
_MOST_PIXELS_A_SIDE, _MOST_PIXELS = 1 << 16, 1 << 30


def check_picture_size(path: Path, width: int, height: int) -> None:
    """SequenceError unless a camera can have taken a picture of that size."""
    sides = 0 < width <= _MOST_PIXELS_A_SIDE and 0 < height <= _MOST_PIXELS_A_SIDE
    if not sides or width * height > _MOST_PIXELS:
        raise SequenceError(
            f"{path}: its header states {width}x{height} px, which no camera's picture has: it is "
            "damaged; copy the file again"
        )


def check_index(index: int, length: int, what: str) -> None:
    """IndexError unless 0 <= index < length."""
    if not 0 <= index < length:
        raise IndexError(f"frame {index} of {what}: it has frames 0 to {length - 1}")
