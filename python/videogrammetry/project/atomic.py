"""Files that are either whole or not there: write beside, fsync, rename."""

from __future__ import annotations

import contextlib
import os
import secrets
from collections.abc import Iterator
from pathlib import Path


def refuse_overwrite(path: str | os.PathLike[str], force: bool) -> None:
    """Raises if ``path`` cannot be written, or would be overwritten without ``force``.

    Called before the work, so that nobody waits for a result that cannot be kept.

    Raises
    ------
    FileExistsError
        Something stands at ``path`` and ``force`` is not given.
    FileNotFoundError, NotADirectoryError, PermissionError
        The folder of ``path`` is not there, is none, or may not be written to.
    IsADirectoryError
        ``path`` is a folder.
    """
    _check_folder(Path(path))
    if not force and os.path.lexists(path):
        raise FileExistsError(
            f"{os.fspath(path)} is there already: choose another name, or give --force to "
            "overwrite it"
        )
    if os.path.isdir(path):
        raise IsADirectoryError(f"{os.fspath(path)} is a folder, a file's name is needed")


def nearest_folder(path: str | os.PathLike[str]) -> Path:
    """The folder ``path`` or, where it is yet to be made, the nearest one above it.

    Called before the work; raises as :func:`refuse_overwrite` does if that
    folder is none or may not be written to.
    """
    target = Path(path)
    folder = next(p for p in (target, *target.parents, Path(".")) if os.path.lexists(p))
    _check_writable(target, folder)
    return folder


def _check_folder(target: Path) -> None:
    folder = target.parent
    if not folder.exists():
        raise FileNotFoundError(
            f"{target} cannot be written: there is no folder {folder}; make it, or choose "
            "another place"
        )
    _check_writable(target, folder)


def _check_writable(target: Path, folder: Path) -> None:
    if not folder.is_dir():
        raise NotADirectoryError(
            f"{target} cannot be written: {folder} is no folder; choose another place"
        )
    if not os.access(folder, os.W_OK | os.X_OK):
        raise _not_permitted(target, folder)


def _not_permitted(target: Path, folder: Path) -> PermissionError:
    return PermissionError(
        f"{target} cannot be written: no permission to write in folder {folder}; allow it, or "
        "choose another place"
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
    _check_folder(target)
    beside = target.with_name(f".{target.stem}.{secrets.token_hex(4)}.part{target.suffix}")
    try:
        yield beside
        _flush(beside)
        os.replace(beside, target)
    except PermissionError as error:
        if beside.name in str(error):  # a name that nobody has chosen nor knows
            raise _not_permitted(target, target.parent) from error
        raise
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
