"""Reading and recognising frames, several at a time."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Protocol, TypeVar

from videogrammetry.errors import ProjectFileError, SequenceError
from videogrammetry.project import CameraSection, Project, TargetsSection
from videogrammetry.recognition import RecognitionOptions, read_frame, recognize
from videogrammetry.sequence import open_sequence
from videogrammetry.sequence.source import JoinedSource
from videogrammetry.types import FrameSource, Targets

T = TypeVar("T")
R = TypeVar("R")


class Progress(Protocol):
    """Called as the work goes on: ``what`` is being done, ``done`` of ``total`` are finished."""

    def __call__(self, done: int, total: int, what: str = "") -> None:
        """Show it."""
        ...


def silent(done: int, total: int, what: str = "") -> None:
    """The progress that nobody watches."""


def recognition_options(targets: TargetsSection) -> RecognitionOptions:
    """``[targets]`` as options of recognition."""
    return RecognitionOptions(
        codes=targets.codes,
        direction=targets.direction,
        polarity=targets.polarity,
        diameter_px=targets.diameter_px,
        method=targets.method,
        estimator=targets.estimator,
    )


def open_cameras(
    project: Project, key: str, specs: Callable[[CameraSection], tuple[str, ...] | None]
) -> dict[str, JoinedSource]:
    """The sequences that ``key`` names in every camera's section."""
    sources = {}
    for name, camera in project.cameras.items():
        spec = specs(camera)
        if not spec:
            raise ProjectFileError(
                f'{project.path}: [cameras.{name}] has no {key}: add {key} = "pictures/*.tif" '
                "(files, a folder or a pattern)"
            )
        try:
            sources[name] = open_sequence(spec, project.folder)
        except SequenceError as error:
            raise SequenceError(f"camera {name!r}, {key}: {error}") from error
    return sources


def read_and_recognize(source: FrameSource, index: int, options: RecognitionOptions) -> Targets:
    """The targets of one frame; an error names the frame."""
    frame = read_frame(source, index, options)
    try:
        return recognize(frame, options)
    except ValueError as error:
        raise SequenceError(f"{source.name(index)}: {error}") from error


def map_bounded(work: Callable[[T], R], items: Iterable[T], num_threads: int = 0) -> Iterator[R]:
    """Results of ``work`` in the items' order, computed by threads.

    At most twice as many items as threads are under way or waiting to be
    taken, so that memory does not grow with their number.

    Examples
    --------
    >>> list(map_bounded(lambda x: x * x, range(5), 2))
    [0, 1, 4, 9, 16]
    """
    threads = num_threads or os.cpu_count() or 1
    with ThreadPoolExecutor(threads) as pool:
        waiting: deque[Future[R]] = deque()
        try:
            for item in items:
                waiting.append(pool.submit(work, item))
                if len(waiting) >= 2 * threads:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            for future in waiting:
                future.cancel()


def input_files(project: Project, sources: Mapping[str, FrameSource]) -> list[str]:
    """The files that a result's provenance names."""
    table = [project.targets.codes] if os.path.isfile(project.targets.codes) else []
    pictures = [str(p) for s in sources.values() for p in getattr(s, "paths", ())]
    return [str(project.path), *table, *pictures]
