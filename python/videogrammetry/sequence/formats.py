"""The formats, by suffix. A new format is one file here and one line below.

Such a file has ``SUFFIXES``, lower case with the dot, and ``open_file(path)``,
which reads the header only, checks what it can without decoding, and returns
a :class:`~videogrammetry.types.FrameSource`; it raises SequenceError with the
file's name for whatever is wrong.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from videogrammetry.errors import SequenceError
from videogrammetry.sequence import cine, mraw, pgm, raster, tiff, video
from videogrammetry.types import FrameSource

_OPENERS: dict[str, Callable[[Path], FrameSource]] = {
    suffix: module.open_file
    for module in (tiff, raster, pgm, mraw, cine, video)
    for suffix in module.SUFFIXES
}


def known_suffixes() -> tuple[str, ...]:
    """Lower-case suffixes of all formats that can be read.

    Examples
    --------
    >>> ".tif" in known_suffixes()
    True
    """
    return tuple(_OPENERS)


def open_file(path: Path) -> FrameSource:
    """The frames of one file, in the format that its suffix names.

    Raises
    ------
    SequenceError
        Unknown suffix, empty, damaged or of a kind that cannot be measured in.
    """
    opener = _OPENERS.get(path.suffix.lower())
    if opener is None:
        raise SequenceError(
            f"{path}: {path.suffix or 'no suffix'!r} is not a picture or sequence format known "
            f"here; known are {', '.join(_OPENERS)}"
        )
    if path.stat().st_size == 0:
        raise SequenceError(f"{path}: the file is empty (0 bytes); copy or record it again")
    return opener(path)
