"""Recordings that are still being written: the frames that are complete so far.

A folder that a camera's program fills with pictures, or a Photron ``.mraw`` that is being
saved. Both are frame sources whose length grows by ``available()`` alone, so that whoever
measures sees a fixed number of frames between two questions.
"""

from __future__ import annotations

import os
import time
import warnings
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy.typing as npt

from videogrammetry.errors import SequenceError, SequenceWarning
from videogrammetry.sequence import mraw, photron_header, raster, tiff
from videogrammetry.sequence.formats import open_file
from videogrammetry.sequence.lenient import UnreadablePicture
from videogrammetry.sequence.mraw import MrawSource
from videogrammetry.sequence.pgm import SUFFIXES as PGM_SUFFIXES
from videogrammetry.sequence.select import natural_key
from videogrammetry.sequence.source import check_index
from videogrammetry.types import FrameSource, PackedSamples

#: What a growing folder's pictures may be.
PICTURE_SUFFIXES = (*tiff.SUFFIXES, *raster.SUFFIXES, *PGM_SUFFIXES)


class GrowingSource:
    """Base of growing sources: waiting, and the face of a sequence.

    Attributes
    ----------
    frame_rate_hz : frames a second, None where not known.
    """

    frame_rate_hz: float | None = None
    path: Path

    def available(self) -> int:
        """Looks again; the number of complete frames, never less than before."""
        raise NotImplementedError

    def wait(self, count: int, timeout_s: float, poll_s: float = 0.1) -> int:
        """Waits until ``count`` frames are complete, or none has come for ``timeout_s``.

        Returns the number of complete frames, which tells what happened.
        """
        number, since = self.available(), time.monotonic()
        while number < count and time.monotonic() - since < timeout_s:
            time.sleep(poll_s)
            now = self.available()
            if now > number:
                number, since = now, time.monotonic()
        return number

    @property
    def image_size_px(self) -> tuple[int, int]:
        """(width, height); SequenceError while there is no frame."""
        return self._locate(0)[0].image_size_px

    def __len__(self) -> int:
        """Frames that were complete when ``available`` was last asked."""
        raise NotImplementedError

    def name(self, index: int) -> str:
        """Name of a frame."""
        source, at = self._locate(index)
        return source.name(at)

    def read(self, index: int) -> npt.NDArray[Any]:
        """The frame: (height, width), uint8 or uint16."""
        source, at = self._locate(index)
        return source.read(at)

    def packed(self, index: int) -> PackedSamples | None:
        """The packed samples where they stand; None if the frame is to be read."""
        source, at = self._locate(index)
        packed = getattr(source, "packed", None)
        samples: PackedSamples | None = None if packed is None else packed(at)
        return samples

    def _locate(self, index: int) -> tuple[FrameSource, int]:
        raise NotImplementedError

    def _check(self, index: int) -> None:
        if len(self) == 0:
            raise SequenceError(
                f"{self.path}: no frame is complete yet; wait for the first (available())"
            )
        check_index(index, len(self), str(self.path))


@dataclass
class _Seen:
    """A file's size and time of change, and since when they are so."""

    state: tuple[int, int]
    since: float


