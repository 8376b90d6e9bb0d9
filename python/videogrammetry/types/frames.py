"""What a reader of a sequence provides."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt


@runtime_checkable
class FrameSource(Protocol):
    """A sequence of frames of one camera: what a reader of a format provides.

    ``read`` may be called from several threads at once. Frames are numbered
    from 0 here (stages count from 1 in files and results). A source may also
    have ``packed(index)``: the frame as :class:`PackedSamples` where it stands,
    or None if it is to be read. What else one may have, and an example:
    docs/how-to/own-format.md.
    """

    @property
    def image_size_px(self) -> tuple[int, int]:
        """(width, height)."""
        ...

    @property
    def frame_rate_hz(self) -> float | None:
        """Frames a second as the file says, or None."""
        ...

    def __len__(self) -> int:
        """Number of frames."""
        ...

    def name(self, index: int) -> str:
        """Name of a frame for tables and messages (a file's name, no folder)."""
        ...

    def read(self, index: int) -> npt.NDArray[Any]:
        """The frame: (height, width), uint8 or uint16, C-contiguous."""
        ...


class PackedSamples(Protocol):
    """A picture of 12-bit samples in memory, two in three bytes, without gaps.

    What a source's ``packed(index)`` gives and recognition reads in place: any
    object with these attributes.
    """

    @property
    def data(self) -> npt.NDArray[np.uint8]:
        """(3 H W / 2,) bytes."""
        ...

    @property
    def shape(self) -> tuple[int, int]:
        """(H, W), W even."""
        ...

    @property
    def order(self) -> str:
        """``high-first`` (Photron) or ``low-first`` (Mono12p)."""
        ...
