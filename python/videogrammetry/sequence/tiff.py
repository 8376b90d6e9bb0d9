"""TIFF pictures and stacks of pictures: 8 and 16 bit, and packed 9 to 15 bit.

Directories are read by tifffile, uncompressed samples straight from the file
(any thread, any page, at once), compressed ones by tifffile or, where it lacks
the codec (LZW, PackBits, JPEG), by Pillow. tifffile overlooks a directory or
strip that lies beyond the end of a file that was cut; both are checked here, and
of a stack that was cut the pages before are read, with a remark. A stack's
uncompressed pages are views of the mapped file.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import tifffile
from PIL import Image

from videogrammetry.errors import SequenceError
from videogrammetry.sequence.file_bytes import FileBytes
from videogrammetry.sequence.grey import grey_from_rgb
from videogrammetry.sequence.raster import grey_of_image
from videogrammetry.sequence.source import check_index, check_picture_size
from videogrammetry.types import FrameSource

SUFFIXES = (".tif", ".tiff")

_MIN_IS_WHITE, _MIN_IS_BLACK, _RGB = 0, 1, 2
_UNCOMPRESSED = 1
#: What the decoders raise on damaged bytes.
_DAMAGE = (
    ArithmeticError,
    tifffile.TiffFileError,
    ValueError,
    RuntimeError,
    OSError,
    KeyError,
    IndexError,
    TypeError,
    MemoryError,
    struct.error,
    zlib.error,
)


@dataclass(frozen=True)
class _Page:
    """Where the samples of one page are and how to understand them."""

    index: int  # in the chain of directories
    shape: tuple[int, int]
    bits: int
    inverted: bool
    offset: int | None  # of grey samples that stand uncompressed in one piece
    big_endian: bool


@dataclass(frozen=True)
class TiffSource:
    """The pages of one TIFF file, reduced copies (thumbnails) left out.

    Attributes
    ----------
    file : the mapped file of a stack, whose uncompressed samples are not copied.
    remarks : what is wrong with the file though it can be measured in.
    """

    path: Path
    pages: tuple[_Page, ...]
    file: FileBytes | None = None
    remarks: tuple[str, ...] = ()

    @property
    def image_size_px(self) -> tuple[int, int]:
        """(width, height)."""
        height, width = self.pages[0].shape
        return width, height

    @property
    def frame_rate_hz(self) -> float | None:
        """None: TIFF has no field for it."""
        return None

    def __len__(self) -> int:
        return len(self.pages)

    def name(self, index: int) -> str:
        """The file's name, with ``#n`` from 1 where it holds several pages."""
        check_index(index, len(self.pages), str(self.path))
        return self.path.name if len(self.pages) == 1 else f"{self.path.name}#{index + 1}"

    def read(self, index: int) -> npt.NDArray[Any]:
        """The frame: (height, width), uint8 or uint16."""
        check_index(index, len(self.pages), str(self.path))
        page = self.pages[index]
        if page.offset is not None:
            frame = _read_plain(self.path, page, self.file)
        else:
            frame = _decode(self.path, page)
        if frame.shape != page.shape:
            raise _damaged(self.path, f"page {page.index + 1} decodes to {frame.shape}")
        if page.inverted:
            frame = np.invert(frame) if page.bits in (8, 16) else (1 << page.bits) - 1 - frame
        return np.ascontiguousarray(frame)


def open_file(path: Path) -> FrameSource:
    """A TIFF file as a sequence of its pages.

    Raises
    ------
    SequenceError
        Not a TIFF, cut short, or samples of a kind that cannot be measured in.
    """
    size = path.stat().st_size
    offsets, cut = _directory_offsets(path, size)
    try:
        with tifffile.TiffFile(path, is_ome=False) as tif:
            found = list(tif.pages)[: len(offsets)]
            if [p.offset for p in found] != offsets:
                raise _damaged(path, f"{len(found)} of {len(offsets)} pages can be read")
            _check_hidden_stack(path, tif)
            pages, missing = _whole_pages(path, size, found, tif.byteorder == ">")
    except SequenceError:  # says what is wrong already
        raise
    except _DAMAGE as error:
        raise _damaged(path, str(error)) from error
    for page in pages:
        if page.shape != pages[0].shape:
            raise SequenceError(
                f"{path}: page {page.index + 1} has {page.shape[1]}x{page.shape[0]} px, the first "
                f"has {pages[0].shape[1]}x{pages[0].shape[0]} px: a sequence has one size; "
                "split the file"
            )
    remarks: tuple[str, ...] = ()
    if cut or missing:
        remarks = (
            f"{path}: the stack is cut short at byte {size}: its first {len(pages)} pages are "
            "whole and are used; copy the file again for the others",
        )
    return TiffSource(path, pages, FileBytes(path) if len(pages) > 1 else None, remarks)


