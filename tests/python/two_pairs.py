"""Two stereo pairs on opposite sides and what they would measure, without pictures."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from videogrammetry.geometry import CAMERA_PARAMETERS, project
from videogrammetry.motion import compute_motion
from videogrammetry.project import (
    ScaleBar,
    TrajectoryTable,
    format_trajectories,
    write_measurement,
    write_rig,
    write_scale_bars,
    write_text,
)
from videogrammetry.reconstruction import Triangulator
from videogrammetry.types import (
    Measurement,
    RigCamera,
    RigData,
    TargetRecords,
    Trajectories,
    cov6_from_matrix,
)

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


def measure(truth_rig, rig, position, used, rng, *, sigma_px=0.02, rate_hz=500.0):
    """Trajectories of points (S, P, 3) seen by ``used`` (P, C); without ``rng`` no noise."""
    stages, points = position.shape[:2]
    flat = position.reshape(-1, 3)
    pixels = np.stack(
        [project(c, flat @ c.rotation.T + c.translation_mm) for c in truth_rig.cameras.values()],
        axis=1,
    )
    if rng is not None:
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
        point_id=np.arange(points, dtype=np.int32) + 1,
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


def measurement_of(table: Trajectories, rng: np.random.Generator, sigma_px=0.02) -> Measurement:
    """A measurement with a target for every sighting."""
    s, p, c = np.nonzero(table.cameras_used)
    n = len(s)
    residual = rng.normal(0, sigma_px, (n, 2))
    targets = TargetRecords(
        stage=table.stage[s],
        camera=c.astype(np.int32),
        centre_px=rng.uniform(0, 1000, (n, 2)),
        semi_axes_px=np.full((n, 2), 8.0),
        angle_rad=np.zeros(n),
        sigma_px=np.full((n, 2), sigma_px),
        code_id=table.point_id[p],
        point_id=table.point_id[p],
        residual_px=residual,
        match_status=np.zeros(n, np.uint8),
        ring_status=np.zeros(n, np.uint8),
    )
    order = np.lexsort((targets.camera, targets.stage))
    names = targets.__dataclass_fields__
    return Measurement(
        trajectories=table,
        motion=compute_motion(table),
        targets=TargetRecords(**{name: getattr(targets, name)[order] for name in names}),
        image_name=tuple(tuple(f"{n}{i}.tif" for i in table.stage) for n in table.camera_names),
        frame_rate_hz=1 / (table.time_s[1] - table.time_s[0]),
        provenance={"version": "0", "options": {"stages": [1, len(table.stage)]}},
    )


@dataclasses.dataclass(frozen=True)
class Scene:
    """A simulated fall with all that a project's folder holds of it."""

    truth: RigData
    rig: RigData
    position: np.ndarray
    used: np.ndarray
    table: Trajectories


def falling(seed: int, *, stages=60, rate_hz=150.0, lost=0.1, spin=(0.3, 0.5, -0.8)) -> Scene:
    """Sixteen points 1-16 of a turning body, eight seen by either pair; down is +y, g standard."""
    rng = np.random.default_rng(seed)
    truth = two_pair_rig(rng)
    rig = calibrated(truth, rng)
    body = rng.uniform(-300, 300, (16, 3))
    body -= body.mean(axis=0)
    time = np.arange(stages) / rate_hz
    turned = np.einsum(
        "nij,pj->npi", Rotation.from_rotvec(time[:, None] * np.array(spin)).as_matrix(), body
    )
    path = np.array([0, -500, 0]) + time[:, None] * [100, 0, 50]
    path = path + 0.5 * 9806.65 * time[:, None] ** 2 * np.array([0, 1, 0])
    position = turned + path[:, None]
    used = np.repeat(PAIRS, 8, axis=0)
    table = measure(truth, rig, position, used, rng, rate_hz=rate_hz)
    missing = rng.uniform(size=(stages, 16)) < lost
    return Scene(truth, rig, position, used, without(table, missing) if lost else table)


def write_project(folder: Path, scene: Scene, verify: str = "") -> Path:
    """project.toml, rig, measurement, bars.csv and the truth's folder."""
    cameras = "".join(f'[cameras.{n}]\nsequence = "{n}/*.tif"\n' for n in NAMES)
    (folder / "project.toml").write_text(f"schema = 1\n{cameras}\n{verify}")
    write_rig(folder / "rig.json", scene.rig)
    rng = np.random.default_rng(99)
    write_measurement(folder / "measurement.h5", measurement_of(scene.table, rng))
    (folder / "truth").mkdir()
    write_rig(folder / "truth" / "rig.json", dataclasses.replace(scene.truth, cov=None))
    stages, points = scene.position.shape[:2]
    names = np.array(NAMES, dtype=object)
    rows = TrajectoryTable(
        stage=np.repeat(scene.table.stage, points),
        time_s=np.repeat(scene.table.time_s, points),
        point=tuple(str(i) for i in np.tile(scene.table.point_id, stages)),
        position_mm=scene.position.reshape(-1, 3),
        sigma_mm=np.full((stages * points, 3), np.nan),
        cameras=tuple(tuple(names[u]) for u in np.tile(scene.used, (stages, 1))),
    )
    write_text(folder / "truth" / "trajectories.csv", format_trajectories(rows))
    bars = [
        ScaleBar(
            point_a=1,
            point_b=b,
            length_mm=float(np.linalg.norm(scene.position[0, 0] - scene.position[0, b - 1])),
            sigma_mm=0.003,
        )
        for b in (2, 10)
    ]
    write_scale_bars(folder / "bars.csv", bars)
    return folder / "project.toml"
