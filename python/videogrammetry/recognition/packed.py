"""Frames of packed 12-bit samples, recognised where they stand in memory."""

from __future__ import annotations

import operator
from typing import Any, TypeGuard

import numpy as np
import numpy.typing as npt

from videogrammetry._core import recognition as _core
from videogrammetry.types import PackedSamples

#: How two samples stand in three bytes: Photron's way, and GenICam's Mono12p.
PACKED_ORDERS = ("high-first", "low-first")
_LARGEST_SIDE = 1 << 16


class PackedFrame:
    """A picture of 12-bit samples, two in three bytes, as cameras store it.

    ``recognize`` and ``recognize_sequence`` take it like an array; the method
    ``edge-pair`` reads the bytes where they stand, so that a frame of a mapped
    file is never copied. ``numpy.asarray`` gives the samples as uint16.

    Parameters
    ----------
    data : bytes, memoryview, mmap, or C-contiguous array of uint8
        3 H W / 2 bytes without gaps; not copied, kept alive, not to be changed
        while a frame is recognised.
    shape : (H, W), rows and columns; W even, or a row would begin within a byte.
    order : ``high-first`` as Photron writes: the first sample is byte 0 and the
        upper half of byte 1; ``low-first``: least significant bit first (Mono12p).

    Attributes
    ----------
    data : (3 H W / 2,) uint8. shape : (H, W). order : as given.
    core : the frame as the C++ core takes it.

    Raises
    ------
    ValueError
        What is given does not fit together.

    Examples
    --------
    >>> frame = PackedFrame(bytes.fromhex("abcdef"), (1, 2))
    >>> frame.unpack().tolist() == [[0xABC, 0xDEF]], frame
    (True, PackedFrame(1 x 2, high-first))
    """

    __slots__ = ("core", "data", "order", "shape")

    def __init__(self, data: Any, shape: tuple[int, int], order: str = "high-first") -> None:
        if order not in PACKED_ORDERS:
            raise ValueError(
                f"order: expected {' or '.join(map(repr, PACKED_ORDERS))}, got {order!r}"
            )
        self.order = order
        self.shape = _checked_shape(shape)
        self.data = _as_bytes(data)
        height, width = self.shape
        expected = height * width // 2 * 3
        if self.data.size != expected:
            raise ValueError(
                f"data: expected {expected} bytes for {height} x {width} samples of 12 bits, "
                f"got {self.data.size}"
            )
        self.core = _core.PackedFrame(self.data, height, width, order == PACKED_ORDERS[0])

    #: As an array of the samples would have them.
    ndim = 2
    dtype = np.dtype(np.uint16)

    @property
    def size(self) -> int:
        """Number of samples."""
        return self.shape[0] * self.shape[1]

    def unpack(self) -> npt.NDArray[np.uint16]:
        """(H, W) samples, 0 to 4095, in a new array."""
        samples: npt.NDArray[np.uint16] = self.core.unpack()
        return samples

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> npt.NDArray[Any]:
        if copy is False:
            raise ValueError("copy: packed samples cannot be an array without a copy")
        samples = self.unpack()
        return samples if dtype is None else samples.astype(dtype, copy=False)

    def __len__(self) -> int:
        return self.shape[0]

    def __reduce__(self) -> tuple[Any, ...]:
        return PackedFrame, (self.data, self.shape, self.order)

    def __repr__(self) -> str:
        return f"PackedFrame({self.shape[0]} x {self.shape[1]}, {self.order})"


def is_packed(frame: Any) -> TypeGuard[PackedSamples]:
    """Whether it is a packed frame, ours or one of the same attributes."""
    return isinstance(frame, PackedFrame) or all(
        hasattr(frame, name) for name in ("data", "shape", "order")
    )


def as_packed(frame: PackedSamples) -> PackedFrame:
    """``frame`` itself if it is ours, else ours of the same bytes."""
    if isinstance(frame, PackedFrame):
        return frame
    return PackedFrame(frame.data, frame.shape, frame.order)


def _checked_shape(shape: Any) -> tuple[int, int]:
    try:
        height, width = (operator.index(n) for n in shape)
    except (TypeError, ValueError):
        raise ValueError(f"shape: expected (height, width), got {shape!r}") from None
    if not (0 <= height <= _LARGEST_SIDE and 0 <= width <= _LARGEST_SIDE):
        raise ValueError(
            f"shape: expected 0 to {_LARGEST_SIDE} rows and columns, got {(height, width)}"
        )
    if width % 2:
        raise ValueError(
            f"shape: expected an even width, got {(height, width)}: a row would begin in the "
            "middle of a byte; unpack such samples"
        )
    return height, width


def _as_bytes(data: Any) -> npt.NDArray[np.uint8]:
    if isinstance(data, np.ndarray):
        if data.dtype != np.uint8:
            raise ValueError(f"data: expected bytes or an array of uint8, got {data.dtype}")
        if not data.flags.c_contiguous:
            raise ValueError("data: expected contiguous bytes, got an array with gaps")
        return np.asarray(data).reshape(-1)
    try:
        return np.frombuffer(data, np.uint8) if len(data) else np.empty(0, np.uint8)
    except (TypeError, ValueError, BufferError):
        raise ValueError(
            f"data: expected contiguous bytes or an array of uint8, got {type(data).__name__}"
        ) from None
