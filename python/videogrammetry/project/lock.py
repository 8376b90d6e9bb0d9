"""One process at a time: a lock of the operating system, which ends with its process."""

from __future__ import annotations

import contextlib
import errno
import os
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from videogrammetry.errors import ProjectFileError

#: The file system has no locks: the work must be possible there all the same.
_NO_LOCKS = {errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS, errno.EINVAL}
#: Locked on Windows, where the locked bytes cannot be read: far behind the text.
_FAR = 1 << 30


@contextlib.contextmanager
def one_at_a_time(path: str | os.PathLike[str], what: str) -> Iterator[None]:
    """Holds the lock file ``path`` while the block runs.

    The lock is the operating system's: of a process that is killed nothing stays that would
    have to be removed. Network drives pass it on between machines (NFS, SMB).

    Parameters
    ----------
    path : made where it is not there, removed at the end.
    what : for the message: "measured".

    Raises
    ------
    ProjectFileError
        Another process holds it; it is named.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / ".lock"
    >>> with one_at_a_time(path, "measured"):
    ...     path.exists()
    True
    >>> path.exists()
    False
    """
    lock = Path(path)
    file = _hold(lock, what)
    try:
        yield
    finally:
        if os.name == "posix":  # while it is held: nobody can have locked another one meanwhile
            lock.unlink(missing_ok=True)
        file.close()
        if os.name != "posix":
            with contextlib.suppress(OSError):  # somebody else has opened it by now
                lock.unlink(missing_ok=True)


def _hold(lock: Path, what: str) -> IO[str]:
    while True:
        descriptor = os.open(lock, os.O_RDWR | os.O_CREAT, 0o666)
        file = os.fdopen(descriptor, "r+", encoding="utf-8", errors="replace")
        try:
            if not _try_lock(descriptor):
                holder = file.read(200).strip() or "another process"
                raise ProjectFileError(
                    f"{lock.parent}: is being {what} already, by {holder}: wait until it is done, "
                    "or stop it; when that process ends, however it ends, the way is free, and "
                    "nothing need be removed"
                )
            if not _is_at(descriptor, lock):  # its holder has just removed it
                file.close()
                continue
            file.seek(0)
            file.truncate()
            file.write(f"process {os.getpid()} on {socket.gethostname()}\n")
            file.flush()
            return file
        except BaseException:
            file.close()
            raise


def _is_at(descriptor: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), os.stat(path))
    except FileNotFoundError:
        return False


def _try_lock(descriptor: int) -> bool:
    """Whether the lock could be had."""
    try:
        if os.name == "posix":
            import fcntl

            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        else:  # pragma: no cover
            import msvcrt

            os.lseek(descriptor, _FAR, os.SEEK_SET)
            getattr(msvcrt, "locking")(descriptor, getattr(msvcrt, "LK_NBLCK"), 1)  # noqa: B009
            os.lseek(descriptor, 0, os.SEEK_SET)
    except OSError as error:
        if error.errno in _NO_LOCKS:
            return True
        if error.errno in (errno.EWOULDBLOCK, errno.EACCES, errno.EDEADLK):
            return False
        raise
    return True
