"""A whole sequence of pictures to their targets, in one call."""

from __future__ import annotations

import math
import operator
import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count
from queue import SimpleQueue
from typing import Any, Literal, SupportsIndex, TypeVar, cast

import numpy as np
import numpy.typing as npt

from videogrammetry._core import recognition as _core
from videogrammetry.errors import SequenceError
from videogrammetry.recognition.camera_model import CameraModel
from videogrammetry.recognition.learning import (
    CameraRule,
    Frames,
    camera_rule,
    frame_numbers,
    read_frame,
    same_depth_runs,
)
from videogrammetry.recognition.options import RecognitionOptions, TrackedOptions
from videogrammetry.recognition.packed import PackedFrame
from videogrammetry.recognition.recognize import CoreFrame, checked_frame, core_recognizer
from videogrammetry.recognition.tracked import Follower, core_tracker
from videogrammetry.types import PackedSamples, Targets

_FIELDS = tuple(Targets.__dataclass_fields__)

#: Frames in memory go to the core in runs of about this many pixels a thread: a
#: few milliseconds of work, against which Python's share of 0.1 ms is little
#: and after which an interrupt is heard; of large frames still _LEAST_RUN, so
#: that threads with an easy frame do not wait long for one with a hard one.
_RUN_PX = 1 << 20
_LEAST_RUN = 4
#: Of frames that are followed: some milliseconds of work too, and of those that are read
#: no more than this many bytes and a frame.
_FOLLOWED_RUN = 32
_HELD_BYTES = 1 << 24

Found = TypeVar("Found")


@dataclass(frozen=True, kw_only=True)
class TargetSequence:
    """The targets of the frames of a sequence.

    ``sequence[i]`` are the targets of the i-th frame that was recognised, as
    views into the arrays of ``targets``; iteration goes over the frames.

    Attributes
    ----------
    targets : of all frames, one after the other.
    offsets : (S + 1,) those of the i-th frame stand at offsets[i] to offsets[i + 1].
    frame : (S,) the frames' numbers in the sequence, from 0.
    camera : the model that the frames were measured by, learned or given; None:
        each one said for itself.
    full : (S,) whether the whole frame was searched; None: targets were not followed.
    lost : (S,) targets that were expected in the frame and not found; likewise.
    """

    targets: Targets
    offsets: npt.NDArray[np.int64]
    frame: npt.NDArray[np.int64]
    camera: CameraModel | None = None
    full: npt.NDArray[np.bool_] | None = None
    lost: npt.NDArray[np.int32] | None = None

    def __len__(self) -> int:
        return len(self.frame)

    def __getitem__(self, index: SupportsIndex) -> Targets:
        """Targets of the i-th frame recognised; negative numbers count from the end."""
        i = operator.index(index)
        i += len(self) if i < 0 else 0
        if not 0 <= i < len(self):
            raise IndexError(f"frame {operator.index(index)} of {len(self)} recognised frames")
        return self.targets.select(slice(int(self.offsets[i]), int(self.offsets[i + 1])))

    def __iter__(self) -> Iterator[Targets]:
        return (self[i] for i in range(len(self)))


