"""The rigorous way: one pose a target position and constant relative poses of the cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from videogrammetry.adjustment import Adjustment, AdjustOptions, Dispersion
from videogrammetry.calibration.bundle import (
    Bundle,
    dropped_rejections,
    joint_bundle,
    observation_rejections,
    offered,
)
from videogrammetry.calibration.linking import link_cameras
from videogrammetry.calibration.pictures import Pictures
from videogrammetry.calibration.run import CalibrationOptions, CameraFrames, Rejection
from videogrammetry.calibration.start import CameraStart
from videogrammetry.types import FloatArray, PointSet


@dataclass(frozen=True, kw_only=True)
class JointSolution:
    """The adjusted network with everything that was left out."""

    bundle: Bundle
    adjustment: Adjustment
    dispersion: Dispersion
    rejected: tuple[Rejection, ...]
    warnings: tuple[str, ...]


def solve_joint(
    cameras: Sequence[CameraFrames],
    starts: Sequence[CameraStart],
    pictures: Pictures,
    target: PointSet,
    target_cov: FloatArray,
    options: CalibrationOptions,
) -> JointSolution:
    """Adjust all cameras together (the paper's Eq. 4 with weighted target coordinates)."""
    names = [camera.name for camera in cameras]
    rig = link_cameras(names, starts, pictures.pictures, target)
    bundle = joint_bundle(
        cameras, starts, pictures.pictures, rig.cam_from_rig, rig.rig_from_target, target, target_cov
    )
    adjust = AdjustOptions(
        critical_value=options.critical_value,
        significance=options.significance,
        num_threads=options.num_threads,
    )
    adjustment = bundle.network.adjust(adjust, offered(cameras))
    dispersion = bundle.network.dispersion()
    rejected = dropped_rejections(adjustment, bundle.camera_of, names)
    rejected += observation_rejections(bundle, adjustment, names, target)
    return JointSolution(
        bundle=bundle, adjustment=adjustment, dispersion=dispersion,
        rejected=tuple(rejected), warnings=(),
    )  # fmt: skip


def exterior_covariance(solution: JointSolution) -> tuple[FloatArray, FloatArray]:
    """Places of every camera's 16 parameters and their a-posteriori covariance (16 C, 16 C).

    Held parameters (and the reference camera's exterior orientation) have no variance.
    """
    dispersion = solution.dispersion
    places = []
    for camera, pose in enumerate(solution.bundle.outer):
        places += list(dispersion.interior_index[camera])
        first = dispersion.pose_index[pose]
        places += [first + k if first >= 0 else -1 for k in range(6)]
    place = np.array(places)
    estimated = place >= 0
    cov = np.zeros((len(place), len(place)))
    cov[np.ix_(estimated, estimated)] = (
        solution.adjustment.sigma0**2 * dispersion.cov[np.ix_(place[estimated], place[estimated])]
    )
    return place, cov
