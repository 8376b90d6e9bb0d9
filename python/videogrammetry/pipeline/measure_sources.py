"""A measurement's sequences: opened, brought into step, and what is to be said of them."""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from videogrammetry.errors import (
    MeasurementError,
    ProjectFileError,
    SequenceError,
    SequenceWarning,
)
from videogrammetry.pipeline.frames import input_files
from videogrammetry.project import Project
from videogrammetry.sequence import (
    LenientSource,
    RangeSource,
    check_same_length,
    check_synchronous,
    open_sequence,
)
from videogrammetry.types import FrameSource

#: Frames that cannot be read and are named one by one.
_MOST_NAMED = 20


@dataclass(frozen=True, kw_only=True)
class CameraFrames:
    """How a camera's frames are opened, here or by another machine.

    Attributes
    ----------
    spec : files, folders or patterns, from ``folder``, which is absolute.
    first_frame : of the files' frames (from 1) the first stage's.
    skip_unreadable : whether frames that cannot be read are black ones.
    """

    spec: tuple[str, ...]
    folder: Path
    first_frame: int = 1
    skip_unreadable: bool = False

    def open(self) -> FrameSource:
        """The frames; SequenceError where there are none."""
        with warnings.catch_warnings(action="ignore", category=SequenceWarning):
            whole = open_sequence(self.spec, self.folder, keep_unreadable=self.skip_unreadable)
        source: FrameSource = LenientSource(whole) if self.skip_unreadable else whole
        skip = self.first_frame - 1
        if not skip:
            return source
        if skip >= len(source):
            raise SequenceError(
                f"first_frame = {self.first_frame}, but there are {len(source)} frames"
            )
        return RangeSource(source, skip, len(source) - skip)


def camera_frames(project: Project, *, skip_unreadable: bool = False) -> dict[str, CameraFrames]:
    """How every camera's sequence is opened; ProjectFileError where one has none."""
    frames = {}
    for name, camera in project.cameras.items():
        if not camera.sequence:
            raise ProjectFileError(
                f"{project.path}: [cameras.{name}] has no sequence: add sequence = "
                '"pictures/*.tif" (files, a folder or a pattern)'
            )
        frames[name] = CameraFrames(
            spec=camera.sequence,
            folder=project.folder,
            first_frame=camera.first_frame or 1,
            skip_unreadable=skip_unreadable,
        )
    return frames


def open_frames(frames: Mapping[str, CameraFrames]) -> dict[str, FrameSource]:
    """The cameras' sequences; a SequenceError names the camera."""
    sources = {}
    for name, camera in frames.items():
        try:
            sources[name] = camera.open()
        except SequenceError as error:
            raise SequenceError(f"camera {name!r}, sequence: {error}") from error
    return sources


def common_frames(project: Project, sources: Mapping[str, FrameSource]) -> tuple[int, list[str]]:
    """How many frames all cameras have, and what is to be said of them.

    Cameras that by their files do not start together are refused, with the lines that
    bring them into step; ``first_frame`` for any camera says that it is known better.
    Different lengths are measured as far as all cameras go where it is known that the first
    frames belong together: the files or ``first_frame`` say so, or the shorter ones
    were cut short; or if ``[sequence] last`` says that only these are wanted.

    Raises
    ------
    SequenceError
        Out of step, or of different lengths for no known reason.
    """
    found = check_synchronous(sources)
    said = [
        f"camera {name!r}: {remark}"
        for name, source in sources.items()
        for remark in getattr(source, "remarks", ())
    ]
    said += found.warnings
    in_step = any(camera.first_frame is not None for camera in project.cameras.values())
    late = {name: count for name, count in found.skip.items() if count}
    if late and not in_step:
        lines = ", ".join(f"[cameras.{name}] first_frame = {1 + n}" for name, n in late.items())
        raise SequenceError(
            f"by their {found.evidence} the cameras do not start together: add {lines} to "
            f"{project.path}, and {found.num_common} frames of every camera belong together; or "
            f"first_frame = 1 for one of them, if the {found.evidence} are wrong"
        )
    if late:
        said.append(
            f"by their {found.evidence} the cameras do not start together with first_frame as "
            f"it is: {', '.join(f'{name!r} is {n} frames early' for name, n in late.items())}"
        )
    lengths = {name: len(source) for name, source in sources.items()}
    common, most = min(lengths.values()), max(lengths.values())
    if common == most:
        return common, said
    last = project.sequence.last
    if last is not None and last <= common:
        return common, said
    cut = [
        length == most or any("cut short" in text for text in getattr(sources[name], "remarks", ()))
        for name, length in lengths.items()
    ]
    if not (found.evidence or in_step or all(cut)):
        check_same_length(sources)
    counts = ", ".join(f"camera {name!r} has {length} frames" for name, length in lengths.items())
    said.append(f"{counts}: measured are the {common} that all cameras have")
    return common, said


