"""PGM, plain (P2) and binary (P5), 8 and 16 bit; values are kept as they stand.

Netpbm's definition: https://netpbm.sourceforge.net/doc/pgm.html. Read here and
not with Pillow, which stretches values where maxval is neither 255 nor 65535.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from videogrammetry.errors import SequenceError
from videogrammetry.sequence.source import PictureSource, check_picture_size
from videogrammetry.types import FrameSource

SUFFIXES = (".pgm",)

_GAP = rb"(?:\s|#[^\n\r]*[\n\r])+"
_HEADER = re.compile(
    rb"(P[1-7])" + _GAP + rb"(\d{1,9})" + _GAP + rb"(\d{1,9})" + _GAP + rb"(\d{1,5})\s"
)
_HEADER_BYTES = 4096


def open_file(path: Path) -> FrameSource:
    """A PGM file as a sequence of one frame."""
    with path.open("rb") as file:
        _, width, height, _, _ = _header(path, file.read(_HEADER_BYTES))
    return PictureSource(path, (width, height), _decode)


def _header(path: Path, data: bytes) -> tuple[bytes, int, int, int, int]:
    """Magic, width, height, maxval and where the samples begin."""
    match = _HEADER.match(data)
    if match is None or match[1] not in (b"P2", b"P5"):
        raise SequenceError(
            f"{path}: not a grey PGM picture (P2 or P5 with width, height and maxval); "
            "save it as PGM, PNG or TIFF in grey"
        )
    width, height, maxval = (int(match[i]) for i in (2, 3, 4))
    if not (width > 0 and height > 0 and 0 < maxval < 65536):
        raise SequenceError(
            f"{path}: PGM header says {width}x{height} px, maxval {maxval}, which cannot be; "
            "save the picture again"
        )
    check_picture_size(path, width, height)
    return match[1], width, height, maxval, match.end()


def _decode(path: Path) -> npt.NDArray[Any]:
    data = path.read_bytes()
    magic, width, height, maxval, start = _header(path, data[:_HEADER_BYTES])
    samples = _plain_samples(path, data[start:]) if magic == b"P2" else data[start:]
    dtype = np.dtype(np.uint8 if maxval < 256 else ">u2")
    bytes_each = 1 if magic == b"P2" else dtype.itemsize
    count = width * height
    _check_count(path, samples, bytes_each, count)
    if isinstance(samples, bytes):
        frame = np.frombuffer(samples, dtype, count)
    else:
        if max(samples) > maxval:
            raise SequenceError(
                f"{path}: PGM sample {max(samples)} is larger than maxval {maxval}; save it again"
            )
        frame = np.array(samples, dtype=dtype)
    return np.ascontiguousarray(frame.reshape(height, width), dtype=dtype.newbyteorder("="))


def _plain_samples(path: Path, text: bytes) -> list[int]:
    if text[-1:].isdigit():
        raise SequenceError(
            f"{path}: cut short, no white space ends the last PGM sample; copy the file again"
        )
    words = re.sub(rb"#[^\n\r]*", b"", text).split()
    for word in words:
        if not word.isdigit():
            raise SequenceError(
                f"{path}: {word.decode('ascii', 'replace')!r} stands where a PGM sample is due; "
                "save the picture again"
            )
    return [int(word) for word in words]


def _check_count(path: Path, samples: bytes | list[int], bytes_each: int, count: int) -> None:
    got = len(samples) // bytes_each
    if got < count:
        raise SequenceError(
            f"{path}: cut short, {got} of {count} PGM samples are there; copy the file again"
        )
    rest = samples[count * bytes_each :]
    if rest if isinstance(rest, list) else rest.strip():
        raise SequenceError(
            f"{path}: more than the {count} PGM samples of its header: several pictures in one "
            "file, or a damaged header; split or save it again"
        )
