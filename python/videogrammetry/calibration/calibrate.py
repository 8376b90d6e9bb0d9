"""Calibration of all cameras from synchronous pictures of a known target."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict

import numpy as np

from videogrammetry.calibration.joint import exterior_covariance, solve_joint
from videogrammetry.calibration.pictures import check_input, collect_pictures, target_covariance
from videogrammetry.calibration.result import observation_table, rig_data, rms_px
from videogrammetry.calibration.run import CalibrationOptions, CalibrationRun, CameraFrames
from videogrammetry.calibration.start import start_camera
from videogrammetry.types import PointSet, RigCamera, cov6_from_matrix


def calibrate(
    cameras: Sequence[CameraFrames],
    target: PointSet,
    options: CalibrationOptions | None = None,
) -> CalibrationRun:
    options = options or CalibrationOptions()
    began = time.perf_counter()
    check_input(cameras, target)
    pictures = collect_pictures(cameras, target)
    starts = [start_camera(c, pictures.of_camera(i), target) for i, c in enumerate(cameras)]
    cov = target_covariance(target, options)
    solution = solve_joint(cameras, starts, pictures, target, cov, options)
    bundle, adjustment = solution.bundle, solution.adjustment
    network = bundle.network
    _, cov_exterior = exterior_covariance(solution)
    floors = [network.floor_px(i) for i in range(len(cameras))]
    models = []
    for i, start in enumerate(starts):
        rotation, translation = network.pose(bundle.outer[i])
        models.append(
            RigCamera(image_size_px=start.model.image_size_px, interior=network.interior(i),
                      r0_px=start.model.r0_px, rotation=rotation, translation_mm=translation)
        )
    table = observation_table(bundle, adjustment, floors, target)
    how = {"method": "joint", "options": asdict(options)}
    s2 = adjustment.sigma0**2
    return CalibrationRun(
        rig=rig_data(cameras, models, cov_exterior, floors, how),
        method="joint",
        camera_names=tuple(c.name for c in cameras),
        image_names={(cameras[p.camera].name, p.stage): p.image for p in pictures.pictures},
        rig_from_target={s: network.pose(k) for s, k in bundle.stage_pose.items()},
        target=PointSet(id=target.id, position_mm=network.positions_mm,
                        cov_mm2=s2 * cov6_from_matrix(solution.dispersion.point_cov_mm2),
                        normal=target.normal, diameter_mm=target.diameter_mm),
        observations=table,
        sigma0=adjustment.sigma0,
        rms_px=rms_px(table.residual_px[table.used]),
        redundancy=adjustment.redundancy,
        num_unknowns=adjustment.num_unknowns,
        num_observations=adjustment.num_observations,
        camera_rms_px={c.name: adjustment.cameras[i].rms_px for i, c in enumerate(cameras)},
        camera_count={c.name: adjustment.cameras[i].count for i, c in enumerate(cameras)},
        parameters_kept={c.name: network.free(i) for i, c in enumerate(cameras)},
        rejected=(*pictures.rejected, *(r for s in starts for r in s.rejected), *solution.rejected),
        warnings=(*pictures.warnings, *solution.warnings),
        seconds=time.perf_counter() - began,
    )
