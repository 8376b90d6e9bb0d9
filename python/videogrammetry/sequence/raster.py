"""PNG, BMP and JPEG pictures, grey or colour, decoded by Pillow.

Pillow accepts some files that end too early; what must be there is therefore
checked here first. An orientation noted by a photo camera (EXIF) is left alone:
coordinates are those of the sensor. Transparency is left out.
"""

from __future__ import annotations

import io
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image

from videogrammetry.errors import SequenceError
from videogrammetry.sequence.grey import grey_from_rgb
from videogrammetry.sequence.source import PictureSource, check_picture_size
from videogrammetry.types import FrameSource

SUFFIXES = (".png", ".bmp", ".jpg", ".jpeg")

_FORMAT = {".png": "PNG", ".bmp": "BMP", ".jpg": "JPEG", ".jpeg": "JPEG"}
_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_PNG_COLOUR_TYPES = (2, 4, 6)


def open_file(path: Path) -> FrameSource:
    """A PNG, BMP or JPEG file as a sequence of one frame."""
    with path.open("rb") as file:
        image = _open(path, file)
        size = image.size
        image.close()
    check_picture_size(path, *size)
    return PictureSource(path, size, _decode)


def _open(path: Path, file: Any) -> Image.Image:
    kind = _FORMAT[path.suffix.lower()]
    try:
        return Image.open(file, formats=[kind])
    except Image.DecompressionBombError as error:
        raise SequenceError(f"{path}: larger than any camera's picture ({error})") from error
    except (OSError, SyntaxError, ValueError, struct.error) as error:
        raise SequenceError(
            f"{path}: not a {kind} picture, or its header is damaged; take the file out, or give "
            "it the suffix of what it is"
        ) from error


def _decode(path: Path) -> npt.NDArray[Any]:
    data = path.read_bytes()
    kind = _FORMAT[path.suffix.lower()]
    if kind == "PNG":
        _check_png(path, data)
    elif kind == "JPEG":
        _check_jpeg(path, data)
    with _open(path, io.BytesIO(data)) as image:
        try:
            if kind == "JPEG":
                image.draft("L", None)  # luminance alone, if that is how it is stored
            image.load()
        except (
            OSError,
            SyntaxError,
            ValueError,
            IndexError,
            MemoryError,
            struct.error,
            zlib.error,
        ) as error:
            raise SequenceError(
                f"{path}: the {kind} picture is damaged or cut short ({error}); copy it again"
            ) from error
        return grey_of_image(image, path)


def grey_of_image(image: Image.Image, path: Path) -> npt.NDArray[Any]:
    """Grey values (height, width), uint8 or uint16, of a picture that Pillow has loaded."""
    if image.mode.startswith("I;16"):
        return np.ascontiguousarray(np.asarray(image), dtype=np.uint16)
    if image.mode in ("L", "LA", "1"):
        return np.ascontiguousarray(np.asarray(image.convert("L")))
    if image.mode == "I":  # 16-bit grey in some versions of Pillow
        values = np.asarray(image)
        if values.min() >= 0 and values.max() <= 65535:
            return np.ascontiguousarray(values, dtype=np.uint16)
    if image.mode in ("P", "PA", "RGB", "RGBA", "RGBX", "CMYK", "YCbCr"):
        return np.ascontiguousarray(grey_from_rgb(np.asarray(image.convert("RGB"))))
    raise SequenceError(
        f"{path}: pictures of mode {image.mode} cannot be measured in; save it in grey, 8 or 16 bit"
    )


def _check_png(path: Path, data: bytes) -> None:
    """Every chunk whole with its check sum right, IEND at the end; no 16-bit colour."""
    at, chunk = len(_PNG_SIGNATURE), b""
    while chunk != b"IEND":
        if at + 12 > len(data):
            raise SequenceError(f"{path}: PNG picture cut short; copy the file again")
        length, chunk = struct.unpack_from(">I4s", data, at)
        end = at + 12 + length
        if end > len(data):
            raise SequenceError(f"{path}: PNG picture cut short; copy the file again")
        if zlib.crc32(data[at + 4 : end - 4]) != struct.unpack_from(">I", data, end - 4)[0]:
            raise SequenceError(
                f"{path}: PNG picture is damaged (check sum of {chunk!r} at byte {at}); "
                "copy the file again"
            )
        if chunk == b"IHDR" and length == 13:
            depth, colour_type = data[at + 16], data[at + 17]
            if depth == 16 and colour_type in _PNG_COLOUR_TYPES:
                raise SequenceError(
                    f"{path}: 16-bit colour PNG would lose half of its bits here; "
                    "save it as 16-bit grey without transparency"
                )
        at = end


def _check_jpeg(path: Path, data: bytes) -> None:
    """The end marker stands after the start of the scan (not in an embedded thumbnail)."""
    at = 2
    while at + 4 <= len(data) and data[at] == 0xFF:
        marker = data[at + 1]
        if marker == 0xDA:
            if data.find(b"\xff\xd9", at) > 0:
                return
            break
        if marker == 0xFF or marker == 0x01 or 0xD0 <= marker <= 0xD8:
            at += 1 if marker == 0xFF else 2
        else:
            at += 2 + int(struct.unpack_from(">H", data, at + 2)[0])
    raise SequenceError(f"{path}: JPEG picture cut short, its end is missing; copy the file again")
