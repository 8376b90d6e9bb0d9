"""Chunks of a measurement on other processes and machines, by Dask distributed.

Workers read the sequences and write the parts on storage that all machines share, each
under the same absolute path; over the network go the job, some kilobytes, and the names of
stages. A worker that is lost costs the chunks it was at, which others measure.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import pickle
import signal
import threading
import time
import uuid
from collections import Counter, OrderedDict, deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from videogrammetry.errors import MeasurementError, SequenceError
from videogrammetry.pipeline.chunk_job import ChunkOptions, ChunkWorker
from videogrammetry.pipeline.chunk_store import Chunk, ChunkStore, FolderStore, put_part
from videogrammetry.pipeline.measure_sources import CameraFrames, open_frames
from videogrammetry.recognition import CameraModel
from videogrammetry.types import FrameSource, RigData
from videogrammetry.version import __version__

if TYPE_CHECKING:
    from videogrammetry.pipeline.measure_job import MeasureJob

#: What the command takes for a cluster of its own on this machine.
LOCAL = "local"

#: Workers that may be lost while they measure one chunk; further ones are its fault.
_MOST_LOST = 100
#: How long to wait for the first worker, for workers when all are lost, and for shared
#: storage to show what another machine has written.
_FIRST_S, _NONE_LEFT_S, _SEEN_S = 60.0, 600.0, 90.0
#: How often the number of workers is asked for.
_LOOK_S = 2.0
#: Jobs whose sequences a worker keeps open.
_KEPT_OPEN = 2


@dataclass(frozen=True, kw_only=True)
class ClusterJob:
    """What a worker needs for any chunk of a measurement.

    Attributes
    ----------
    rig, options, models : as :class:`ChunkWorker` takes them.
    frames : how the cameras' sequences are opened.
    sizes : of every camera the number of frames and the last file's bytes, that all
        machines look at the same.
    parts, fingerprint : where the records go, as :func:`put_part` takes them.
    version : of the program that asks.
    """

    rig: RigData
    options: ChunkOptions
    models: Mapping[str, CameraModel | None]
    frames: Mapping[str, CameraFrames]
    sizes: Mapping[str, tuple[int, int]]
    parts: Path
    fingerprint: str
    version: str = __version__


class ClusterRunner:
    """Measures chunks by the workers of a Dask scheduler.

    Parameters
    ----------
    scheduler : "tcp://host:port", or "local": processes of this machine.
    workers : of "local" how many; 0: one a core.
    client : a ``distributed.Client`` that is there already, used instead.

    Raises
    ------
    MeasurementError
        Dask is not installed, the scheduler cannot be reached, no worker comes, a worker
        cannot see a file, or too many are lost.
    """

    def __init__(self, scheduler: str = LOCAL, workers: int = 0, client: Any = None) -> None:
        self._scheduler, self._workers, self._client = scheduler, workers, client
        self._distributed = _distributed()

    def __call__(
        self,
        job: MeasureJob,
        store: ChunkStore,
        models: Mapping[str, CameraModel | None],
        chunks: Sequence[Chunk],
    ) -> Iterator[Chunk]:
        """Chunks whose records the store has, as they come."""
        if not isinstance(store, FolderStore) or not job.frames:
            raise ValueError("store: a cluster measures projects into folders")
        if not chunks:
            return
        data = pickle.dumps(_cluster_job(job, store, models))
        digest = hashlib.sha256(data).hexdigest()
        with contextlib.ExitStack() as stack:
            client = self._client or stack.enter_context(self._connect())
            dispatch = _Dispatch(self._distributed, client, store, data, digest)
            yield from dispatch.run(chunks)

    @contextlib.contextmanager
    def _connect(self) -> Iterator[Any]:
        distributed = self._distributed
        with contextlib.ExitStack() as stack:
            address: Any = self._scheduler
            if address == LOCAL:
                with _without_interrupts():
                    cluster = distributed.LocalCluster(
                        n_workers=self._workers or os.cpu_count() or 1,
                        threads_per_worker=1,
                        processes=True,
                        dashboard_address=None,
                        memory_limit=0,  # pages of mapped recordings would count
                        silence_logs="CRITICAL",
                    )
                address = stack.enter_context(cluster)  # the client knows it by this
            try:
                client = stack.enter_context(distributed.Client(address, timeout=_FIRST_S))
            except (OSError, ValueError) as error:
                raise MeasurementError(
                    f"the scheduler {self._scheduler} cannot be reached ({error}): start it with "
                    "`dask scheduler`, and give the address that it prints: tcp://host:8786"
                ) from error
            yield client


class _Dispatch:
    """Chunks under way on the workers of a client."""

    def __init__(
        self, distributed: Any, client: Any, store: FolderStore, data: bytes, digest: str
    ) -> None:
        self._distributed, self._client, self._store = distributed, client, store
        self._data, self._digest = data, digest
        self._running: dict[Any, Chunk] = {}
        self._lost: Counter[Chunk] = Counter()
        self._looked, self._threads = 0.0, 0
        # Of a cluster of our own: workers that were lost while they began are begun again.
        cluster = getattr(client, "cluster", None)
        self._cluster, self._size = cluster, len(getattr(cluster, "worker_spec", ()))

    def run(self, chunks: Sequence[Chunk]) -> Iterator[Chunk]:
        try:
            self._client.wait_for_workers(1, timeout=_FIRST_S)
        except TimeoutError as error:
            raise MeasurementError(
                f"the scheduler has no worker after {_FIRST_S:g} s: start some with `dask worker "
                "tcp://host:8786 --memory-limit 0`"
            ) from error
        waiting = deque(chunks)
        try:
            while waiting or self._running:
                # As many as the workers can do, and as many more to begin with at once.
                while waiting and len(self._running) < 2 * max(self._num_threads(), 1):
                    self._submit(waiting.popleft())
                for future in self._ended():
                    chunk = self._running.pop(future)
                    if self._is_done(future, chunk):
                        yield chunk
                    else:
                        waiting.appendleft(chunk)
        finally:
            with contextlib.suppress(Exception):  # the scheduler may be gone
                self._client.cancel(list(self._running))

    def _submit(self, chunk: Chunk) -> None:
        future = self._client.submit(
            measure_part,
            self._data,
            self._digest,
            chunk,
            pure=False,
            key=f"videogrammetry-{chunk[0]}-{chunk[1]}-{uuid.uuid4().hex[:12]}",
        )
        self._running[future] = chunk

    def _num_threads(self) -> int:
        if time.monotonic() - self._looked > _LOOK_S:
            self._threads = sum(self._client.nthreads().values())
            self._looked = time.monotonic()
            if self._cluster is not None:
                self._cluster.scale(self._size)
        return self._threads

    def _ended(self) -> list[Any]:
        """Futures that have ended, one at least."""
        since = time.monotonic()
        while True:
            with contextlib.suppress(TimeoutError, self._distributed.CancelledError):
                self._distributed.wait(
                    list(self._running), timeout=_LOOK_S, return_when="FIRST_COMPLETED"
                )
            ended = [future for future in self._running if future.status != "pending"]
            if ended:
                return sorted(ended, key=lambda future: self._running[future])
            if self._client.status not in ("running", "connecting"):
                raise _gone()
            if self._num_threads():
                since = time.monotonic()
            elif time.monotonic() - since > _NONE_LEFT_S:
                raise MeasurementError(
                    f"no worker is left for {_NONE_LEFT_S:g} s: start some, and run "
                    "`videogrammetry measure` again: what was measured is kept"
                )

    def _is_done(self, future: Any, chunk: Chunk) -> bool:
        """Whether the chunk's record is there; False: its worker was lost."""
        if future.status in ("cancelled", "lost"):
            raise _gone()
        if future.status == "error":
            error = future.exception()
            if not isinstance(error, self._distributed.KilledWorker):
                raise _named(error)
            return self._is_lost(chunk)
        if not self._store.missing([chunk]):
            return True
        try:
            where = future.result(timeout=_SEEN_S)
        except (
            self._distributed.KilledWorker,
            self._distributed.CancelledError,
            TimeoutError,
            OSError,
        ):  # who did it was lost afterwards, and its word with it
            return self._is_lost(chunk) if self._store.missing([chunk]) else True
        until = time.monotonic() + _SEEN_S
        while self._store.missing([chunk]):
            if time.monotonic() > until:
                raise MeasurementError(
                    f"worker {where} has written the stages {chunk[0]} to {chunk[1]}, but they do "
                    f"not appear in {self._store.folder}: that folder must be the same storage "
                    "for all machines"
                )
            time.sleep(0.2)
        return True

    def _is_lost(self, chunk: Chunk) -> bool:
        """False, the chunk is to be measured again; an error if that was tried too often."""
        self._lost[chunk] += 1
        if self._lost[chunk] * 4 > _MOST_LOST:  # Dask itself tries four
            raise MeasurementError(
                f"{_MOST_LOST} workers were lost while they measured the stages {chunk[0]} to "
                f"{chunk[1]}: have they too little memory? What was measured is kept"
            )
        return False


