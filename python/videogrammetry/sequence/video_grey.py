"""Grey values of a decoded video frame, none of them scaled."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from videogrammetry.errors import SequenceError
from videogrammetry.sequence.grey import grey_from_rgb

#: Formats whose first plane is the luminance, samples at the bottom of their bytes.
_LUMINANCE_FIRST = ("gray", "yuv", "nv1", "nv2")
#: The same, samples at the top of 16 bits.
_LUMINANCE_HIGH = ("p010", "p012", "p016", "p21", "p41")
_COLOUR = ("rgb", "bgr", "gbr", "argb", "abgr", "rgba", "bgra", "0rgb", "0bgr", "pal8", "x2")
_INTERLEAVED = ("yuyv", "uyvy", "yvyu", "ya8", "ya16")


def check_pixel_format(path: Path, pixel_format: Any) -> int:
    """Bits of a frame's grey values.

    Raises
    ------
    SequenceError
        Samples that cannot be measured in: a colour filter's pattern, or not known here.
    """
    name = "" if pixel_format is None else str(pixel_format.name)
    if name.startswith("bayer"):
        raise SequenceError(
            f"{path}: a colour recording (raw Bayer pattern): neighbouring pixels see different "
            "colours, so that edges cannot be measured in it; save it as grey"
        )
    known = (*_LUMINANCE_FIRST, *_LUMINANCE_HIGH, *_COLOUR, *_INTERLEAVED)
    bits = int(pixel_format.components[0].bits) if name and pixel_format.components else 0
    if not name.startswith(known) or "f16" in name or "f32" in name or not bits <= 16:
        raise SequenceError(
            f"{path}: pixels of the kind {name or 'unknown'!r} are not read here; save the video "
            "as grey, or as pictures"
        )
    return 8 if name == "pal8" else max(8, bits)


def grey_of_frame(path: Path, frame: Any) -> npt.NDArray[Any]:
    """(height, width) uint8 or uint16: the luminance as it is stored; of RGB its weighted sum."""
    name = str(frame.format.name)
    bits = check_pixel_format(path, frame.format)
    if name.startswith(_COLOUR):
        return grey_from_rgb(frame.to_ndarray(format="rgb24" if bits == 8 else "rgb48le"))
    if name.startswith(_INTERLEAVED):
        kind = {"ya8": "gray", "ya16le": "gray16le", "ya16be": "gray16be"}.get(name, "yuv422p")
        frame = frame.reformat(format=kind)
        name = kind
    plane = frame.planes[0]
    dtype: np.dtype[Any] = np.dtype(np.uint8)
    if bits > 8:
        dtype = np.dtype(">u2" if name.endswith("be") else "<u2")
    rows = np.frombuffer(plane, dtype).reshape(-1, plane.line_size // dtype.itemsize)
    grey = rows[: frame.height, : frame.width]
    if name.startswith(_LUMINANCE_HIGH):
        return np.ascontiguousarray(grey >> (16 - bits), dtype=np.uint16)
    # A copy: the decoder uses its own memory again.
    return np.array(grey, dtype=dtype.newbyteorder("="), order="C")
