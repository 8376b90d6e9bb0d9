"""Whole blocks for an HDF5 file that is written from its beginning to its end."""

from __future__ import annotations

import os
import zlib
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from videogrammetry.project.atomic import flush_file

#: Rows of a block of what has no points: series of stages, targets.
ROWS = 4096
#: The deflation of what is compressed.
DEFLATE = 1
#: Stages between two looks whether the disk keeps up.
_FLUSH_STAGES = 1000


def write_block(dataset: h5py.Dataset, place: tuple[int, ...], values: Any) -> None:
    """A whole block of a dataset as it lies in the file: HDF5's own way takes several times
    as long.
    """
    data = np.ascontiguousarray(values, dtype=dataset.dtype)
    stored: Any = data
    if dataset.compression is not None:  # HDF5's filters "shuffle" and "deflate"
        shuffled = data.reshape(-1).view(np.uint8).reshape(-1, data.itemsize).T
        stored = zlib.compress(shuffled.tobytes(), DEFLATE)
    dataset.id.write_direct_chunk((*place, *[0] * (data.ndim - len(place))), stored)


class RowBuffer:
    """Takes rows of several datasets alike, and writes them block by block."""

    def __init__(self, datasets: Mapping[str, h5py.Dataset], total: int) -> None:
        self._datasets, self._total = datasets, total
        self._waiting: dict[str, list[Any]] = {}
        self._first = self._count = 0

    def add(self, values: Mapping[str, Any]) -> None:
        """The next rows, by dataset."""
        for name, rows in values.items():
            self._waiting.setdefault(name, []).append(rows)
        self._count += len(next(iter(values.values())))
        if self._count >= ROWS or self._first + self._count == self._total:
            self._write()

    def _write(self) -> None:
        last = self._first + self._count == self._total
        blocks = self._count // ROWS
        for name, parts in self._waiting.items():
            dataset = self._datasets[name]
            values = parts[0] if len(parts) == 1 else np.concatenate(parts)
            if dataset.chunks is not None and dataset.chunks[0] == ROWS:
                for begin in range(0, blocks * ROWS, ROWS):
                    rows = values[begin : begin + ROWS]
                    write_block(dataset, (self._first + begin,), rows)
                done = blocks * ROWS
            else:
                done = 0
            if last and done < self._count:
                dataset[self._first + done : self._total] = values[done:]
            self._waiting[name] = [values[blocks * ROWS :]]
        self._first += blocks * ROWS
        self._count -= blocks * ROWS


class Flusher:
    """Has what is written brought to the disk meanwhile, so that the end need not wait."""

    def __init__(self, path: Path) -> None:
        self._path, self._until = path, 0
        self._pool = ThreadPoolExecutor(1)
        self._running: Future[None] | None = None

    def written(self, stages: int) -> None:
        """So many stages are written."""
        if os.name != "posix" or stages - self._until < _FLUSH_STAGES:
            return
        if self._running is None or self._running.done():
            self._until = stages
            self._running = self._pool.submit(flush_file, self._path)

    def close(self) -> None:
        """No file is open any more."""
        self._pool.shutdown()
