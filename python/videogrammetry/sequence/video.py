"""Video files through PyAV (FFmpeg): every frame under its own number, whatever the codec.

The packets are listed once, without decoding; a frame is found by its time stamp, from the key
frame before it. Where time stamps do not tell frames apart, they are counted from the first.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from videogrammetry.errors import SequenceError
from videogrammetry.sequence.recording import (
    FloatArray,
    RecordingFacts,
    RecordingSource,
    joined_words,
)
from videogrammetry.sequence.video_grey import check_pixel_format, grey_of_frame
from videogrammetry.types import FrameSource

SUFFIXES = (".avi", ".mp4", ".m4v", ".mov", ".mkv")

#: Codecs that give back the very samples; all others move edges.
_LOSSLESS = frozenset("rawvideo v210 r210 v410 ffv1 huffyuv ffvhuff utvideo lagarith png".split())
_MAX_SIDE = 65536
#: Decoding on is quicker than seeking for so many frames.
_NEAR = 8
#: Decoded frames that are kept: threads ask for neighbours in any order.
_KEPT = 16


@dataclass(frozen=True, kw_only=True)
class VideoIndex:
    """The frames of a video in the order in which they are shown.

    Attributes
    ----------
    stamp : (N,) int64 time stamps, in units of ``tick_s``; rising if ``exact``.
    key : numbers of the frames that can be decoded alone, rising.
    exact : whether every frame has a time stamp of its own; else they are counted.
    corrupt : packets that were not whole and are left out.
    """

    stamp: npt.NDArray[np.int64]
    key: npt.NDArray[np.int64]
    exact: bool
    tick_s: float
    corrupt: int

    def key_before(self, index: int) -> int:
        """The last key frame that is not after a frame."""
        at = int(np.searchsorted(self.key, index, side="right")) - 1
        return int(self.key[at]) if at >= 0 else 0

    def number_of(self, stamp: int | None) -> int:
        """The frame of a time stamp; -1 if there is none."""
        if stamp is None:
            return -1
        at = int(np.searchsorted(self.stamp, stamp))
        return at if at < len(self.stamp) and self.stamp[at] == stamp else -1

    def rate_hz(self) -> float | None:
        """Frames a second if they are evenly spaced but for the rounding to ticks."""
        count = len(self.stamp)
        if count < 2 or not self.exact:
            return None
        spacing = (self.stamp[-1] - self.stamp[0]) / (count - 1)
        even = self.stamp[0] + spacing * np.arange(count)
        # Rounding moves a stamp by up to one tick, and the two that give the spacing also.
        if np.abs(self.stamp - even).max() > 2.0 or spacing <= 0:
            return None
        return float(1.0 / (spacing * self.tick_s))


class VideoSource(RecordingSource):
    """The frames of one video file; ``read`` decodes, one thread at a time."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lock = threading.Lock()
        self._decoder: _Decoder | None = _Decoder(path)
        self.index = self._decoder.list_packets()
        stream = self._decoder.stream
        if not len(self.index.stamp):
            raise SequenceError(
                f"{path}: the video has no whole frame: it was cut short or never finished; copy "
                "or record it again"
            )
        self._next = 0
        self._kept: dict[int, Any] = {}
        first, interlaced = self._decode(0)
        height, width = first.shape
        codec = str(stream.codec_context.name)
        bits = check_pixel_format(path, stream.codec_context.format)
        rate, remarks = self._rate(stream)
        remarks += _losses(path, self._decoder, self.index)
        if interlaced:
            remarks.append(
                f"{path}: the video is interlaced: the even rows of a frame are of another time "
                "than the odd ones, and moving targets are torn; record progressive video"
            )
        super().__init__(
            (path,),
            RecordingFacts(
                image_size_px=(width, height),
                num_frames=len(self.index.stamp),
                bit_depth=bits,
                frame_rate_hz=rate,
                origin=joined_words(
                    f"video, {codec}",
                    "" if codec in _LOSSLESS else "compressed with loss, which moves edges",
                    "" if rate is None else f"played at {rate:g} Hz",
                ),
            ),
            remarks,
        )

    def read(self, index: int) -> npt.NDArray[Any]:
        """The frame: (height, width), uint8 or uint16; of colour its luminance."""
        self._check(index)
        with self._lock:
            frame, _ = self._decode(index)
        width, height = self.image_size_px
        if frame.shape != (height, width):
            raise SequenceError(
                f"{self._path}: frame {index + 1} has {frame.shape[1]}x{frame.shape[0]} px, the "
                f"first has {width}x{height} px: a sequence has one size; split the file"
            )
        return frame

    def times_s(self) -> FloatArray | None:
        """(N,) the file's time stamps from the first frame; None where it has none."""
        if not self.index.exact:
            return None
        return np.asarray((self.index.stamp - self.index.stamp[0]) * self.index.tick_s)

    def _decode(self, index: int) -> tuple[npt.NDArray[Any], bool]:
        """The frame, and whether it is interlaced."""
        frame = self._kept.get(index)
        if frame is None:
            decoder, self._decoder = self._decoder, None  # after an error it stands nowhere
            if decoder is None:
                decoder, self._next = _Decoder(self._path), 0
            what = f"frame {index + 1} of {len(self.index.stamp)}"
            frame = self._find(decoder, index, what)
            if frame is None and self.index.exact and self._can_be_counted(decoder, what):
                frame = self._find(decoder, index, what)
            if frame is None:
                raise SequenceError(
                    f"{self._path}: {what} cannot be decoded: the video is damaged there; copy the "
                    f"file again, or use the frames before (last = {index})"
                )
            self._decoder = decoder
        return grey_of_frame(self._path, frame), bool(getattr(frame, "interlaced_frame", False))

    def _find(self, decoder: _Decoder, index: int, what: str) -> Any | None:
        """The frame, decoding on from where the decoder stands or from a key frame."""
        near = self._next <= index <= self._next + _NEAR
        key = self.index.key_before(index)
        if near or key <= self._next <= index:
            return self._forward(decoder, index, what)
        # Some formats land after the key frame that was asked for: then from an earlier one.
        for start in (key, self.index.key_before(max(0, key - 1)), 0):
            if start == 0 or not self.index.exact:
                decoder.rewind()
                self._next = 0
            else:
                decoder.seek(int(self.index.stamp[start]))
                self._next = start
            frame = self._forward(decoder, index, what)
            if frame is not None:
                return frame
        return None

    def _forward(self, decoder: _Decoder, index: int, what: str) -> Any | None:
        """Decodes up to the frame; None if it does not come. Those on the way are kept."""
        while (frame := decoder.next_frame(what)) is not None:
            number = self._next
            if self.index.exact:
                stamp = frame.pts if frame.pts is not None else frame.dts
                number = self.index.number_of(stamp)
            self._next = number + 1
            self._kept[number] = frame
            if len(self._kept) > _KEPT:
                del self._kept[next(iter(self._kept))]
            if number == index:
                return frame
            if number > index or number < 0:
                return None
        return None

    def _can_be_counted(self, decoder: _Decoder, what: str) -> bool:
        """Frames whose stamps are not those of the packets: counts them, if none is lost."""
        decoder.rewind()
        self._next = 0
        self._kept.clear()
        count = 0
        while decoder.next_frame(what) is not None:
            count += 1
        decoder.rewind()
        if count != len(self.index.stamp):
            return False
        self.index = replace(self.index, exact=False)
        return True

    def _rate(self, stream: Any) -> tuple[float | None, list[str]]:
        """The rate, of the header if the time stamps agree; what is to be said of it."""
        stated = float(stream.average_rate) if stream.average_rate else None
        if len(self.index.stamp) < 2 or not self.index.exact:
            return stated, []
        even = self.index.rate_hz()
        if even is not None:
            span = (self.index.stamp[-1] - self.index.stamp[0]) * self.index.tick_s
            close = stated is not None and abs(stated / even - 1) * span <= 4 * self.index.tick_s
            return (stated if close else even), []
        apart = np.diff(self.index.stamp) * self.index.tick_s
        steps = apart / apart.min()
        if np.abs(steps - np.round(steps)).max() < 0.1 and np.median(steps) < 1.1:
            gaps = np.flatnonzero(steps > 1.5)
            return stated, [
                f"{self._path}: {round(float((steps - 1).sum()))} frames are missing, the first "
                f"after frame {gaps[0] + 1}: from there on the n-th frame is not that of the other "
                "cameras; copy or record the video again, or measure up to there (last = "
                f"{gaps[0] + 1})"
            ]
        return None, [
            f"{self._path}: the video has a variable frame rate: its frames are {apart.min():g} to "
            f"{apart.max():g} s apart, so that no rate is taken from it; record with a constant "
            "rate, or give [sequence] frame_rate_hz if you know that it was constant"
        ]


