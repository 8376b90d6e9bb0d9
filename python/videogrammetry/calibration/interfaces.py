"""Calibration through flat windows: checks, start values, the network's windows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from videogrammetry.adjustment import Network
from videogrammetry.calibration.linking import Rigid, RigStart, compose
from videogrammetry.calibration.run import (
    INTERFACE_FRAMES,
    CalibrationInterface,
    CalibrationOptions,
    CameraFrames,
)
from videogrammetry.errors import CalibrationError
from videogrammetry.geometry import apparent_points, interface_model
from videogrammetry.types import FlatInterface, FloatArray, IntArray, PointSet


def check_interfaces(cameras: Sequence[CameraFrames], options: CalibrationOptions) -> None:
    """ValueError or CalibrationError if the windows cannot be calibrated with."""
    names = [i.interface.name for i in options.interfaces]
    for camera in cameras:
        if camera.interface is not None and camera.interface not in names:
            raise ValueError(
                f"camera {camera.name}: interface {camera.interface!r} is not among the options' "
                f"interfaces ({', '.join(names) or 'none'})"
            )
    if not options.interfaces:
        return
    if len(set(names)) < len(names):
        raise ValueError(f"interfaces: a name is given twice ({', '.join(names)})")
    for stated in options.interfaces:
        interface_model(stated.interface)
        if stated.frame not in INTERFACE_FRAMES:
            raise ValueError(
                f"interface {stated.interface.name!r}: expected frame "
                f"{' or '.join(INTERFACE_FRAMES)}, got {stated.frame!r}"
            )
    if len({i.frame for i in options.interfaces}) > 1:
        raise ValueError("interfaces: expected the same frame for all, got both")
    if options.method != "joint":
        raise ValueError(
            f"interfaces: method {options.method!r} has no refraction; use method 'joint'"
        )
    stages = {frame.stage for camera in cameras for frame in camera.frames}
    if in_target_frame(options) and len(stages) != 1:
        raise CalibrationError(
            f"interface {names[0]!r} is stated in the target's frame, which moves: the pictures "
            f"have {len(stages)} stages; use one stage, or state the window in the first camera's "
            'frame (frame = "rig")'
        )


def in_target_frame(options: CalibrationOptions) -> bool:
    """Whether the windows, and with them the rig, are in the target's frame."""
    return any(i.frame == "target" for i in options.interfaces)


def apparent_target(
    camera: CameraFrames, target: PointSet, options: CalibrationOptions
) -> PointSet:
    """The target as it seems to lie to a camera behind its window, for start values.

    The target itself for a camera without one, and where its place behind the
    window is not known before the calibration (frame "rig").
    """
    for stated in options.interfaces:
        if stated.interface.name == camera.interface and stated.frame == "target":
            seen = apparent_points(stated.interface, target.position_mm)
            return replace(target, position_mm=seen)
    return target


def start_in_target_frame(rig: RigStart) -> RigStart:
    """The start of a single stage with the rig's frame moved to the target's."""
    ((stage, from_target),) = rig.rig_from_target.items()
    identity: Rigid = (np.eye(3), np.zeros(3))
    return replace(
        rig,
        cam_from_rig=[compose(pose, from_target) for pose in rig.cam_from_rig],
        rig_from_target={stage: identity},
        doubtful={},
    )


def check_sides(
    cameras: Sequence[CameraFrames], rig: RigStart, options: CalibrationOptions
) -> None:
    """CalibrationError if a camera starts behind its window."""
    stated = {i.interface.name: i.interface for i in options.interfaces}
    for camera, (rotation, shift) in zip(cameras, rig.cam_from_rig, strict=True):
        if camera.interface is None:
            continue
        window = stated[camera.interface]
        height_mm = -float(window.normal @ rotation.T @ shift) - window.distance_mm
        if not height_mm > 0:
            raise CalibrationError(
                f"camera {camera.name}: it stands {-height_mm:.0f} mm behind the face of the "
                f"interface {window.name!r} through which it looks; the normal must point to the "
                "cameras (turn the signs of normal and distance_mm round?) and distance_mm is "
                "normal . X of the face on their side, in the frame in which the window is stated"
            )


def add_interfaces(network: Network, interfaces: Sequence[CalibrationInterface]) -> dict[str, int]:
    """The windows in the network, by name."""
    return {
        i.interface.name: network.add_interface(i.interface, free=i.free, prior_sigma=i.prior_sigma)
        for i in interfaces
    }


def adjusted_interfaces(
    network: Network, windows: dict[str, int], index: IntArray, cov: FloatArray, sigma0: float
) -> dict[str, FlatInterface]:
    """The windows as adjusted, with their standard deviations.

    Parameters
    ----------
    index : (I, 3) places of the unknowns or -1; cov : of the orientation's unknowns.
    """
    found = {}
    for name, window in windows.items():
        sigma = {
            unknown: float(sigma0 * np.sqrt(cov[place, place]))
            for unknown, place in zip(
                ("tilt_1", "tilt_2", "distance"), index[window].tolist(), strict=True
            )
            if place >= 0
        }
        found[name] = replace(network.interface(window), sigma=sigma)
    return found
