"""Targets followed from frame to frame, and what happens to frames that do not belong."""

from __future__ import annotations

import operator
from typing import Any

import numpy as np

from videogrammetry._core import recognition as _core
from videogrammetry.recognition.camera_model import CameraModel, from_core
from videogrammetry.recognition.learning import CameraRule, is_wide
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

    Frames say for themselves, as without following, as long as no model is known,
    and where they are of another depth than those that it was learned from.
    """

    def __init__(
        self,
        options: RecognitionOptions,
        track: TrackedOptions,
        rule: CameraRule,
        recognizer: _core.Recognizer,
    ) -> None:
        self._options, self._track, self._rule = options, track, rule
        self._recognizer = recognizer
        self._begin()

    @property
    def camera(self) -> CameraModel | None:
        """The model given or learned; None as long as there is none to be learned."""
        return self._rule.camera

    def recognize(self, frame: CoreFrame) -> dict[str, Any]:
        """The targets' arrays, their ``offsets``, and ``full`` and ``lost``."""
        followed = self._rule.camera is None or self._rule.core_for(frame) is not None
        found: dict[str, Any] = self._tracker.next(frame) if followed else {}
        if self._rule.camera is None and self._tracker.camera is not None:
            self._rule = CameraRule(from_core(self._tracker.camera), is_wide(frame))
        if not followed or self._rule.camera is None:
            found = self._recognizer.recognize(frame) | {"full": True, "lost": 0}
        elif len(found["id"]) == 0:
            self._begin()  # with nothing to follow the next frame is searched as a whole
        return found | {"offsets": np.array([0, len(found["id"])])}

    def _begin(self) -> None:
        camera = self._rule.camera or "learn"
        self._tracker = core_tracker(self._options, self._track, camera)
