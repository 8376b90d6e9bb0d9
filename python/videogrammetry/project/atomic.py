"""Files that are either whole or not there: write beside, fsync, rename."""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
import shutil
from collections.abc import Iterator
from pathlib import Path

from videogrammetry.errors import VideogrammetryError

#: The disk, the quota (which Windows has no number for) or a file's largest size is exhausted.
_FULL = {errno.ENOSPC, errno.EFBIG, getattr(errno, "EDQUOT", errno.ENOSPC)}


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
def atomic_path(path: str | os.PathLike[str], *, flush: bool = True) -> Iterator[Path]:
    """A path beside ``path`` to write to; takes its place when the block ends well.

    If the block raises, what was written is removed and ``path`` is as it was. Without
    ``flush`` nobody waits for the disk: a program that is killed leaves a whole file or
    none all the same, but after a power cut it may be there and damaged. For what has a
    checksum and can be made again.

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
        if flush:
            flush_file(beside)
        os.replace(beside, target)
    except PermissionError as error:
        if beside.name in str(error):  # a name that nobody has chosen nor knows
            raise _not_permitted(target, target.parent) from error
        raise
    finally:
        beside.unlink(missing_ok=True)
    if flush:
        _flush_folder(target.parent)


@contextlib.contextmanager
def atomic_folder(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A folder beside ``path`` to fill; takes its name when the block ends well.

    If the block raises (a full disk, an interruption), the folder is removed
    and ``path`` does not exist, nor folders above it that had to be made. An
    error that names the hidden folder is raised with ``path`` in its place.

    Raises
    ------
    FileExistsError
        Something stands at ``path`` already.
    NotADirectoryError, PermissionError
        The nearest folder above ``path`` is none, or may not be written to.

    Examples
    --------
    >>> import tempfile
    >>> target = Path(tempfile.mkdtemp()) / "results"
    >>> with atomic_folder(target) as beside:
    ...     _ = (beside / "a.txt").write_text("whole")
    >>> [p.name for p in target.iterdir()]
    ['a.txt']
    """
    target = Path(path)
    if os.path.lexists(target):
        raise FileExistsError(
            f"{target} is there already, and nothing is overwritten: name another folder, or "
            "remove it"
        )
    nearest_folder(target)
    made = [p for p in target.parents if not p.exists()]
    beside = target.with_name(f".{target.name}.{secrets.token_hex(4)}.part")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        beside.mkdir()
        yield beside
        _give_name(beside, target)
    except Exception as error:
        raise _without_part(error, beside, target) from error
    finally:
        shutil.rmtree(beside, ignore_errors=True)
        if not os.path.lexists(target):
            for folder in made:
                with contextlib.suppress(OSError):  # somebody else uses it by now
                    folder.rmdir()
    _flush_folder(target.parent)


def _give_name(beside: Path, target: Path) -> None:
    if os.path.lexists(target):  # rename would replace an empty folder, and a link
        raise FileExistsError(
            f"{target} has been made by somebody else meanwhile; nothing was kept: name another "
            "folder"
        )
    os.rename(beside, target)


def _without_part(error: Exception, beside: Path, target: Path) -> Exception:
    """The error with the name that the user has chosen instead of the hidden one."""
    if isinstance(error, OSError) and error.errno in _FULL:
        reason = error.strerror or ""
        if reason == os.strerror(error.errno):
            free = shutil.disk_usage(nearest_folder(target)).free
            reason = f"no room on the disk ({free / 1e6:.0f} MB free)"
        return OSError(error.errno, f"{reason}; nothing was kept", str(target))
    hidden, named = str(beside), str(target)
    if isinstance(error, OSError) and error.errno is not None:
        names = [
            None if name is None else os.fsdecode(name).replace(hidden, named)
            for name in (error.filename, error.filename2)
        ]
        return type(error)(error.errno, error.strerror, names[0], None, names[1])
    text = str(error)
    for path, name in ((beside.resolve(), target.resolve()), (beside, target)):
        text = text.replace(str(path), str(name))
    if text != str(error) and isinstance(error, (VideogrammetryError, ValueError, OSError)):
        return type(error)(text)
    return error


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Writes UTF-8 text with ``\\n`` line ends, all of it or nothing."""
    write_bytes(path, text.encode())


def write_bytes(path: str | os.PathLike[str], data: bytes) -> None:
    """Writes bytes, all of them or nothing."""
    with atomic_path(path) as beside:
        beside.write_bytes(data)


def flush_file(path: Path) -> None:
    """Waits until what was written to a file is on the disk."""
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
