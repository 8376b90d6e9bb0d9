"""The rigorous way: one pose a target position and constant relative poses of the cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from videogrammetry.adjustment import CAMERA_UNKNOWNS, AdjustOptions
from videogrammetry.calibration.additional_points import (
    Placed,
    add_to_bundle,
    additional_sightings,
    place_sightings,
    with_points,
)
from videogrammetry.calibration.bundle import joint_bundle, offered, offered_names
from videogrammetry.calibration.interfaces import adjusted_interfaces
from videogrammetry.calibration.linking import RigStart
from videogrammetry.calibration.mirrored import settle_doubtful
from videogrammetry.calibration.network_result import AdjustedBars
from videogrammetry.calibration.pictures import Pictures
from videogrammetry.calibration.result import Outcome, adjusted_bars
from videogrammetry.calibration.run import CalibrationOptions, CameraFrames
from videogrammetry.calibration.solving import Solution, finished, solve
from videogrammetry.calibration.start import CameraStart
from videogrammetry.calibration.suspicions import doubts_of_lengths
from videogrammetry.types import FloatArray, PointSet


def calibrate_joint(
    cameras: Sequence[CameraFrames],
    starts: Sequence[CameraStart],
    rig: RigStart,
    pictures: Pictures,
    target: PointSet,
    target_cov: FloatArray,
    options: CalibrationOptions,
) -> Outcome:
    """Adjust all cameras together (the paper's Eq. 4, with observed target coordinates)."""
    bundle = joint_bundle(
        cameras,
        starts,
        pictures.pictures,
        rig.cam_from_rig,
        rig.rig_from_target,
        target,
        target_cov,
        options,
    )
    f_given = [start.f_given for start in starts]
    solution = solve(bundle, cameras, f_given, target, options)
    changed, warnings = settle_doubtful(solution, rig.doubtful)
    if changed:
        solution = solve(bundle, cameras, f_given, target, options)
    extra = None
    if options.free_points != "none":
        solution, extra = _with_additional(solution, cameras, f_given, target, target_cov, options)
        warnings = [*warnings, *extra.warnings]
    n = len(target)
    bars = _bars(solution, target, options) if options.lengths else None
    if bars is not None:
        warnings = [*warnings, *doubts_of_lengths(bars, options.lengths)]
    network, adjustment, dispersion = bundle.network, solution.adjustment, solution.dispersion
    return Outcome(
        solutions=(solution,),
        interior=[network.interior(i) for i in range(len(cameras))],
        cam_from_rig=[network.pose(pose) for pose in bundle.outer],
        rig_from_target={s: network.pose(pose) for s, pose in bundle.stage_pose.items()},
        cov=camera_covariance(solution),
        interfaces=adjusted_interfaces(
            network, bundle.windows, dispersion.interface_index, dispersion.cov, adjustment.sigma0
        ) if bundle.windows else {},
        position_mm=network.positions_mm[:n],
        point_cov_mm2=adjustment.sigma0**2 * dispersion.point_cov_mm2[:n],
        additional=extra,
        rejected=(*rig.rejected, *(extra.sightings.rejected if extra else ())),
        warnings=warnings,
        statistics=_time_offsets(cameras, solution) if options.time_offset else {},
        bars=bars,
    )  # fmt: skip


def _with_additional(
    solution: Solution,
    cameras: Sequence[CameraFrames],
    f_given: Sequence[bool],
    target: PointSet,
    target_cov: FloatArray,
    options: CalibrationOptions,
) -> tuple[Solution, Placed]:
    """The adjustment again with the targets that are not the known target's."""
    bundle, mode = solution.bundle, options.free_points
    placed = place_sightings(
        bundle, cameras, additional_sightings(cameras, bundle, target, mode), mode
    )
    if not len(placed.position_mm):
        nothing = f'free_points = "{mode}": no target beside the known one was placed'
        return solution, replace(placed, warnings=(*placed.warnings, nothing))
    add_to_bundle(bundle, placed, target, target_cov, options, solution.adjustment.used)
    # More points may show what few could not: every parameter is offered anew.
    for index, camera in enumerate(cameras):
        bundle.network.set_free(index, offered_names(camera))
    adjust = AdjustOptions(
        critical_value=options.critical_value, significance=options.significance,
        robust_start=False, num_threads=options.num_threads,
    )  # fmt: skip
    adjustment = bundle.network.adjust(adjust, offered(cameras))
    again = finished(
        bundle, adjustment, bundle.network.dispersion(), cameras, f_given,
        with_points(target, placed), remarks=solution.remarks,
    )  # fmt: skip
    return again, placed


def _bars(solution: Solution, target: PointSet, options: CalibrationOptions) -> AdjustedBars:
    row = {int(number): i for i, number in enumerate(target.id)}
    ends = [[row[b.point_a] for b in options.lengths], [row[b.point_b] for b in options.lengths]]
    a, b = np.array(ends, np.int32)
    return adjusted_bars(
        solution.adjustment,
        (a, b),
        np.array([bar.length_mm for bar in options.lengths]),
        np.array([bar.sigma_mm for bar in options.lengths]),
    )


def _time_offsets(cameras: Sequence[CameraFrames], solution: Solution) -> dict[str, Any]:
    """By which part of the interval between stages each camera is late, and its sigma."""
    place = CAMERA_UNKNOWNS.index("time_offset")
    sigma0 = solution.adjustment.sigma0
    offsets, sigmas = {}, {}
    for index, camera in enumerate(cameras):
        row = int(solution.dispersion.camera_index[index, place])
        offsets[camera.name] = float(solution.bundle.network.camera_unknowns(index)[place])
        variance = solution.dispersion.cov[row, row] if row >= 0 else 0.0
        sigmas[camera.name] = float(sigma0 * np.sqrt(variance))
    return {"time_offset_stages": offsets, "sigma_time_offset_stages": sigmas}


def camera_covariance(solution: Solution) -> FloatArray:
    """A-posteriori covariance (16 C, 16 C) of the cameras' interior and exterior parameters.

    Held parameters (and the reference camera's pose) have no variance. Where windows
    are estimated it is the covariance given the windows: what a window's error does to
    points, the cameras' poses and f compensate almost wholly, and their covariance
    without the window's would state it as an error of the points.
    """
    dispersion = solution.dispersion
    places: list[int] = []
    for camera, pose in enumerate(solution.bundle.outer):
        places += [int(p) for p in dispersion.interior_index[camera]]
        first = int(dispersion.pose_index[pose])
        places += [first + k if first >= 0 else -1 for k in range(6)]
    place = np.array(places)
    free = np.flatnonzero(place >= 0)
    cov = np.zeros((len(place), len(place)))
    known = place[free]
    cov[np.ix_(free, free)] = dispersion.cov[np.ix_(known, known)]
    window = dispersion.interface_index[dispersion.interface_index >= 0]
    if window.size:
        across = dispersion.cov[np.ix_(known, window)]
        own = dispersion.cov[np.ix_(window, window)]
        scale = 1.0 / np.sqrt(np.diag(own))  # rad beside mm
        whitened = np.linalg.solve(own * np.outer(scale, scale), (across * scale).T)
        cov[np.ix_(free, free)] -= (across * scale) @ whitened
    return solution.adjustment.sigma0**2 * cov
