"""From a specification to a sequence."""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence
from pathlib import Path

from videogrammetry.errors import SequenceError, SequenceWarning
from videogrammetry.sequence.formats import known_suffixes, open_file
from videogrammetry.sequence.lenient import UnreadablePicture
from videogrammetry.sequence.mraw import one_of_each_recording
from videogrammetry.sequence.select import find_files
from videogrammetry.sequence.source import JoinedSource
from videogrammetry.sequence.video import SUFFIXES as VIDEO_SUFFIXES
from videogrammetry.types import FrameSource

#: A file, folder or pattern, or several of these, read one after the other.
SequenceSpec = str | os.PathLike[str] | Sequence[str | os.PathLike[str]]


def open_sequence(
    spec: SequenceSpec,
    base_dir: str | os.PathLike[str] | None = None,
    *,
    same_size: bool = True,
    keep_unreadable: bool = False,
) -> JoinedSource:
    """Opens the frames of one camera; only headers are read here.

    Parameters
    ----------
    spec : a picture or sequence file, a folder, a pattern (``*``, ``?``,
        ``[...]``, ``**``, ``{a,b}``), or a list of these. Within each, files
        are in natural order (``img9`` before ``img10``).
    base_dir : what relative names start from; None: the current folder.
    same_size : whether frames of different sizes are an error, as they are
        for one camera.
    keep_unreadable : whether a file of several that does not open is a frame all the
        same, whose ``read`` says what is wrong (:class:`LenientSource` makes it black).

    Raises
    ------
    SequenceError
        Nothing matches; a file is no picture, empty, cut short, or of another
        size than the first. The message names it.

    Warns
    -----
    SequenceWarning
        A file is not as it should be, but can be measured in; the same texts are the
        sequence's ``remarks``.
    """
    base = Path() if base_dir is None else Path(base_dir)
    specs = [spec] if isinstance(spec, str | os.PathLike) else list(spec)
    if not specs:
        raise SequenceError("an empty list names no picture: give a file, a folder or a pattern")
    paths = [path for one in specs for path in _files(one, base)]
    sources = [_opened(path, keep_unreadable and len(paths) > 1) for path in paths]
    good = [source for source in sources if not isinstance(source, UnreadablePicture)]
    if not good:
        sources[0].read(0)  # says why
    for remark in (text for source in sources for text in getattr(source, "remarks", ())):
        warnings.warn(remark, SequenceWarning, stacklevel=2)
    if same_size:
        first = next(p for p, source in zip(paths, sources, strict=True) if source is good[0])
        for path, source in zip(paths, sources, strict=True):
            if isinstance(source, UnreadablePicture):
                continue
            if source.image_size_px != good[0].image_size_px:
                raise SequenceError(
                    f"{path} has {_size(source.image_size_px)}, but {first} of the same "
                    f"sequence has {_size(good[0].image_size_px)}: one camera's pictures have "
                    "one size; take the stranger out"
                )
    return JoinedSource(sources, paths)


def _opened(path: Path, keep_unreadable: bool) -> FrameSource:
    try:
        return open_file(path)
    except SequenceError as error:
        if not keep_unreadable:
            raise
        return UnreadablePicture(path, str(error))


def _files(spec: str | os.PathLike[str], base: Path) -> list[Path]:
    """The files of one specification; of a folder no video beside pictures or recordings."""
    paths = one_of_each_recording(find_files(spec, base, known_suffixes()))
    if not (base / os.fspath(spec)).is_dir():
        return paths
    # Cameras' software likes to leave a film to look at beside the frames to measure in.
    return [p for p in paths if p.suffix.lower() not in VIDEO_SUFFIXES] or paths


def _size(image_size_px: tuple[int, int]) -> str:
    return f"{image_size_px[0]}x{image_size_px[1]} px"
