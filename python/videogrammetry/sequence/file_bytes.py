"""The bytes of a file of frames: mapped into memory where that is safe, else read.

A page of a mapped file that is no longer there (the file has shrunk, the server is gone) ends
the whole process, and no ``except`` helps. So the file's length is asked for before every
view, which costs about a microsecond, and files on network drives are read into memory instead.
"""

from __future__ import annotations

import mmap
import os
import threading
import weakref
from pathlib import Path

import numpy as np
import numpy.typing as npt

from videogrammetry.errors import SequenceError

#: File systems whose server may go away, by their names in /proc/self/mountinfo.
_REMOTE = frozenset(
    "nfs nfs4 cifs smb3 smbfs ncpfs afs ceph 9p glusterfs lustre beegfs gpfs fuse.sshfs "
    "fuse.glusterfs fuse.ceph fuse.rclone fuse.s3fs davfs fuse.davfs2".split()
)
_MOUNTS = Path("/proc/self/mountinfo")


class FileBytes:
    """Parts of one file, as arrays; from any thread.

    Parameters
    ----------
    path : a file that is there and can be read.
    mapped : whether to map it; None: unless it is on a network drive or cannot be mapped.

    Attributes
    ----------
    size : its length in bytes when it was opened. mapped : whether views are of the file itself.

    Raises
    ------
    SequenceError
        The file cannot be opened.
    """

    def __init__(self, path: Path, mapped: bool | None = None) -> None:
        self.path = path
        try:
            self._file = os.open(path, os.O_RDONLY | getattr(os, "O_BINARY", 0))
        except OSError as error:
            raise SequenceError(
                f"{path}: cannot be opened ({error.strerror}); allow reading, or copy it to a "
                "local disk"
            ) from error
        weakref.finalize(self, os.close, self._file)
        self.size = os.fstat(self._file).st_size
        self._lock = threading.Lock()
        self._map: npt.NDArray[np.uint8] | None = None
        if self.size and (not is_remote(path) if mapped is None else mapped):
            try:
                opened = mmap.mmap(self._file, self.size, access=mmap.ACCESS_READ)
            except (OSError, ValueError, OverflowError):
                pass  # a file system without mapping, or no address space left: read instead
            else:
                self._map = np.frombuffer(opened, np.uint8)
        self.mapped = self._map is not None

    def view(self, begin: int, end: int, what: str) -> npt.NDArray[np.uint8]:
        """Bytes ``begin`` to ``end``, read-only; not copied where the file is mapped.

        Raises
        ------
        SequenceError
            The file ends before them, or cannot be read; the message begins with ``what``.
        """
        try:
            size = os.fstat(self._file).st_size
            if not 0 <= begin <= end <= size:
                raise SequenceError(self._too_short(end, size, what))
            if self._map is not None and end <= self.size:
                return self._map[begin:end]
            return self._read(begin, end, what)
        except OSError as error:
            raise SequenceError(
                f"{self.path}: {what} (bytes {begin} to {end}) cannot be read ({error.strerror}): "
                "the disk or its server fails; copy the file to a local disk"
            ) from error

    def _too_short(self, end: int, size: int, what: str) -> str:
        before = (
            f" (it had {self.size} when it was opened: something is replacing or cutting it)"
            if size < self.size
            else ""
        )
        return (
            f"{self.path}: {what} would end at byte {end}, but the file has {size}{before}; copy "
            "the file again, or use the frames before"
        )

    def _read(self, begin: int, end: int, what: str) -> npt.NDArray[np.uint8]:
        """Network drives may give less than was asked for: asks until nothing more comes."""
        data = np.empty(end - begin, np.uint8)
        rest = memoryview(data.data)
        while len(rest):
            got = self._read_some(rest, end - len(rest))
            if got == 0:
                raise SequenceError(self._too_short(end, end - len(rest), what))
            rest = rest[got:]
        data.flags.writeable = False
        return data

    def _read_some(self, rest: memoryview, at: int) -> int:
        if hasattr(os, "preadv"):
            return os.preadv(self._file, [rest], at)
        with self._lock:
            os.lseek(self._file, at, os.SEEK_SET)
            part = os.read(self._file, min(len(rest), 1 << 24))
        rest[: len(part)] = part
        return len(part)


def is_remote(path: Path, mounts: Path = _MOUNTS) -> bool:
    """Whether a file is on a network drive, as far as the system tells."""
    if os.name == "nt":
        return os.fspath(path.absolute()).startswith(("\\\\", "//"))
    try:
        lines = mounts.read_text(errors="replace").splitlines()
        device = os.stat(path).st_dev
    except OSError:
        return False
    wanted = f"{os.major(device)}:{os.minor(device)}"
    for line in lines:
        fields, _, kind = line.partition(" - ")
        numbers = fields.split()
        if len(numbers) > 2 and numbers[2] == wanted:
            return kind.split(" ", 1)[0] in _REMOTE
    return False
