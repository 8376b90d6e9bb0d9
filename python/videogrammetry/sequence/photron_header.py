"""Headers of Photron recordings: ``.cihx`` (XML between bytes) and ``.cih`` (lines of text).

A header says how the samples stand in the ``.mraw`` beside it. Both kinds are
read into the same names, those of the older ``.cih``. No description by Photron
is public: what is read here agrees with files of FASTCAM cameras and with what
pyMRAW (https://github.com/ladisk/pyMRAW) takes from them.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from videogrammetry.errors import SequenceError

#: Names of the older header, and where the newer one has them.
_XML_PLACES = {
    "Date": "fileInfo/date",
    "Time": "fileInfo/time",
    "Camera Type": "deviceInfo/deviceName",
    "User Defined Camera Name": "basicInfo/cameraName",
    "Record Rate(fps)": "recordInfo/recordRate",
    "Shutter Speed(s)": "recordInfo/shutterSpeed",
    "Shutter Type2(nsec)": "recordInfo/shutterSpeedNsec",
    "Total Frame": "frameInfo/totalFrame",
    "Start Frame": "frameInfo/startFrame",
    "Save Step": "frameInfo/skipFrame",
    "Partition Number": "deviceInfo/currentPartition",
    "Partition Count": "deviceInfo/totalPartition",
    "Image Width": "imageDataInfo/resolution/width",
    "Image Height": "imageDataInfo/resolution/height",
    "Color Type": "imageDataInfo/colorInfo/type",
    "Color Bit": "imageDataInfo/colorInfo/bit",
    "EffectiveBit Depth": "imageDataInfo/effectiveBit/depth",
    "EffectiveBit Side": "imageDataInfo/effectiveBit/side",
    "File Format": "imageFileInfo/fileFormat",
}

#: Larger than any header, with whatever the camera's software notes in it.
_LARGEST_HEADER_BYTES = 1 << 24
_MOST_PIXELS_A_SIDE = 1 << 16
_MOST_FRAMES = 1 << 32
_COPY = "copy the recording's two files from the camera's computer again"


@dataclass(frozen=True, kw_only=True)
class PhotronHeader:
    """What a header says of the recording beside it.

    Attributes
    ----------
    image_size_px : (width, height). num_frames : in the ``.mraw``.
    stored_bits : 8, 12 (packed) or 16 that a sample takes in the file.
    effective_bits : that the camera delivered. upper : whether they stand at
        the top of the stored bits ("Higher") and not at the bottom ("Lower").
    record_rate_hz : frames a second of the camera, None where not stated.
    save_step : every n-th recorded frame was saved.
    exposure_s : None where not stated. camera_name, device : "" likewise.
    date : of the recording, by the clock of its computer.
    first_frame : the camera's number of the first frame, 0 the trigger's; None where not stated.
    partition, num_partitions : of the camera's memory; each is saved as a recording of its own.
    """

    image_size_px: tuple[int, int]
    num_frames: int
    stored_bits: int
    effective_bits: int
    upper: bool
    record_rate_hz: float | None
    save_step: int
    exposure_s: float | None
    camera_name: str
    device: str
    date: datetime | None
    first_frame: int | None = None
    partition: int | None = None
    num_partitions: int | None = None


def file_format(path: Path) -> str:
    """How the frames beside a header were saved ("MRaw", "Tiff", ...); "" if it cannot be read."""
    try:
        return _fields(path).get("File Format", "")
    except (SequenceError, OSError):
        return ""


def read_header(path: Path) -> PhotronHeader:
    """Reads and checks a ``.cihx`` or ``.cih`` header.

    Raises
    ------
    SequenceError
        Damaged, of a recording in colour or in another file format, or with
        numbers that cannot be.
    """
    reader = _Reader(path, _fields(path))
    kind = reader.text("File Format", "MRaw")
    if kind.lower() != "mraw":
        raise SequenceError(
            f"{path}: the header of a recording that was saved as {kind}, not as MRaw; open those "
            "pictures instead of their header"
        )
    stored_bits = reader.stored_bits()
    return PhotronHeader(
        image_size_px=(
            reader.integer("Image Width", 1, _MOST_PIXELS_A_SIDE),
            reader.integer("Image Height", 1, _MOST_PIXELS_A_SIDE),
        ),
        num_frames=reader.integer("Total Frame", 1, _MOST_FRAMES),
        stored_bits=stored_bits,
        effective_bits=reader.integer("EffectiveBit Depth", 1, 16, default=stored_bits),
        upper=reader.side(),
        record_rate_hz=reader.rate(),
        save_step=max(1, reader.integer("Save Step", 0, _MOST_FRAMES, default=1)),
        exposure_s=reader.exposure(),
        camera_name=reader.text("User Defined Camera Name", ""),
        device=reader.text("Camera Type", ""),
        date=reader.date(),
        first_frame=reader.optional("Start Frame"),
        partition=reader.optional("Partition Number"),
        num_partitions=reader.optional("Partition Count"),
    )


def _fields(path: Path) -> dict[str, str]:
    """All fields by the names of the older header, as text without blanks around it."""
    with path.open("rb") as file:
        data = file.read(_LARGEST_HEADER_BYTES + 1)
    if len(data) > _LARGEST_HEADER_BYTES:
        raise SequenceError(
            f"{path}: more than {_LARGEST_HEADER_BYTES >> 20} MB is no camera header; {_COPY}"
        )
    return _xml_fields(path, data) if path.suffix.lower() == ".cihx" else _text_fields(path, data)


def _decoded(data: bytes) -> str:
    """Text in UTF-8, UTF-16 with its mark, or a Japanese computer's own encoding."""
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return data.decode("utf-16", "replace")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp932", "replace")


