"""A file for HDF5 to write to, on a disk that may be full."""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Any

import h5py


class Hdf5Output:
    """A new file, as h5py's driver for Python objects takes it, that never fails to HDF5.

    HDF5 does not survive a write that fails: what it could not write stays in its caches,
    it tries again when the process ends, and crashes. Here the first failure is kept for
    :meth:`check`, and what is written from then on stays in memory, where it can be read
    back, so that HDF5 closes all that it has open.

    Raises
    ------
    OSError
        The file cannot be made.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._file = io.FileIO(path, "x+")
        self._at = 0
        self._error: OSError | None = None
        self._unwritten: list[tuple[int, bytes]] = []

    def __enter__(self) -> Hdf5Output:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._file.close()

    def check(self) -> None:
        """Raises the OSError of the first write that failed."""
        if self._error is not None:
            raise self._error

    def write(self, data: Any) -> int:
        """Bytes at the present place: to the file, or to memory after a failure."""
        left = memoryview(data).cast("B")
        begin, size = self._at, len(left)
        self._at += size
        if self._error is None:
            try:
                self._file.seek(begin)
                while left:
                    left = left[self._file.write(left) or 0 :]
            except OSError as error:
                self._error = error
        if self._error is not None:
            self._unwritten.append((begin, bytes(data)))
        return size

    def read(self, size: int) -> bytes:
        """So many bytes from the present place on; h5py knows a file by this method."""
        data = bytearray(size)
        self.readinto(data)
        return bytes(data)

    def readinto(self, buffer: Any) -> int:
        """Fills the buffer from the present place on, with zeros beyond the end."""
        into = memoryview(buffer).cast("B")
        begin, size = self._at, len(into)
        self._file.seek(begin)
        there = 0
        while there < size and (more := self._file.readinto(into[there:])):
            there += more
        into[there:] = bytes(size - there)
        for at, data in self._unwritten:
            first, last = max(at, begin), min(at + len(data), begin + size)
            if first < last:
                into[first - begin : last - begin] = data[first - at : last - at]
        self._at += size
        return size

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """As of any file; what is in memory alone counts for the end too."""
        begin = {os.SEEK_SET: 0, os.SEEK_CUR: self._at}.get(whence)
        if begin is None:
            ends = (at + len(data) for at, data in self._unwritten)
            begin = max(self._file.seek(0, os.SEEK_END), *ends, 0)
        self._at = begin + offset
        return self._at

    def tell(self) -> int:
        """The present place."""
        return self._at

    def truncate(self, size: int) -> int:
        """Makes the file so long."""
        if self._error is None:
            try:
                self._file.truncate(size)
            except OSError as error:
                self._error = error
        return size

    def flush(self) -> None:
        """Nothing: every write goes to the system at once."""


@contextmanager
def open_hdf5(path: str | os.PathLike[str]) -> Iterator[tuple[h5py.File, Hdf5Output]]:
    """A new HDF5 file, and what says (:meth:`Hdf5Output.check`) whether writing has failed.

    Raises
    ------
    OSError
        The disk is full, or whatever else kept the file from being written.
    """
    with Hdf5Output(path) as output:
        with h5py.File(output, "w", track_order=True) as file:
            yield file, output
        output.check()