def stage_range(project: Project, count: int) -> tuple[int, int]:
    """First and last stage that the project wants, of ``count``."""
    first = project.sequence.first
    last = count if project.sequence.last is None else project.sequence.last
    if last > count or first > count:
        raise ProjectFileError(
            f"{project.path}: [sequence] asks for the stages {first} to {last}, but the sequences "
            f"have {count}: correct first and last"
        )
    return first, last


def frame_rate(
    project: Project, sources: Mapping[str, FrameSource]
) -> tuple[float | None, list[str]]:
    """The project's rate over the files' own, with a warning where they differ."""
    rates = {name: source.frame_rate_hz for name, source in sources.items()}
    stated = {name: rate for name, rate in rates.items() if rate is not None}
    wanted = project.sequence.frame_rate_hz
    warnings = []
    if wanted is not None:
        for name, rate in stated.items():
            if not np.isclose(rate, wanted, rtol=1e-9):
                warnings.append(
                    f"camera {name!r}: its file says {rate:g} frames a second, the project "
                    f"{wanted:g}: the project's is taken"
                )
        return wanted, warnings
    for name, source in sources.items():
        step = int(getattr(source, "save_step", 1))
        if step > 1 and name in stated:
            apart = step / stated[name]
            warnings.append(
                f"camera {name!r}: its file says that only every {step}th frame was "
                f"saved: if so, the frames are {apart:g} s apart, and [sequence] frame_rate_hz = "
                f"{1 / apart:g} must be given; {stated[name]:g} Hz is taken"
            )
    if len(set(stated.values())) > 1:
        raise MeasurementError(
            f"the cameras' files state different frame rates ({stated}): synchronous cameras have "
            "one; say which with [sequence] frame_rate_hz"
        )
    if not stated:
        warnings.append(
            "no frame rate: times and velocities are left empty; give [sequence] frame_rate_hz"
        )
        return None, warnings
    return next(iter(stated.values())), warnings


def unreadable_frames(
    sources: Mapping[str, FrameSource], rows: Mapping[str, list[int]]
) -> list[str]:
    """A warning for every frame of ``rows``, from 0, that could not be read.

    Asked of those alone that show no target, which a frame that was read seldom does.
    """
    found = [
        f"camera {name!r}, stage {row + 1}: cannot be read and is left empty: {problem}"
        for name, source in sources.items()
        for row in rows[name]
        if (problem := _problem(source, row)) is not None
    ]
    if len(found) > _MOST_NAMED:
        return [*found[:_MOST_NAMED], f"{len(found) - _MOST_NAMED} further frames are like these"]
    return found


def _problem(source: FrameSource, index: int) -> str | None:
    problem = getattr(source, "problem", lambda index: None)
    said: str | None = problem(index)
    return said


def all_inputs(
    project: Project, sources: Mapping[str, FrameSource]
) -> list[str | os.PathLike[str]]:
    """The files that a measurement depends on."""
    files: list[str | os.PathLike[str]] = [*input_files(project, sources)]
    rig_files = (project.rig_path, project.rig_path.with_suffix(".npz"))
    static = [] if project.stability.points is None else [project.stability.points]
    return [*files, *static, *(path for path in rig_files if path.is_file())]
