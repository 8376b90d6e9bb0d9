"""A camera's model from the pictures of a sequence, and how frames come to recognition."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, cast

import numpy as np
import numpy.typing as npt

from videogrammetry._core import recognition as _core
from videogrammetry.recognition.camera_model import CameraModel, from_core, pool_models
from videogrammetry.recognition.options import RecognitionOptions
from videogrammetry.recognition.packed import PackedFrame, as_packed, is_packed
from videogrammetry.recognition.recognize import (
    IN_PLACE,
    CoreFrame,
    checked_frame,
    core_camera,
    core_recognizer,
)
from videogrammetry.types import PackedSamples

#: Pictures that a model is pooled of; where none of them shows a target, the
#: first one of so many others that does has the say.
_LEARN_FROM, _LOOK_AT = 5, 32


class Frames(Protocol):
    """What is needed of a ``FrameSource`` here.

    ``name(index)`` and ``packed(index)`` are used where there are any.
    """

    def __len__(self) -> int:
        """Number of frames."""
        ...

    def read(self, index: int) -> npt.NDArray[Any]:
        """The frame, (height, width); called from several threads at once."""
        ...


def read_frame(
    source: Frames, index: int, options: RecognitionOptions | None = None
) -> npt.NDArray[Any] | PackedFrame:
    """A source's frame as recognition with these options takes it with the least work.

    Where the source has the frame's packed samples in memory (``packed(index)``)
    and the method reads them in place, they are it; else what ``read`` gives.

    Parameters
    ----------
    source : a FrameSource.
    index : the frame, from 0.
    options : of the recognition to come; None: the defaults.
    """
    method = (options or RecognitionOptions()).method
    packed = getattr(source, "packed", None) if method == IN_PLACE else None
    samples: PackedSamples | None = None if packed is None else packed(index)
    return source.read(index) if samples is None else as_packed(samples)


def learn_camera(
    images: Frames | PackedSamples | npt.NDArray[Any] | Sequence[npt.NDArray[Any] | PackedSamples],
    options: RecognitionOptions | None = None,
    *,
    first: int = 0,
    last: int | None = None,
) -> CameraModel | None:
    """Learn noise, blur and light of a camera from one or some of its pictures.

    Of several pictures up to five are looked at, spread evenly from the first
    to the last, and the medians taken; the blur's spread contains what it
    differs between them. If none of these shows a target, the first one that
    does of 32 others, spread likewise, is taken alone. Pictures of another depth
    than the first one with targets are not used, nor those that cannot be read.
    The result depends on nothing but the frames named.

    Parameters
    ----------
    images : (H, W) array or PackedFrame; FrameSource, (S, H, W) array or sequence of these.
    options : RecognitionOptions, optional
    first, last : of several pictures the first and last, inclusive, from 0.

    Returns
    -------
    CameraModel or None
        None if no target was seen, and of any method but ``edge-pair``.

    Raises
    ------
    ValueError
        An option, an array or the range is not what is expected.

    Examples
    --------
    >>> y, x = np.mgrid[:60, :80]
    >>> distance = np.hypot(x - 40.3, y - 30.5)
    >>> image = np.uint8(20 + 200 / (1 + np.exp(2 * (distance - 10.5))))
    >>> model = learn_camera(image, RecognitionOptions(method="edge-pair"))
    >>> round(model.blur_px, 1)
    0.8
    """
    options = options or RecognitionOptions()
    recognizer = core_recognizer(options)
    if _is_one_picture(images):
        images = [cast(Any, images)]
        checked_frame(images[0])
    numbers = frame_numbers(len(cast(Any, images)), first, last)
    if options.method != IN_PLACE:
        return None
    return learned_rule(frame_getter(images, options), numbers, recognizer).camera


@dataclass(frozen=True)
class CameraRule:
    """A model and the frames that are measured by it: of its depth (``wide``: over 8 bit)."""

    camera: CameraModel | None = None
    wide: bool | None = None

    def core_for(self, frame: CoreFrame) -> _core.CameraModel | None:
        """The model for a frame, or None: it says for itself."""
        if self.camera is None or self.wide not in (None, is_wide(frame)):
            return None
        return self.camera.core


def camera_rule(
    camera: CameraModel | str | None,
    frames: Any,
    options: RecognitionOptions,
    numbers: range,
) -> CameraRule:
    """The rule that the argument ``camera`` of ``recognize_sequence`` means."""
    if isinstance(camera, str) and camera != "learn":
        raise ValueError(f"camera: expected a CameraModel, 'learn' or None, got {camera!r}")
    if camera is not None and not isinstance(camera, str):
        core_camera(camera)
        return CameraRule(camera) if options.method == IN_PLACE else CameraRule()
    if camera is None or options.method != IN_PLACE:
        return CameraRule()
    return learned_rule(frame_getter(frames, options), numbers, core_recognizer(options))


def learned_rule(
    get: Callable[[int], CoreFrame], numbers: range, recognizer: _core.Recognizer
) -> CameraRule:
    """The model of some of the frames, whose recognition will name those that are wrong."""
    models: list[CameraModel] = []
    wide: bool | None = None

    def look(index: int) -> None:
        nonlocal wide
        try:
            frame = get(index)
        except Exception:
            return  # it is met again, by its turn and with its name
        if wide not in (None, is_wide(frame)):
            return
        model = recognizer.learn(frame)
        if model is not None:
            models.append(from_core(model))
            wide = is_wide(frame)

    chosen = _spread(numbers, _LEARN_FROM)
    for index in chosen:
        look(index)
    for index in _spread(numbers, _LOOK_AT):
        if models:
            break
        if index not in chosen:
            look(index)
    return CameraRule(pool_models(models), wide)


def frame_getter(frames: Any, options: RecognitionOptions) -> Callable[[int], CoreFrame]:
    """Frames by their number, of a source or of what is in memory, as the core takes them."""
    if hasattr(frames, "read"):
        return lambda index: checked_frame(read_frame(frames, index, options))
    return lambda index: checked_frame(frames[index])


def frame_numbers(length: int, first: int, last: int | None) -> range:
    """The frames from first to last, inclusive.

    Raises
    ------
    ValueError
        There are no such frames.
    """
    if length == 0 and first == 0 and last is None:
        return range(0)
    end = length - 1 if last is None else last
    if not 0 <= first <= end < length:
        raise ValueError(
            f"first, last: expected 0 <= first <= last <= {length - 1}, the last frame; "
            f"got {first} and {last}"
        )
    return range(first, end + 1)


def same_depth_runs(frames: list[CoreFrame]) -> Iterator[list[CoreFrame]]:
    """The frames, cut where their depth changes."""
    begin = 0
    for i in range(1, len(frames) + 1):
        if i == len(frames) or is_wide(frames[i]) != is_wide(frames[begin]):
            yield frames[begin:i]
            begin = i


def is_wide(frame: CoreFrame) -> bool:
    """Whether its samples have more than 8 bits."""
    return not isinstance(frame, np.ndarray) or frame.itemsize > 1


def _spread(numbers: range, count: int) -> list[int]:
    """Up to ``count`` numbers, evenly from the first to the last, each once.

    Examples
    --------
    >>> _spread(range(10, 31), 5), _spread(range(3), 5), _spread(range(0), 5)
    ([10, 15, 20, 25, 30], [0, 1, 2], [])
    """
    if len(numbers) <= count:
        return list(numbers)
    return [numbers[i * (len(numbers) - 1) // (count - 1)] for i in range(count)]


def _is_one_picture(images: Any) -> bool:
    if isinstance(images, np.ndarray):
        return images.ndim == 2
    return not hasattr(images, "read") and is_packed(images)