def _xml_fields(path: Path, data: bytes) -> dict[str, str]:
    begin, end = data.find(b"<cih>"), data.rfind(b"</cih>")
    if begin < 0 or end < begin:
        raise SequenceError(
            f"{path}: no Photron header, or cut short: the XML from <cih> to </cih> is not "
            f"in its {len(data)} bytes; {_COPY}"
        )
    text = _decoded(data[begin : end + len(b"</cih>")])
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise SequenceError(
            f"{path}: the XML of the Photron header is damaged ({error}); {_COPY}"
        ) from error
    values = {name: root.findtext(place) for name, place in _XML_PLACES.items()}
    return {name: value.strip() for name, value in values.items() if value and value.strip()}


def _text_fields(path: Path, data: bytes) -> dict[str, str]:
    """The lines "name : value" up to the first empty one, where other programs' notes begin."""
    text = _decoded(data)
    fields: dict[str, str] = {}
    for line in text.splitlines():
        if not line.strip():
            break
        name, colon, value = line.partition(":")
        if colon and value.strip():
            fields.setdefault(name.strip(), value.strip())
    if not fields:
        raise SequenceError(
            f"{path}: no Photron header: it has no line like 'Image Width : 1024'; {_COPY}"
        )
    return fields


@dataclass(frozen=True)
class _Reader:
    """Fields as numbers, with what is wrong said in one paragraph."""

    path: Path
    fields: dict[str, str]

    def text(self, name: str, default: str) -> str:
        return self.fields.get(name, default)

    def integer(self, name: str, low: int, high: int, default: int | None = None) -> int:
        value = self.fields.get(name)
        if value is None:
            if default is not None:
                return default
            raise SequenceError(f"{self.path}: the Photron header does not state {name!r}; {_COPY}")
        if not re.fullmatch(r"[+-]?\d{1,18}", value) or not low <= int(value) <= high:
            raise self._absurd(name, f"a whole number from {low} to {high}")
        return int(value)

    def optional(self, name: str) -> int | None:
        """A whole number that nothing depends on; None where it is none."""
        value = self.fields.get(name, "")
        return int(value) if re.fullmatch(r"[+-]?[0-9]{1,10}", value) else None

    def stored_bits(self) -> int:
        kind = self.text("Color Type", "Mono")
        bits = self.integer("Color Bit", 1, 64)
        if not kind.lower().startswith("mono"):
            raise SequenceError(
                f"{self.path}: a recording in colour ({kind}, {bits} bit): its pixels do not all "
                "see the same light, which shifts the edges of targets; record with a "
                "monochrome camera, or save it as grey TIFF pictures"
            )
        if bits not in (8, 12, 16):
            raise SequenceError(
                f"{self.path}: samples of {bits} bit are not read here; save the recording as "
                "MRaw with 8, 12 or 16 bit"
            )
        return bits

    def side(self) -> bool:
        side = self.text("EffectiveBit Side", "Lower").lower()
        if side not in ("lower", "higher"):
            raise self._absurd("EffectiveBit Side", "Lower or Higher")
        return side == "higher"

    def rate(self) -> float | None:
        """Frames a second; cameras that run on another's clock may state 0."""
        rate = self._number("Record Rate(fps)")
        if rate is not None and not (math.isfinite(rate) and 0 <= rate <= 1e9):
            raise self._absurd("Record Rate(fps)", "frames a second from 0 to 1e9")
        return rate or None

    def exposure(self) -> float | None:
        """The nanoseconds if they are there; "1/15371" is rounded."""
        nanoseconds = self._number("Shutter Type2(nsec)")
        if nanoseconds:
            return self._checked_exposure(nanoseconds / 1e9, "Shutter Type2(nsec)")
        speed = self.fields.get("Shutter Speed(s)", "")
        number = self._number("Shutter Speed(s)") if not speed.startswith("1/") else None
        if speed.startswith("1/") or (number and self.path.suffix.lower() == ".cihx"):
            try:
                number = 1.0 / float(speed.removeprefix("1/"))
            except (ValueError, ZeroDivisionError):
                raise self._absurd("Shutter Speed(s)", "seconds, or 1/n of one") from None
        return self._checked_exposure(number, "Shutter Speed(s)") if number else None

    def _checked_exposure(self, exposure_s: float, name: str) -> float:
        if not 0 < exposure_s <= 3600:
            raise self._absurd(name, "an exposure of up to an hour")
        return exposure_s

    def _number(self, name: str) -> float | None:
        value = self.fields.get(name)
        try:
            return None if value is None else float(value)
        except ValueError:
            raise self._absurd(name, "a number") from None

    def date(self) -> datetime | None:
        """Date and time of day; None where they are not stated as numbers."""
        numbers = re.findall(r"\d+", f"{self.text('Date', '')} {self.text('Time', '')}")
        try:
            if len(numbers) < 3:
                return None
            year, month, day, hour, minute = [*(int(n) for n in numbers), 0, 0][:5]
            return datetime(year, month, day, hour, minute)
        except (ValueError, OverflowError):
            return None

    def _absurd(self, name: str, expected: str) -> SequenceError:
        return SequenceError(
            f"{self.path}: the Photron header says {name} = {self.fields[name]!r}, expected "
            f"{expected}; {_COPY}"
        )
