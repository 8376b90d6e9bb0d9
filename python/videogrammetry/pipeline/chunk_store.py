"""Where the records of measured chunks wait for each other."""

from __future__ import annotations

import json
import re
import shutil
import threading
import warnings
from collections import OrderedDict
from pathlib import Path
from typing import Protocol

from videogrammetry.errors import MeasurementError, MeasurementWarning
from videogrammetry.pipeline.chunk_record import ChunkRecord, read_record, write_record
from videogrammetry.project.atomic import write_text
from videogrammetry.version import __version__

Chunk = tuple[int, int]
_JOB = "job.json"
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


#: Bytes of records that a store keeps in memory as well, because they are asked for soon.
_KEPT_BYTES = 32_000_000


class _Recent:
    """The last records, some megabytes of them; safe to use from several threads."""

    def __init__(self) -> None:
        self._records: OrderedDict[Chunk, ChunkRecord] = OrderedDict()
        self._bytes, self._lock = 0, threading.Lock()

    def put(self, chunk: Chunk, record: ChunkRecord) -> None:
        with self._lock:
            self._drop(chunk)
            self._records[chunk] = record
            self._bytes += record.nbytes
            while self._bytes > _KEPT_BYTES:
                self._drop(next(iter(self._records)))

    def get(self, chunk: Chunk) -> ChunkRecord | None:
        with self._lock:
            return self._records.get(chunk)

    def _drop(self, chunk: Chunk) -> None:
        record = self._records.pop(chunk, None)
        self._bytes -= 0 if record is None else record.nbytes


class FolderStore:
    """Records as files of a folder, each of them whole or not there.

    A folder whose ``job.json`` names the same fingerprint and version goes on
    where it ended; parts of other work are removed first, and so are damaged ones,
    with a MeasurementWarning: they are measured anew.

    Parameters
    ----------
    folder : made where it is not there; anything else in it is left alone.
    fingerprint : of all that the records depend on.
    """

    def __init__(self, folder: Path, fingerprint: str) -> None:
        self._folder, self.fingerprint = folder, fingerprint
        self._recent = _Recent()
        told = _told(fingerprint)
        job = folder / _JOB
        folder.mkdir(exist_ok=True)
        same = job.is_file() and job.read_text(encoding="utf-8") == told
        for path in folder.iterdir():
            if _UNFINISHED.fullmatch(path.name) or (not same and _PART.fullmatch(path.name)):
                path.unlink(missing_ok=True)
            elif _PART.fullmatch(path.name) and not _is_whole(path):
                warnings.warn(
                    f"{path}: this part of the measurement is damaged; its stages are measured "
                    "anew (look at the disk: files that were whole do not change by themselves)",
                    MeasurementWarning,
                    stacklevel=2,
                )
                path.unlink()
        if not same:
            write_text(job, told)

    @property
    def folder(self) -> Path:
        """Where the records are."""
        return self._folder

    def adopt(self, fingerprint: str) -> None:
        """The records are those of a job with another fingerprint as well."""
        write_text(self._folder / _JOB, _told(fingerprint))
        self.fingerprint = fingerprint

    def missing(self, chunks: list[Chunk]) -> list[Chunk]:
        """Those of ``chunks`` that are not there yet."""
        there = {path.name for path in self._folder.iterdir()}
        return [chunk for chunk in chunks if self.path(chunk).name not in there]

    def path(self, chunk: Chunk) -> Path:
        """The file of a chunk."""
        return self._folder / part_name(chunk)

    def put(self, chunk: Chunk, record: ChunkRecord) -> None:
        """Writes a record."""
        _write(self.path(chunk), chunk, record)
        self._recent.put(chunk, record)

    def get(self, chunk: Chunk) -> ChunkRecord:
        """Reads a record, if it is none of the last that were written here."""
        return self._recent.get(chunk) or read_record(self.path(chunk))

    def remove(self) -> None:
        """Removes the records; the folder too, if nothing else is in it."""
        for path in list(self._folder.iterdir()):
            if _PART.fullmatch(path.name) or path.name == _JOB:
                path.unlink()
        if not any(self._folder.iterdir()):
            shutil.rmtree(self._folder, ignore_errors=True)


def part_name(chunk: Chunk) -> str:
    """The file's name of a chunk."""
    return f"stages-{chunk[0]:07d}-{chunk[1]:07d}.npz"


def put_part(folder: Path, fingerprint: str, chunk: Chunk, record: ChunkRecord) -> None:
    """Writes a record into the folder of another process's :class:`FolderStore`.

    Raises
    ------
    MeasurementError
        The folder is not there, or is another job's by now; or the disk is full.
    """
    job = folder / _JOB
    try:
        same = job.read_text(encoding="utf-8") == _told(fingerprint)
    except OSError as error:
        raise MeasurementError(
            f"{folder}: this machine cannot see the parts of the measurement ({error}): all "
            "workers need the project's folder under the same absolute path, on shared storage"
        ) from error
    if not same:
        raise MeasurementError(f"{folder}: has become another measurement's; nothing is written")
    _write(folder / part_name(chunk), chunk, record)


def _write(path: Path, chunk: Chunk, record: ChunkRecord) -> None:
    try:
        write_record(path, record)
    except OSError as error:
        raise MeasurementError(
            f"{path}: the stages {chunk[0]} to {chunk[1]} are measured but cannot be kept "
            f"({error}); what was written before stays: make room, or allow it, and run "
            "`videogrammetry measure` again"
        ) from error


def _told(fingerprint: str) -> str:
    return json.dumps({"fingerprint": fingerprint, "version": __version__}, sort_keys=True)


def _is_whole(path: Path) -> bool:
    """Whether the checksums of a part's arrays are right."""
    try:
        read_record(path)
    except MeasurementError:
        return False
    return True
