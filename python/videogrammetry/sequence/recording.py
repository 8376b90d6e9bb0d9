"""What readers of recordings share: a file of many frames that knows how it was taken."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from videogrammetry.sequence.source import check_index

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class RecordingFacts:
    """What a recording's file says of itself, None where it does not.

    Attributes
    ----------
    image_size_px : (width, height). num_frames : that can be read.
    bit_depth : bits that count: samples are 0 to 2**bit_depth - 1.
    frame_rate_hz : frames a second that the camera took. exposure_s : of one frame.
    first_frame : number of the first frame, in the camera's count from the trigger (frame 0;
        negative: before it). save_step : every n-th frame that was taken is in the file.
    trigger_time : when the trigger came, to the camera's accuracy.
    date : of the recording, by whichever clock.
    camera_name : as the user or the maker calls it. origin : all of it in words.
    """

    image_size_px: tuple[int, int]
    num_frames: int
    bit_depth: int
    frame_rate_hz: float | None = None
    exposure_s: float | None = None
    first_frame: int | None = None
    save_step: int = 1
    trigger_time: datetime | None = None
    date: datetime | None = None
    camera_name: str = ""
    origin: str = ""


class RecordingSource:
    """Base of the readers of recordings: a subclass adds ``read``.

    Attributes
    ----------
    facts : what the file says. paths : its files, the one that bears its name first.
    remarks : what is wrong with the file though it can be measured in, a paragraph each.
    """

    def __init__(
        self, paths: Sequence[Path], facts: RecordingFacts, remarks: Sequence[str] = ()
    ) -> None:
        self.paths = tuple(paths)
        self.facts = facts
        self.remarks = tuple(remarks)

    @property
    def image_size_px(self) -> tuple[int, int]:
        """(width, height)."""
        return self.facts.image_size_px

    @property
    def frame_rate_hz(self) -> float | None:
        """Frames a second that the camera took.

        Where only every n-th frame was saved (``save_step``), those in the file
        are n times further apart; headers are not reliable in this, so it is
        said and left to the user.
        """
        return self.facts.frame_rate_hz

    @property
    def save_step(self) -> int:
        """Every n-th frame was saved, as the header says."""
        return self.facts.save_step

    @property
    def exposure_s(self) -> float | None:
        """Exposure time of a frame."""
        return self.facts.exposure_s

    @property
    def bit_depth(self) -> int:
        """Bits that count: samples are 0 to 2**bit_depth - 1."""
        return self.facts.bit_depth

    @property
    def first_frame(self) -> int | None:
        """Number of the first frame, counted by the camera from the trigger."""
        return self.facts.first_frame

    @property
    def trigger_time(self) -> datetime | None:
        """When the trigger came, by the camera's clock."""
        return self.facts.trigger_time

    @property
    def date(self) -> datetime | None:
        """When it was recorded."""
        return self.facts.date

    @property
    def camera_name(self) -> str:
        """What the camera is called, or its type."""
        return self.facts.camera_name

    @property
    def origin(self) -> str:
        """Camera, date, trigger and rate of the recording, in words."""
        return self.facts.origin

    def times_s(self) -> FloatArray | None:
        """(N,) time stamps of the frames, from the trigger; None where the format has none."""
        return None

    def __len__(self) -> int:
        return self.facts.num_frames

    def name(self, index: int) -> str:
        """The file's name, with ``#n`` from 1 where there are several frames."""
        self._check(index)
        name = self.paths[0].name
        return name if len(self) == 1 else f"{name}#{index + 1}"

    def read(self, index: int) -> npt.NDArray[Any]:
        """The frame: (height, width), uint8 or uint16."""
        raise NotImplementedError

    def _check(self, index: int) -> None:
        check_index(index, len(self), str(self.paths[0]))


def joined_words(*parts: str) -> str:
    """The parts that say something, with commas.

    Examples
    --------
    >>> joined_words("Phantom", "", "serial 7")
    'Phantom, serial 7'
    """
    return ", ".join(part for part in parts if part)
