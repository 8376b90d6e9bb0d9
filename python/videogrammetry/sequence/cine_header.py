"""The headers of a Phantom ``.cine`` file (Vision Research's cine file format).

A file has a cine header, a Windows bitmap header and the camera's setup, whose fields
stand without padding; an older camera writes a shorter setup, so that every field is
looked for within its stated length.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from videogrammetry.errors import SequenceError

_CINE = struct.Struct("<2s3HiIiI3I2I")
_BITMAP = struct.Struct("<IiiHHII")
#: biCompression: how the samples are stored.
STORED_PLAIN, STORED_10BIT, STORED_12BIT = 0, 256, 1024
#: Bytes of the setup's fields from its beginning.
_FRAME_RATE16, _SHUTTER16, _MARK, _LENGTH = 0, 2, 140, 142
_SERIAL, _FLIP_H, _FLIP_V, _FRAME_RATE, _SHUTTER_US = 743, 756, 760, 768, 772
_POST_TRIGGER, _CFA, _REAL_BITS = 780, 808, 896
_SHUTTER_NS = 1568
#: A block of the camera's: length with this head, kind, reserved. 1002: time stamps alone.
_BLOCK, _TIMES_BLOCK = struct.Struct("<IHH"), 1002
_MAX_SIDE, _MAX_FRAMES = 65536, 100_000_000


@dataclass(frozen=True, kw_only=True)
class CineHeader:
    """What a cine file says of itself.

    Attributes
    ----------
    image_size_px : (width, height). num_frames : in the file.
    first_frame : number of the first one, counted from the trigger (negative: before it).
    stored_bits : 8, 10, 12 or 16. effective_bits : that count, as the camera says.
    flip_h, flip_v : the camera's software would mirror the picture; it is stored as it is.
    bottom_up : rows stand from the lowest one up.
    total_frames : that the camera took; the file may hold a range of them.
    trigger : (seconds since 1970, fraction in 1/2**32) of the trigger.
    times_at : where the frames' time stamps stand, 8 bytes each. offset_bytes : that the place
    of a frame takes in the table of pictures.
    """

    image_size_px: tuple[int, int]
    num_frames: int
    first_frame: int
    stored_bits: int
    effective_bits: int
    bottom_up: bool
    frame_rate_hz: float | None
    exposure_s: float | None
    trigger_time: datetime | None
    serial: int | None
    post_trigger: int | None
    flip_h: bool
    flip_v: bool
    offsets_at: int
    image_bytes: int
    total_frames: int
    trigger: tuple[int, int] | None
    times_at: int | None
    offset_bytes: int


def parse_header(path: Path, data: bytes, file_size: int) -> CineHeader:
    """Reads the headers.

    Parameters
    ----------
    data : the file's beginning, all of it up to the table of pictures.

    Raises
    ------
    SequenceError
        Not a cine file, cut short, colour, compressed, or of numbers that cannot be.
    """
    if len(data) < _CINE.size or data[:2] != b"CI":
        raise SequenceError(
            f"{path}: not a Phantom cine file (it does not begin with CI), or cut short"
        )
    fields = _CINE.unpack_from(data)
    compression, version, total, first, count = fields[2], fields[3], *fields[5:8]
    at_bitmap, at_setup, at_offsets, fraction, seconds = fields[8:13]
    if compression == 1:
        raise SequenceError(
            f"{path}: its pictures are JPEG-compressed, which moves edges; save the cine "
            "uncompressed in the camera's software"
        )
    if at_bitmap + _BITMAP.size > len(data) or at_setup + 2 > len(data):
        raise SequenceError(f"{path}: cut short within its headers; copy the file again")
    _, width, height, _, bits, stored, size = _BITMAP.unpack_from(data, at_bitmap)
    setup = _Setup(data, at_setup, at_offsets)
    _check_samples(path, compression, bits, stored, setup)
    bottom_up, height = height > 0, abs(height)
    if not (0 < width < _MAX_SIDE and 0 < height < _MAX_SIDE and count < _MAX_FRAMES):
        raise SequenceError(
            f"{path}: the header states {width} x {height} px and {count} frames, which cannot be: "
            "it is damaged; copy the file again"
        )
    stored_bits = {STORED_10BIT: 10, STORED_12BIT: 12}.get(stored, bits)
    wanted = (width * height * stored_bits + 7) // 8
    if size and size < wanted:
        raise SequenceError(
            f"{path}: a picture of {width} x {height} px with {stored_bits} bits has {wanted} "
            f"bytes, the header states {size}: it is damaged"
        )
    offset_bytes = 4 if version == 0 else 8
    if at_offsets + offset_bytes * count > file_size:
        raise SequenceError(
            f"{path}: the table of its {count} pictures is cut off ({file_size} bytes); copy the "
            "file again"
        )
    rate = setup.whole(_FRAME_RATE) or setup.short(_FRAME_RATE16)
    exposure_ns = setup.whole(_SHUTTER_NS) or 1000 * (setup.whole(_SHUTTER_US) or 0)
    # 10-bit samples stand for 12 bits by the camera's own table.
    real = 12 if stored == STORED_10BIT else (setup.whole(_REAL_BITS) or stored_bits)
    when = datetime.fromtimestamp(seconds, UTC) + timedelta(seconds=fraction / 2**32)
    return CineHeader(
        image_size_px=(width, height),
        num_frames=count,
        first_frame=first,
        stored_bits=stored_bits,
        effective_bits=min(real, 16),
        # Packed pictures stand from the top down, whatever the sign says.
        bottom_up=bottom_up and stored == STORED_PLAIN,
        frame_rate_hz=float(rate) if rate else None,
        exposure_s=1e-9 * exposure_ns if exposure_ns else None,
        trigger_time=when if seconds else None,
        serial=setup.whole(_SERIAL) or None,
        post_trigger=setup.whole(_POST_TRIGGER),
        flip_h=bool(setup.whole(_FLIP_H)),
        flip_v=bool(setup.whole(_FLIP_V)),
        offsets_at=at_offsets,
        image_bytes=wanted,
        total_frames=total,
        trigger=(seconds, fraction) if seconds else None,
        times_at=_find_times(data, setup.end, at_offsets, count),
        offset_bytes=offset_bytes,
    )


def _find_times(data: bytes, begin: int, end: int, count: int) -> int | None:
    """Where the block of time stamps has its first: blocks stand after the setup, in a row."""
    at = begin
    while at + _BLOCK.size <= min(end, len(data)):
        size, kind, _ = _BLOCK.unpack_from(data, at)
        if kind == _TIMES_BLOCK and size >= _BLOCK.size + 8 * count:
            return at + _BLOCK.size
        if size < _BLOCK.size:
            break
        at += size
    return None


def _check_samples(path: Path, compression: int, bits: int, stored: int, setup: _Setup) -> None:
    if compression == 2 or (setup.whole(_CFA) or 0) & 0xFF:
        raise SequenceError(
            f"{path}: a colour recording (raw Bayer pattern): neighbouring pixels see different "
            "colours, so that edges cannot be measured in it; use a monochrome camera, or save "
            "the green channel"
        )
    if stored not in (STORED_PLAIN, STORED_10BIT, STORED_12BIT):
        raise SequenceError(
            f"{path}: samples are stored in a way that is not known here (biCompression {stored}); "
            "save the cine with 8, 10 (packed), 12 (packed) or 16 bits"
        )
    if stored == STORED_PLAIN and bits not in (8, 16):
        colour = " (colour)" if bits in (24, 48) else ""
        raise SequenceError(
            f"{path}: {bits} bits a pixel{colour} cannot be measured in; save it as grey, 8 or 16 "
            "bit"
        )


class _Setup:
    """Fields of the camera's setup, None where its version is too old to have them."""

    def __init__(self, data: bytes, begin: int, end: int) -> None:
        self._data, self._begin = data, begin
        marked = data[begin + _MARK : begin + _MARK + 2] == b"ST"
        length = self._read("<H", _LENGTH, len(data)) if marked else 0
        stop = begin + (length or _MARK)
        self.end = stop
        self._stop = min(stop, len(data), end if end > begin else len(data))

    def _read(self, code: str, at: int, stop: int) -> int | None:
        size = struct.calcsize(code)
        if self._begin + at + size > stop:
            return None
        return int(struct.unpack_from(code, self._data, self._begin + at)[0])

    def whole(self, at: int) -> int | None:
        return self._read("<I", at, self._stop)

    def short(self, at: int) -> int | None:
        return self._read("<H", at, self._stop)
