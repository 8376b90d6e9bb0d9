"""Options of the joint calibration: late cameras, bars on the target, its full covariance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from videogrammetry.calibration import CalibrationOptions, CameraFrames, FrameTargets, calibrate
from videogrammetry.calibration.run import KnownLength
from videogrammetry.errors import CalibrationError
from videogrammetry.geometry import project, rotation_from_vector, rotation_looking_at
from videogrammetry.types import PointSet, RigCamera, cov6_from_matrix

SIZE, NOISE_PX, TARGET_MM = (1280, 1024), 0.02, 0.02
FREE = ("f", "x0", "y0", "A1")
COUNT = 40


def cameras():
    found = {}
    for k, azimuth in enumerate((-0.3, 0.3)):
        stand = 3000.0 * np.array([np.sin(azimuth), 0.0, -np.cos(azimuth)])
        rotation = rotation_looking_at(stand, np.zeros(3))
        found[f"c{k}"] = RigCamera(
            image_size_px=SIZE, interior=np.r_[2000.0, 4.0, -6.0, -2e-8, np.zeros(6)],
            r0_px=540.0, rotation=rotation, translation_mm=-rotation @ stand,
        )  # fmt: skip
    return found


def target_points(seed=0):
    return np.random.default_rng(seed).uniform(-0.5, 0.5, (COUNT, 3)) * [800.0, 700.0, 150.0]


def swung(time):
    """Rotation and place of a target that a hand swings smoothly."""
    turn = 0.5 * np.sin(0.21 * time + np.array([0.0, 1.0, 2.0]))
    place = 150.0 * np.sin(0.17 * time + np.array([0.5, 2.0, 4.0]))
    return rotation_from_vector(turn), place


def frames(rng, late=(0.0, 0.0), stages=30):
    points = target_points()
    result = []
    for (name, camera), delay in zip(cameras().items(), late, strict=True):
        own = []
        for stage in range(1, stages + 1):
            rotation, place = swung(stage + delay)
            in_world = points @ rotation.T + place
            xy = project(camera, in_world @ camera.rotation.T + camera.translation_mm)
            xy += rng.normal(0, NOISE_PX, xy.shape)
            own.append(
                FrameTargets(
                    stage=stage, image=f"{name}_{stage}", id=np.arange(COUNT), xy_px=xy,
                    cov_px2=np.tile([NOISE_PX**2, 0, NOISE_PX**2], (COUNT, 1)),
                )
            )  # fmt: skip
        result.append(CameraFrames(name=name, image_size_px=SIZE, frames=own, free=FREE))
    return result


def measured_target(rng, scale=1.0, cov=None):
    position = scale * target_points() + rng.normal(0, TARGET_MM, (COUNT, 3))
    blocks = np.tile(np.eye(3) * TARGET_MM**2, (COUNT, 1, 1))
    return PointSet(
        id=np.arange(COUNT, dtype=np.int32), position_mm=position,
        cov_mm2=cov6_from_matrix(blocks), full_cov_mm2=cov,
    )  # fmt: skip


def baseline(run):
    return float(np.linalg.norm(run.rig.cameras["c1"].centre_mm))


TRUE_BASELINE = 2 * 3000.0 * np.sin(0.3)


def test_a_late_camera_is_found_and_an_unknown_delay_spoils_the_fit():
    rng = np.random.default_rng(1)
    late = frames(rng, late=(0.0, 0.2))
    target = measured_target(rng)
    blind = calibrate(late, target, CalibrationOptions(critical_value=0.0))
    run = calibrate(late, target, CalibrationOptions(time_offset=True))
    found = run.rig.how["time_offset_stages"]["c1"]
    sigma = run.rig.how["sigma_time_offset_stages"]["c1"]
    # Pictures move by some 40 px a stage; what their differences leave out of the motion's
    # bend is a few thousandths of a stage.
    assert found == pytest.approx(0.2, abs=0.005 + 4 * sigma)
    assert run.rig.how["time_offset_stages"]["c0"] == 0.0
    assert run.rms_px < 0.5 * blind.rms_px
    assert abs(baseline(run) - TRUE_BASELINE) < 1.0


def test_cameras_in_time_have_no_significant_offset():
    rng = np.random.default_rng(2)
    run = calibrate(frames(rng), measured_target(rng), CalibrationOptions(time_offset=True))
    found = run.rig.how["time_offset_stages"]["c1"]
    assert abs(found) < 4 * run.rig.how["sigma_time_offset_stages"]["c1"]


def test_a_bar_on_the_target_gives_the_scale():
    rng = np.random.default_rng(3)
    pictures = frames(rng)
    target = measured_target(rng, scale=1.001)  # a ruler that is wrong by a thousandth
    points = target_points()
    a, b = 0, int(np.argmax(np.linalg.norm(points - points[0], axis=1)))
    bar = KnownLength(
        point_a=a, point_b=b, length_mm=float(np.linalg.norm(points[a] - points[b])),
        sigma_mm=0.005,
    )  # fmt: skip
    # The table's coordinates are known to no better than its scale.
    loose = CalibrationOptions(sigma_mm=1.0)
    without = calibrate(pictures, target, loose)
    with_bar = calibrate(pictures, target, replace(loose, lengths=(bar,)))
    bars, at = with_bar.bars, with_bar.target.position_mm
    stated = float(np.linalg.norm(at[bars.point_a[0]] - at[bars.point_b[0]]))
    assert bars.length_mm[0] - bars.residual_mm[0] == pytest.approx(stated, abs=1e-6)
    assert abs(baseline(without) / TRUE_BASELINE - 1) > 5e-4
    assert baseline(with_bar) == pytest.approx(TRUE_BASELINE, rel=1e-4)


def test_a_bar_beside_the_target_is_refused():
    rng = np.random.default_rng(4)
    bar = KnownLength(point_a=0, point_b=999, length_mm=1.0, sigma_mm=0.1)
    with pytest.raises(CalibrationError, match=r"bar 0-999 ends in point 999"):
        calibrate(frames(rng), measured_target(rng), CalibrationOptions(lengths=(bar,)))


def test_correlations_of_the_target_count():
    rng = np.random.default_rng(5)
    pictures = frames(rng)
    points = target_points()
    # All coordinates share one scale of 1e-4: as single variances it would average out.
    common = 1e-4 * points.ravel()
    full = np.eye(3 * COUNT) * TARGET_MM**2 + np.outer(common, common)
    blocks = np.array([full[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] for i in range(COUNT)])
    target = replace(measured_target(rng), cov_mm2=cov6_from_matrix(blocks))
    alone = calibrate(pictures, target, CalibrationOptions())
    joint = calibrate(pictures, replace(target, full_cov_mm2=full), CalibrationOptions())

    def sigma_of_baseline(run):
        camera = run.rig.cameras["c1"]
        names = [f"c1/{p}" for p in ("rx", "ry", "rz", "tx", "ty", "tz")]
        rows = [run.rig.cov_names.index(n) for n in names]
        way = camera.translation_mm / np.linalg.norm(camera.translation_mm)
        cov = run.rig.cov[np.ix_(rows, rows)][3:, 3:]
        return float(np.sqrt(way @ cov @ way))

    # As variances of single coordinates the scale averages out; what it adds as one number
    # is 1e-4 of the baseline (a part of it the single variances still hold: a tenth).
    added = np.sqrt(sigma_of_baseline(joint) ** 2 - sigma_of_baseline(alone) ** 2)
    assert added == pytest.approx(1e-4 * TRUE_BASELINE, rel=0.1)