class _CutShortError(SequenceError):
    """Samples lie beyond the file's end: pages before can be whole."""


def _whole_pages(
    path: Path, size: int, found: list[Any], big_endian: bool
) -> tuple[tuple[_Page, ...], bool]:
    """The pages up to the first whose samples are not all there, and whether there is one."""
    pages: list[_Page] = []
    for i, page in enumerate(found):
        if isinstance(page, tifffile.TiffPage) and not (page.is_reduced and i > 0):
            try:
                pages.append(_page_of(path, size, i, page, big_endian))
            except _CutShortError:
                if not pages:
                    raise
                return tuple(pages), True
    return tuple(pages), False


def _damaged(path: Path, what: str) -> SequenceError:
    return SequenceError(
        f"{path}: TIFF picture is damaged or cut short ({what.strip().rstrip('.')}); "
        "copy the file again"
    )


def _directory_offsets(path: Path, size: int) -> tuple[list[int], bool]:
    """Offsets of the directories that lie wholly within the file (TIFF 6.0, p. 13-15).

    And whether others, of a file that was cut short, do not.
    """
    with path.open("rb") as file:
        header = file.read(16)
        order = {b"II": "<", b"MM": ">"}.get(header[:2])
        version = struct.unpack_from(order + "H", header, 2)[0] if order and len(header) >= 4 else 0
        if order is None or version not in (42, 43):
            raise SequenceError(
                f"{path}: not a TIFF picture (its first bytes are not a TIFF's); take the file "
                "out, or give it the suffix of what it is"
            )
        count_format, entry, next_format, at = (
            ("H", 12, "I", 4) if version == 42 else ("Q", 20, "Q", 8)
        )
        offsets: dict[int, None] = {}  # in order, and quick to look into
        try:
            offset = struct.unpack_from(order + next_format, header, at)[0]
            while offset:
                if offset in offsets or len(offsets) > 10_000_000:
                    raise _damaged(path, "its directories go round in a circle")
                offsets[offset] = None
                file.seek(offset)
                raw = file.read(struct.calcsize(count_format))
                entries = struct.unpack(order + count_format, raw)[0]
                file.seek(entries * entry, 1)
                raw = file.read(struct.calcsize(next_format))
                offset = struct.unpack(order + next_format, raw)[0]
        except (struct.error, OSError, OverflowError, ValueError) as error:
            if len(offsets) > 1:
                return list(offsets)[:-1], True
            raise _damaged(
                path, f"directory {max(1, len(offsets))} lies beyond the end at byte {size}"
            ) from error
    if not offsets:
        raise _damaged(path, "it has no page")
    return list(offsets), False


def _check_hidden_stack(path: Path, tif: tifffile.TiffFile) -> None:
    """ImageJ writes stacks over 4 GB with one directory: the others would be overlooked."""
    if tif.is_imagej and tif.imagej_metadata is not None:
        images = int(tif.imagej_metadata.get("images", 1))
        if images > len(tif.pages):
            raise SequenceError(
                f"{path}: ImageJ stack of {images} pictures with {len(tif.pages)} directories; "
                "save it as BigTIFF or as single pictures"
            )


def _page_of(path: Path, size: int, index: int, page: tifffile.TiffPage, big_endian: bool) -> _Page:
    where = f"{path}: page {index + 1}"
    kind, bits = page.dtype.kind if page.dtype is not None else "?", page.bitspersample
    grey = page.photometric in (_MIN_IS_WHITE, _MIN_IS_BLACK) and page.samplesperpixel <= 2
    if not (kind == "u" and (bits in (8, 16) or (grey and 8 < bits < 16))):
        raise SequenceError(
            f"{where} has {bits}-bit samples of type {page.dtype}; save it as 8- or 16-bit grey"
        )
    numbers = (page.imagewidth, page.imagelength, page.samplesperpixel, bits)
    if not all(isinstance(n, int) for n in (*numbers, *page.dataoffsets, *page.databytecounts)):
        raise SequenceError(
            f"{where} of the TIFF states sizes or places that are no whole numbers: it is damaged; "
            "copy the file again"
        )
    check_picture_size(path, page.imagewidth, page.imagelength)
    _check_segments(where, size, page)
    plain = (
        page.compression == _UNCOMPRESSED
        and grey
        and page.samplesperpixel == 1
        and page.fillorder == 1
        and not page.is_tiled
        and _in_one_piece(page)
    )
    if bits not in (8, 16) and not plain:
        raise SequenceError(
            f"{where} has compressed {bits}-bit samples; save it uncompressed or with 16 bit"
        )
    return _Page(
        index=index,
        shape=(page.imagelength, page.imagewidth),
        bits=bits,
        inverted=page.photometric == _MIN_IS_WHITE,
        offset=page.dataoffsets[0] if plain else None,
        big_endian=big_endian,
    )


