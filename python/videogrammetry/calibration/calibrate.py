"""Calibration of all cameras from synchronous pictures of a known target."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

from videogrammetry.calibration.additional_points import check_free_points
from videogrammetry.calibration.interfaces import (
    apparent_target,
    check_interfaces,
    check_sides,
    in_target_frame,
    start_in_target_frame,
)
from videogrammetry.calibration.joint import calibrate_joint
from videogrammetry.calibration.linking import link_cameras
from videogrammetry.calibration.mean import calibrate_mean
from videogrammetry.calibration.pictures import check_input, collect_pictures, target_covariance
from videogrammetry.calibration.result import calibration_run
from videogrammetry.calibration.run import CalibrationOptions, CalibrationRun, CameraFrames
from videogrammetry.calibration.start import start_camera
from videogrammetry.calibration.suspicions import check_frames, doubts_of_target
from videogrammetry.calibration.volume import with_volume
from videogrammetry.errors import CalibrationError
from videogrammetry.types import PointSet

METHODS = ("joint", "mean")
# What a calibration that fits looks like: half a pixel, with nearly all points used.
_FITS_PX = 0.5
_FITS_SHARE = 0.8


def calibrate(
    cameras: Sequence[CameraFrames],
    target: PointSet,
    options: CalibrationOptions | None = None,
) -> CalibrationRun:
    """Interior and relative orientation of 1 to 64 cameras from pictures of a known target.

    Needs no start values. Pictures of equal ``stage`` are synchronous: the
    target stood still relative to the rig's clock. Cameras are tied together
    by the stages they share, not by shared points: a two-sided target, each
    side seen by another pair, ties all four.

    "joint" minimises v'Pv over the interior parameters, one constant pose a
    camera (cam_from_rig, the first camera's frame), one pose a stage
    (rig_from_target) and the target's coordinates, observed with their
    covariance: Hu et al. (2012), Eq. 4, with constant relative poses. "mean"
    is the paper's own way (Eqs. 5-8). In both, image points are weighted by
    their covariance plus an estimated floor per camera, outliers are rejected
    by Baarda's w-test, distortion parameters are tested for significance where
    ``free`` is None, and targets without a number are assigned to the target's
    points from where they are expected.

    Cameras that look through a flat window into a fluid name it (``interface``), and
    the options say where it stands: pictures are then those of refracted rays.

    Parameters
    ----------
    cameras : the cameras' pictures in the project's order.
    target : known points; unknown numbers in pictures are counted and left out.
    options : see :class:`CalibrationOptions`.

    Raises
    ------
    CalibrationError : cause, place and remedy in one paragraph.
    ValueError : malformed input.

    References
    ----------
    Hu et al., A four-camera videogrammetric system for 3-D motion measurement
    of deformable object, Optics and Lasers in Engineering 50 (2012) 800-811.
    """
    options = options or CalibrationOptions()
    if options.method not in METHODS:
        raise ValueError(f"method: expected one of {', '.join(METHODS)}, got {options.method!r}")
    check_input(cameras, target)
    check_interfaces(cameras, options)
    check_free_points(options)
    check_frames(cameras)
    try:
        return _calibrate(cameras, target, options)
    except CalibrationError as error:
        _check_mirrored(cameras, target, options, error)
        raise


def _check_mirrored(
    cameras: Sequence[CameraFrames],
    target: PointSet,
    options: CalibrationOptions,
    error: CalibrationError,
) -> None:
    """CalibrationError if the mirror image of a target that failed calibrates well.

    What a left-handed target breaks first depends on its shape and on the
    number of cameras, so that the failure itself would name something else.
    """
    mirrored = replace(target, position_mm=target.position_mm * [1.0, 1.0, -1.0], normal=None)
    try:
        run = _calibrate(cameras, mirrored, options)
    except (CalibrationError, ValueError):
        return
    if run.rms_px < _FITS_PX and run.observations.used.mean() > _FITS_SHARE:
        raise CalibrationError(
            f"the mirror image of the target fits the pictures ({run.rms_px:.2f} px), the target "
            "itself does not: its coordinates are left-handed, or the pictures are mirrored; "
            "change the sign of one coordinate of the target, or mirror the pictures back"
        ) from error


def _calibrate(
    cameras: Sequence[CameraFrames], target: PointSet, options: CalibrationOptions
) -> CalibrationRun:
    began = time.perf_counter()
    pictures = collect_pictures(cameras, target, keep_unknown=options.free_points != "none")
    seen = [apparent_target(c, target, options) for c in cameras]
    pictures = replace(pictures, warnings=(*pictures.warnings, *doubts_of_target(target)))
    starts = [start_camera(c, pictures.of_camera(i), seen[i]) for i, c in enumerate(cameras)]
    rig = link_cameras([c.name for c in cameras], starts, pictures.pictures, seen)
    for camera, stage in rig.dropped:
        del starts[camera].poses[stage]
    if in_target_frame(options):
        rig = start_in_target_frame(rig)
    check_sides(cameras, rig, options)
    if options.method == "mean":
        outcome = calibrate_mean(cameras, starts, rig, pictures, target, options)
    else:
        cov = target_covariance(target, options)
        outcome = calibrate_joint(cameras, starts, rig, pictures, target, cov, options)
    return with_volume(
        calibration_run(
            cameras, starts, pictures, target, options, outcome, time.perf_counter() - began
        )
    )
