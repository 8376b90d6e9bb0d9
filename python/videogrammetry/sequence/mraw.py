"""Photron recordings: a ``.cihx`` or ``.cih`` header with the samples in a ``.mraw`` beside it.

The ``.mraw`` has all frames one after the other and nothing else: 8 bit, 16 bit
(little-endian) or 12 bit packed, two samples in three bytes with the first one's
upper eight bits first. It is mapped into memory, so that a frame of 8 or 16 bit
is read without a copy, and one of 12 bit can be recognised where it stands.
"""

from __future__ import annotations

import os
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from videogrammetry.errors import SequenceError
from videogrammetry.sequence import photron_header
from videogrammetry.sequence.packing import PackedPicture, packed_12bit_bytes, unpack_12bit
from videogrammetry.sequence.photron_header import PhotronHeader
from videogrammetry.sequence.source import check_index
from videogrammetry.types import FrameSource

HEADER_SUFFIXES = (".cihx", ".cih")
SAMPLES_SUFFIX = ".mraw"
SUFFIXES = (*HEADER_SUFFIXES, SAMPLES_SUFFIX)


class MrawSource:
    """The frames of one Photron recording.

    Attributes
    ----------
    header : all that the header says. paths : the header and the ``.mraw``.
    """

    def __init__(self, header_path: Path, samples_path: Path, header: PhotronHeader) -> None:
        self.header = header
        self.paths = (header_path, samples_path)
        self._frames = _map_frames(header_path, samples_path, header)
        spare = header.stored_bits - header.effective_bits
        self._shift = spare if header.upper and spare > 0 else 0

    @property
    def image_size_px(self) -> tuple[int, int]:
        """(width, height)."""
        return self.header.image_size_px

    @property
    def frame_rate_hz(self) -> float | None:
        """Frames a second that the camera took.

        Where only every n-th frame was saved (``save_step``), those in the file
        are n times further apart; headers are not reliable in this, so it is
        said and left to the user.
        """
        return self.header.record_rate_hz

    @property
    def save_step(self) -> int:
        """Every n-th frame was saved, as the header says."""
        return self.header.save_step

    @property
    def exposure_s(self) -> float | None:
        """Exposure time of a frame."""
        return self.header.exposure_s

    @property
    def bit_depth(self) -> int:
        """Bits that count: samples are 0 to 2**bit_depth - 1."""
        return min(self.header.stored_bits, self.header.effective_bits)

    @property
    def camera_name(self) -> str:
        """What the camera is called in the header, else its type."""
        return self.header.camera_name or self.header.device

    @property
    def date(self) -> datetime | None:
        """When it was recorded."""
        return self.header.date

    @property
    def origin(self) -> str:
        """Camera, date and rate of the recording, in words."""
        header = self.header
        rate = header.record_rate_hz
        parts = [
            header.camera_name,
            header.device,
            "" if header.date is None else f"{header.date:%Y-%m-%d %H:%M}",
            "" if rate is None else f"recorded at {rate:g} Hz",
            "" if header.save_step == 1 else f"header: 1 in {header.save_step} frames saved",
        ]
        return ", ".join(part for part in parts if part)

    def __len__(self) -> int:
        return self.header.num_frames

    def name(self, index: int) -> str:
        """The header's name, with ``#n`` from 1 where there are several frames."""
        check_index(index, len(self), str(self.paths[0]))
        name = self.paths[0].name
        return name if len(self) == 1 else f"{name}#{index + 1}"

    def read(self, index: int) -> npt.NDArray[Any]:
        """The frame: (height, width), uint8 or uint16; a read-only view where none is decoded."""
        check_index(index, len(self), str(self.paths[0]))
        width, height = self.image_size_px
        frame = self._frames[index]
        if self.header.stored_bits == 12:
            samples = unpack_12bit(frame, (height, width))
        else:
            native = frame.dtype.newbyteorder("=")
            samples = frame.reshape(height, width).astype(native, copy=False)
        return samples >> samples.dtype.type(self._shift) if self._shift else samples

    def packed(self, index: int) -> PackedPicture | None:
        """The frame's packed samples in the mapped file, not copied.

        None where ``read`` is to be used: other bits than 12, an odd width, or
        samples that have to be shifted.
        """
        check_index(index, len(self), str(self.paths[0]))
        width, height = self.image_size_px
        if self.header.stored_bits != 12 or self._shift or width % 2:
            return None
        return PackedPicture(data=self._frames[index], shape=(height, width))


