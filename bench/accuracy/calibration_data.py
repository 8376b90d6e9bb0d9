"""Readers of the calibration data sets, and the error of a scale bar from calibration alone."""

from __future__ import annotations

import csv
import json
import os
from pathlib import Path

import numpy as np

from videogrammetry.calibration import CameraFrames, FrameTargets
from videogrammetry.geometry import rays_through_pixels
from videogrammetry.types import INTERIOR_NAMES, PointSet, RigCamera, RigData


def data_folder() -> Path:
    """The folder of the shared data: $VIDEOGRAMMETRY_DATA or ../shared/data beside the project."""
    here = Path(__file__).resolve().parents[2]
    return Path(os.environ.get("VIDEOGRAMMETRY_DATA", here.parent / "shared" / "data"))


def read_points(path: Path) -> PointSet:
    with path.open() as file:
        table = list(csv.DictReader(file))
    return PointSet(
        id=np.array([int(row["id"]) for row in table], np.int32),
        position_mm=np.array([[float(row[k]) for k in ("x_mm", "y_mm", "z_mm")] for row in table]),
    )


def frames_of(rows, stage_of, point="point", sigma_px=0.05):
    """FrameTargets of table rows, grouped by image; ``stage_of`` names -> stage."""
    groups: dict[str, list[dict[str, str]]] = {}
    for row in rows:
        groups.setdefault(row["image"], []).append(row)
    frames = []
    for image, group in groups.items():
        variance = np.array([float(row.get("sigma_px") or sigma_px) ** 2 for row in group])
        frames.append(
            FrameTargets(
                stage=stage_of(image),
                image=image,
                id=np.array([int(row[point]) for row in group], np.int32),
                xy_px=np.array([[float(row["x_px"]), float(row["y_px"])] for row in group]),
                cov_px2=np.stack([variance, 0 * variance, variance], axis=1),
            )  # fmt: skip
        )
    return frames


def rig_simulated(kind: str, free="reference", r0_px=None):
    """Cameras, target and truth of rig-simulated/mild or table1."""
    folder = data_folder() / "rig-simulated" / kind
    truth = json.loads((folder / "truth.json").read_text())
    if free == "reference":
        free = tuple(truth["reference_joint_bundle"]["free"])
    cameras = []
    for name in ("1", "2", "3", "4"):
        with (folder / f"cam{name}.csv").open() as file:
            rows = list(csv.DictReader(file))
        frames = frames_of(rows, lambda image: int(image.removeprefix("pose")) + 1)
        cameras.append(
            CameraFrames(
                name=name, image_size_px=(1024, 1024), frames=frames, free=free, r0_px=r0_px
            )
        )
    return cameras, read_points(folder / "cross.csv"), truth


AICON_STAGES = (5, 9, 13, 17, 21)


def aicon_panel(stages=AICON_STAGES, free=None):
    """Cameras and target of aicon-panel with the coded dots read by another program."""
    folder = data_folder() / "aicon-panel"
    with (folder / "coded_elsewhere.csv").open() as file:
        rows = list(csv.DictReader(file))
    cameras = []
    for name in ("left", "right"):
        own = [
            row
            for row in rows
            if row["image"].startswith(name) and int(row["image"].split("_")[1]) in stages
        ]
        frames = frames_of(own, lambda image: int(image.split("_")[1]), point="id")
        cameras.append(
            CameraFrames(name=name, image_size_px=(2000, 1333), frames=frames, free=free)
        )
    return cameras, read_points(folder / "points.csv")


def triangulate(rays, projection_centres, rotations):
    """Midpoint of two rays each: adequate for exact pictures."""
    normal, right = np.zeros((3, 3)), np.zeros(3)
    for ray, centre, rotation in zip(rays, projection_centres, rotations, strict=True):
        d = rotation.T @ ray
        d = d / np.linalg.norm(d)
        p = np.eye(3) - np.outer(d, d)
        normal += p
        right += p @ centre
    return np.linalg.solve(normal, right)


def read_bars(kind: str):
    with (data_folder() / "rig-simulated" / kind / "bars.csv").open() as file:
        return list(csv.DictReader(file))


def bar_lengths(rig, bars, pair: str):
    """Lengths of the bars of a pair ("12"), triangulated from their exact pictures."""
    ends: dict[tuple[str, str], list[dict[str, str]]] = {}
    for row in bars:
        if row["pair"] == pair:
            ends.setdefault((row["bar"], row["end"]), []).append(row)
    position = {}
    for key, rows in ends.items():
        cameras = [rig.cameras[row["camera"]] for row in rows]
        rays = [
            rays_through_pixels(cam, [[float(row["x_px"]), float(row["y_px"])]])[0]
            for cam, row in zip(cameras, rows, strict=True)
        ]
        centres = [-cam.rotation.T @ cam.translation_mm for cam in cameras]
        position[key] = triangulate(rays, centres, [cam.rotation for cam in cameras])
    names = sorted({bar for bar, _ in position}, key=int)
    return np.array([np.linalg.norm(position[n, "A"] - position[n, "B"]) for n in names])


def bar_ends(kind: str, pair: str):
    """Pictures of both ends of a pair's bars: two dicts camera -> (B, 2)."""
    rows = [row for row in read_bars(kind) if row["pair"] == pair]
    ends = []
    for end in ("A", "B"):
        pictures = {}
        for camera in pair:
            mine = [r for r in rows if r["end"] == end and r["camera"] == camera]
            mine.sort(key=lambda r: int(r["bar"]))
            pictures[camera] = np.array([[float(r["x_px"]), float(r["y_px"])] for r in mine])
        ends.append(pictures)
    return tuple(ends)


def true_rig(truth) -> RigData:
    """The rig of a truth.json."""
    keys = ("f_px", "x0_px", "y0_px", *INTERIOR_NAMES[3:])
    return RigData(
        cameras={
            name: RigCamera(
                image_size_px=(1024, 1024),
                interior=np.array([t[k] for k in keys]),
                r0_px=t["r0_px"],
                rotation=np.array(t["cam_from_world"]["rotation"]),
                translation_mm=np.array(t["cam_from_world"]["translation_mm"]),
            )
            for name, t in truth["cameras"].items()
        }
    )
