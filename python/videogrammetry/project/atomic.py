"""Files that are either whole or not there: write beside, fsync, rename."""

from __future__ import annotations

import contextlib
import os
import secrets
from collections.abc import Iterator
from pathlib import Path


def refuse_overwrite(path: str | os.PathLike[str], force: bool) -> None:
    """FileExistsError if something stands at ``path`` and ``force`` is not given.

    Called before the work, so that nobody waits for a result that cannot be kept.
    """
    if not force and os.path.lexists(path):
        raise FileExistsError(
            f"{os.fspath(path)} is there already: choose another name, or give --force to "
            "overwrite it"
        )


@contextlib.contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A path beside ``path`` to write to; takes its place when the block ends well.

    If the block raises, what was written is removed and ``path`` is as it was.

    Examples
    --------
    >>> import tempfile
    >>> target = Path(tempfile.mkdtemp()) / "a.txt"
    >>> with atomic_path(target) as beside:
    ...     _ = beside.write_text("whole")
    >>> target.read_text()
    'whole'
    """
    target = Path(path)
    if target.is_dir():
        raise IsADirectoryError(f"{target} is a folder, a file's name is needed")
    if not target.parent.is_dir():
        raise FileNotFoundError(f"{target} cannot be written: there is no folder {target.parent}")
    beside = target.with_name(f".{target.stem}.{secrets.token_hex(4)}.part{target.suffix}")
    try:
        yield beside
        _flush(beside)
        os.replace(beside, target)
    finally:
        beside.unlink(missing_ok=True)
    _flush_folder(target.parent)


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Writes UTF-8 text with ``\\n`` line ends, all of it or nothing."""
    write_bytes(path, text.encode())


def write_bytes(path: str | os.PathLike[str], data: bytes) -> None:
    """Writes bytes, all of them or nothing."""
    with atomic_path(path) as beside:
        beside.write_bytes(data)


def _flush(path: Path) -> None:
    # Opened for writing: Windows flushes only what may be written.
    with path.open("r+b") as file:
        os.fsync(file.fileno())


def _flush_folder(folder: Path) -> None:
    """Makes the renaming itself last; folders cannot be opened on Windows, nor need it."""
    if os.name != "posix":
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError:  # some network file systems refuse; the file itself is safe
        pass
    finally:
        os.close(descriptor)
