"""Output that looks whole only when it is: part names, free space, what a full disk means.

Sequences are large, of several files and written frame by frame, so that they
need more than one file's "write beside and rename": the caller renames its parts
in the order in which they make sense.
"""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
import shutil
from collections.abc import Iterable
from pathlib import Path

from videogrammetry.errors import SequenceError

#: The disk, the quota or the largest size of a file is exhausted.
_FULL = {errno.ENOSPC, errno.EFBIG, getattr(errno, "EDQUOT", errno.ENOSPC)}


def part_of(target: Path) -> Path:
    """A hidden name beside ``target`` that nobody else uses, of the same suffix."""
    return target.with_name(f".{target.stem}.{secrets.token_hex(4)}.part{target.suffix}")


def check_outputs(targets: Iterable[Path]) -> None:
    """Raises unless the folder is there, may be written to, and has none of ``targets``.

    Raises
    ------
    FileNotFoundError, NotADirectoryError, PermissionError
        The folder is not there, is none, or may not be written to.
    FileExistsError
        Something of that name is there already.
    """
    for target in targets:
        folder = target.parent
        if not folder.exists():
            raise FileNotFoundError(
                f"{target} cannot be written: there is no folder {folder}; make it, or choose "
                "another place"
            )
        if not folder.is_dir():
            raise NotADirectoryError(
                f"{target} cannot be written: {folder} is no folder; choose another place"
            )
        if not os.access(folder, os.W_OK | os.X_OK):
            raise PermissionError(
                f"{target} cannot be written: no permission to write in folder {folder}; allow "
                "it, or choose another place"
            )
        if os.path.lexists(target):
            raise FileExistsError(
                f"{target} is there already: choose another name, or remove it first"
            )


def check_free_space(target: Path, needed_bytes: int) -> None:
    """SequenceError if the disk of ``target`` has less than is needed."""
    free = free_bytes(target)
    if free is not None and free < needed_bytes:
        raise SequenceError(
            f"{target} does not fit: it needs {_size(needed_bytes)}, and its disk has "
            f"{_size(free)} free; make room, choose another disk, or write fewer frames. "
            "Nothing was written"
        )


def free_bytes(target: Path) -> int | None:
    """Free space for the user where ``target`` is to be; None if the system does not tell.

    Folders above it may be yet to be made.
    """
    folder = next(p for p in target.absolute().parents if p.exists())
    try:
        return shutil.disk_usage(folder).free
    except OSError:
        return None


def write_failed(target: Path, needed_bytes: int, error: OSError) -> SequenceError:
    """The error for a write that failed although space was there at the start."""
    free = free_bytes(target)
    space = "" if free is None else f" and {_size(free)} are free now"
    if error.errno == errno.EFBIG:
        cause = "no file may be that large here (ulimit -f, or the file system's own limit)"
        remedy = "raise the limit, or choose another disk"
    elif error.errno in _FULL:
        cause = "the disk or your share of it is full"
        remedy = "make room or choose another disk"
    else:
        cause = error.strerror or str(error)
        remedy = "see that the disk is there and can be written to"
    return SequenceError(
        f"{target} could not be written: {cause}; it needs {_size(needed_bytes)} in all{space}. "
        f"What was written has been removed; {remedy}, then write the sequence again"
    )


def flush_folder(folder: Path) -> None:
    """Makes renaming in a folder last; Windows cannot and need not."""
    if os.name != "posix":
        return
    descriptor = os.open(folder, os.O_RDONLY)
    with contextlib.suppress(OSError):  # some network file systems refuse
        os.fsync(descriptor)
    os.close(descriptor)


def _size(num_bytes: int) -> str:
    """Bytes in readable units.

    Examples
    --------
    >>> _size(999), _size(1_500_000), _size(2_340_000_000)
    ('999 bytes', '1.5 MB', '2.3 GB')
    """
    for unit, name in ((10**9, "GB"), (10**6, "MB")):
        if num_bytes >= unit:
            return f"{num_bytes / unit:.1f} {name}"
    return f"{num_bytes} bytes"
