"""The mirrored pose of a flat target: settled after the adjustment, or said to be open."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from videogrammetry.adjustment import AdjustOptions, Network
from videogrammetry.calibration.linking import Rigid
from videogrammetry.calibration.solving import Solution
from videogrammetry.types import RigCamera

#: Difference of v'Pv (in units of sigma0^2) below which both poses are possible:
#: the 99.9 % point of chi-square with one degree of freedom.
UNDECIDED_CHI2 = 10.8


def settle_doubtful(solution: Solution, doubtful: Mapping[int, Rigid]) -> tuple[bool, list[str]]:
    """Refine the twin pose of every doubtful stage against the adjusted cameras.

    A twin that fits better replaces the pose (then True: adjust again); one
    that fits as well is a warning.
    """
    changed, warnings = False, []
    network = solution.bundle.network
    for stage, twin in doubtful.items():
        pose = solution.bundle.stage_pose[stage]
        now = network.pose(pose)
        cost_now, refined_now = _refine(solution, stage, now)
        cost_twin, refined_twin = _refine(solution, stage, twin)
        if np.abs(refined_now[0] - refined_twin[0]).max() < 1e-3:
            continue  # both run into the same pose
        gain = (cost_now - cost_twin) / max(solution.adjustment.sigma0**2, 1e-12)
        if gain > UNDECIDED_CHI2:
            network.set_pose(pose, *refined_twin)
            changed = True
        elif gain > -UNDECIDED_CHI2:
            images = [p.image for p in solution.bundle.pictures if p.stage == stage]
            warnings.append(
                f"stage {stage} ({', '.join(images)}): a mirrored pose of the target fits as well; "
                "tilt the target more, or use one that is not flat"
            )
    return changed, warnings


def _refine(solution: Solution, stage: int, pose: Rigid) -> tuple[float, Rigid]:
    """v'Pv and pose of one stage, everything else held."""
    bundle = solution.bundle
    network = Network()
    images, points, xy, cov = [], [], [], []
    inner = network.add_pose("stage", *pose)
    for image, picture in enumerate(bundle.pictures):
        if picture.stage != stage:
            continue
        model = bundle.network.model(bundle.network_camera(image))
        held = RigCamera(
            image_size_px=(model.width_px, model.height_px), interior=np.array(model.interior),
            r0_px=model.r0_px, rotation=np.eye(3), translation_mm=np.zeros(3),
        )  # fmt: skip
        floor = bundle.network.floor_px(bundle.network_camera(image))
        window = bundle.window_of(picture.camera)
        camera = network.add_camera(
            picture.image, held, free=(), floor_px=floor,
            interface=None if window is None
            else network.add_interface(bundle.network.interface(window)),
        )  # fmt: skip
        outer = network.add_pose(
            picture.image, *bundle.network.pose(bundle.outer[picture.camera]), free=False
        )
        index = network.add_image(picture.image, camera, inner=inner, outer=outer)
        used = solution.adjustment.used[bundle.image_of == image]
        images.append(np.full(int(used.sum()), index))
        points.append(picture.point[used])
        xy.append(picture.xy_px[used])
        scale = bundle.network.cov_scale(bundle.network_camera(image))
        cov.append(scale * picture.cov_px2[used])
    network.set_points(np.arange(len(bundle.network.positions_mm)), bundle.network.positions_mm)
    network.set_observations(*(np.concatenate(part) for part in (images, points, xy, cov)))
    result = network.adjust(
        AdjustOptions(critical_value=0.0, estimate_floor=False, robust_start=False)
    )
    return result.sigma0**2 * result.redundancy, network.pose(inner)
