"""Adjusting a calibration's network, with the un-coded points coming in on the way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from videogrammetry.adjustment import Adjustment, AdjustOptions, Dispersion
from videogrammetry.calibration.bundle import (
    Bundle,
    dropped_rejections,
    observation_rejections,
    offered,
    offered_names,
)
from videogrammetry.calibration.circles import complete_circles
from videogrammetry.calibration.pictures import Picture
from videogrammetry.calibration.run import CalibrationOptions, CameraFrames, Rejection
from videogrammetry.calibration.suspicions import check_attitudes, doubts_of_result
from videogrammetry.calibration.uncoded import assign_uncoded, faces
from videogrammetry.errors import CalibrationError
from videogrammetry.types import PointSet

#: Assignments of un-coded targets settle in two or three rounds.
MAX_ASSIGNMENTS = 5
#: The bend of ways within a delay is second order: few rounds settle it.
MAX_DELAYS = 6


@dataclass(frozen=True, kw_only=True)
class Solution:
    """An adjusted network with everything that was left out; ``remarks``: on its circles."""

    bundle: Bundle
    adjustment: Adjustment
    dispersion: Dispersion
    rejected: tuple[Rejection, ...]
    warnings: tuple[str, ...]
    remarks: tuple[str, ...] = ()


def solve(
    bundle: Bundle,
    cameras: Sequence[CameraFrames],
    f_given: Sequence[bool],
    target: PointSet,
    options: CalibrationOptions,
) -> Solution:
    """Adjust the network; assign un-coded targets and adjust again until nothing changes.

    Raises
    ------
    CalibrationError : rank defect, no convergence, f undetermined without a
        start value, or most points of a camera rejected.
    """
    own = [cameras[i] for i in bundle.camera_of]
    adjust = AdjustOptions(
        critical_value=options.critical_value,
        significance=options.significance,
        num_threads=options.num_threads,
    )
    adjustment = bundle.network.adjust(adjust, offered(own))
    again = replace(adjust, robust_start=False)
    for _ in range(MAX_DELAYS if bundle.time_offset else 0):
        if not bundle.update_delay():
            break
        bundle.set_observations(adjustment.used)
        adjustment = bundle.network.adjust(again, offered(own))
    dispersion = bundle.network.dispersion()
    base = list(bundle.pictures)
    for _ in range(MAX_ASSIGNMENTS if any(len(p.open_xy_px) for p in base) else 0):
        pictures = assign_uncoded(
            bundle, base, adjustment, dispersion, target, options.critical_value
        )
        if all(
            np.array_equal(a.point, b.point) for a, b in zip(pictures, bundle.pictures, strict=True)
        ):
            break
        _exchange_pictures(bundle, pictures, adjustment, base)
        # More points may show what few could not: every parameter is offered anew.
        for index, camera in enumerate(own):
            bundle.network.set_free(index, offered_names(camera))
        adjustment = bundle.network.adjust(again, offered(own))
        dispersion = bundle.network.dispersion()
    remarks: list[str] = []
    if options.eccentricity and not options.interfaces:
        changed, remarks = complete_circles(bundle, target, options.diameter_mm)
        if changed:
            adjustment = bundle.network.adjust(again, offered(own))
            dispersion = bundle.network.dispersion()
    return finished(
        bundle, adjustment, dispersion, cameras, f_given, target, remarks=tuple(remarks)
    )


def finished(
    bundle: Bundle,
    adjustment: Adjustment,
    dispersion: Dispersion,
    cameras: Sequence[CameraFrames],
    f_given: Sequence[bool],
    target: PointSet,
    *,
    remarks: tuple[str, ...] = (),
) -> Solution:
    """An adjustment that is the last one, with what it left out; its checks as :func:`solve`."""
    names = [camera.name for camera in cameras]
    _check(bundle, adjustment, cameras, f_given)
    _check_facing(bundle, adjustment, target)
    check_attitudes(bundle, cameras, f_given, target)
    rejected = dropped_rejections(adjustment, bundle.camera_of, names)
    rejected += observation_rejections(bundle, adjustment, names, target)
    return Solution(
        bundle=bundle, adjustment=adjustment, dispersion=dispersion, rejected=tuple(rejected),
        warnings=(
            *_doubts(bundle, adjustment, cameras),
            *doubts_of_result(bundle, adjustment, cameras),
            *remarks,
        ), remarks=remarks,
    )  # fmt: skip


def _exchange_pictures(
    bundle: Bundle, pictures: list[Picture], adjustment: Adjustment, base: list[Picture]
) -> None:
    """New pictures (base points first, then assigned ones); what was rejected of base stays so."""
    used = []
    images = bundle.image_of
    for image, picture in enumerate(pictures):
        before = adjustment.used[images == image][: len(base[image])]
        used += [before, np.ones(len(picture) - len(before), bool)]
    bundle.pictures = pictures
    bundle.set_observations(np.concatenate(used))


def _check(
    bundle: Bundle,
    adjustment: Adjustment,
    cameras: Sequence[CameraFrames],
    f_given: Sequence[bool],
) -> None:
    for d in adjustment.dropped:
        camera = bundle.camera_of[d.camera]
        if d.undetermined and d.name == "f" and not f_given[camera]:
            raise CalibrationError(
                f"camera {cameras[camera].name}: the pictures do not determine f "
                f"({d.value:.0f} px with a standard deviation of {d.sigma:.0f}); tilt the target "
                "by 30 degrees and more in some pictures, bring it nearer, or give f_px as start "
                "value and leave f out of free"
            )
    if not adjustment.converged:
        raise CalibrationError(
            f"the adjustment does not converge ({adjustment.message.strip()}); free fewer "
            "interior parameters, or give start values of f"
        )
    images = bundle.image_of
    # Additional points say nothing of the target.
    camera_of_image = np.array(
        [-1 if i in bundle.inner else p.camera for i, p in enumerate(bundle.pictures)]
    )
    for camera in bundle.camera_of:
        mine = np.isin(images, np.flatnonzero(camera_of_image == camera))
        share = float(adjustment.used[mine].mean()) if mine.any() else 0.0
        if share < 0.5:
            raise CalibrationError(
                f"camera {cameras[camera].name}: only {share:.0%} of its {int(mine.sum())} points "
                "agree with one rigid target and one rigid rig; are its pictures synchronous with "
                "the others', its codes and the target's coordinates the right ones?"
            )


def _check_facing(bundle: Bundle, adjustment: Adjustment, target: PointSet) -> None:
    """CalibrationError if most points with a known normal turn away from the cameras."""
    if target.normal is None:
        return
    images, points = bundle.image_of, bundle.point_of
    facing = np.concatenate(
        [
            faces(bundle, image, points[adjustment.used & (images == image)], target)
            for image in range(len(bundle.pictures))
        ]
    )
    if facing.size and facing.mean() < 0.5:
        raise CalibrationError(
            f"{1 - facing.mean():.0%} of the points are seen from behind their normals: the "
            "target's coordinates or normals are mirrored; change the sign of one coordinate"
        )


def _doubts(bundle: Bundle, adjustment: Adjustment, cameras: Sequence[CameraFrames]) -> list[str]:
    warnings = []
    if adjustment.rounds >= AdjustOptions.max_rounds:
        warnings.append(
            f"weights and rejections still changed after {adjustment.rounds} adjustments; the last "
            "ones stand"
        )
    if adjustment.point_redundancy > 10 and adjustment.point_factor > 2.0:
        warnings.append(
            f"the target's points deviate {np.sqrt(adjustment.point_factor):.1f} times as much as "
            "their standard deviations say; measure the target anew or raise sigma_mm"
        )
    for index, camera in enumerate(bundle.camera_of):
        scale = bundle.network.cov_scale(index)
        if scale < 0.25:
            warnings.append(
                f"camera {cameras[camera].name}: the stated standard deviations of its image "
                f"points are {1 / np.sqrt(scale):.1f} times too large; the residuals' were used"
            )
        floor = bundle.network.floor_px(index)
        if floor > 0.5:
            warnings.append(
                f"camera {cameras[camera].name}: its points scatter by {floor:.2f} px more than "
                "their edges; look for bad pictures, a moved camera or a target that bends"
            )
    rejected = 1.0 - float(adjustment.used.mean())
    if rejected > 0.05:
        warnings.append(
            f"{rejected:.0%} of the points were rejected, where one in a hundred is usual: the "
            "model does not fit (are too few parameters free?) or the pictures are bad"
        )
    for d in adjustment.dropped:
        if d.undetermined:
            warnings.append(
                f"camera {cameras[bundle.camera_of[d.camera]].name}: {d.name} is not determined "
                f"by these pictures (sigma {d.sigma:.3g} px) and is held at its start value"
            )
    return warnings
