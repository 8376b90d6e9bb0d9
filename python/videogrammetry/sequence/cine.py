"""Phantom recordings, ``.cine``: 8 and 16 bit, 10 and 12 bit packed; mapped into memory.

Frames of 8 and 16 bits mostly stand from the lowest row up and are turned upright; packed
12-bit ones can be recognised where they stand (``packed``); packed 10-bit ones go through the
camera's own table to linear 12 bits, as edges need. Of a file cut short the whole frames are
read, with a remark.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from videogrammetry.errors import SequenceError
from videogrammetry.sequence.cine_header import CineHeader, parse_header
from videogrammetry.sequence.cine_table import LINEAR_12BIT
from videogrammetry.sequence.file_bytes import FileBytes
from videogrammetry.sequence.packing import PackedPicture, unpack_12bit
from videogrammetry.sequence.recording import (
    FloatArray,
    RecordingFacts,
    RecordingSource,
    joined_words,
)
from videogrammetry.types import FrameSource

SUFFIXES = (".cine",)
#: A cine's headers, with the setup and tagged blocks, end long before this.
_HEADER_BYTES = 1 << 20
#: Bytes of the note before a frame's samples, with its own length and theirs.
_LEAST_ANNOTATION, _LARGEST_ANNOTATION = 8, 1 << 24


class CineSource(RecordingSource):
    """The frames of one cine file.

    Attributes
    ----------
    header : all that the headers say. paths : the file.
    """

    def __init__(self, path: Path, header: CineHeader, file: FileBytes | None = None) -> None:
        self.header = header
        self._file = file or FileBytes(path)
        self._offsets = self._frame_offsets()
        whole = self._whole_frames()
        remarks = []
        if whole < header.num_frames:
            cut = (
                f"{path}: the header promises {header.num_frames} frames, but frame {whole + 1} "
                f"begins or reaches beyond the file's end ({self._file.size} bytes): the file was "
                "cut short"
            )
            if whole == 0:
                raise SequenceError(f"{cut}; copy it again")
            remarks.append(f"{cut}; the {whole} frames before are used; copy it again for the rest")
        super().__init__((path,), _facts(header, whole), remarks)

    def read(self, index: int) -> npt.NDArray[Any]:
        """The frame: (height, width), uint8 or uint16; a view where it stands upright."""
        samples = self._samples(index)
        width, height = self.image_size_px
        bits = self.header.stored_bits
        if bits == 12:
            return unpack_12bit(samples, (height, width))
        if bits == 10:
            return LINEAR_12BIT[unpack_10bit(samples, (height, width))]
        kind = np.dtype("<u2") if bits == 16 else np.dtype(np.uint8)
        frame = samples.view(kind).reshape(height, width)
        if self.header.bottom_up:
            frame = frame[::-1]
        # Samples begin wherever the note before them ends: an odd place is no array of words.
        return np.require(frame, kind.newbyteorder("="), ["C", "A"])

    def packed(self, index: int) -> PackedPicture | None:
        """The packed 12-bit samples where they stand; None of other depths and odd widths."""
        width, height = self.image_size_px
        if self.header.stored_bits != 12 or width % 2:
            return None
        return PackedPicture(data=self._samples(index), shape=(height, width))

    def times_s(self) -> FloatArray | None:
        """(N,) the camera's time stamps, seconds from the trigger; None where there are none."""
        header = self.header
        if header.times_at is None or header.trigger is None:
            return None
        end = header.times_at + 8 * header.num_frames
        stamps = self._file.view(header.times_at, end, "the table of time stamps")
        fraction, seconds = stamps.view("<u4").reshape(-1, 2).T[:, : len(self)].astype(np.int64)
        # The two lowest bits of a fraction are flags (event, clock locked).
        ticks = (fraction & ~3) - (header.trigger[1] & ~3)
        return np.asarray((seconds - header.trigger[0]) + ticks / 2.0**32, np.float64)

    def _samples(self, index: int) -> npt.NDArray[np.uint8]:
        self._check(index)
        begin = int(self._offsets[index])
        what = f"frame {index + 1} of {len(self)}"
        head = self._file.view(begin, begin + 4, what)
        (annotation,) = struct.unpack("<I", head.tobytes())
        if not _LEAST_ANNOTATION <= annotation <= _LARGEST_ANNOTATION:
            raise SequenceError(
                f"{self.paths[0]}: the head of {what} at byte {begin} is damaged (a note of "
                f"{annotation} bytes); copy the file again, or use frames before it (last = "
                f"{index})"
            )
        first = begin + annotation
        return self._file.view(first, first + self.header.image_bytes, what)

    def _frame_offsets(self) -> npt.NDArray[np.int64]:
        """(N,) where each frame begins; the oldest files count in four bytes."""
        each = self.header.offset_bytes
        begin = self.header.offsets_at
        table = self._file.view(
            begin, begin + each * self.header.num_frames, "the table of its pictures"
        )
        return table.view("<u8" if each == 8 else "<u4").astype(np.int64)

    def _whole_frames(self) -> int:
        """Frames, from the first on, that lie in the file."""
        ends = self._offsets + _LEAST_ANNOTATION
        # (in this order: a damaged offset near 2**63 must not run over)
        good = (self._offsets > 0) & (ends > 0) & (ends <= self._file.size)
        good &= self._offsets <= self._file.size - _LEAST_ANNOTATION - self.header.image_bytes
        whole = len(good) if good.all() else int(np.argmin(good))
        while whole and not self._ends_in_the_file(int(self._offsets[whole - 1])):
            whole -= 1
        return whole

    def _ends_in_the_file(self, begin: int) -> bool:
        """Whether a frame with the note before it does; the others are asked when read."""
        note = int(self._file.view(begin, begin + 4, "a frame's head").view("<u4")[0])
        good = _LEAST_ANNOTATION <= note <= _LARGEST_ANNOTATION
        return good and begin + note + self.header.image_bytes <= self._file.size


def _facts(header: CineHeader, num_frames: int) -> RecordingFacts:
    when, rate, first = header.trigger_time, header.frame_rate_hz, header.first_frame
    return RecordingFacts(
        image_size_px=header.image_size_px,
        num_frames=num_frames,
        bit_depth=header.effective_bits,
        frame_rate_hz=rate,
        exposure_s=header.exposure_s,
        first_frame=first,
        trigger_time=when,
        date=when,
        camera_name="" if header.serial is None else f"Phantom {header.serial}",
        origin=joined_words(
            "Phantom" if header.serial is None else f"Phantom, serial {header.serial}",
            "" if when is None else f"triggered {when:%Y-%m-%d %H:%M:%S}.{when.microsecond:06d}",
            "" if rate is None else f"recorded at {rate:g} Hz",
            f"frames {first} to {first + num_frames - 1} from the trigger"
            + ("" if num_frames == header.total_frames else f" (of {header.total_frames} taken)"),
            "the camera's software shows it mirrored" if header.flip_h or header.flip_v else "",
        ),
    )


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
    file = FileBytes(path)
    data = file.view(0, min(file.size, _HEADER_BYTES), "the header").tobytes()
    header = parse_header(path, data, file.size)
    if header.num_frames == 0:
        raise SequenceError(f"{path}: the recording has no frame; save it again")
    return CineSource(path, header, file)
