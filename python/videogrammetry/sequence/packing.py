"""Samples of 12 bits, two in three bytes, to uint16 and back (C++ core)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from videogrammetry._core import sequence as _core


@dataclass(frozen=True, kw_only=True)
class PackedPicture:
    """A frame of packed 12-bit samples where it stands: ``types.PackedSamples``."""

    data: npt.NDArray[np.uint8]
    shape: tuple[int, int]
    order: str = "high-first"


def packed_12bit_bytes(num_samples: int) -> int:
    """Bytes that packed samples take: half a byte is left over after an odd number.

    Examples
    --------
    >>> [packed_12bit_bytes(n) for n in (1, 2, 3, 4)]
    [2, 3, 5, 6]
    """
    return (3 * num_samples + 1) // 2


def unpack_12bit(
    packed: npt.NDArray[np.uint8],
    shape: int | tuple[int, ...],
    *,
    high_first: bool = True,
    out: npt.NDArray[np.uint16] | None = None,
) -> npt.NDArray[np.uint16]:
    """Spreads packed samples of 12 bits to 16 bits; other Python threads run meanwhile.

    Parameters
    ----------
    packed : C-contiguous, (3 n + 1) // 2 bytes for the n samples of ``shape``.
    shape : of the result, often (height, width).
    high_first : True: as Photron writes, the first sample is byte 0 and the
        upper half of byte 1. False: least significant bit first (Mono12p).
    out : C-contiguous array of ``shape`` to write to; None: a new one.

    Raises
    ------
    ValueError
        The sizes do not fit.

    Examples
    --------
    >>> [hex(v) for v in unpack_12bit(np.array([0xAB, 0xCD, 0xEF], np.uint8), 2).tolist()]
    ['0xabc', '0xdef']
    """
    if out is None:
        out = np.empty(shape, np.uint16)
    elif out.shape != _tuple(shape):
        raise ValueError(f"out: expected shape {_tuple(shape)}, got {out.shape}")
    _core.unpack_12bit(packed, out, high_first)
    return out


def pack_12bit(
    samples: npt.NDArray[np.uint16], *, high_first: bool = True
) -> npt.NDArray[np.uint8]:
    """Packs samples of 0 to 4095 into 12 bits each: the inverse of :func:`unpack_12bit`.

    Raises
    ------
    ValueError
        A sample is larger than 4095.

    Examples
    --------
    >>> bytes(pack_12bit(np.array([0xABC, 0xDEF], np.uint16))).hex()
    'abcdef'
    """
    packed = np.empty(packed_12bit_bytes(samples.size), np.uint8)
    _core.pack_12bit(samples, packed, high_first)
    return packed


def _tuple(shape: int | tuple[int, ...]) -> tuple[int, ...]:
    return (shape,) if isinstance(shape, int) else tuple(shape)
