"""A measurement that never took place, for tests of what keeps or shows one."""

from __future__ import annotations

import numpy as np

from videogrammetry.motion import compute_motion
from videogrammetry.types import Measurement, TargetRecords, Trajectories

STAGES, POINTS, CAMERAS, TARGETS = 4, 5, 3, 17


def fake_measurement() -> Measurement:
    rng = np.random.default_rng(1)
    position = rng.normal(size=(STAGES, POINTS, 3))
    position[2, 1] = np.nan
    cov = np.abs(rng.normal(size=(STAGES, POINTS, 6)))
    table = Trajectories(
        stage=np.arange(1, STAGES + 1, dtype=np.int32),
        time_s=np.arange(STAGES) / 50.0,
        point_id=np.array([3, 7, 9, 517, 518], dtype=np.int32),
        position_mm=position,
        cov_mm2=cov,
        cov_image_mm2=cov / 2,
        cameras_used=rng.uniform(size=(STAGES, POINTS, CAMERAS)) > 0.3,
        rms_px=rng.uniform(size=(STAGES, POINTS)),
        camera_names=("left", "right", "oben"),
    )
    targets = TargetRecords(
        stage=np.sort(rng.integers(1, STAGES + 1, TARGETS)).astype(np.int32),
        camera=rng.integers(0, CAMERAS, TARGETS).astype(np.int32),
        centre_px=rng.normal(size=(TARGETS, 2)),
        semi_axes_px=rng.normal(size=(TARGETS, 2)),
        angle_rad=rng.normal(size=TARGETS),
        sigma_px=rng.normal(size=(TARGETS, 2)),
        code_id=rng.integers(-1, 9, TARGETS).astype(np.int32),
        point_id=rng.integers(-1, 9, TARGETS).astype(np.int32),
        residual_px=rng.normal(size=(TARGETS, 2)),
        match_status=rng.integers(0, 5, TARGETS).astype(np.uint8),
        ring_status=rng.integers(0, 5, TARGETS).astype(np.uint8),
    )
    return Measurement(
        trajectories=table,
        motion=compute_motion(table),
        targets=targets,
        image_name=tuple(tuple(f"{c}{s}.tif" for s in range(STAGES)) for c in range(CAMERAS)),
        frame_rate_hz=50.0,
        provenance={"version": "0", "options": {"a": [1, None]}},
        warnings=("a warning",),
        flag_meanings={"ring_status": ("coded", "no ring", "ring cut")},
    )