def measure_part(data: bytes, digest: str, chunk: Chunk) -> str:
    """Measures a chunk of the pickled job ``data`` into its parts; returns who did it.

    Run by workers; sequences stay open from chunk to chunk.
    """
    job, worker = _OPEN.get(data, digest)
    put_part(job.parts, job.fingerprint, chunk, worker(*chunk))
    return _this_worker()


class _OpenJobs:
    """The last jobs of this process by their digests."""

    def __init__(self) -> None:
        self._jobs: OrderedDict[str, tuple[ClusterJob, ChunkWorker]] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, data: bytes, digest: str) -> tuple[ClusterJob, ChunkWorker]:
        with self._lock:
            if digest not in self._jobs:
                job: ClusterJob = pickle.loads(data)
                self._jobs[digest] = (job, _worker_of(job))
                while len(self._jobs) > _KEPT_OPEN:
                    self._jobs.popitem(last=False)
            self._jobs.move_to_end(digest)
            return self._jobs[digest]


_OPEN = _OpenJobs()


def _worker_of(job: ClusterJob) -> ChunkWorker:
    if job.version != __version__:
        raise MeasurementError(
            f"worker {_this_worker()} has videogrammetry {__version__}, the measurement is begun "
            f"with {job.version}: install the same version on all machines"
        )
    try:
        sources = open_frames(job.frames)
        sizes = {name: _size(source) for name, source in sources.items()}
    except (SequenceError, OSError) as error:
        raise SequenceError(
            f"worker {_this_worker()} cannot see the sequences: {error}; all workers need the "
            "project's folder and the recordings under the same absolute paths, on shared storage"
        ) from error
    for name, size in sizes.items():
        if size != job.sizes[name]:
            raise SequenceError(
                f"worker {_this_worker()} sees another sequence of camera {name!r} ({size[0]} "
                f"frames, last file {size[1]} bytes, instead of {job.sizes[name][0]} and "
                f"{job.sizes[name][1]}): the path must be the same storage on all machines"
            )
    return ChunkWorker(job.rig, sources, job.options, job.models)


