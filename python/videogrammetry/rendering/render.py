"""Renderer: one camera before one background; pictures of targets with their truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from videogrammetry._core import rendering as _core
from videogrammetry.geometry import rig_model
from videogrammetry.rendering.options import Background, Illumination, Sensor
from videogrammetry.rendering.scene import SceneTargets, TargetTruth
from videogrammetry.types import RigData

if TYPE_CHECKING:
    from videogrammetry.types import RigCamera


@dataclass(frozen=True, kw_only=True)
class RenderedFrame:
    """A picture, (height, width) uint8 or uint16, and what is true of its targets."""

    image: npt.NDArray[Any]
    truth: TargetTruth


class Renderer:
    """One camera before one background under one light.

    Each target's picture is integrated over the pixels' area along exact rays
    (undistortion, then the target's plane) and blurred by the lens; sub-pixel
    errors are below 0.0005 px for a PSF of 0.6 px and more. Background and lens
    are prepared once, so a renderer should serve all frames of a sequence. It may
    be used by several threads at once.

    Parameters
    ----------
    camera
        Interior and exterior orientation; ``cam_from_world`` takes the targets' frame.
    background, illumination, sensor
        See the classes.

    Raises
    ------
    ValueError
        An option or the camera is impossible: the message names the field.

    Examples
    --------
    >>> from videogrammetry.types import RigCamera
    >>> camera = RigCamera(image_size_px=(64, 48), interior=np.r_[500.0, np.zeros(9)],
    ...                    r0_px=25.0, rotation=np.eye(3), translation_mm=np.zeros(3))
    >>> renderer = Renderer(camera, sensor=Sensor(read_noise=1.0))
    >>> frame = renderer.render(SceneTargets(centre_mm=[[2.0, 0.0, 500.0]], radius_mm=6.0), seed=1)
    >>> frame.image.shape, frame.image.dtype, frame.truth.centre_px.round(3).tolist()
    ((48, 64), dtype('uint8'), [[33.5, 23.5]])
    """

    def __init__(
        self,
        camera: RigCamera,
        *,
        background: Background | None = None,
        illumination: Illumination | None = None,
        sensor: Sensor | None = None,
    ) -> None:
        self.camera = camera
        self.background = background or Background()
        self.illumination = illumination or Illumination()
        self.sensor = sensor or Sensor()
        back = {f.name: getattr(self.background, f.name) for f in fields(Background)}
        back["spots"] = [
            _core.SpecularSpot(s.x_px, s.y_px, s.sigma_px, s.amplitude) for s in back["spots"]
        ]
        self._model = _core.Renderer(
            rig_model(RigData(cameras={"": camera}))[0],
            _core.Background(**back),
            _core.Illumination(self.illumination.level, self.illumination.gradient),
            _core.Sensor(**{f.name: getattr(self.sensor, f.name) for f in fields(Sensor)}),
        )

    def render(self, targets: SceneTargets, *, seed: int = 0) -> RenderedFrame:
        """Picture and truth; ``seed`` is the noise's, one for each picture."""
        return render_frames([(self, targets, seed)], num_threads=1)[0]

    def truth(self, targets: SceneTargets) -> TargetTruth:
        """What is true of the targets, without a picture."""
        return _truth(targets, self._model.truth(targets.model))

    def light(self, targets: SceneTargets) -> npt.NDArray[np.float32]:
        """The picture before noise and sampling, (height, width), as a share of full scale."""
        result: npt.NDArray[np.float32] = self._model.light(targets.model)
        return result


def render_frames(
    frames: Sequence[tuple[Renderer, SceneTargets, int]], *, num_threads: int = 0
) -> list[RenderedFrame]:
    """Render many frames, of one camera or of several, in parallel.

    All pictures are held in memory: give long sequences in parts.

    Parameters
    ----------
    frames
        Renderer, targets and the noise's seed of each frame.
    num_threads
        0: one a core. The pictures do not depend on it.

    Returns
    -------
    list of RenderedFrame
        In the order of ``frames``.

    Raises
    ------
    ValueError
        A target moves too far during the exposure (more than 200 px).
    """
    pictures, truths = _core.render_frames(
        [renderer._model for renderer, _, _ in frames],
        [targets.model for _, targets, _ in frames],
        [seed for _, _, seed in frames],
        num_threads,
    )
    return [
        RenderedFrame(image=image, truth=_truth(targets, truth))
        for image, truth, (_, targets, _) in zip(pictures, truths, frames, strict=True)
    ]


def _truth(targets: SceneTargets, arrays: dict[str, Any]) -> TargetTruth:
    return TargetTruth(id=np.asarray(targets.id).astype(np.int32), **arrays)
