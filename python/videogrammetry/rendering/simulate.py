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

import errno
import json
import os
import shutil
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from videogrammetry.project import (
    TrajectoryTable,
    atomic_folder,
    format_csv,
    format_trajectories,
    plain,
    write_points,
    write_rig,
    write_text,
)
from videogrammetry.recognition import CodeFamily
from videogrammetry.rendering.disturbances import Conditions, missing_camera, occluded
from videogrammetry.rendering.render import RenderedFrame, Renderer, render_frames
from videogrammetry.rendering.scene import VISIBILITY, SceneTargets, TargetTruth
from videogrammetry.rendering.scenes import CrossTarget, PhotoScene, Scene
from videogrammetry.rendering.simulated_project import write_photo_project, write_project
from videogrammetry.sequence import create_sequence
from videogrammetry.types import FloatArray, PointSet

#: Told about the work: done, total, what.
Progress = Callable[[int, int, str], None]

_BATCH_STAGES = 8  # rendered at a time: bounds the memory
_BEHIND = VISIBILITY.index("behind")


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

    conditions: Conditions = Conditions()
    format: str = "mraw"
    target_sigma_mm: float = 0.1
    calibration: Path | None = None
    num_threads: int = 0


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

    Raises
    ------
    FileExistsError
        ``out`` is there already.
    ValueError
        The scene is impossible: a target behind a camera, an exposure longer
        than the frame, ...
    OSError
        Nothing is left of what could not be written whole.
    """
    options = options or SimulateOptions()
    scene = occluded(scene, options.conditions.occluded, options.conditions.seed)
    _refuse_behind(scene)
    with atomic_folder(out) as folder:
        kind = "calibration" if scene.name == "calibration" else "sequence"
        (folder / kind).mkdir()
        specs, truths, lost = _record(scene, folder / kind, options, progress)
        specs = {name: f"{kind}/{spec}" for name, spec in specs.items()}
        _write_truth(scene, folder, truths, options)
        if cross is not None and kind == "calibration":
            _write_cross(folder, cross, options)
        write_project(
            scene,
            folder,
            Path(out),
            specs,
            family,
            calibration=options.calibration,
            target_sigma_mm=options.target_sigma_mm,
            pictures=options.format != "mraw",
        )
    seen = np.array([[t.visibility for t in row] for row in truths])[:, :, scene.marks.is_target]
    return Simulated(
        num_pictures=scene.num_stages * len(scene.rig.cameras),
        num_visible=int((seen == VISIBILITY.index("visible")).sum()),
        num_hidden=int((seen == VISIBILITY.index("occluded")).sum()),
        missing={stage: list(scene.rig.cameras)[c] for stage, c in lost.items()},
    )


def simulate_photos(
    photos: PhotoScene,
    out: str | os.PathLike[str],
    family: CodeFamily,
    options: SimulateOptions | None = None,
    *,
    progress: Progress = lambda done, total, what: None,
) -> Simulated:
    """Renders the photographs of the target; arguments and errors as :func:`simulate`."""
    options = options or SimulateOptions()
    if options.format == "mraw":
        options = replace(options, format="tiff")  # a hand-held camera takes single pictures
    scene = photos.as_scene()
    truths = []
    conditions = options.conditions
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
        _write_truth(scene, folder, [truths], options)
        _write_points(folder / "truth" / "points.csv", photos)
        write_photo_project(photos, folder, writer.spec, family)
    seen = np.array([t.visibility for t in truths])
    return Simulated(
        num_pictures=len(truths),
        num_visible=int((seen == VISIBILITY.index("visible")).sum()),
        num_hidden=int((seen == VISIBILITY.index("occluded")).sum()),
        missing={},
    )


def _renderer(camera: Any, index: int, conditions: Conditions) -> Renderer:
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
                    f"the scene is impossible: at stage {stage} target {scene.marks.point[rows][worst]}"
                    f" lies behind camera {name} ({depth[worst]:.0f} mm before it): change the "
                    "object's way, or the cameras"
                )


def _record(
    scene: Scene, folder: Path, options: SimulateOptions, progress: Progress
) -> tuple[dict[str, str], list[list[TargetTruth]], dict[int, int]]:
    """Renders all stages into one sequence a camera; returns names, truth, and empty pictures."""
    conditions = options.conditions
    cameras = scene.rig.cameras
    renderers = [_renderer(c, i, conditions) for i, c in enumerate(cameras.values())]
    lost = missing_camera(scene, conditions.missing, conditions.seed)
    writers = {
        name: create_sequence(
            folder / name,
            format=options.format,
            image_size_px=camera.image_size_px,
            num_frames=scene.num_stages,
            bit_depth=conditions.bit_depth,
            frame_rate_hz=scene.frame_rate_hz,
            exposure_s=scene.exposure_s or None,
            camera_name=name,
        )
        for name, camera in cameras.items()
    }
    _refuse_full_disk(folder, sum(writer.needed_bytes for writer in writers.values()))
    truths: list[list[TargetTruth]] = []
    with ExitStack() as stack:
        for writer in writers.values():
            stack.enter_context(writer)
        for first in range(1, scene.num_stages + 1, _BATCH_STAGES):
            stages = range(first, min(first + _BATCH_STAGES, scene.num_stages + 1))
            for stage, frames in zip(
                stages, _render(scene, renderers, stages, options), strict=True
            ):
                for c, (writer, frame) in enumerate(zip(writers.values(), frames, strict=True)):
                    empty = lost.get(stage) == c
                    writer.append(np.zeros_like(frame.image) if empty else frame.image)
                truths.append([frame.truth for frame in frames])
                progress(stage, scene.num_stages, "rendering")
    return {name: writer.spec for name, writer in writers.items()}, truths, lost


def _refuse_full_disk(folder: Path, needed: int) -> None:
    """All cameras together must fit, before the first picture is rendered."""
    free = shutil.disk_usage(folder).free
    if needed > free:
        raise OSError(
            errno.ENOSPC,
            f"the pictures need {needed / 1e6:.0f} MB, but the disk has {free / 1e6:.0f} MB free: "
            "make room, choose another disk, or ask for fewer stages",
            str(folder),
        )


def _render(
    scene: Scene, renderers: Sequence[Renderer], stages: range, options: SimulateOptions
) -> list[list[RenderedFrame]]:
    jobs: list[tuple[Renderer, SceneTargets, int]] = []
    for stage in stages:
        targets = scene.targets(scene.time_s(stage))
        jobs += [(r, targets, _seed(options, c, stage)) for c, r in enumerate(renderers)]
    frames = render_frames(jobs, num_threads=options.num_threads)
    count = len(renderers)
    return [frames[i * count : (i + 1) * count] for i in range(len(stages))]


def _write_truth(
    scene: Scene, folder: Path, truths: list[list[TargetTruth]], options: SimulateOptions
) -> None:
    truth = folder / "truth"
    truth.mkdir()
    write_rig(truth / "rig.json", scene.rig)
    write_text(truth / "trajectories.csv", format_trajectories(true_trajectories(scene, truths)))
    write_text(truth / "images.csv", _images_csv(scene, truths))
    facts = {
        "scene": scene.name,
        "stages": scene.num_stages,
        "frame_rate_hz": scene.frame_rate_hz,
        "exposure_s": scene.exposure_s,
        "facts": scene.facts,
        "conditions": options.conditions,
        "target_sigma_mm": options.target_sigma_mm,
    }
    write_text(truth / "scene.json", json.dumps(plain(facts), indent=1) + "\n")


def true_trajectories(scene: Scene, truths: list[list[TargetTruth]]) -> TrajectoryTable:
    """The true places of the targets at the middle of every exposure, in the rig's frame."""
    rows = np.flatnonzero(scene.marks.is_target)
    names = list(scene.rig.cameras)
    stages = np.arange(1, scene.num_stages + 1)
    times = (stages - 1) / scene.frame_rate_hz
    places = [scene.place(t).centre_mm[rows] for t in times.tolist()]
    seen = [[t.visible[rows] for t in row] for row in truths]
    count = len(rows) * len(stages)
    return TrajectoryTable(
        stage=np.repeat(stages, len(rows)).astype(np.int32),
        time_s=np.repeat(times, len(rows)),
        point=tuple(str(p) for _ in stages for p in scene.marks.point[rows].tolist()),
        position_mm=np.concatenate(places),
        sigma_mm=np.full((count, 3), np.nan),
        cameras=tuple(
            tuple(name for name, by_camera in zip(names, row, strict=True) if by_camera[k])
            for row in seen
            for k in range(len(rows))
        ),
    )


