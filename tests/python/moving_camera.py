"""Residuals of cameras around a volume, one of which may move, without pictures."""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.spatial.transform import Rotation
from two_pairs import SIGMAS, calibrated

from videogrammetry.geometry import CAMERA_PARAMETERS, project, rotation_looking_at
from videogrammetry.reconstruction import Triangulator
from videogrammetry.reconstruction.camera_scores import (
    PointResiduals,
    calibration_factor,
    camera_scores,
)
from videogrammetry.reconstruction.stability import PoseWatch
from videogrammetry.types import RigCamera, RigData

SIGMA_PX, DISTANCE_MM = 0.02, 4000.0
#: Of so many stages one is looked at, as in a measurement.
EVERY = 4


def ring_rig(count: int, rng: np.random.Generator, *, sigma: float = 1.0) -> RigData:
    """Cameras 4 m from the origin, 25 degrees apart, up and down by turns, all seeing all."""
    cameras = {}
    for k in range(count):
        angle = np.deg2rad(25.0) * (k - (count - 1) / 2)
        place = DISTANCE_MM * np.array([np.sin(angle), 0.15 * (-1) ** k, -np.cos(angle)])
        rotation = rotation_looking_at(place, [0.0, 0, 0], up=(0.0, -1.0, 0.0))
        cameras[f"c{k + 1}"] = RigCamera(
            image_size_px=(1024, 1024),
            interior=np.r_[2650.0, 8, -12, 1e-8, np.zeros(6)],
            r0_px=480.0,
            rotation=rotation,
            translation_mm=-rotation @ place,
        )
    names = tuple(f"{c}/{p}" for c in cameras for p in CAMERA_PARAMETERS)
    of = np.array([SIGMAS.get(n.split("/")[1], 0.0) for n in names])
    return RigData(
        cameras=cameras,
        cov=np.diag((sigma * of) ** 2),
        cov_names=names,
        volume_mm=rng.uniform(-600, 600, (60, 3)),
        volume_seen=np.ones((60, count), bool),
    )


def turned(rig: RigData, camera: int, turn_rad, shift_mm=(0.0, 0, 0)) -> RigData:
    """The rig with one camera turned about its projection centre, and that shifted."""
    name = list(rig.cameras)[camera]
    old = rig.cameras[name]
    rotation = Rotation.from_rotvec(turn_rad).as_matrix() @ old.rotation
    centre = old.centre_mm + np.asarray(shift_mm)
    new = dataclasses.replace(old, rotation=rotation, translation_mm=-rotation @ centre)
    return dataclasses.replace(rig, cameras={**rig.cameras, name: new})


def body(rng, points: int, stages: int, *, swing_mm: float = 0.0, bend_mm: float = 0.0):
    """(S, P, 3) points that swing to and fro together, and bend each its own way."""
    start = rng.uniform(-350, 350, (points, 3))
    time = np.arange(stages) / 100.0
    path = swing_mm * np.sin(2 * np.pi * time)[:, None, None] * np.array([1.0, 0.3, 0.5])
    way = rng.normal(size=(points, 3)) * bend_mm
    growth = (np.arange(stages) / stages)[:, None, None] + 0.3 * np.sin(time)[:, None, None]
    return start + path + growth * way


def pictures(rig: RigData, position, rng, sigma_px=SIGMA_PX):
    """(N, C, 2) of points (N, 3)."""
    xy = np.stack(
        [project(c, position @ c.rotation.T + c.translation_mm) for c in rig.cameras.values()],
        axis=1,
    )
    return xy + rng.normal(0, sigma_px, xy.shape)


def intersected(triangulator: Triangulator, xy, sigma_px=SIGMA_PX):
    """Positions (N, 3) and residuals (N, C, 2) of pictures, NaN where not seen."""
    seen = np.isfinite(xy[..., 0])
    point, camera = np.nonzero(seen)
    variance = np.full(len(point), sigma_px**2)
    found = triangulator(
        np.concatenate([[0], np.cumsum(seen.sum(axis=1))]),
        camera,
        xy[point, camera],
        np.stack([variance, 0 * variance, variance], axis=1),
    )
    residual = np.full(xy.shape, np.nan)
    residual[point, camera] = found["residual_px"]
    return found["position_mm"], residual


def residuals_of(place, residual, looks=1) -> PointResiduals:
    """Of as many points at every look, one look after the other."""
    return PointResiduals(
        look=np.repeat(np.arange(looks), len(place) // looks),
        position_mm=place,
        residual_px=residual,
        variance_px2=np.full(residual.shape, SIGMA_PX**2),
        systematic=np.zeros(residual.shape[:2]),
    )


def scale_of(cameras: int):
    """(C, 6) what of every pose parameter moves the picture by about a pixel."""
    return np.tile([1 / 2650] * 3 + [DISTANCE_MM / 2650] * 3, (cameras, 1))


def watched(
    seed, *, cameras=4, stages=1000, at=0, camera=1, turn_rad=(1e-4, 0, 0), sigma=0.2,
    points=50, every=EVERY, swing_mm=20.0, bend_mm=50.0, covariance=True, spoil=None,
):  # fmt: skip
    """A watch that has seen a sequence; from stage ``at`` (from 1) on a camera is turned.

    ``sigma``: the calibration's errors over those of two_pairs. ``spoil(stage, xy)``
    changes the pictures (P, C, 2) of a stage.
    """
    rng = np.random.default_rng(seed)
    truth = ring_rig(cameras, rng, sigma=sigma)
    rig = calibrated(truth, rng)
    if not covariance:
        rig = dataclasses.replace(rig, cov=None, cov_names=())
    later = turned(truth, camera, turn_rad)
    position = body(rng, points, stages, swing_mm=swing_mm, bend_mm=bend_mm)
    triangulator, factor = Triangulator(rig), calibration_factor(rig)
    looked = np.arange(1, stages + 1, every)
    watch = PoseWatch(scale_of(cameras), len(looked))
    for part in np.array_split(looked, max(len(looked) // 10, 1)):
        xy = np.stack(
            [
                pictures(later if at and stage >= at else truth, position[stage - 1], rng)
                for stage in part
            ]
        )
        if spoil is not None:
            for stage, of_stage in zip(part, xy, strict=True):
                spoil(stage, of_stage)
        place, residual = intersected(triangulator, xy.reshape(-1, cameras, 2))
        residuals = residuals_of(place, residual, len(part))
        watch.add(part, camera_scores(rig, residuals, len(part), factor))
    watch.finish()
    return watch
