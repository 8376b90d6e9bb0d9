"""A camera's new pose from points that stand still."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from videogrammetry.calibration.reorient import reorient_camera
from videogrammetry.errors import CalibrationError
from videogrammetry.geometry import (
    CAMERA_PARAMETERS,
    project,
    rotation_from_vector,
    vector_from_rotation,
)
from videogrammetry.types import RigCamera, RigData

SIGMA_PX, SIGMA_MM = 0.02, 0.05


def still_points(count=40, seed=0):
    rng = np.random.default_rng(seed)
    return rng.uniform([-800, -600, 4000], [800, 600, 6000], (count, 3))


def camera(turn=(0.0, 0.0, 0.0), shift=(0.0, 0.0, 0.0)):
    return RigCamera(
        image_size_px=(1024, 1024), interior=np.r_[2600.0, 3.0, -5.0, -2e-8, np.zeros(6)],
        r0_px=480.0, rotation=rotation_from_vector(np.array(turn)),
        translation_mm=np.array(shift),
    )  # fmt: skip


def rig_of(cam, interior_sigma=0.0):
    n = len(CAMERA_PARAMETERS)
    cov = np.zeros((2 * n, 2 * n))
    for c in range(2):
        cov[c * n, c * n] = (400.0 * interior_sigma) ** 2  # f
        cov[c * n + 1, c * n + 1] = (100.0 * interior_sigma) ** 2  # x0
    names = tuple(f"{c}/{p}" for c in ("a", "b") for p in CAMERA_PARAMETERS)
    return RigData(cameras={"a": camera(), "b": cam}, cov=cov, cov_names=names)


def pictures(cam, points, rng, interior=None):
    lens = cam if interior is None else replace(cam, interior=interior)
    xy = project(lens, points @ cam.rotation.T + cam.translation_mm)
    return xy + rng.normal(0, SIGMA_PX, xy.shape)


def arguments(count):
    cov = np.tile(np.eye(3) * SIGMA_MM**2, (count, 1, 1))
    return cov, np.tile([SIGMA_PX**2, 0.0, SIGMA_PX**2], (count, 1))


def test_a_turned_camera_is_found_with_its_significance_and_moved_points_are_left_out():
    points, rng = still_points(), np.random.default_rng(1)
    old, new = camera(), camera((1e-4, -2e-4, 0.0), (0.2, 0.0, -0.1))
    xy = pictures(new, points, rng)
    xy[3] += 5.0  # a point that was knocked
    xy[7] = np.nan
    cov, cov_px2 = arguments(len(points))
    found = reorient_camera(rig_of(old), "b", points, cov, xy, cov_px2)
    assert not found.used[[3, 7]].any()
    assert found.used.sum() == 38
    # 0.1 mrad at f = 2600 px is 0.26 px: far beyond 0.02 px over 38 points.
    assert found.significance > 5
    error = vector_from_rotation(found.rig.cameras["b"].rotation @ new.rotation.T)
    assert (np.abs(error) < 5 * np.sqrt(np.diag(found.cov)[:3])).all()
    assert found.rms_px < 3 * SIGMA_PX


def test_a_camera_that_stood_still_is_not_significantly_moved():
    points, rng = still_points(), np.random.default_rng(2)
    cov, cov_px2 = arguments(len(points))
    found = reorient_camera(
        rig_of(camera()), "b", points, cov, pictures(camera(), points, rng), cov_px2
    )
    # sqrt of chi-square with 6 degrees of freedom: 5.0 is beyond 99.9 %.
    assert found.significance < 5.0


@pytest.mark.parametrize("interior_sigma", [0.0, 0.02])
def test_the_covariance_is_the_scatter_of_many_resections(interior_sigma):
    points, rng = still_points(30), np.random.default_rng(3)
    new = camera((3e-4, 0.0, 1e-4), (0.5, 0.0, 0.0))
    rig = rig_of(camera(), interior_sigma)
    cov, cov_px2 = arguments(len(points))
    errors, last = [], None
    for _ in range(150):
        # The calibration took the interior for what it says; the truth scatters about it.
        true = new.interior + np.r_[
            rng.normal(0, 400.0 * interior_sigma), rng.normal(0, 100.0 * interior_sigma),
            np.zeros(8),
        ]  # fmt: skip
        xy = pictures(new, points + rng.normal(0, SIGMA_MM, points.shape), rng, true)
        last = reorient_camera(rig, "b", points, cov, xy, cov_px2, critical_value=0.0)
        pose = last.rig.cameras["b"]
        errors.append(
            np.concatenate(
                [vector_from_rotation(pose.rotation @ new.rotation.T),
                 pose.translation_mm - new.translation_mm]
            )
        )  # fmt: skip
    scatter = np.std(errors, axis=0)
    # A standard deviation of 150 draws is good to 1 / sqrt(300) = 6 %: four of these.
    np.testing.assert_allclose(scatter, np.sqrt(np.diag(last.cov)), rtol=0.24)


def test_the_rigs_covariance_is_carried_on():
    points, rng = still_points(), np.random.default_rng(4)
    rig = rig_of(camera(), 0.02)
    cov, cov_px2 = arguments(len(points))
    found = reorient_camera(rig, "b", points, cov, pictures(camera(), points, rng), cov_px2)
    n = len(CAMERA_PARAMETERS)
    np.testing.assert_allclose(found.rig.cov[n + 10 :, n + 10 :], found.cov)
    assert np.abs(found.rig.cov[n, n + 10 :]).max() > 0  # f and pose belong together
    assert np.linalg.eigvalsh(found.rig.cov / found.rig.cov.max()).min() > -1e-9


def test_too_few_points_and_unknown_cameras_are_refused():
    points, rng = still_points(3), np.random.default_rng(5)
    cov, cov_px2 = arguments(3)
    xy = pictures(camera(), points, rng)
    with pytest.raises(CalibrationError, match=r"camera b: 3 points of known place"):
        reorient_camera(rig_of(camera()), "b", points, cov, xy, cov_px2)
    with pytest.raises(ValueError, match=r"camera 'c' is not in the rig, which has a, b"):
        reorient_camera(rig_of(camera()), "c", points, cov, xy, cov_px2)
