"""Targets followed from frame to frame, and what happens to frames that do not belong."""

from __future__ import annotations

import operator
from typing import Any

import numpy as np

from videogrammetry._core import recognition as _core
from videogrammetry.recognition.camera_model import CameraModel, from_core
from videogrammetry.recognition.learning import CameraRule, is_wide, same_depth_runs
from videogrammetry.recognition.options import RecognitionOptions, TrackedOptions
from videogrammetry.recognition.recognize import CoreFrame, core_family, core_options

_MOST_FRAMES = (1 << 31) - 1


def core_tracker(
    options: RecognitionOptions, track: TrackedOptions, camera: CameraModel | str | None
) -> _core.TrackedRecognizer:
    """The core's recogniser of one camera's frames, one after the other.

    Raises
    ------
    ValueError
        An option is not what is expected, or the method does not follow targets,
        or ``camera`` is None: targets are followed by one model.
    """
    if not isinstance(track, TrackedOptions):
        raise ValueError(f"track: expected TrackedOptions or None, got {track!r}")
    if camera is None:
        raise ValueError(
            "camera: expected a CameraModel or 'learn' with track, got None: targets are "
            "followed by one model of the camera"
        )
    try:
        full_every = operator.index(track.full_every)
    except TypeError:
        raise ValueError(f"full_every: expected a whole number, got {track.full_every!r}") from None
    try:
        margin_px = float(track.margin_px)
    except (TypeError, ValueError):
        raise ValueError(f"margin_px: expected a number, got {track.margin_px!r}") from None
    if abs(full_every) > _MOST_FRAMES:
        raise ValueError(f"full_every: expected 1 to {_MOST_FRAMES}, got {full_every}")
    model = camera.core if isinstance(camera, CameraModel) else None
    return _core.TrackedRecognizer(
        core_options(options), core_family(options), full_every, margin_px, model
    )


class Follower:
    """Recognises the frames of a sequence one after the other.

    Frames say for themselves, as without following, where they are of another depth
    than those that the model was learned from.
    """

    def __init__(
        self,
        options: RecognitionOptions,
        track: TrackedOptions,
        rule: CameraRule,
        recognizer: _core.Recognizer,
    ) -> None:
        self._rule, self._recognizer = rule, recognizer
        self._tracker = core_tracker(options, track, rule.camera or "learn")

    @property
    def camera(self) -> CameraModel | None:
        """The model given or learned; None as long as there is none to be learned."""
        return self._rule.camera

    def recognize(self, frames: list[CoreFrame]) -> list[dict[str, Any]]:
        """Of runs of the next frames: the targets' arrays, ``offsets``, ``full`` and ``lost``."""
        parts = []
        for run in same_depth_runs(frames):
            while run and self._rule.camera is None:
                # One by one, for the first with a target says what depth the model is of.
                parts.append(self._tracker.follow(run[:1]))
                if self._tracker.camera is not None:
                    self._rule = CameraRule(from_core(self._tracker.camera), is_wide(run[0]))
                run = run[1:]
            if run:
                parts.append(self._by_model(run))
        return parts

    def _by_model(self, frames: list[CoreFrame]) -> dict[str, Any]:
        found: dict[str, Any]
        if self._rule.core_for(frames[0]) is not None:
            found = self._tracker.follow(frames)
        else:
            found = self._recognizer.recognize_frames(frames)
            found["full"] = np.ones(len(frames), bool)
            found["lost"] = np.zeros(len(frames), np.int32)
        return found