class GrowingFolder(GrowingSource):
    """Pictures of one camera in a folder that is being filled, in natural order of their names.

    A file is complete when it opens and a later one is there; the last one when its size has
    not changed for ``settle_s`` and it decodes. A file that stays as it is, with later ones
    there, and does not open is a frame all the same, whose ``read`` says what is wrong: the
    numbers of the others must not change.

    Parameters
    ----------
    path : the folder; it may be empty, and come later.
    suffixes : lower-case endings of its pictures.
    settle_s : how long a file must stand still; longer than the writer's longest pause.
    frame_rate_hz : of the camera, if it is known.

    Examples
    --------
    >>> import tempfile
    >>> folder = GrowingFolder(tempfile.mkdtemp(), settle_s=0.0)
    >>> folder.available()
    0
    >>> _ = Path(folder.path, "a1.pgm").write_bytes(b"P5 2 1 255 ab")
    >>> folder.wait(1, timeout_s=5.0, poll_s=0.01), folder.read(0).tolist()
    (1, [[97, 98]])
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        suffixes: tuple[str, ...] = PICTURE_SUFFIXES,
        settle_s: float = 0.5,
        frame_rate_hz: float | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.path = Path(path)
        self.frame_rate_hz = frame_rate_hz
        self._suffixes, self._settle_s, self._clock = suffixes, settle_s, clock
        self._sources: list[FrameSource] = []
        self._ends: list[int] = []
        self._files: list[Path] = []
        self._taken: set[str] = set()
        self._seen: dict[str, _Seen] = {}

    @property
    def paths(self) -> tuple[Path, ...]:
        """The files of the complete frames."""
        return tuple(self._files)

    def __len__(self) -> int:
        return self._ends[-1] if self._ends else 0

    def available(self) -> int:
        """Looks into the folder again; the number of complete frames.

        Raises
        ------
        SequenceError
            A picture has come that belongs before one that was complete already, so that
            numbers would change; or one of another size.
        """
        names = self._new_names()
        if names and self._files and natural_key(names[0]) < natural_key(self._files[-1].name):
            raise SequenceError(
                f"{self.path / names[0]}: came after {self._files[-1].name} was complete, which "
                "stands behind it: frames already measured would change their numbers; give "
                "pictures rising numbers, or measure the folder when it is full"
            )
        now = self._clock()
        still = {name: self._stands_still(name, now) for name in names}
        for name in names:
            source = self._complete(name, last=name == names[-1], still=still[name])
            if source is None:
                break
            self._add(name, source)
        return len(self)

    def _new_names(self) -> list[str]:
        try:
            with os.scandir(self.path) as entries:
                names = [
                    entry.name
                    for entry in entries
                    if entry.name not in self._taken
                    and not entry.name.startswith(".")
                    and os.path.splitext(entry.name)[1].lower() in self._suffixes
                ]
        except FileNotFoundError:
            return []
        except OSError as error:
            raise SequenceError(
                f"{self.path}: the folder cannot be read ({error.strerror}); see that the disk is "
                "there and may be read"
            ) from error
        return sorted(names, key=natural_key)

    def _stands_still(self, name: str, now: float) -> bool:
        """Whether a file has not changed since it was looked at ``settle_s`` ago."""
        try:
            status = (self.path / name).stat()
        except OSError:  # gone again, or renamed meanwhile
            return False
        state = (status.st_size, status.st_mtime_ns)
        seen = self._seen.get(name)
        if seen is None or seen.state != state:
            self._seen[name] = _Seen(state, now)
            return False
        return now - seen.since >= self._settle_s

    def _complete(self, name: str, *, last: bool, still: bool) -> FrameSource | None:
        """The file's frames if it is complete, else None."""
        path = self.path / name
        if last and not still:
            return None
        try:
            source = open_file(path)
            if last:
                for index in range(len(source)):
                    source.read(index)
        except (SequenceError, OSError) as error:
            return None if last or not still else UnreadablePicture(path, str(error))
        return source

    def _add(self, name: str, source: FrameSource) -> None:
        good = next((s for s in self._sources if not isinstance(s, UnreadablePicture)), None)
        if good is not None and not isinstance(source, UnreadablePicture):
            size, first = source.image_size_px, good.image_size_px
            if size != first:
                raise SequenceError(
                    f"{self.path / name}: has {size[0]}x{size[1]} px, the pictures before have "
                    f"{first[0]}x{first[1]} px: one camera's pictures have one size; take the "
                    "stranger out"
                )
        self._taken.add(name)
        self._seen.pop(name, None)
        self._files.append(self.path / name)
        self._sources.append(source)
        self._ends.append(len(self) + len(source))

    @property
    def image_size_px(self) -> tuple[int, int]:
        """(width, height) of the first picture that opens."""
        self._check(0)
        good = next(
            (s for s in self._sources if not isinstance(s, UnreadablePicture)), self._sources[0]
        )
        return good.image_size_px

    def _locate(self, index: int) -> tuple[FrameSource, int]:
        self._check(index)
        which = bisect_right(self._ends, index)
        return self._sources[which], index - (self._ends[which - 1] if which else 0)


class GrowingMraw(GrowingSource):
    """A Photron recording whose ``.mraw`` is being written; the header must be there.

    A frame is complete when the file is longer than its end. A program that reserves the whole
    file before it writes gives no sign of how far it is: such a file looks complete at once.

    Parameters
    ----------
    path : the ``.cihx`` or ``.cih``, or the ``.mraw`` with one of them beside it.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path, self._samples_path = mraw.files_of_recording(Path(path), growing=True)
        self.header = photron_header.read_header(self.path)
        self.frame_rate_hz = self.header.record_rate_hz
        self._frame_bytes = mraw.frame_bytes(self.path, self.header)
        self._source: MrawSource | None = None

    @property
    def paths(self) -> tuple[Path, ...]:
        """The header and the ``.mraw``."""
        return (self.path, self._samples_path)

    def __len__(self) -> int:
        return 0 if self._source is None else len(self._source)

    def available(self) -> int:
        """Looks at the file's length again; the number of complete frames."""
        try:
            size = self._samples_path.stat().st_size
        except OSError:
            return len(self)
        count = min(size // self._frame_bytes, self.header.num_frames)
        if count > len(self):
            with warnings.catch_warnings(action="ignore", category=SequenceWarning):
                part = replace(self.header, num_frames=count)
                self._source = MrawSource(self.path, self._samples_path, part, growing=True)
        return len(self)

    @property
    def image_size_px(self) -> tuple[int, int]:
        """(width, height)."""
        return self.header.image_size_px

    def _locate(self, index: int) -> tuple[FrameSource, int]:
        self._check(index)
        assert self._source is not None
        return self._source, index


def open_growing(path: str | os.PathLike[str]) -> GrowingSource:
    """A folder of pictures or a Photron recording that is still being written."""
    if Path(path).suffix.lower() in mraw.SUFFIXES:
        return GrowingMraw(path)
    return GrowingFolder(path)
