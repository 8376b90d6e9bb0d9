"""Whether the cameras' sequences belong together frame by frame, and the offset where not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

import numpy as np
import numpy.typing as npt

from videogrammetry.errors import SequenceError
from videogrammetry.sequence.source import check_index
from videogrammetry.types import FrameSource, PackedSamples

#: Rates that differ by more drift apart by a frame within a recording of a million.
_SAME_RATE = 1e-6
#: Share of a frame's time by which stamps of synchronous cameras may differ.
_SAME_TIME = 0.25


@dataclass(frozen=True, kw_only=True)
class Synchrony:
    """What the cameras' files say of one another.

    Attributes
    ----------
    errors : why the n-th frames cannot belong together, a paragraph each, with the offset.
    warnings : what may be wrong.
    skip : frames to leave out at each camera's beginning so that the n-th ones belong
        together; all 0 where the files do not say, or say that they do.
    num_common : frames that every camera has after that.
    evidence : what ``skip`` comes from: "time stamps", "trigger", or "" for nothing.
    """

    errors: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    skip: Mapping[str, int] = field(default_factory=dict)
    num_common: int = 0
    evidence: str = ""


def check_synchronous(sources: Mapping[str, FrameSource]) -> Synchrony:
    """Compares the lengths, rates, trigger frames and time stamps of all cameras.

    The start of each camera on a common clock is, where all cameras have them, the time of its
    first frame (trigger's time + stamp), else the number of its first frame counted from a
    trigger that all cameras got at once. The camera that starts last starts the common part;
    ``skip = round((latest start - start) * rate)``.

    Parameters
    ----------
    sources : camera's name to its sequence; pictures of different sizes are no contradiction.

    Raises
    ------
    ValueError
        No camera.

    Examples
    --------
    >>> from videogrammetry.sequence import ArraySource
    >>> film = np.zeros((5, 4, 6), np.uint8)
    >>> found = check_synchronous({"left": ArraySource(film), "right": ArraySource(film[1:])})
    >>> found.errors[0][:42], found.num_common
    ("camera 'left' has 5 frames, camera 'right'", 4)
    """
    if not sources:
        raise ValueError("sources: expected at least one camera, got none")
    errors, warnings = _rates(sources)
    skip, evidence, remarks = _offsets(sources)
    warnings += remarks
    counts = {name: len(source) - skip[name] for name, source in sources.items()}
    common = max(0, min(counts.values()))
    if any(skip.values()):
        said = ", ".join(f"{name!r} {count}" for name, count in skip.items())
        errors.append(
            f"the cameras do not start together, by their {evidence}: leave out at the beginning "
            f"{said} frames; {common} frames of every camera then belong together "
            "(videogrammetry.sequence.align does so)"
        )
    lengths = {name: len(source) for name, source in sources.items()}
    if len(set(lengths.values())) > 1:
        said = ", ".join(f"camera {name!r} has {count} frames" for name, count in lengths.items())
        aligned = f" after leaving out {skip}" if any(skip.values()) else ""
        known = (
            f"by their {evidence} they start together, so that the first {common} belong together"
            if evidence and not aligned
            else f"the first {common}{aligned} belong together if none is missing in between"
        )
        errors.append(
            f"{said}: the n-th frames of all cameras belong together; {known}: find the missing "
            f"or surplus frames, or measure up to there (last = {common})"
        )
    return Synchrony(
        errors=tuple(errors),
        warnings=tuple(warnings),
        skip=skip,
        num_common=common,
        evidence=evidence,
    )


def check_same_length(sources: Mapping[str, FrameSource]) -> int:
    """Number of frames of every camera; SequenceError names two cameras that differ.

    The n-th frames of all cameras belong to one stage, so that one missing
    picture would pair all later ones wrongly.
    """
    if not sources:
        raise ValueError("sources: expected at least one camera, got none")
    first = next(iter(sources))
    count = len(sources[first])
    for name, source in sources.items():
        if len(source) != count:
            raise SequenceError(
                f"camera {first!r} has {count} frames, but camera {name!r} has {len(source)}: "
                "the n-th frames of all cameras belong together, so the numbers must be equal; "
                f"find the missing or surplus picture, or narrow the pattern{_offer(sources)}"
            )
    return count


def _offer(sources: Mapping[str, FrameSource]) -> str:
    """Which frames to leave out, where the files say so; else ""."""
    found = check_synchronous(sources)
    if not any(found.skip.values()):
        return ""
    said = ", ".join(f"{name!r} {count}" for name, count in found.skip.items())
    return (
        f". By their {found.evidence} the cameras do not start together: leave out {said} frames "
        f"at the beginning, and {found.num_common} of every camera belong together"
    )


def align(sources: Mapping[str, FrameSource]) -> dict[str, FrameSource]:
    """The frames that belong together by :func:`check_synchronous`, from every camera.

    Examples
    --------
    >>> from videogrammetry.sequence import ArraySource
    >>> film = np.zeros((5, 4, 6), np.uint8)
    >>> both = align({"left": ArraySource(film), "right": ArraySource(film[1:])})
    >>> [len(source) for source in both.values()]
    [4, 4]
    """
    found = check_synchronous(sources)
    if found.num_common == 0:
        raise ValueError("sources: expected cameras with frames in common, got none")
    return {
        name: RangeSource(source, found.skip[name], found.num_common)
        for name, source in sources.items()
    }


class RangeSource:
    """``count`` frames of another source, from its ``first`` (from 0) on.

    Examples
    --------
    >>> from videogrammetry.sequence import ArraySource
    >>> film = np.arange(5, dtype=np.uint8).repeat(24).reshape(5, 4, 6)
    >>> part = RangeSource(ArraySource(film), 2, 3)
    >>> len(part), int(part.read(0)[0, 0]), part.name(0)
    (3, 2, 'frame 3')
    """

    def __init__(self, source: FrameSource, first: int, count: int) -> None:
        if not (first >= 0 and 1 <= count <= len(source) - first):
            raise ValueError(
                f"first, count: expected a part of {len(source)} frames, got {first}, {count}"
            )
        self._source, self._first, self._count = source, first, count
        self.paths = tuple(getattr(source, "paths", ()))

    @property
    def image_size_px(self) -> tuple[int, int]:
        """(width, height)."""
        return self._source.image_size_px

    @property
    def frame_rate_hz(self) -> float | None:
        """Frames a second as the file says, or None."""
        return self._source.frame_rate_hz

    @property
    def save_step(self) -> int:
        """Every n-th frame that the camera took was saved."""
        return int(getattr(self._source, "save_step", 1))

    @property
    def remarks(self) -> tuple[str, ...]:
        """What is wrong with the files of the whole sequence."""
        return tuple(getattr(self._source, "remarks", ()))

    @property
    def first_frame(self) -> int | None:
        """The camera's number of the part's first frame, from the trigger, if it is stated."""
        number: int | None = getattr(self._source, "first_frame", None)
        return None if number is None else number + self._first * self.save_step

    @property
    def trigger_time(self) -> datetime | None:
        """When the trigger came, if it is stated."""
        time: datetime | None = getattr(self._source, "trigger_time", None)
        return time

    def times_s(self) -> npt.NDArray[np.float64] | None:
        """(N,) time stamps of the part, from the trigger; None where there are none."""
        times: npt.NDArray[np.float64] | None
        times = getattr(self._source, "times_s", lambda: None)()
        return None if times is None else times[self._first : self._first + self._count]

    def __len__(self) -> int:
        return self._count

    def name(self, index: int) -> str:
        """The frame's name in the whole sequence."""
        return self._source.name(self._at(index))

    def read(self, index: int) -> npt.NDArray[Any]:
        """The frame: (height, width), uint8 or uint16."""
        return self._source.read(self._at(index))

    def packed(self, index: int) -> PackedSamples | None:
        """The packed samples where they stand; None if the frame is to be read."""
        packed = getattr(self._source, "packed", None)
        samples: PackedSamples | None = None if packed is None else packed(self._at(index))
        return samples

    def problem(self, index: int) -> str | None:
        """Why a frame of a :class:`LenientSource` cannot be read; None: it can."""
        problem = getattr(self._source, "problem", lambda index: None)
        said: str | None = problem(self._at(index))
        return said

    def _at(self, index: int) -> int:
        check_index(index, self._count, "the part")
        return index + self._first


def _rates(sources: Mapping[str, FrameSource]) -> tuple[list[str], list[str]]:
    errors, warnings = [], []
    rates = {n: s.frame_rate_hz for n, s in sources.items() if s.frame_rate_hz is not None}
    steps = {name: int(getattr(source, "save_step", 1)) for name, source in sources.items()}
    if rates and max(rates.values()) > min(rates.values()) * (1 + _SAME_RATE):
        said = ", ".join(f"{name!r} {rate:g} Hz" for name, rate in rates.items())
        errors.append(
            f"the cameras ran at different rates ({said}): their n-th frames are not of one "
            "instant; record with one rate, or say with [sequence] frame_rate_hz that the files err"
        )
    if len(set(steps.values())) > 1:
        said = ", ".join(f"{name!r} 1 in {step}" for name, step in steps.items())
        errors.append(
            f"of the cameras' frames different shares were saved ({said}): save all alike"
        )
    silent = [name for name in sources if name not in rates]
    if rates and silent:
        warnings.append(
            f"the files of {', '.join(map(repr, silent))} state no frame rate, the others do: "
            "whether the cameras ran alike is not known"
        )
    return errors, warnings


def _offsets(sources: Mapping[str, FrameSource]) -> tuple[dict[str, int], str, list[str]]:
    """Frames to skip, what says so, and warnings."""
    none = dict.fromkeys(sources, 0)
    if len(sources) < 2:
        return none, "", []
    numbers = {name: getattr(source, "first_frame", None) for name, source in sources.items()}
    first: dict[str, int] = {name: n for name, n in numbers.items() if n is not None}
    by_trigger = None
    if len(first) == len(sources):
        step = max(int(getattr(source, "save_step", 1)) for source in sources.values())
        latest = max(first.values())
        by_trigger = {name: (latest - number) // step for name, number in first.items()}
        odd = any((latest - number) % step for number in first.values())
    by_time, remarks = _by_time(sources)
    if by_time is not None:
        if by_trigger is not None and by_trigger != by_time:
            remarks.append(
                f"the trigger frames say that {by_trigger} frames are to be left out, the time "
                f"stamps {by_time}: the cameras were not triggered at once, or a clock is wrong; "
                "the time stamps are followed"
            )
        return by_time, "time stamps", remarks
    if by_trigger is None:
        return none, "", remarks
    if odd:
        remarks.append(
            f"the cameras' first frames ({first}) are not whole steps of {step} frames apart: "
            "their saved frames are of different instants; save all from one frame on"
        )
    return by_trigger, "trigger frames", remarks


def _by_time(sources: Mapping[str, FrameSource]) -> tuple[dict[str, int] | None, list[str]]:
    """Frames to skip by absolute times of the first frames; None where they do not tell."""
    starts: dict[str, float] = {}
    rate = next((s.frame_rate_hz for s in sources.values() if s.frame_rate_hz), None)
    zero = None
    for name, source in sources.items():
        trigger = getattr(source, "trigger_time", None)
        times = getattr(source, "times_s", lambda: None)()
        if trigger is None or times is None or not len(times) or rate is None:
            return None, []
        zero = trigger if zero is None else zero
        starts[name] = (trigger - zero).total_seconds() + float(times[0])
    latest = max(starts.values())
    late = {name: (latest - start) * float(rate or 0) for name, start in starts.items()}
    skip = {name: round(frames) for name, frames in late.items()}
    shortest = min(len(source) for source in sources.values())
    if max(skip.values()) >= shortest:
        return None, [
            f"the cameras' clocks differ by {max(starts.values()) - min(starts.values()):g} s, "
            "more than the recordings last: they were not set alike, and nothing is taken from them"
        ]
    remarks = []
    worst = max(abs(frames - skip[name]) for name, frames in late.items())
    if worst > _SAME_TIME:
        remarks.append(
            f"by their time stamps the cameras' frames are {worst:.2f} of a frame's time apart: "
            "the shutters do not open together, or the clocks are not set to one another"
        )
    return skip, remarks


def irregular_times(times_s: npt.NDArray[np.float64]) -> int | None:
    """The first frame (from 0) that is not as long after the one before as most; None if even.

    Examples
    --------
    >>> irregular_times(np.array([0.0, 0.1, 0.2, 0.4, 0.5]))
    3
    """
    apart = np.diff(times_s)
    if len(apart) < 2:
        return None
    usual = float(np.median(apart))
    odd = np.flatnonzero(np.abs(apart - usual) > max(0.1 * abs(usual), 1e-9))
    return int(odd[0]) + 1 if len(odd) else None
