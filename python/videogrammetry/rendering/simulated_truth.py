"""What is true of a simulated recording: cameras, places, pictures, options; the cross's table."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from videogrammetry.project import (
    TrajectoryTable,
    format_csv,
    format_trajectories,
    plain,
    write_points,
    write_rig,
    write_text,
)
from videogrammetry.rendering.scene import VISIBILITY, TargetTruth
from videogrammetry.rendering.scenes import CrossTarget, PhotoScene, Scene
from videogrammetry.types import FloatArray, PointSet


def write_truth(
    scene: Scene,
    folder: Path,
    truths: list[list[TargetTruth]],
    options: Mapping[str, Any],
    missing: Mapping[int, str],
) -> None:
    """Writes the folder ``truth``: rig.json, trajectories.csv, images.csv, scene.json.

    Parameters
    ----------
    truths : stage by stage, camera by camera. options : for scene.json, as they are.
    missing : stage -> camera whose picture is empty.
    """
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
        **options,
        "missing": {str(stage): name for stage, name in missing.items()},
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
                [stage] * len(rows), [name] * len(rows), scene.marks.point[rows].tolist(),
                code, seen,
                *([None if np.isnan(x) else x for x in v.tolist()] for v in values),
            ]  # fmt: skip
            for column, part in zip(columns, text, strict=True):
                column += part
    return format_csv(_IMAGE_COLUMNS, columns)


def write_cross(folder: Path, cross: CrossTarget, sigma_mm: float, seed: int) -> None:
    """Writes cross.csv as a measurement of the target would give it, and truth/cross.csv."""
    exact = cross.points()
    write_points(folder / "truth" / "cross.csv", exact)
    rng = np.random.default_rng([seed, 21])
    measured = exact.position_mm + rng.normal(0, sigma_mm, exact.position_mm.shape)
    cov = np.tile(sigma_mm**2 * np.array([1.0, 0, 0, 1, 0, 1]), (len(exact), 1))
    kept = {f.name: getattr(exact, f.name) for f in fields(PointSet)}
    kept |= {"position_mm": measured.round(6), "cov_mm2": cov if sigma_mm > 0 else None}
    write_points(folder / "cross.csv", PointSet(**kept))


def write_photo_points(path: Path, photos: PhotoScene) -> None:
    """Writes the true places of all that was photographed, in the cross's own frame."""
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
