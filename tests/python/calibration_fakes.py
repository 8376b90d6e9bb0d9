"""A calibration that never took place, for tests of what shows one."""

from __future__ import annotations

import numpy as np

from videogrammetry.calibration.run import CalibrationRun, ObservationTable, Rejection
from videogrammetry.geometry import rotation_from_vector
from videogrammetry.types import INTERIOR_NAMES, PointSet, RigCamera, RigData
from videogrammetry.version import __version__

SIGMA_PX = 0.03
POSE_NAMES = ("rx", "ry", "rz", "tx", "ty", "tz")
INTERIOR_SIGMA = (0.31, 0.42, 0.38, 2.1e-10, 1e-15, 1e-21, 1.9e-8, 2.2e-8, 2e-5, 1e-5)


def fake_camera(index: int, rng: np.random.Generator) -> RigCamera:
    interior = np.array([2640, -50, -45, 2.1e-8, 0, 0, 1.2e-7, -7.4e-7, 0, 0]) * rng.normal(1, 0.01)
    kept = np.flatnonzero(interior)
    sigma = {INTERIOR_NAMES[i]: INTERIOR_SIGMA[i] for i in kept}
    if index:
        sigma.update(dict.fromkeys(POSE_NAMES[:3], 2.4e-5))
        sigma.update(dict.fromkeys(POSE_NAMES[3:], 0.21))
    return RigCamera(
        image_size_px=(1024, 1024),
        interior=interior,
        r0_px=482.72,
        rotation=rotation_from_vector([0.02 * index, -0.46 * index, 0.01 * index]),
        translation_mm=np.array([-5350.0 * index, 60.0 * index, 1310.0 * index]),
        sigma=sigma,
    )


def fake_run(cameras: int = 4, stages: int = 12, points: int = 49, seed: int = 3) -> CalibrationRun:
    rng = np.random.default_rng(seed)
    names = tuple(f"cam{k + 1}" for k in range(cameras))
    camera, stage, point = (
        a.ravel().astype(np.int32)
        for a in np.meshgrid(
            np.arange(cameras), np.arange(1, stages + 1), np.arange(1, points + 1), indexing="ij"
        )
    )
    count = len(camera)
    centre = rng.uniform(250, 780, (stages + 1, 2))[stage]
    xy = np.clip(centre + rng.normal(0, 130, (count, 2)), 5, 1018)
    residual = rng.normal(0, SIGMA_PX, (count, 2)) + 0.00005 * (xy - 512)[:, ::-1]
    used = rng.random(count) > 0.006
    residual[~used] *= 9
    table = ObservationTable(
        camera=camera,
        stage=stage,
        point_id=point,
        xy_px=xy,
        sigma_px=np.full((count, 2), SIGMA_PX),
        residual_px=residual,
        normalised=residual / SIGMA_PX,
        redundancy=np.full((count, 2), 0.9),
        used=used,
    )
    cams = {name: fake_camera(k, rng) for k, name in enumerate(names)}
    images = {(n, s): f"{n}_{s:04d}.tif" for n in names for s in range(1, stages + 1)}
    square = residual[used] ** 2
    return CalibrationRun(
        rig=RigData(
            cameras=cams,
            reference=f"camera {names[0]}",
            sigma_floor_px=dict.fromkeys(names, 0.018),
            how={
                "program": "videogrammetry",
                "version": __version__,
                "time_utc": "2012-06-01T12:00:00Z",
                "options": {"method": "joint", "critical_value": 3.29},
                "inputs_sha256": {"cross.csv": "ab" * 32},
            },
        ),
        method="joint",
        camera_names=names,
        image_names=images,
        rig_from_target={s: (np.eye(3), np.array([0, 0, 12e3])) for s in range(1, stages + 1)},
        target=PointSet(
            id=np.arange(1, points + 1, dtype=np.int32), position_mm=rng.normal(size=(points, 3))
        ),
        observations=table,
        sigma0=1.04,
        rms_px=float(np.sqrt(square.mean())),
        redundancy=2 * count - 250,
        num_unknowns=250,
        num_observations=2 * int(used.sum()),
        camera_rms_px={
            n: float(np.sqrt((residual[used & (camera == k)] ** 2).mean()))
            for k, n in enumerate(names)
        },
        camera_count={n: int((used & (camera == k)).sum()) for k, n in enumerate(names)},
        parameters_kept={n: ("f", "x0", "y0", "A1", "B1", "B2") for n in names},
        rejected=fake_rejections(names, camera, stage, point, used, residual),
        warnings=("camera cam2 <left>: only 12 pictures; 16 or more are better",),
        seconds=2.31,
    )


def fake_rejections(names, camera, stage, point, used, residual) -> tuple[Rejection, ...]:
    observations = [
        Rejection(
            kind="observation",
            camera=names[camera[i]],
            image=f"{names[camera[i]]}_{stage[i]:04d}.tif",
            point_id=int(point[i]),
            value=float(np.abs(residual[i]).max() / SIGMA_PX),
            reason="normalised residual above 3.29",
        )
        for i in np.flatnonzero(~used)
    ]
    parameters = [
        Rejection(
            kind="parameter",
            camera=name,
            image="",
            point_id=None,
            value=0.7,
            reason=f"{parameter} is 0.7 of its standard deviation, less than 2.58",
        )
        for name in names
        for parameter in ("A2", "A3", "E1", "E2")
    ]
    image = Rejection(
        kind="image",
        camera=names[-1],
        image=f"{names[-1]}_0013.tif",
        point_id=None,
        value=1.9,
        reason="only 3 targets of known number: a pose needs 4",
    )
    return (image, *parameters, *observations)