def _losses(path: Path, decoder: _Decoder, index: VideoIndex) -> list[str]:
    """What the header promises and the file does not hold."""
    count, promised = len(index.stamp), int(decoder.stream.frames)
    said = []
    if index.corrupt:
        said.append(f"{index.corrupt} are cut short or cannot be reached")
    if promised > count:
        said.append(f"the header promises {promised}")
    alone = len(decoder.container.streams) == 1 and decoder.container.duration is not None
    if alone and not said and index.exact and count > 1:
        # Matroska states the length alone; 1e-6 s is the unit of it.
        frame_s = float(np.median(np.diff(index.stamp))) * index.tick_s
        there_s = float(index.stamp[-1] - index.stamp[0]) * index.tick_s + frame_s
        promised_s = float(decoder.container.duration) * 1e-6
        if promised_s > there_s + 1.5 * frame_s:
            said.append(f"they take {there_s:g} s, the header promises {promised_s:g} s")
    if not said:
        return []
    return [
        f"{path}: {count} frames are whole, {', '.join(said)}; the whole ones are used; copy the "
        "file again for the rest"
    ]


class _Decoder:
    """One opened file with a place in it."""

    def __init__(self, path: Path) -> None:
        av = _pyav()
        self._path, self._errors = path, (av.error.FFmpegError, ValueError, RuntimeError)
        try:
            self.container = av.open(os.fspath(path), metadata_errors="replace")
        except (*self._errors, OSError, UnicodeError) as error:
            raise SequenceError(
                f"{path}: not a video that can be opened, cut short, or never finished "
                f"({_cause(error)}); copy or record it again"
            ) from error
        if not self.container.streams.video:
            raise SequenceError(f"{path}: the file has no video in it; give another one")
        self.stream = self.container.streams.video[0]
        context = self.stream.codec_context
        if context is None:
            raise SequenceError(
                f"{path}: the video's codec is not known here; save it as raw AVI, or as pictures"
            )
        if not (0 < context.width <= _MAX_SIDE and 0 < context.height <= _MAX_SIDE):
            raise SequenceError(
                f"{path}: the header states {context.width}x{context.height} px, which cannot be: "
                "it is damaged; copy the file again"
            )
        context.options = {"err_detect": "explode"}  # or damage is painted over
        self.stream.thread_type = "AUTO"
        self._frames: Iterator[Any] = self.container.decode(self.stream)

    def list_packets(self) -> VideoIndex:
        """Reads all packets, decodes none, and goes back to the first."""
        stamps: list[int | None] = []
        keys, corrupt = [], 0
        shown = decoded = True
        try:
            for packet in self.container.demux(self.stream):
                if packet.size == 0 or packet.is_discard:
                    continue
                if packet.is_corrupt:
                    corrupt += 1
                    continue
                shown = shown and packet.pts is not None
                decoded = decoded and packet.dts is not None
                stamps.append(packet.pts if packet.pts is not None else packet.dts)
                keys.append(bool(packet.is_keyframe))
        except (*self._errors, OSError):
            corrupt += 1  # the rest cannot be reached; what came before can be used
        in_order = shown or (decoded and not self.stream.codec_context.has_b_frames)
        exact = in_order and len(set(stamps)) == len(stamps)
        tick_s = float(self.stream.time_base) if self.stream.time_base else 0.0
        exact = exact and tick_s > 0
        if exact:
            values = np.array(stamps, np.int64)
            order = np.argsort(values, kind="stable")
        else:
            values, order = np.arange(len(stamps)), np.arange(len(stamps))
        key = np.flatnonzero(np.array(keys, bool)[order])
        self.rewind()
        return VideoIndex(stamp=values[order], key=key, exact=exact, tick_s=tick_s, corrupt=corrupt)

    def rewind(self) -> None:
        """To the first frame: a file opened anew, as not all formats can go back."""
        again = _Decoder(self._path)
        self.container.close()
        self.container, self.stream, self._frames = again.container, again.stream, again._frames

    def seek(self, stamp: int) -> None:
        """To the key frame at ``stamp``, or before it."""
        try:
            self.container.seek(stamp, stream=self.stream, backward=True, any_frame=False)
        except (*self._errors, OSError):
            self.rewind()
            return
        self._frames = self.container.decode(self.stream)

    def next_frame(self, what: str) -> Any | None:
        """The next frame; None after the last."""
        try:
            frame = next(self._frames, None)
        except (*self._errors, OSError) as error:
            raise SequenceError(
                f"{self._path}: {what} cannot be decoded ({_cause(error)}): the video is damaged "
                "or cut short; copy the file again, or use the frames before"
            ) from error
        if frame is not None and frame.is_corrupt:
            raise SequenceError(
                f"{self._path}: {what} is damaged; copy the file again, or use the frames before"
            )
        return frame


def _pyav() -> Any:
    try:
        import av
        import av.error
        import av.logging
    except ImportError as error:
        raise SequenceError(
            "video files need PyAV, which is not installed: pip install 'videogrammetry[video]' "
            "(or pip install av), or save the video as TIFF pictures"
        ) from error
    av.logging.set_level(None)  # what is wrong is raised; FFmpeg would print it as well
    return av


def _cause(error: BaseException) -> str:
    return str(getattr(error, "strerror", None) or error).strip().rstrip(".")


def open_file(path: Path) -> FrameSource:
    """A video file as a sequence.

    Raises
    ------
    SequenceError
        PyAV is missing; no video, damaged, or in colours that cannot be measured in.
    """
    return VideoSource(path)
