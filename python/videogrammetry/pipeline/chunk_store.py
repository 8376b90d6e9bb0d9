"""Where the records of measured chunks wait for each other."""

from __future__ import annotations

import json
import re
import shutil
import threading
from pathlib import Path
from typing import Protocol

from videogrammetry.errors import MeasurementError
from videogrammetry.pipeline.chunk_record import ChunkRecord, read_record, write_record
from videogrammetry.project.atomic import write_text
from videogrammetry.version import __version__

Chunk = tuple[int, int]
_PART = re.compile(r"stages-\d{7}-\d{7}\.npz")
#: What a writer that was killed leaves behind.
_UNFINISHED = re.compile(r"\.stages-.*\.part\.npz|\.job\..*\.part\.json")


class ChunkStore(Protocol):
    """Records by the first and last stage of their chunks; safe to use from several threads."""

    def missing(self, chunks: list[Chunk]) -> list[Chunk]:
        """Those of ``chunks`` that are not there yet."""
        ...

    def put(self, chunk: Chunk, record: ChunkRecord) -> None:
        """Keeps a record."""
        ...

    def get(self, chunk: Chunk) -> ChunkRecord:
        """The record of a chunk that is there."""
        ...


class MemoryStore:
    """Records in memory: a measurement that fits there."""

    def __init__(self) -> None:
        self._records: dict[Chunk, ChunkRecord] = {}
        self._lock = threading.Lock()

    def missing(self, chunks: list[Chunk]) -> list[Chunk]:
        """Those of ``chunks`` that are not there yet."""
        return [chunk for chunk in chunks if chunk not in self._records]

    def put(self, chunk: Chunk, record: ChunkRecord) -> None:
        """Keeps a record."""
        with self._lock:
            self._records[chunk] = record

    def get(self, chunk: Chunk) -> ChunkRecord:
        """The record of a chunk."""
        return self._records[chunk]


class FolderStore:
    """Records as files of a folder, each of them whole or not there.

    A folder whose ``job.json`` names the same fingerprint and version goes on
    where it ended; parts of other work are removed first.

    Parameters
    ----------
    folder : made where it is not there; anything else in it is left alone.
    fingerprint : of all that the records depend on.

    Attributes
    ----------
    found : number of whole records that were there already.
    """

    def __init__(self, folder: Path, fingerprint: str) -> None:
        self._folder = folder
        told = json.dumps({"fingerprint": fingerprint, "version": __version__}, sort_keys=True)
        job = folder / "job.json"
        folder.mkdir(exist_ok=True)
        same = job.is_file() and job.read_text(encoding="utf-8") == told
        self.found = 0
        for path in folder.iterdir():
            if _UNFINISHED.fullmatch(path.name) or (not same and _PART.fullmatch(path.name)):
                path.unlink(missing_ok=True)
            elif _PART.fullmatch(path.name):
                self.found += 1
        if not same:
            write_text(job, told)

    def missing(self, chunks: list[Chunk]) -> list[Chunk]:
        """Those of ``chunks`` that are not there yet."""
        there = {path.name for path in self._folder.iterdir()}
        return [chunk for chunk in chunks if self.path(chunk).name not in there]

    def path(self, chunk: Chunk) -> Path:
        """The file of a chunk."""
        return self._folder / f"stages-{chunk[0]:07d}-{chunk[1]:07d}.npz"

    def put(self, chunk: Chunk, record: ChunkRecord) -> None:
        """Writes a record."""
        try:
            write_record(self.path(chunk), record)
        except OSError as error:
            raise MeasurementError(
                f"{self.path(chunk)}: the stages {chunk[0]} to {chunk[1]} are measured but cannot "
                f"be kept ({error}); what was written before stays: make room, or allow it, and "
                "run `videogrammetry measure` again"
            ) from error

    def get(self, chunk: Chunk) -> ChunkRecord:
        """Reads a record."""
        return read_record(self.path(chunk))

    def remove(self) -> None:
        """Removes the records; the folder too, if nothing else is in it."""
        for path in list(self._folder.iterdir()):
            if _PART.fullmatch(path.name) or path.name == "job.json":
                path.unlink()
        if not any(self._folder.iterdir()):
            shutil.rmtree(self._folder, ignore_errors=True)
