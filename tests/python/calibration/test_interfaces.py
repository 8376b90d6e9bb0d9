"""Calibration of cameras that look into a tank, against simulated truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from tanks import SIZE, WINDOW, block_points, pictures, tank_cameras

from videogrammetry.calibration import (
    CalibrationInterface,
    CalibrationOptions,
    CameraFrames,
    FrameTargets,
    calibrate,
)
from videogrammetry.errors import CalibrationError
from videogrammetry.geometry import rotation_from_vector
from videogrammetry.reconstruction import Rig
from videogrammetry.types import FlatInterface, FloatArray, PointSet

SIGMA_PX, SIGMA_MM = 0.05, 0.02
FREE = ("f", "x0", "y0", "A1")


def frames_of(
    stages: Sequence[FloatArray], rng: np.random.Generator, interface: str | None = "window"
) -> list[CameraFrames]:
    """What the tank's cameras see of points at some stages, (N, 3) each, in their frame."""
    cameras = tank_cameras()
    seen = [pictures(cameras, points) for points in stages]
    return [
        CameraFrames(
            name=name,
            image_size_px=SIZE,
            free=FREE,
            interface=interface,
            r0_px=500.0,
            frames=[
                FrameTargets(
                    stage=s + 1,
                    image=f"{name}-{s + 1}",
                    id=np.arange(1, len(xy[name]) + 1, dtype=np.int32),
                    xy_px=xy[name] + rng.normal(0, SIGMA_PX, xy[name].shape),
                    cov_px2=np.tile([SIGMA_PX**2, 0, SIGMA_PX**2], (len(xy[name]), 1)),
                )
                for s, xy in enumerate(seen)
            ],
        )
        for name in cameras
    ]


def block(rng: np.random.Generator) -> PointSet:
    """The block as it was measured."""
    points = block_points()
    return PointSet(
        id=np.arange(1, len(points) + 1, dtype=np.int32),
        position_mm=points + rng.normal(0, SIGMA_MM, points.shape),
    )


def options(window: FlatInterface, *free: str, frame: str = "target") -> CalibrationOptions:
    stated = CalibrationInterface(interface=window, free=free, frame=frame)
    return CalibrationOptions(sigma_mm=SIGMA_MM, interfaces=(stated,))


def rough() -> FlatInterface:
    """The window as somebody with a ruler would state it."""
    return replace(WINDOW, normal=np.array([0.0, 0.0, 1.0]), distance_mm=104.0)


def test_truth_lies_within_the_standard_deviations() -> None:
    """The mean of chi-square with U degrees of freedom over m draws is U +- sqrt(2 U / m)."""
    rng = np.random.default_rng(8)
    truth = tank_cameras()
    draws = 20
    window_squares, camera_squares, count = 0.0, 0.0, 0
    for _ in range(draws):
        run = calibrate(
            frames_of([block_points()], rng), block(rng), options(rough(), "normal", "distance")
        )
        assert run.rig.reference == "target"
        found = run.rig.cameras["c0"].interface
        assert found is not None
        # tilt_1 turns the normal (0, 0, 1) towards x, tilt_2 towards y.
        error = np.array([*found.normal[:2] / found.normal[2], found.distance_mm - 100.0])
        sigma = np.array([found.sigma[n] for n in ("tilt_1", "tilt_2", "distance")])
        window_squares += float(np.sum((error / sigma) ** 2))
        for name, camera in run.rig.cameras.items():
            other = truth[name]
            moved = [
                *(camera.interior - other.interior)[[0, 1, 2, 3]],
                *(camera.translation_mm - other.translation_mm),
            ]
            names = (*FREE, "tx", "ty", "tz")
            # Their covariance is that given the window: nothing is freer than this.
            sigmas = np.array([camera.sigma[n] for n in names])
            assert (sigmas > 0).all()
            camera_squares += float(np.sum((np.array(moved) / sigmas) ** 2))
            count += len(names)
    # Three correlated squares: their mean is 3, its scatter below sqrt(2) * 3 a draw.
    assert abs(window_squares / draws - 3.0) < 4.5 * 3.0 * np.sqrt(2.0 / draws)
    # Without the window's part the cameras' errors are larger than stated, never smaller.
    assert camera_squares / count > 0.8


