"""Photron recordings: a ``.cihx`` or ``.cih`` header with the samples in a ``.mraw`` beside it.

The ``.mraw`` has all frames one after the other and nothing else: 8 bit, 16 bit
(little-endian) or 12 bit packed, two samples in three bytes with the first one's
upper eight bits first. It is mapped into memory, so that a frame of 8 or 16 bit
is read without a copy, and one of 12 bit can be recognised where it stands. Of a
file that was cut short the whole frames are read, with a remark.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from videogrammetry.errors import SequenceError
from videogrammetry.sequence import photron_header
from videogrammetry.sequence.file_bytes import FileBytes
from videogrammetry.sequence.packing import PackedPicture, packed_12bit_bytes, unpack_12bit
from videogrammetry.sequence.photron_header import PhotronHeader
from videogrammetry.sequence.recording import RecordingFacts, RecordingSource, joined_words
from videogrammetry.types import FrameSource

HEADER_SUFFIXES = (".cihx", ".cih")
SAMPLES_SUFFIX = ".mraw"
SUFFIXES = (*HEADER_SUFFIXES, SAMPLES_SUFFIX)


class MrawSource(RecordingSource):
    """The frames of one Photron recording.

    Attributes
    ----------
    header : all that the header says. paths : the header and the ``.mraw``.
    packing : of 12-bit samples: "high-first", as Photron's software writes, or "low-first".
    """

    def __init__(
        self,
        header_path: Path,
        samples_path: Path,
        header: PhotronHeader,
        *,
        growing: bool = False,
    ) -> None:
        self.header = header
        self._file = FileBytes(samples_path)
        self._frame_bytes = frame_bytes(header_path, header)
        whole, remark = header.num_frames, ""
        if not growing:
            whole, remark = _whole_frames(header_path, self._file, header, self._frame_bytes)
        super().__init__(
            (header_path, samples_path), _facts(header, whole), [remark] if remark else []
        )
        spare = header.stored_bits - header.effective_bits
        self._shift = spare if header.upper and spare > 0 else 0
        self.packing = "high-first"
        # (the first frame alone may be dark)
        if header.stored_bits == 12 and any(
            looks_low_first(self._stored(k), header.image_size_px)
            for k in sorted({0, whole // 2, whole - 1})
        ):
            self.packing = "low-first"
            self.remarks += (
                f"{samples_path}: the packed 12-bit samples stand with their lowest bits first, "
                "as neighbours show that are alike only then; they are read so",
            )

    def read(self, index: int) -> npt.NDArray[Any]:
        """The frame: (height, width), uint8 or uint16; a read-only view where none is decoded."""
        self._check(index)
        width, height = self.image_size_px
        stored = self._stored(index)
        if self.header.stored_bits == 12:
            samples = unpack_12bit(stored, (height, width), high_first=self.packing == "high-first")
        else:
            kind = np.dtype("<u2") if self.header.stored_bits == 16 else np.dtype(np.uint8)
            frame = stored.view(kind).reshape(height, width)
            samples = frame.astype(kind.newbyteorder("="), copy=False)
        return samples >> samples.dtype.type(self._shift) if self._shift else samples

    def packed(self, index: int) -> PackedPicture | None:
        """The frame's packed samples in the mapped file, not copied.

        None where ``read`` is to be used: other bits than 12, an odd width, or
        samples that have to be shifted.
        """
        self._check(index)
        width, height = self.image_size_px
        if self.header.stored_bits != 12 or self._shift or width % 2:
            return None
        return PackedPicture(data=self._stored(index), shape=(height, width), order=self.packing)

    def _stored(self, index: int) -> npt.NDArray[np.uint8]:
        begin = index * self._frame_bytes
        return self._file.view(begin, begin + self._frame_bytes, f"frame {index + 1}")


def _facts(header: PhotronHeader, num_frames: int) -> RecordingFacts:
    rate = header.record_rate_hz
    several = header.num_partitions is not None and header.num_partitions > 1
    return RecordingFacts(
        image_size_px=header.image_size_px,
        num_frames=num_frames,
        bit_depth=min(header.stored_bits, header.effective_bits),
        frame_rate_hz=rate,
        exposure_s=header.exposure_s,
        first_frame=header.first_frame,
        save_step=header.save_step,
        date=header.date,
        camera_name=header.camera_name or header.device,
        origin=joined_words(
            header.camera_name,
            header.device,
            "" if header.date is None else f"{header.date:%Y-%m-%d %H:%M}",
            "" if rate is None else f"recorded at {rate:g} Hz",
            "" if header.save_step == 1 else f"header: 1 in {header.save_step} frames saved",
            f"partition {header.partition} of {header.num_partitions}" if several else "",
        ),
    )


def open_file(path: Path) -> FrameSource:
    """A Photron recording, by its ``.cihx`` or ``.cih`` header or by its ``.mraw``.

    Raises
    ------
    SequenceError
        One of the two files is missing, cut short or damaged, or they do not
        belong together; or samples of a kind that cannot be measured in.
    """
    header_path, samples_path = files_of_recording(path)
    return MrawSource(header_path, samples_path, photron_header.read_header(header_path))


def files_of_recording(path: Path, *, growing: bool = False) -> tuple[Path, Path]:
    """The header and the ``.mraw`` that one of them means; ``growing``: the latter may come."""
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
    samples_path = _beside(path, SAMPLES_SUFFIX)
    if samples_path is None and growing:
        samples_path = path.with_suffix(SAMPLES_SUFFIX)
    if samples_path is None:
        photron_header.read_header(path)  # whose message goes first
        raise SequenceError(
            f"{path}: the frames are missing: there is no {path.stem}{SAMPLES_SUFFIX} beside "
            "this header; copy it there too"
        )
    return path, samples_path


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


def frame_bytes(header_path: Path, header: PhotronHeader) -> int:
    """Bytes that a frame takes in the ``.mraw``."""
    width, height = header.image_size_px
    pixels = width * height
    if header.stored_bits == 12 and pixels % 2:
        raise SequenceError(
            f"{header_path}: frames of {width}x{height} px have an odd number of samples of 12 "
            "bit, so that it is not known where the second one begins; save the recording as "
            "MRaw with 16 bit"
        )
    return (
        packed_12bit_bytes(pixels) if header.stored_bits == 12 else pixels * header.stored_bits // 8
    )


def _whole_frames(
    header_path: Path, file: FileBytes, header: PhotronHeader, each: int
) -> tuple[int, str]:
    """How many frames are there as a whole, and what is to be said of it."""
    width, height = header.image_size_px
    expected = each * header.num_frames
    whole = file.size // each
    what = (
        f"{header.num_frames} frames of {width}x{height} px and {header.stored_bits} bit by "
        f"{header_path.name}"
    )
    if file.size > expected:
        raise SequenceError(
            f"{file.path}: {file.size} bytes, but {what} are {expected}: header and frames are of "
            "different recordings, or the header is damaged; copy both files again"
        )
    if file.size == expected:
        return whole, ""
    cut = (
        f"{file.path}: cut short: {whole} whole frames are there, {file.size} of {expected} bytes "
        f"for {what}"
    )
    if whole == 0:
        raise SequenceError(f"{cut}; copy the file again")
    return whole, f"{cut}; these {whole} are used; copy the file again for the others"


def looks_low_first(packed: npt.NDArray[np.uint8], image_size_px: tuple[int, int]) -> bool:
    """Whether packed samples make a picture only if their lowest bits stand first.

    No header says the order. Neighbours of a picture are alike: read the wrong way, one's
    upper four bits are the other's lower ones, and differences are many times as large. Where
    both ways look alike (noise, an even frame), it is the usual order.
    """
    width, height = image_size_px
    rows = max(1, min(height, 65536 // width))
    first = (height - rows) // 2
    if width % 2:  # rows begin in the middle of a byte
        return False
    part = np.ascontiguousarray(packed[first * width * 3 // 2 : (first + rows) * width * 3 // 2])
    rough = [
        float(
            np.abs(np.diff(unpack_12bit(part, (rows, width), high_first=way).astype(float))).sum()
        )
        for way in (True, False)
    ]
    return rough[1] < 0.5 * rough[0]
