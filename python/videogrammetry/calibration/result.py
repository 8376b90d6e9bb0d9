"""From an adjusted network to a :class:`CalibrationRun`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from videogrammetry.adjustment import Adjustment
from videogrammetry.calibration.bundle import POSE_NAMES, Bundle
from videogrammetry.calibration.run import CameraFrames, ObservationTable
from videogrammetry.types import INTERIOR_NAMES, FloatArray, PointSet, RigCamera, RigData

#: Order of a camera's sixteen parameters in the covariance of a rig.
CAMERA_PARAMETERS = (*INTERIOR_NAMES, *POSE_NAMES)


def rig_data(
    cameras: Sequence[CameraFrames],
    models: Sequence[RigCamera],
    cov: FloatArray,
    floors: Sequence[float],
    how: Mapping[str, Any],
) -> RigData:
    """The rig with its covariance (16 C, 16 C); ``models`` carry the poses."""
    sigma = np.sqrt(np.maximum(np.diag(cov), 0.0)).reshape(len(cameras), -1)
    return RigData(
        cameras={
            camera.name: RigCamera(
                image_size_px=model.image_size_px, interior=model.interior, r0_px=model.r0_px,
                rotation=model.rotation, translation_mm=model.translation_mm,
                sigma=dict(zip(CAMERA_PARAMETERS, map(float, sigma[i]), strict=True)),
            )
            for i, (camera, model) in enumerate(zip(cameras, models, strict=True))
        },
        reference=f"camera {cameras[0].name}",
        cov=cov,
        cov_names=tuple(f"{c.name}/{p}" for c in cameras for p in CAMERA_PARAMETERS),
        sigma_floor_px={c.name: float(f) for c, f in zip(cameras, floors, strict=True)},
        how=dict(how),
    )  # fmt: skip


def observation_table(
    bundle: Bundle, adjustment: Adjustment, floors: Sequence[float], target: PointSet
) -> ObservationTable:
    """Every observation that had a known point, used or rejected."""
    pictures = bundle.pictures
    counts = [len(p) for p in pictures]
    camera = np.repeat([p.camera for p in pictures], counts).astype(np.int32)
    cov = np.concatenate([p.cov_px2 for p in pictures])
    floor = np.asarray(floors, dtype=float)[camera]
    return ObservationTable(
        camera=camera,
        stage=np.repeat([p.stage for p in pictures], counts).astype(np.int32),
        point_id=target.id[bundle.point_of].astype(np.int32),
        xy_px=np.concatenate([p.xy_px for p in pictures]),
        sigma_px=np.sqrt(cov[:, [0, 2]] + floor[:, None] ** 2),
        residual_px=adjustment.residual_px,
        normalised=adjustment.normalised,
        redundancy=adjustment.redundancy_numbers,
        used=adjustment.used,
    )


def rms_px(residual_px: FloatArray) -> float:
    """RMS per coordinate; 0 of nothing."""
    return float(np.sqrt(np.mean(residual_px**2))) if residual_px.size else 0.0
