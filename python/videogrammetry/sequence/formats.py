"""The formats, by suffix. A new format is one file here and one line below.

Such a file has ``SUFFIXES``, lower case with the dot, and ``open_file(path)``,
which reads the header only, checks what it can without decoding, and returns
a :class:`~videogrammetry.types.FrameSource`; it raises SequenceError with the
file's name for whatever is wrong. A user's own format is registered, or named in the
entry points "videogrammetry.formats" of an installed package: docs/how-to/own-format.md.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path

from videogrammetry.errors import SequenceError, SequenceWarning
from videogrammetry.sequence import cine, mraw, pgm, raster, tiff, video
from videogrammetry.types import FrameSource

_OPENERS: dict[str, Callable[[Path], FrameSource]] = {
    suffix: module.open_file
    for module in (tiff, raster, pgm, mraw, cine, video)
    for suffix in module.SUFFIXES
}


#: Entry points of installed packages: the name is the suffix with its dot, the object the opener.
ENTRY_POINTS = "videogrammetry.formats"


def register_format(
    suffixes: Iterable[str], opener: Callable[[Path], FrameSource], *, replace: bool = False
) -> None:
    """Makes files of these suffixes known to all that reads sequences.

    Parameters
    ----------
    suffixes : with the dot; case does not count.
    opener : gives the frames of a file; raises SequenceError for whatever is wrong with it.
    replace : whether a format that is known already may be read by ``opener`` from now on.

    Raises
    ------
    ValueError
        A suffix without dot, or one that is known already.
    """
    lower = [suffix.lower() for suffix in suffixes]
    for suffix in lower:
        if not suffix.startswith(".") or len(suffix) < 2:
            raise ValueError(f"suffixes: expected endings like '.raw', got {suffix!r}")
        if suffix in _OPENERS and _OPENERS[suffix] is not opener and not replace:
            raise ValueError(f"suffixes: {suffix!r} is known already; replace=True puts it aside")
    _OPENERS.update(dict.fromkeys(lower, opener))


@cache
def _load_entry_points() -> None:
    """Formats of installed packages; the ones here and registered ones go first."""
    for point in entry_points(group=ENTRY_POINTS):
        if point.name.lower() in _OPENERS:
            continue
        try:
            register_format([point.name], point.load())
        except Exception as error:  # another's package: whatever it raises
            warnings.warn(
                f"the format {point.name!r} of the installed package {point.value!r} cannot be "
                f"used: {type(error).__name__}: {error}",
                SequenceWarning,
                stacklevel=2,
            )


def known_suffixes() -> tuple[str, ...]:
    """Lower-case suffixes of all formats that can be read.

    Examples
    --------
    >>> ".tif" in known_suffixes()
    True
    """
    _load_entry_points()
    return tuple(_OPENERS)


def open_file(path: Path) -> FrameSource:
    """The frames of one file, in the format that its suffix names.

    Raises
    ------
    SequenceError
        Unknown suffix, empty, damaged or of a kind that cannot be measured in.
    """
    suffix = path.suffix.lower()
    if suffix not in _OPENERS:
        _load_entry_points()
    opener = _OPENERS.get(suffix)
    if opener is None:
        raise SequenceError(
            f"{path}: {path.suffix or 'no suffix'!r} is not a picture or sequence format known "
            f"here; known are {', '.join(_OPENERS)}"
        )
    if path.stat().st_size == 0:
        raise SequenceError(f"{path}: the file is empty (0 bytes); copy or record it again")
    return opener(path)