def _cluster_job(
    job: MeasureJob, store: FolderStore, models: Mapping[str, CameraModel | None]
) -> ClusterJob:
    return ClusterJob(
        rig=job.rig,
        options=job.options,
        models=models,
        frames=job.frames,
        sizes={name: _size(source) for name, source in job.sources.items()},
        parts=store.folder.resolve(),
        fingerprint=store.fingerprint,
    )


def _size(source: FrameSource) -> tuple[int, int]:
    """Number of frames, and bytes of the last file."""
    paths = getattr(source, "paths", ())
    return len(source), os.stat(paths[-1]).st_size if paths else 0


@contextlib.contextmanager
def _without_interrupts() -> Iterator[None]:
    """Threads and processes begun here take no Ctrl-C, which is for who began them.

    The mask goes on to whatever they begin, so that workers begun anew have it too. A
    Ctrl-C meanwhile comes at the end.
    """
    if os.name != "posix":
        yield
        return
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # it would take the mask off when it begins
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _this_worker() -> str:
    try:
        from distributed import get_worker

        return str(get_worker().address)
    except (ImportError, ValueError):
        return f"process {os.getpid()}"


def _gone() -> MeasurementError:
    return MeasurementError(
        "the connection to the scheduler was lost; what was measured is kept: start it again and "
        "run `videogrammetry measure` again"
    )


def _named(error: BaseException) -> BaseException:
    if isinstance(error, ModuleNotFoundError):
        return MeasurementError(
            f"a worker lacks a module ({error}): install the same videogrammetry in the Python "
            "of all workers"
        )
    return error


def _distributed() -> Any:
    try:
        import distributed
    except ImportError as error:
        raise MeasurementError(
            "measuring on a cluster needs Dask: pip install 'videogrammetry[cluster]'"
        ) from error
    return distributed