def open_file(path: Path) -> FrameSource:
    """A Photron recording, by its ``.cihx`` or ``.cih`` header or by its ``.mraw``.

    Raises
    ------
    SequenceError
        One of the two files is missing, cut short or damaged, or they do not
        belong together; or samples of a kind that cannot be measured in.
    """
    if path.suffix.lower() == SAMPLES_SUFFIX:
        headers = [found for suffix in HEADER_SUFFIXES if (found := _beside(path, suffix))]
        if not headers:
            raise SequenceError(
                f"{path}: its header is missing: a recording is {path.stem}{SAMPLES_SUFFIX} with "
                f"{path.stem}.cihx or {path.stem}.cih beside it, which says how large the frames "
                "are; copy the header there too"
            )
        path = headers[0]
        if path.stat().st_size == 0:
            raise SequenceError(f"{path}: the file is empty (0 bytes); copy it again")
    header = photron_header.read_header(path)
    samples_path = _beside(path, SAMPLES_SUFFIX)
    if samples_path is None:
        raise SequenceError(
            f"{path}: the frames are missing: there is no {path.stem}{SAMPLES_SUFFIX} beside "
            "this header; copy it there too"
        )
    return MrawSource(path, samples_path, header)


def one_of_each_recording(paths: list[Path]) -> list[Path]:
    """Of the files of one recording the first kind of .cihx, .cih, .mraw; others stay.

    Left out, too, are headers that were saved with pictures (TIFF, PNG, ...) and
    not with a ``.mraw``, unless there is nothing else.
    """
    best: dict[tuple[Path, str], Path] = {}
    for path in paths:
        if path.suffix.lower() in SUFFIXES:
            key = (path.parent, path.stem)
            if key not in best or _rank(path) < _rank(best[key]):
                best[key] = path
    chosen = set(best.values())
    kept = [p for p in paths if p.suffix.lower() not in SUFFIXES or p in chosen]
    without = [p for p in kept if not _is_of_pictures(p)]
    return without or kept


def _rank(path: Path) -> int:
    return SUFFIXES.index(path.suffix.lower())


def _is_of_pictures(path: Path) -> bool:
    if path.suffix.lower() not in HEADER_SUFFIXES:
        return False
    return photron_header.file_format(path).lower() not in ("", "mraw")


def _beside(path: Path, suffix: str) -> Path | None:
    """The file of the same stem with ``suffix`` in whichever case."""
    names = [path.stem + suffix, path.stem + suffix.upper()]
    there = (path.with_name(name) for name in names)
    found = next((p for p in there if p.is_file()), None)
    if found is not None:
        return found
    others = (p for p in path.parent.iterdir() if p.stem == path.stem)
    return next((p for p in others if p.suffix.lower() == suffix and p.is_file()), None)


def _map_frames(header_path: Path, path: Path, header: PhotronHeader) -> npt.NDArray[Any]:
    """(frames, samples or bytes of a frame), mapped; the file's size fits the header."""
    width, height = header.image_size_px
    pixels = width * height
    if header.stored_bits == 12 and pixels % 2:
        raise SequenceError(
            f"{header_path}: frames of {width}x{height} px have an odd number of samples of 12 "
            "bit, so that it is not known where the second one begins; save the recording as "
            "MRaw with 16 bit"
        )
    frame_bytes = (
        packed_12bit_bytes(pixels) if header.stored_bits == 12 else pixels * header.stored_bits // 8
    )
    size, expected = os.path.getsize(path), frame_bytes * header.num_frames
    what = (
        f"{header.num_frames} frames of {width}x{height} px and {header.stored_bits} bit by "
        f"{header_path.name}"
    )
    if size < expected:
        raise SequenceError(
            f"{path}: cut short: {size // frame_bytes} whole frames are there, {size} of "
            f"{expected} bytes for {what}; copy the file again"
        )
    if size > expected:
        raise SequenceError(
            f"{path}: {size} bytes, but {what} are {expected}: header and frames are of different "
            "recordings, or the header is damaged; copy both files again"
        )
    dtype = np.dtype("<u2") if header.stored_bits == 16 else np.dtype(np.uint8)
    try:
        mapped = np.memmap(path, dtype, mode="r")
    except (OSError, ValueError) as error:
        raise SequenceError(
            f"{path}: cannot be mapped into memory ({error}); allow reading, or copy it to a "
            "local disk"
        ) from error
    return np.asarray(mapped).reshape(header.num_frames, -1)
