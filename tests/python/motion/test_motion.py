"""Eqs. (10)-(12) on motions known in closed form, and their covariances by Monte Carlo."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from videogrammetry.motion import MotionOptions, compute_motion
from videogrammetry.types import Trajectories


def trajectories(position, *, sigma=0.1, rate=100.0, rig_sigma=0.0):
    stages, points = position.shape[:2]
    image = np.zeros((stages, points, 6))
    image[..., [0, 3, 5]] = sigma**2
    image[np.isnan(position[..., 0])] = np.nan
    total = image.copy()
    total[..., [0, 3, 5]] += rig_sigma**2
    return Trajectories(
        stage=np.arange(1, stages + 1, dtype=np.int32),
        time_s=np.arange(stages) / rate,
        point_id=np.arange(1, points + 1, dtype=np.int32),
        position_mm=position,
        cov_mm2=total,
        cov_image_mm2=image,
        cameras_used=np.ones((stages, points, 2), dtype=bool),
        rms_px=np.zeros((stages, points)),
        camera_names=("a", "b"),
    )


def falling(stages=20, points=5):
    time = np.arange(stages) / 100.0
    start = np.arange(points)[:, None] * np.array([10.0, 0.0, 0.0])
    drop = np.stack([0 * time, 9810 / 2 * time**2, 300 * time], axis=1)
    return start[None] + drop[:, None]


def test_free_fall_is_exact_for_central_differences():
    motion = compute_motion(trajectories(falling()))
    time = np.arange(20) / 100.0
    # Central differences of a parabola are its derivative, without error.
    np.testing.assert_allclose(motion.velocity_mm_s[1:-1, 2, 1], 9810 * time[1:-1], rtol=1e-9)
    np.testing.assert_allclose(motion.velocity_mm_s[1:-1, 2, 2], 300, rtol=1e-9)
    assert np.isnan(motion.velocity_mm_s[[0, -1]]).all()
    np.testing.assert_allclose(motion.displacement_mm[:, 3, 1], 9810 / 2 * time**2, atol=1e-9)
    np.testing.assert_allclose(
        motion.step_mm[:-1, 0, 1], np.diff(9810 / 2 * time**2), rtol=1e-9, atol=1e-9
    )
    assert np.isnan(motion.step_mm[-1]).all()
    np.testing.assert_allclose(motion.centroid_mm[:, 0], 20.0, rtol=1e-12)
    np.testing.assert_allclose(motion.centroid_velocity_mm_s[1:-1, 1], 9810 * time[1:-1])


def test_another_reference_stage():
    motion = compute_motion(trajectories(falling()), MotionOptions(reference_stage=5))
    assert (motion.displacement_mm[4] == 0).all()
    assert (motion.displacement_cov_mm2[4] == 0).all()
    assert (motion.displacement_mm[0, :, 1] < 0).all()
    with pytest.raises(ValueError, match="reference_stage 99"):
        compute_motion(trajectories(falling()), MotionOptions(reference_stage=99))


def test_a_lost_point_does_not_make_the_centroid_jump():
    position = falling()
    position[7:9, 4] = np.nan
    motion = compute_motion(trajectories(position))
    assert motion.centroid_points.tolist() == [1, 2, 3, 4]
    np.testing.assert_allclose(motion.centroid_mm[:, 0], 15.0, rtol=1e-12)


def test_no_point_at_every_stage():
    position = falling()
    for p in range(5):
        position[p * 3, p] = np.nan
    motion = compute_motion(trajectories(position))
    measured = np.isfinite(motion.centroid_mm[:, 0])
    assert len(motion.centroid_points) >= 3
    assert measured.sum() >= 15
    assert np.ptp(motion.centroid_mm[measured, 0]) < 1e-9
    motion = compute_motion(trajectories(position), MotionOptions(centroid_points=(2, 3)))
    assert motion.centroid_points.tolist() == [2, 3]
    with pytest.raises(ValueError, match=r"centroid_points: \[77\]"):
        compute_motion(trajectories(position), MotionOptions(centroid_points=(2, 77)))


# A variance from m samples scatters by sqrt(2/m) of itself; 5 sigma of that.
@pytest.mark.parametrize("seed", [1, 2])
def test_covariances_are_the_scatter(seed):
    rng = np.random.default_rng(seed)
    trials = 2000
    stages, points = 6, 8
    names = ("step", "displacement", "velocity", "centroid_displacement", "centroid_velocity")
    unit = {
        name: ("_mm_s", "_cov_mm2_s2") if "velocity" in name else ("_mm", "_cov_mm2")
        for name in names
    }
    samples = {name: [] for name in names}
    for _ in range(trials):
        noisy = falling(stages, points) + rng.normal(0, 0.1, (stages, points, 3))
        motion = compute_motion(trajectories(noisy))
        for name in names:
            samples[name].append(getattr(motion, name + unit[name][0])[3])
    for name in names:
        predicted = getattr(motion, name + unit[name][1])[3][..., 0]
        scatter = np.var(np.array(samples[name])[..., 0], axis=0)
        np.testing.assert_allclose(scatter / predicted, 1.0, atol=5 * np.sqrt(2 / trials))


def test_calibration_does_not_average_out_of_the_centroid():
    motion = compute_motion(trajectories(falling(4, 100), sigma=0.1, rig_sigma=0.2))
    np.testing.assert_allclose(motion.centroid_cov_mm2[:, 0], 0.1**2 / 100 + 0.2**2)
    np.testing.assert_allclose(motion.centroid_displacement_cov_mm2[1:, 0], 2 * 0.1**2 / 100)


def test_without_a_frame_rate_there_is_no_velocity():
    table = trajectories(falling())
    without = Trajectories(**{**table.__dict__, "time_s": np.full(20, np.nan)})
    motion = compute_motion(without)
    assert np.isnan(motion.velocity_mm_s).all()
    assert np.isfinite(motion.displacement_mm).all()


def test_flagged_positions_take_no_part() -> None:
    table = trajectories(falling())
    flags = np.zeros((20, 5), np.uint8)
    flags[7, 2] = 2 + 4  # large_residual, outside_volume
    flags[9, 3] = 1  # two_rays: not asked for
    table = dataclasses.replace(table, flags=flags)
    motion = compute_motion(table, MotionOptions(leave_out=("outside_volume", "large_residual")))
    assert np.isnan(motion.displacement_mm[7, 2]).all()
    assert np.isnan(motion.velocity_mm_s[[6, 8], 2]).all()
    assert np.isfinite(motion.displacement_mm[9, 3]).all()
    assert motion.centroid_points.tolist() == [1, 2, 4, 5]
    assert np.isfinite(table.position_mm).all()
    with pytest.raises(ValueError, match="leave_out: 'odd' is none of two_rays"):
        compute_motion(table, MotionOptions(leave_out=("odd",)))
