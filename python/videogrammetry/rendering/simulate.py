"""Scenes written as a laboratory would have them: recordings, project.toml, and the truth.

OUT/project.toml                     ready for calibrate, measure, verify
OUT/calibration/CAMERA.*             the calibration scene's pictures, or
OUT/sequence/CAMERA.*                those of a moving object, or
OUT/photos/*.tif                     those of a hand-held camera
OUT/cross.csv, scale-bars.csv        as measured elsewhere, with their errors
OUT/truth/rig.json                   the true cameras
OUT/truth/trajectories.csv           the true places, in the frame of the rig
OUT/truth/images.csv                 the true pictures of every target
OUT/truth/scene.json                 every option
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from videogrammetry.project import atomic_folder
from videogrammetry.recognition import CodeFamily
from videogrammetry.rendering.disturbances import Conditions, missing_camera, occluded
from videogrammetry.rendering.render import RenderedFrame, Renderer, render_frames
from videogrammetry.rendering.scene import VISIBILITY, SceneTargets, TargetTruth
from videogrammetry.rendering.scenes import CrossTarget, PhotoScene, Scene
from videogrammetry.rendering.simulated_project import (
    borrowed_calibration,
    write_photo_project,
    write_project,
)
from videogrammetry.rendering.simulated_truth import write_cross, write_photo_points, write_truth
from videogrammetry.sequence import (
    SEQUENCE_FORMATS,
    SequenceFormat,
    SequenceWriter,
    check_free_space,
    create_sequence,
)
from videogrammetry.types import RigCamera

#: Told about the work: done, total, what.
Progress = Callable[[int, int, str], None]

_BATCH_STAGES = 8  # rendered at a time: bounds the memory


@dataclass(frozen=True, kw_only=True)
class SimulateOptions:
    """How a scene is written.

    Attributes
    ----------
    conditions : light, noise, disturbances. format : "mraw", "tiff" or "png".
    target_sigma_mm : standard deviation of the cross's coordinates in cross.csv.
    calibration : the calibration project that a sequence's project shall use.
    num_threads : 0 = one a core; the files do not depend on it.
    """

    conditions: Conditions = field(default_factory=Conditions)
    format: SequenceFormat = "mraw"
    target_sigma_mm: float = 0.1
    calibration: Path | None = None
    num_threads: int = 0

    def __post_init__(self) -> None:
        if self.format not in SEQUENCE_FORMATS:
            raise ValueError(
                f"format: expected one of {', '.join(SEQUENCE_FORMATS)}, got {self.format!r}"
            )
        if not 0 <= self.target_sigma_mm < math.inf:
            raise ValueError(f"target sigma: expected 0 mm or more, got {self.target_sigma_mm:g}")
        if self.num_threads < 0:
            raise ValueError(f"num_threads: expected 0 or more, got {self.num_threads}")


@dataclass(frozen=True)
class Simulated:
    """What was written: pictures, targets whole in them and hidden, stage -> empty camera."""

    num_pictures: int
    num_visible: int
    num_hidden: int
    missing: dict[int, str]


def simulate(
    scene: Scene,
    out: str | os.PathLike[str],
    family: CodeFamily,
    options: SimulateOptions | None = None,
    *,
    cross: CrossTarget | None = None,
    progress: Progress = lambda done, total, what: None,
) -> Simulated:
    """Renders a scene and writes it with project file and truth into a new folder.

    Parameters
    ----------
    scene : what is recorded; ``family`` : the codes, for project.toml.
    out : folder to make, with the folders above it.
    cross : the target of a calibration scene, for cross.csv.
    progress : told after every stage; may raise to stop the work.

    Raises
    ------
    FileExistsError
        ``out`` is there already.
    ValueError
        The scene is impossible: a target behind a camera, a motion of more than
        200 px in an exposure, ...
    ProjectFileError
        ``options.calibration`` names no calibration project of these cameras.
    SequenceError, OSError
        The disk is full, or fails. Nothing is left of what cannot be written whole.

    Examples
    --------
    >>> import tempfile
    >>> from videogrammetry.recognition import code_family
    >>> from videogrammetry.rendering.scenes import tyre_scene
    >>> codes = code_family("schneider-14")
    >>> out = Path(tempfile.mkdtemp()) / "drop"
    >>> done = simulate(tyre_scene(codes, num_stages=1), out, codes)
    >>> done.num_pictures, done.num_visible, sorted(p.name for p in out.iterdir())
    (4, 36, ['project.toml', 'sequence', 'truth'])
    """
    options = options or SimulateOptions()
    scene = occluded(scene, options.conditions.occluded, options.conditions.seed)
    _refuse_behind(scene)
    kind = "calibration" if scene.name == "calibration" else "sequence"
    other = None
    if options.calibration is not None:
        other = borrowed_calibration(options.calibration, Path(out), scene.rig.cameras)
    lost = _missing(scene, options.conditions)
    with atomic_folder(out) as folder:
        (folder / kind).mkdir()
        specs, truths = _record(scene, folder / kind, options, lost, progress)
        write_truth(scene, folder, truths, _facts(options), lost)
        if cross is not None and kind == "calibration":
            write_cross(folder, cross, options.target_sigma_mm, options.conditions.seed)
        write_project(
            scene,
            folder,
            {name: f"{kind}/{spec}" for name, spec in specs.items()},
            family,
            other=other,
            target_sigma_mm=options.target_sigma_mm,
            pictures=options.format != "mraw",
        )
    return _counted(scene, truths, lost)


def simulate_photos(
    photos: PhotoScene,
    out: str | os.PathLike[str],
    family: CodeFamily,
    options: SimulateOptions | None = None,
    *,
    progress: Progress = lambda done, total, what: None,
) -> Simulated:
    """Renders the photographs of the target; arguments and errors as :func:`simulate`.

    Nothing hides a target and no photograph is missing: ``conditions.occluded``
    and ``missing`` must be 0. For the format "mraw" TIFF is taken, because a
    hand-held camera takes single pictures.
    """
    options = options or SimulateOptions()
    conditions = options.conditions
    if conditions.occluded or conditions.missing:
        raise ValueError("occluded, missing: photographs know neither; leave both at 0")
    if options.format == "mraw":
        options = replace(options, format="tiff")
    scene = photos.as_scene()
    _refuse_behind(scene)
    truths = []
    with atomic_folder(out) as folder:
        writer = create_sequence(
            folder / "photos",
            format=options.format,
            image_size_px=next(iter(photos.cameras.values())).image_size_px,
            num_frames=len(photos.cameras),
            bit_depth=conditions.bit_depth,
        )
        with writer:
            for index, camera in enumerate(photos.cameras.values()):
                renderer = _renderer(camera, index, conditions)
                frame = renderer.render(photos.targets(), seed=_seed(options, index, 1))
                writer.append(frame.image)
                truths.append(frame.truth)
                progress(index + 1, len(photos.cameras), "rendering")
        write_truth(scene, folder, [truths], _facts(options), {})
        write_photo_points(folder / "truth" / "points.csv", photos)
        write_photo_project(photos, folder, writer.spec, family)
    return _counted(scene, [truths], {})


def _facts(options: SimulateOptions) -> dict[str, object]:
    return {"conditions": options.conditions, "target_sigma_mm": options.target_sigma_mm}


def _missing(scene: Scene, conditions: Conditions) -> dict[int, str]:
    names = list(scene.rig.cameras)
    lost = missing_camera(scene, conditions.missing, conditions.seed)
    return {stage: names[camera] for stage, camera in lost.items()}


def _counted(scene: Scene, truths: list[list[TargetTruth]], lost: dict[int, str]) -> Simulated:
    seen = np.array([[t.visibility for t in row] for row in truths])[:, :, scene.marks.is_target]
    return Simulated(
        num_pictures=seen.shape[0] * seen.shape[1],
        num_visible=int((seen == VISIBILITY.index("visible")).sum()),
        num_hidden=int((seen == VISIBILITY.index("occluded")).sum()),
        missing=lost,
    )


def _renderer(camera: RigCamera, index: int, conditions: Conditions) -> Renderer:
    return Renderer(
        camera,
        background=conditions.background(camera, index),
        illumination=conditions.illumination(),
        sensor=conditions.sensor(),
    )


def _seed(options: SimulateOptions, camera: int, stage: int) -> int:
    words = np.random.SeedSequence([options.conditions.seed, camera, stage]).generate_state(1)
    return int(words[0])


def _refuse_behind(scene: Scene) -> None:
    """A target that reaches behind a camera cannot have been meant."""
    rows = np.flatnonzero(scene.marks.is_target)
    reach = scene.marks.sticker_mm[rows]
    for stage in range(1, scene.num_stages + 1):
        centre = scene.place(scene.time_s(stage)).centre_mm[rows]
        for name, camera in scene.rig.cameras.items():
            depth = (centre @ camera.rotation.T + camera.translation_mm)[:, 2]
            if (depth <= reach).any():
                worst = int(np.argmin(depth))
                raise ValueError(
                    f"the scene is impossible: at stage {stage} target "
                    f"{scene.marks.point[rows][worst]} lies behind camera {name} or touches it "
                    f"({depth[worst]:.0f} mm before its centre): change the object's way, or the "
                    "cameras"
                )


def _record(
    scene: Scene,
    folder: Path,
    options: SimulateOptions,
    lost: dict[int, str],
    progress: Progress,
) -> tuple[dict[str, str], list[list[TargetTruth]]]:
    """Renders all stages into one sequence a camera; returns their names, and what is true."""
    cameras = scene.rig.cameras
    renderers = [_renderer(c, i, options.conditions) for i, c in enumerate(cameras.values())]
    truths: list[list[TargetTruth]] = []
    with ExitStack() as stack:
        writers = {
            name: stack.enter_context(_writer(scene, folder, name, options)) for name in cameras
        }
        # All cameras together must fit, before the first picture is rendered.
        check_free_space(folder, sum(writer.needed_bytes for writer in writers.values()))
        for first in range(1, scene.num_stages + 1, _BATCH_STAGES):
            stages = range(first, min(first + _BATCH_STAGES, scene.num_stages + 1))
            batch = _render(scene, renderers, stages, options)
            for stage, frames in zip(stages, batch, strict=True):
                kept = [
                    _emptied(frame) if lost.get(stage) == name else frame
                    for name, frame in zip(cameras, frames, strict=True)
                ]
                for writer, frame in zip(writers.values(), kept, strict=True):
                    writer.append(frame.image)
                truths.append([frame.truth for frame in kept])
                progress(stage, scene.num_stages, "rendering")
    return {name: writer.spec for name, writer in writers.items()}, truths


def _writer(scene: Scene, folder: Path, name: str, options: SimulateOptions) -> SequenceWriter:
    return create_sequence(
        folder / name,
        format=options.format,
        image_size_px=scene.rig.cameras[name].image_size_px,
        num_frames=scene.num_stages,
        bit_depth=options.conditions.bit_depth,
        frame_rate_hz=scene.frame_rate_hz,
        exposure_s=scene.exposure_s or None,
        camera_name=name,
    )


def _emptied(frame: RenderedFrame) -> RenderedFrame:
    """A picture that was not delivered: black, and no target lies in it."""
    seen = frame.truth.visibility
    outside = np.minimum(seen, VISIBILITY.index("outside")).astype(seen.dtype)
    return RenderedFrame(
        image=np.zeros_like(frame.image), truth=replace(frame.truth, visibility=outside)
    )


def _render(
    scene: Scene, renderers: Sequence[Renderer], stages: range, options: SimulateOptions
) -> list[list[RenderedFrame]]:
    jobs: list[tuple[Renderer, SceneTargets, int]] = []
    for stage in stages:
        targets = scene.targets(scene.time_s(stage))
        jobs += [(r, targets, _seed(options, c, stage)) for c, r in enumerate(renderers)]
    try:
        frames = render_frames(jobs, num_threads=options.num_threads)
    except ValueError as error:  # the renderer knows no exposure
        raise ValueError(
            f"the scene is impossible: stages {stages[0]} to {stages[-1]} cannot be rendered with "
            f"an exposure of {scene.exposure_s:g} s ({error}): shorten it"
        ) from error
    count = len(renderers)
    return [frames[i * count : (i + 1) * count] for i in range(len(stages))]