_IMAGE_COLUMNS = (
    *("stage", "camera", "point", "code", "visibility", "circle_x_px", "circle_y_px"),
    *("x_px", "y_px", "semi_major_px", "semi_minor_px", "angle_rad"),
)


def _images_csv(scene: Scene, truths: list[list[TargetTruth]]) -> str:
    """Every target in every picture: circle's centre, ellipse, visibility."""
    rows = np.flatnonzero(scene.marks.is_target)
    columns: list[list[Any]] = [[] for _ in _IMAGE_COLUMNS]
    names = list(scene.rig.cameras)
    for stage, row in enumerate(truths, start=1):
        for name, t in zip(names, row, strict=True):
            values: list[FloatArray] = [
                *t.circle_px[rows].T, *t.centre_px[rows].T, *t.semi_axes_px[rows].T,
                t.angle_rad[rows],
            ]  # fmt: skip
            code = [None if i < 0 else i for i in scene.marks.id[rows].tolist()]
            seen = [VISIBILITY[v] for v in t.visibility[rows].tolist()]
            text: list[list[Any]] = [
                [stage] * len(rows), [name] * len(rows), scene.marks.point[rows].tolist(), code, seen,
                *([None if np.isnan(x) else x for x in v.tolist()] for v in values),
            ]  # fmt: skip
            for column, part in zip(columns, text, strict=True):
                column += part
    return format_csv(_IMAGE_COLUMNS, columns)


def _write_cross(folder: Path, cross: CrossTarget, options: SimulateOptions) -> None:
    """cross.csv as a measurement of the target would give it, and its truth."""
    exact = cross.points()
    write_points(folder / "truth" / "cross.csv", exact)
    sigma = options.target_sigma_mm
    if sigma < 0:
        raise ValueError(f"target sigma: expected 0 mm or more, got {sigma:g} mm")
    rng = np.random.default_rng([options.conditions.seed, 21])
    measured = exact.position_mm + rng.normal(0, sigma, exact.position_mm.shape)
    cov = np.tile(sigma**2 * np.array([1.0, 0, 0, 1, 0, 1]), (len(exact), 1))
    kept = {f.name: getattr(exact, f.name) for f in fields(PointSet)}
    kept |= {"position_mm": measured.round(6), "cov_mm2": cov if sigma > 0 else None}
    write_points(folder / "cross.csv", PointSet(**kept))


def _write_points(path: Path, photos: PhotoScene) -> None:
    rows = np.flatnonzero(photos.marks.is_target)
    place = photos.place
    write_points(
        path,
        PointSet(
            id=photos.marks.point[rows],
            position_mm=place.centre_mm[rows],
            normal=place.normal[rows],
            diameter_mm=2 * photos.marks.radius_mm[rows],
        ),
    )
