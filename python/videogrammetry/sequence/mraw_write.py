"""Writes a Photron recording: ``NAME.mraw`` frame by frame, then ``NAME.cihx``."""

from __future__ import annotations

import contextlib
import os
import struct
from datetime import datetime
from pathlib import Path
from typing import Any, BinaryIO
from xml.sax.saxutils import escape

import numpy as np
import numpy.typing as npt

from videogrammetry.sequence.packing import pack_12bit, packed_12bit_bytes
from videogrammetry.sequence.parts import check_outputs, flush_folder, part_of

#: What stands before the XML: a note that fills 256 bytes, then "CIHX", version 1
#: and a table of two sections (kind, where, how long): the XML and an empty one.
_NOTE = b"!!! This file can not be edited. !!!".ljust(256, b"\0")
_TABLE = struct.Struct("<4sII6Q")

_XML = """<?xml version='1.0' encoding='UTF-8'?>
<cih>
    <fileInfo>
        <version>1.0</version>
        <date>{date.year}/{date.month}/{date.day}</date>
        <time>{date.hour}:{date.minute:02d}</time>
    </fileInfo>
    <imageFileInfo>
        <digitsOfFileNumber>6</digitsOfFileNumber>
        <fileFormat>Mraw</fileFormat>
        <resolution>
            <width>{width}</width>
            <height>{height}</height>
        </resolution>
    </imageFileInfo>
    <imageDataInfo>
        <resolution>
            <width>{width}</width>
            <height>{height}</height>
        </resolution>
        <colorInfo>
            <type>Mono</type>
            <bit>{stored_bits}</bit>
        </colorInfo>
        <effectiveBit>
            <depth>{bit_depth}</depth>
            <side>Lower</side>
        </effectiveBit>
        <applyImageProc>0</applyImageProc>
    </imageDataInfo>
    <frameInfo>
        <recordedFrame>{num_frames}</recordedFrame>
        <totalFrame>{num_frames}</totalFrame>
        <startFrame>0</startFrame>
        <correctTriggerFrame>0</correctTriggerFrame>
        <adjustTriggerPoint>0</adjustTriggerPoint>
        <skipFrame>1</skipFrame>
    </frameInfo>
    <basicInfo>
        <comment>Written by videogrammetry</comment>
        <cameraName>{camera_name}</cameraName>
    </basicInfo>
    <recordInfo>
        <triggerTime>0</triggerTime>
        <recordRate>{rate}</recordRate>
        <shutterSpeed>{shutter_speed}</shutterSpeed>
        <shutterSpeedNsec>{shutter_ns}</shutterSpeedNsec>
        <autoExposure>0</autoExposure>
    </recordInfo>
    <deviceInfo>
        <deviceName></deviceName>
    </deviceInfo>
</cih>
"""


def cihx_bytes(
    *,
    image_size_px: tuple[int, int],
    num_frames: int,
    stored_bits: int,
    bit_depth: int,
    frame_rate_hz: float | None,
    exposure_s: float | None,
    camera_name: str,
    date: datetime,
) -> bytes:
    """A ``.cihx`` header; an unknown frame rate or exposure is 0, exposures are whole ns."""
    rate = frame_rate_hz or 0.0
    text = _XML.format(
        width=image_size_px[0],
        height=image_size_px[1],
        num_frames=num_frames,
        stored_bits=stored_bits,
        bit_depth=bit_depth,
        rate=int(rate) if float(rate).is_integer() else repr(float(rate)),
        shutter_speed=round(1.0 / exposure_s) if exposure_s else 0,
        shutter_ns=round(exposure_s * 1e9) if exposure_s else 0,
        camera_name=escape(camera_name),
        date=date,
    )
    xml = text.replace("\n", "\r\n").encode()
    begin = len(_NOTE) + _TABLE.size
    end = begin + len(xml)
    return _NOTE + _TABLE.pack(b"CIHX", 1, 2, 0, begin, len(xml), 4, end, 0) + xml


class MrawOutput:
    """The two files under part names until all frames are there; the header comes last."""

    def __init__(
        self,
        path: Path,
        *,
        image_size_px: tuple[int, int],
        num_frames: int,
        bit_depth: int,
        frame_rate_hz: float | None,
        exposure_s: float | None,
        camera_name: str,
        date: datetime,
    ) -> None:
        stem = path.stem if path.suffix.lower() in (".cihx", ".mraw") else path.name
        self.target = path.with_name(stem + ".cihx")
        self._samples_target = path.with_name(stem + ".mraw")
        self._other_header = path.with_name(stem + ".cih")
        self._stored_bits = bit_depth if bit_depth in (8, 12) else 16
        pixels = image_size_px[0] * image_size_px[1]
        if self._stored_bits == 12 and pixels % 2:
            raise ValueError(
                f"image_size_px: expected an even number of pixels for packed 12 bit, got "
                f"{image_size_px[0]}x{image_size_px[1]}; make one side even, or write tiff"
            )
        self._header = cihx_bytes(
            image_size_px=image_size_px,
            num_frames=num_frames,
            stored_bits=self._stored_bits,
            bit_depth=bit_depth,
            frame_rate_hz=frame_rate_hz,
            exposure_s=exposure_s,
            camera_name=camera_name,
            date=date,
        )
        frame_bytes = (
            packed_12bit_bytes(pixels)
            if self._stored_bits == 12
            else pixels * self._stored_bits // 8
        )
        self.needed_bytes = frame_bytes * num_frames + len(self._header)
        self.spec = self.target.name
        self._part = part_of(self._samples_target)
        self._header_part = part_of(self.target)
        self._file: BinaryIO | None = None

    def check(self) -> None:
        """Raises if the place cannot be written to, or is taken."""
        check_outputs((self.target, self._samples_target, self._other_header))

    def begin(self) -> None:
        """Opens the part for the samples."""
        self._file = self._part.open("xb")

    def write(self, index: int, frame: npt.NDArray[Any]) -> None:
        """Appends one frame of the writer's type."""
        assert self._file is not None
        if self._stored_bits == 12:
            self._file.write(pack_12bit(frame).data)
        else:
            order = "<u2" if self._stored_bits == 16 else np.uint8
            self._file.write(np.ascontiguousarray(frame, dtype=order).data)
        self._file.flush()  # so that a full disk shows at this frame and not at a later one

    def finish(self) -> None:
        """Gives both files their names, the header last: without it there is no recording."""
        assert self._file is not None
        _flush(self._file)
        self._file.close()
        with self._header_part.open("xb") as file:
            file.write(self._header)
            _flush(file)
        self.check()  # nobody has been quicker
        self._part.rename(self._samples_target)
        try:
            self._header_part.rename(self.target)
        except OSError:
            self._samples_target.unlink(missing_ok=True)
            raise
        flush_folder(self.target.parent)

    def discard(self) -> None:
        """Removes what was written."""
        with contextlib.suppress(OSError):  # closing flushes, which fails on a full disk
            if self._file is not None:
                self._file.close()
        for part in (self._part, self._header_part):
            part.unlink(missing_ok=True)


def _flush(file: BinaryIO) -> None:
    file.flush()
    os.fsync(file.fileno())
