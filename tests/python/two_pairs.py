"""Two stereo pairs on opposite sides and what they would measure, without pictures."""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.spatial.transform import Rotation

from videogrammetry.geometry import CAMERA_PARAMETERS, project
from videogrammetry.reconstruction import Triangulator
from videogrammetry.types import RigCamera, RigData, Trajectories, cov6_from_matrix

NAMES = ("cam1", "cam2", "cam3", "cam4")
PAIRS = np.array([[True, True, False, False], [False, False, True, True]])
# Small enough for the pictures' noise to show beside the bending that the
# calibration leaves, and for its linear propagation to hold to 1e-3.
SIGMAS = {"f": 0.03, "x0": 0.04, "y0": 0.04, "A1": 2e-12, "rx": 2e-6, "ry": 2e-6, "rz": 2e-6}
SIGMAS |= {"tx": 0.01, "ty": 0.01, "tz": 0.015}


def two_pair_rig(rng: np.random.Generator) -> RigData:
    """Four cameras 12 m from the origin, +-15 degrees off the z axis on either side."""
    cameras = {}
    for name, angle in zip(NAMES, np.deg2rad([-15, 15, 165, 195]), strict=True):
        rotation = Rotation.from_rotvec([0, angle, 0]).as_matrix()
        cameras[name] = RigCamera(
            image_size_px=(1024, 1024),
            interior=np.r_[2650.0, 8, -12, 1e-8, np.zeros(6)],
            r0_px=480.0,
            rotation=rotation,
            translation_mm=np.array([0, 0, 12000.0]),
        )
    names = tuple(f"{c}/{p}" for c in cameras for p in CAMERA_PARAMETERS)
    sigma = np.array([SIGMAS.get(n.split("/")[1], 0.0) for n in names])
    volume = rng.uniform(-1800, 1800, (60, 3))
    return RigData(
        cameras=cameras,
        cov=np.diag(sigma**2),
        cov_names=names,
        volume_mm=volume,
        volume_seen=np.repeat(PAIRS, 30, axis=0),
    )


def calibrated(truth: RigData, rng: np.random.Generator) -> RigData:
    """The rig as a calibration with that covariance might have found it."""
    draw = rng.normal(size=len(truth.cov)) * np.sqrt(np.diag(truth.cov))
    return moved(truth, draw)


def moved(rig: RigData, change) -> RigData:
    """The rig with its 16 parameters a camera changed."""
    cameras = {}
    for k, (name, c) in enumerate(rig.cameras.items()):
        d = np.asarray(change)[16 * k : 16 * (k + 1)]
        cameras[name] = dataclasses.replace(
            c,
            interior=c.interior + d[:10],
            rotation=Rotation.from_rotvec(d[10:13]).as_matrix() @ c.rotation,
            translation_mm=c.translation_mm + d[13:],
        )
    return dataclasses.replace(rig, cameras=cameras)


def measure(truth_rig, rig, position, used, rng, *, ids=None, sigma_px=0.02, rate_hz=500.0):
    """Trajectories of points (S, P, 3) seen by ``used`` (P, C), with noisy pictures."""
    stages, points = position.shape[:2]
    flat = position.reshape(-1, 3)
    pixels = np.stack(
        [project(c, flat @ c.rotation.T + c.translation_mm) for c in truth_rig.cameras.values()],
        axis=1,
    )
    pixels += rng.normal(0, sigma_px, pixels.shape)
    seen = np.tile(used, (stages, 1))
    point, camera = np.nonzero(seen)
    variance = np.full(len(point), sigma_px**2)
    result = Triangulator(rig)(
        np.concatenate([[0], np.cumsum(seen.sum(axis=1))]),
        camera,
        pixels[point, camera],
        np.stack([variance, 0 * variance, variance], axis=1),
    )
    image = cov6_from_matrix(result["cov_image_mm2"]).reshape(stages, points, 6)
    of_rig = cov6_from_matrix(result["cov_rig_mm2"]).reshape(stages, points, 6)
    return Trajectories(
        stage=np.arange(1, stages + 1, dtype=np.int32),
        time_s=np.arange(stages) / rate_hz,
        point_id=np.arange(points, dtype=np.int32) + 1 if ids is None else ids,
        position_mm=result["position_mm"].reshape(stages, points, 3),
        cov_mm2=image + of_rig,
        cov_image_mm2=image,
        cameras_used=seen.reshape(stages, points, len(NAMES)),
        rms_px=np.zeros((stages, points)),
        camera_names=NAMES,
    )


def without(table: Trajectories, missing) -> Trajectories:
    """The trajectories with positions (S, P) taken away."""
    return dataclasses.replace(
        table,
        position_mm=np.where(missing[..., None], np.nan, table.position_mm),
        cov_mm2=np.where(missing[..., None], np.nan, table.cov_mm2),
        cov_image_mm2=np.where(missing[..., None], np.nan, table.cov_image_mm2),
        cameras_used=table.cameras_used & ~missing[..., None],
    )