def test_a_held_window_gives_right_covariances() -> None:
    rng = np.random.default_rng(9)
    points = np.random.default_rng(1).uniform([-40, -30, -50], [40, 30, -5], (5, 3))
    draws, squares = 25, []
    for _ in range(draws):
        run = calibrate(frames_of([block_points()], rng), block(rng), options(WINDOW))
        rig = Rig.from_data(run.rig)
        seen = pictures(tank_cameras(), points)
        noisy = {n: xy + rng.normal(0, SIGMA_PX, xy.shape) for n, xy in seen.items()}
        # The rig's frame is the target's: errors are in the axes that "rig" states.
        found = rig.intersect(noisy, SIGMA_PX, frame="rig")
        error = found.position_mm - points
        squares.append(np.einsum("ni,nij,nj->n", error, np.linalg.inv(found.cov_mm2), error))
    # The five points share the calibration's error: at worst they count as one a draw.
    assert abs(np.mean(squares) - 3.0) < 4.5 * np.sqrt(6.0 / draws)


def test_refraction_is_what_brings_the_accuracy() -> None:
    rng = np.random.default_rng(10)
    points, target = block_points(), block(rng)
    frames = frames_of([points], rng)
    run = calibrate(frames, target, options(rough(), "normal", "distance"))
    plain = calibrate(
        [replace(f, interface=None) for f in frames], target, CalibrationOptions(sigma_mm=SIGMA_MM)
    )
    assert run.rms_px < 1.2 * SIGMA_PX
    # No 2-D distortion stands for refraction at several depths.
    assert plain.rms_px > 5 * run.rms_px
    rig = Rig.from_data(run.rig)
    position, cov = rig.triangulate(pictures(tank_cameras(), points), SIGMA_PX)
    sigma = np.sqrt(np.trace(cov, axis1=1, axis2=2).mean())
    assert np.sqrt(((position - points) ** 2).sum(axis=1).mean()) < 3 * sigma
    assert sigma < 0.05


def test_several_stages_with_the_window_in_the_first_cameras_frame() -> None:
    rng = np.random.default_rng(11)
    target = block(rng)
    true = block_points()
    stages = [
        (true - [0, 0, 30]) @ rotation_from_vector(np.array(v)).T + [*shift, -30.0]
        for v, shift in (
            ([0.0, 0, 0], (0, 0)), ([0.3, 0.1, 0], (15, 0)), ([-0.2, 0.3, 0.2], (-10, 10)),
            ([0.1, -0.35, 0], (0, -12)), ([-0.3, -0.2, 0.4], (5, 5)),
        )
    ]  # fmt: skip
    first = tank_cameras()["c0"]
    normal = first.rotation @ WINDOW.normal
    distance = WINDOW.distance_mm + float(normal @ first.translation_mm)
    in_rig = replace(
        WINDOW,
        normal=rotation_from_vector(np.array([0.01, -0.01, 0])) @ normal,
        distance_mm=distance + 5.0,
    )
    run = calibrate(
        frames_of(stages, rng), target, options(in_rig, "normal", "distance", frame="rig")
    )
    assert run.rig.reference == "camera c0"
    found = run.rig.cameras["c3"].interface
    assert found is not None
    assert run.rms_px < 1.2 * SIGMA_PX
    assert abs(found.distance_mm - distance) < 4.5 * found.sigma["distance"]
    turned = np.arccos(min(1.0, float(found.normal @ normal)))
    assert turned < 4.5 * max(found.sigma["tilt_1"], found.sigma["tilt_2"])


def test_what_cannot_be_calibrated_says_why() -> None:
    rng = np.random.default_rng(12)
    target, points = block(rng), block_points()
    frames = frames_of([points], rng)
    turned = replace(WINDOW, normal=np.array([0.0, 0, -1]), distance_mm=-100.0)
    with pytest.raises(CalibrationError, match="behind the face of the interface 'window'"):
        calibrate(frames, target, options(turned))
    with pytest.raises(CalibrationError, match="2 stages"):
        calibrate(frames_of([points, points + 1.0], rng), target, options(WINDOW))
    with pytest.raises(ValueError, match="'window' is not among"):
        calibrate(frames, target, CalibrationOptions())
    with pytest.raises(ValueError, match="no refraction"):
        calibrate(frames, target, replace(options(WINDOW), method="mean"))
    with pytest.raises(ValueError, match="expected frame rig or target"):
        calibrate(frames, target, options(WINDOW, frame="world"))
    with pytest.raises(ValueError, match="expected names of tilt_1"):
        calibrate(frames, target, options(WINDOW, "depth"))
    with pytest.raises(ValueError, match="unit length"):
        calibrate(frames, target, options(replace(WINDOW, normal=np.array([0.0, 0, 3]))))