def recognize_sequence(
    frames: Frames | Sequence[npt.NDArray[Any] | PackedSamples] | npt.NDArray[Any],
    options: RecognitionOptions | None = None,
    *,
    camera: CameraModel | Literal["learn"] | None = "learn",
    track: TrackedOptions | None = None,
    first: int = 0,
    last: int | None = None,
    num_threads: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> TargetSequence:
    """Find the targets of every frame, by threads: :func:`recognize` of each one.

    With the method ``edge-pair`` all frames are measured by one model of the
    camera, which is faster too: the targets are those of ``recognize(frame,
    options, camera=result.camera)``. It is learned from some of the frames named
    (:func:`learn_camera`); parts of a sequence agree if they are given the model
    of one of them, or of the whole. Frames of another depth than the pictures
    it was learned from say for themselves.

    The result does not depend on the number of threads. Of a sequence that is
    read, each thread holds one frame and no frame waits (with ``track`` a few small
    ones, 16 MB), so that memory does not grow with the sequence. Frames in memory are
    used where they stand; those that are not rows of native uint8 or uint16 are copied, a run of
    frames (about a million pixels or four frames a thread) at a time.

    With ``track`` targets are followed: the frames are taken one after the other
    and searched around the places where targets are expected, by the method
    ``edge-pair`` alone. A target that lies in such a window is the one that the call
    without ``track`` gives; in clutter the fit of a few may start elsewhere and end
    a part of its sigma away. One that comes into view between windows is
    first seen when a whole frame is searched, which happens every
    ``track.full_every`` frames, where a target is lost, and after a frame without targets.
    Where learning finds none the first frame that has one gives the model. One sequence is
    then the work of one thread: several cameras' go side by side in threads of
    the caller, for the interpreter's lock is released.

    Parameters
    ----------
    frames : FrameSource, or (S, height, width) array or sequence of arrays
        uint8 or uint16, or PackedFrame, as for :func:`recognize`. Of a source only
        ``read`` and ``len`` are needed; ``read`` is called from several threads
        at once. Where it has ``packed`` and the method is ``edge-pair``, packed
        frames are recognised where they stand instead.
    options : RecognitionOptions, optional
        Checked once, before the first frame is read.
    camera : CameraModel, "learn" or None
        The model to measure by; "learn": from up to five frames, which are read
        once more for it; None: each frame says for itself. Methods other than
        ``edge-pair`` have none, and targets are not followed without one.
    track : TrackedOptions, optional
        Follow targets from frame to frame; None: search every frame as a whole.
    first, last : int
        First and last frame, inclusive, from 0; None: to the end.
    num_threads : int
        0: one a core. Nothing with ``track``.
    progress : callable, optional
        Called with (done, total) as frames are finished, by the thread that
        called. What it raises ends the work: frames begun are finished, no
        other is.

    Returns
    -------
    TargetSequence
        In the frames' order.

    Raises
    ------
    ValueError
        An option, an array or the range is not what is expected; of one of
        several arrays, its number from 1 is named.
    SequenceError
        A frame of a source cannot be read or is no picture; its name is in the
        message. If there are several, the first one is named.

    Examples
    --------
    >>> y, x = np.mgrid[:60, :80]
    >>> distance = np.stack([np.hypot(x - 40 - shift, y - 30.5) for shift in range(3)])
    >>> frames = np.uint8(20 + 200 * np.clip(10.5 - distance, 0, 1))
    >>> found = recognize_sequence(frames)
    >>> found.offsets.tolist(), [targets.centre_px[0, 0].round(1).item() for targets in found]
    ([0, 1, 2, 3], [40.0, 41.0, 42.0])

    Followed from frame to frame, of which only the first is searched as a whole:

    >>> fast = RecognitionOptions(method="edge-pair")
    >>> frames = np.uint8(20 + 200 / (1 + np.exp(2 * (distance - 10.5))))
    >>> followed = recognize_sequence(frames, fast, track=TrackedOptions(margin_px=3))
    >>> followed.full.tolist(), followed.lost.tolist(), followed.offsets.tolist()
    ([True, False, False], [0, 0, 0], [0, 1, 2, 3])
    """
    options = options or RecognitionOptions()
    recognizer = core_recognizer(options)
    if num_threads < 0:
        raise ValueError(f"num_threads: expected >= 0 (0: one a core), got {num_threads}")
    num_threads = num_threads or os.cpu_count() or 1
    if isinstance(frames, np.ndarray):
        _check_stack(frames)
    numbers = frame_numbers(len(frames), first, last)
    if track is not None:
        core_tracker(options, track, camera)  # refuses what is wrong before a frame is read
    rule = camera_rule(camera, frames, options, numbers)
    tell = progress or (lambda done, total: None)
    follower = None if track is None else Follower(options, track, rule, recognizer)
    if follower is not None:
        parts = _of_followed(frames, numbers, options, follower, tell)
    elif hasattr(frames, "read"):

        def whole(frame: CoreFrame) -> dict[str, Any]:
            found = recognizer.recognize_frames([frame], 1, rule.core_for(frame))
            return cast(dict[str, Any], found)

        parts = _of_source(
            lambda index: _of_source_frame(frames, index, options, whole),
            numbers,
            num_threads,
            tell,
        )
    else:
        parts = _of_arrays(frames, numbers, recognizer, rule, num_threads, tell)
    # A set of no frames gives the arrays their types where there is nothing else.
    joined = parts or [recognizer.recognize_frames([])]
    sizes = [np.diff(part["offsets"]) for part in joined]
    return TargetSequence(
        targets=Targets(**{n: np.concatenate([part[n] for part in joined]) for n in _FIELDS}),
        offsets=np.concatenate([[0], *sizes]).cumsum(dtype=np.int64),
        frame=np.arange(numbers.start, numbers.stop, dtype=np.int64),
        camera=follower.camera if follower else rule.camera,
        full=_joined(parts, "full", bool) if follower else None,
        lost=_joined(parts, "lost", np.int32) if follower else None,
    )


def _joined(parts: list[dict[str, Any]], name: str, dtype: Any) -> npt.NDArray[Any]:
    return np.concatenate([np.empty(0, dtype), *(part[name] for part in parts)])


def _check_stack(frames: npt.NDArray[Any]) -> None:
    if frames.ndim != 3:
        raise ValueError(
            f"frames: expected 3 dimensions (frames, height, width), got shape {frames.shape}"
        )
    if frames.dtype.kind != "u" or frames.dtype.itemsize > 2:
        raise ValueError(f"frames: expected uint8 or uint16, got {frames.dtype}")


def _of_arrays(
    frames: Any,
    numbers: range,
    recognizer: _core.Recognizer,
    rule: CameraRule,
    num_threads: int,
    tell: Callable[[int, int], None],
) -> list[dict[str, Any]]:
    """Runs of frames, the threads within the core."""
    parts: list[dict[str, Any]] = []
    done = 0
    while done < len(numbers):
        size = max(1, math.prod(_shape(frames[numbers[done]])))
        run = numbers[done : done + num_threads * max(_LEAST_RUN, _RUN_PX // size)]
        parts += _of_run(_checked_run(frames, run), recognizer, rule, num_threads)
        done += len(run)
        tell(done, len(numbers))
    return parts


def _of_run(
    frames: list[CoreFrame], recognizer: _core.Recognizer, rule: CameraRule, num_threads: int
) -> list[dict[str, Any]]:
    one_rule = [frames] if rule.camera is None else same_depth_runs(frames)
    return [
        recognizer.recognize_frames(part, num_threads, rule.core_for(part[0])) for part in one_rule
    ]


def _checked_run(frames: Any, run: range) -> list[CoreFrame]:
    if isinstance(frames, np.ndarray):
        stack = np.asarray(frames[run.start : run.stop])
        if np.may_share_memory(_checked_array(stack[0], run.start), stack):
            return list(stack)  # as the first one they need no copy
    return [_checked_array(frames[i], i) for i in run]


def _shape(frame: Any) -> tuple[int, ...]:
    shape: tuple[int, ...] | None = getattr(frame, "shape", None)
    return np.shape(frame) if shape is None else shape


def _checked_array(frame: Any, index: int) -> CoreFrame:
    try:
        return checked_frame(frame)
    except ValueError as error:
        raise ValueError(f"frame {index + 1}: {error}") from error


def _of_source(
    one_frame: Callable[[int], dict[str, Any]],
    numbers: range,
    num_threads: int,
    tell: Callable[[int, int], None],
) -> list[dict[str, Any]]:
    """Every thread reads the next frame that nobody has, and recognises it.

    Numbers are handed out in order and what is begun is finished, so that of
    several bad frames the first one is always among those found.
    """
    parts: list[Any] = [None] * len(numbers)
    errors: dict[int, BaseException] = {}
    ended: SimpleQueue[bool] = SimpleQueue()
    stop = threading.Event()
    take = count()
    lock = threading.Lock()

    def work() -> None:
        while not stop.is_set():
            with lock:
                at = next(take)
            if at >= len(numbers):
                return
            try:
                parts[at] = one_frame(numbers[at])
            except BaseException as error:
                errors[at] = error
                stop.set()
            ended.put(True)

    threads = min(num_threads, max(1, len(numbers)))
    try:
        with ThreadPoolExecutor(threads) as pool:
            try:
                for _ in range(threads):
                    pool.submit(work)
                for done in range(1, len(numbers) + 1):
                    ended.get()
                    if errors:
                        break
                    tell(done, len(numbers))
            finally:
                stop.set()
        if errors:
            raise errors[min(errors)]
    finally:
        errors.clear()  # their tracebacks hold frames
    return parts


def _of_followed(
    frames: Any,
    numbers: range,
    options: RecognitionOptions,
    follower: Follower,
    tell: Callable[[int, int], None],
) -> list[dict[str, Any]]:
    """One frame after the other, in their order; of those in memory several in one call."""
    parts: list[dict[str, Any]] = []
    done = 0
    from_source = hasattr(frames, "read")
    while done < len(numbers):
        run = numbers[done : done + _FOLLOWED_RUN]
        if from_source:
            held = _held_run(frames, run, options)
            run = run[: len(held)]
            with _named(frames, run[0]):
                parts += follower.recognize(held)
        else:
            parts += follower.recognize(_checked_run(frames, run))
        for _ in run:
            done += 1
            tell(done, len(numbers))
    return parts


def _held_run(source: Frames, run: range, options: RecognitionOptions) -> list[CoreFrame]:
    """The next frames of a source: one, and more as long as they are small."""
    held: list[CoreFrame] = []
    size = 0
    for index in run:
        with _named(source, index):
            frame = read_frame(source, index, options)
            held.append(checked_frame(frame))
        size += (frame.data if isinstance(frame, PackedFrame) else frame).nbytes
        if size > _HELD_BYTES:
            break
    return held


def _of_source_frame(
    source: Frames,
    index: int,
    options: RecognitionOptions,
    recognize: Callable[[CoreFrame], Found],
) -> Found:
    with _named(source, index):
        return recognize(checked_frame(read_frame(source, index, options)))


@contextmanager
def _named(source: Frames, index: int) -> Iterator[None]:
    """Names the frame in what is raised."""
    try:
        yield
    except (SequenceError, ValueError, OSError) as error:
        name = source.name(index) if hasattr(source, "name") else f"frame {index + 1}"
        if isinstance(error, SequenceError) and name in str(error):
            raise
        raise SequenceError(f"{name}: {error}") from error
    except Exception as error:
        error.add_note(f"(at frame {index + 1} of the sequence)")
        raise