def _check_segments(where: str, size: int, page: tifffile.TiffPage) -> None:
    """All strips or tiles are within the file and none is missing."""
    offsets, counts = page.dataoffsets, page.databytecounts
    if not offsets or len(offsets) != len(counts):
        raise SequenceError(f"{where} of the TIFF has no samples; copy the file again")
    for number, (offset, count) in enumerate(zip(offsets, counts, strict=True), start=1):
        if count == 0 or offset == 0 or offset + count > size:
            raise _CutShortError(
                f"{where} of the TIFF is cut short: part {number} of {len(offsets)} should end at "
                f"byte {offset + count}, the file has {size}; copy the file again"
            )
    if page.compression == _UNCOMPRESSED:
        expected = _row_bytes(page) * page.imagelength
        if sum(counts) < expected:
            raise SequenceError(
                f"{where} of the TIFF has {sum(counts)} of {expected} bytes of samples; "
                "copy the file again"
            )


def _row_bytes(page: tifffile.TiffPage) -> int:
    return (page.imagewidth * page.samplesperpixel * page.bitspersample + 7) // 8


def _in_one_piece(page: tifffile.TiffPage) -> bool:
    ends = [o + c for o, c in zip(page.dataoffsets, page.databytecounts, strict=True)]
    return all(end == start for end, start in zip(ends, page.dataoffsets[1:], strict=False))


def _read_plain(path: Path, page: _Page, mapped: FileBytes | None) -> npt.NDArray[Any]:
    height, width = page.shape
    row_bytes = (width * page.bits + 7) // 8
    begin, what = page.offset or 0, f"page {page.index + 1}"
    # (a single picture is read at once: mapping thousands of files keeps them all open)
    file = mapped or FileBytes(path, mapped=False)
    data = file.view(begin, begin + row_bytes * height, what)
    if page.bits == 8:
        return data.reshape(height, width)
    if page.bits == 16:
        words = data.view(">u2" if page.big_endian else "<u2").reshape(height, width)
        return np.require(words, np.uint16, ["C", "A"])
    # Packed samples: the most significant bit first, every row from a new byte.
    rows = data.reshape(height, row_bytes)
    bits = np.unpackbits(rows, axis=1, count=width * page.bits).reshape(height, width, page.bits)
    weights = (1 << np.arange(page.bits - 1, -1, -1)).astype(np.uint16)
    return np.asarray(bits @ weights, dtype=np.uint16)


def _decode(path: Path, page: _Page) -> npt.NDArray[Any]:
    """Samples that are compressed, tiled, in colour or with transparency."""
    try:
        with tifffile.TiffFile(path, is_ome=False) as tif:
            tif_page = tif.pages[page.index].aspage()
            try:
                samples = tif_page.asarray(maxworkers=1)
            except (KeyError, ValueError) as error:
                if "imagecodecs" not in str(error):
                    raise
                return _decode_by_pillow(path, page)
            return _grey_of_samples(path, samples, tif_page)
    except SequenceError:
        raise
    except _DAMAGE as error:
        raise _damaged(path, f"page {page.index + 1}: {error}") from error


def _decode_by_pillow(path: Path, page: _Page) -> npt.NDArray[Any]:
    with Image.open(path, formats=["TIFF"]) as image:
        image.seek(page.index)
        image.load()
        frame = grey_of_image(image, path)
    if page.bits > 8 and frame.dtype == np.uint8:
        raise SequenceError(
            f"{path}: page {page.index + 1} has compressed {page.bits}-bit colours that would lose "
            "half of their bits here; save it uncompressed or as 16-bit grey"
        )
    # Pillow has already turned pictures whose smallest value is white, 8 bit only.
    return np.invert(frame) if page.inverted and frame.dtype == np.uint8 else frame


def _grey_of_samples(
    path: Path, samples: npt.NDArray[Any], page: tifffile.TiffPage
) -> npt.NDArray[Any]:
    if samples.ndim == 3 and page.planarconfig == 2:
        samples = np.moveaxis(samples, 0, -1)
    if samples.ndim == 2 and page.photometric in (_MIN_IS_WHITE, _MIN_IS_BLACK):
        return samples.astype(samples.dtype.newbyteorder("="), copy=False)
    if samples.ndim == 3 and page.photometric in (_MIN_IS_WHITE, _MIN_IS_BLACK):
        return samples[:, :, 0]
    if samples.ndim == 3 and page.photometric == _RGB and samples.shape[2] >= 3:
        return grey_from_rgb(samples)
    raise SequenceError(
        f"{path}: page {page.index + 1} is neither grey nor RGB (photometric {page.photometric}); "
        "save it in grey"
    )
