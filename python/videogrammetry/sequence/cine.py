"""Phantom recordings, ``.cine``: 8 and 16 bit, 10 and 12 bit packed; mapped into memory.

Frames of 8 and 16 bits are views, turned upright; packed 12-bit ones can be recognised where
they stand (``packed``); packed 10-bit ones go through the camera's own table to linear 12
bits, as edges need.
"""

from __future__ import annotations

import struct
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from videogrammetry.errors import SequenceError
from videogrammetry.sequence.cine_header import CineHeader, parse_header
from videogrammetry.sequence.cine_table import LINEAR_12BIT
from videogrammetry.sequence.packing import PackedPicture, unpack_12bit
from videogrammetry.sequence.source import check_index
from videogrammetry.types import FrameSource

SUFFIXES = (".cine",)
#: A cine's headers, with the setup and tagged blocks, end long before this.
_HEADER_BYTES = 1 << 20
_LEAST_ANNOTATION = 8


class CineSource:
    """The frames of one cine file.

    Attributes
    ----------
    header : all that the headers say. paths : the file.
    """

    def __init__(self, path: Path, header: CineHeader) -> None:
        self.header = header
        self.paths = (path,)
        self._map = np.memmap(path, dtype=np.uint8, mode="r")
        table = self._map[header.offsets_at : header.offsets_at + 8 * header.num_frames]
        self._offsets = table.view("<u8").astype(np.int64) if len(table) else np.empty(0, np.int64)
        self._check_offsets()

    @property
    def image_size_px(self) -> tuple[int, int]:
        """(width, height)."""
        return self.header.image_size_px

    @property
    def frame_rate_hz(self) -> float | None:
        """Frames a second that the camera took."""
        return self.header.frame_rate_hz

    @property
    def exposure_s(self) -> float | None:
        """Exposure time of a frame."""
        return self.header.exposure_s

    @property
    def bit_depth(self) -> int:
        """Bits that count: samples are 0 to 2**bit_depth - 1."""
        return self.header.effective_bits

    @property
    def date(self) -> datetime | None:
        """The trigger's time."""
        return self.header.trigger_time

    @property
    def origin(self) -> str:
        """Camera, trigger and rate of the recording, in words."""
        header = self.header
        when, rate, first = header.trigger_time, header.frame_rate_hz, header.first_frame
        parts = [
            "Phantom" if header.serial is None else f"Phantom, serial {header.serial}",
            "" if when is None else f"triggered {when:%Y-%m-%d %H:%M:%S}.{when.microsecond:06d}",
            "" if rate is None else f"recorded at {rate:g} Hz",
            f"frames {first} to {first + header.num_frames - 1} from the trigger",
            "the camera's software shows it mirrored" if header.flip_h or header.flip_v else "",
        ]
        return ", ".join(part for part in parts if part)

    def __len__(self) -> int:
        return self.header.num_frames

    def name(self, index: int) -> str:
        """The file's name, with ``#n`` from 1 where there are several frames."""
        check_index(index, len(self), str(self.paths[0]))
        name = self.paths[0].name
        return name if len(self) == 1 else f"{name}#{index + 1}"

    def read(self, index: int) -> npt.NDArray[Any]:
        """The frame: (height, width), uint8 or uint16."""
        samples = self._samples(index)
        width, height = self.image_size_px
        bits = self.header.stored_bits
        if bits == 12:
            return unpack_12bit(samples, (height, width))
        if bits == 10:
            return LINEAR_12BIT[unpack_10bit(samples, (height, width))]
        frame = samples.view("<u2" if bits == 16 else np.uint8).reshape(height, width)
        native = frame.astype(frame.dtype.newbyteorder("="), copy=False)
        return native[::-1] if self.header.bottom_up else native

    def packed(self, index: int) -> PackedPicture | None:
        """The packed 12-bit samples where they stand; None of other depths."""
        if self.header.stored_bits != 12:
            return None
        width, height = self.image_size_px
        return PackedPicture(data=self._samples(index), shape=(height, width))

    def _samples(self, index: int) -> npt.NDArray[np.uint8]:
        check_index(index, len(self), str(self.paths[0]))
        begin = int(self._offsets[index])
        (annotation,) = struct.unpack("<I", self._map[begin : begin + 4].tobytes())
        first = begin + annotation
        last = first + self.header.image_bytes
        if annotation < _LEAST_ANNOTATION or last > len(self._map):
            raise SequenceError(
                f"{self.paths[0]}: frame {index + 1} of {len(self)} reaches beyond the file's end, "
                "or its head is damaged; copy the file again, or use frames before it (last = "
                f"{index})"
            )
        samples: npt.NDArray[np.uint8] = np.asarray(self._map[first:last])
        return samples

    def _check_offsets(self) -> None:
        """All frames must begin in the file and the last one end in it."""
        if not len(self):
            return
        good = (self._offsets > 0) & (self._offsets + _LEAST_ANNOTATION <= len(self._map))
        if not good.all():
            bad = int(np.flatnonzero(~good)[0])
            raise SequenceError(
                f"{self.paths[0]}: the header promises {len(self)} frames, but frame {bad + 1} "
                f"begins beyond the file's end ({len(self._map)} bytes): the file was cut short; "
                "copy it again"
            )
        self._samples(len(self) - 1)


def unpack_10bit(packed: npt.NDArray[np.uint8], shape: tuple[int, int]) -> npt.NDArray[np.uint16]:
    """Samples of 10 bits, four in five bytes with the highest bits first, to uint16.

    Examples
    --------
    >>> unpack_10bit(np.array([0xFF, 0xC0, 0x00, 0x00, 0x01], np.uint8), (1, 4)).tolist()
    [[1023, 0, 0, 1]]
    """
    count = shape[0] * shape[1]
    whole = np.zeros(5 * (-(-count // 4)), np.uint16)
    whole[: len(packed)] = packed
    a, b, c, d, e = whole.reshape(-1, 5).T
    samples = np.empty((len(a), 4), np.uint16)
    samples[:, 0] = a << 2 | b >> 6
    samples[:, 1] = (b & 0x3F) << 4 | c >> 4
    samples[:, 2] = (c & 0x0F) << 6 | d >> 2
    samples[:, 3] = (d & 0x03) << 8 | e
    return samples.reshape(-1)[:count].reshape(shape)


def open_file(path: Path) -> FrameSource:
    """A cine file as a sequence."""
    size = path.stat().st_size
    with path.open("rb") as file:
        data = file.read(min(size, _HEADER_BYTES))
    header = parse_header(path, data, size)
    if header.num_frames == 0:
        raise SequenceError(f"{path}: the recording has no frame; save it again")
    return CineSource(path, header)
