"""A moved camera's pose by the rays of the others: its error and what it says of that."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from moving_camera import SIGMA_PX, body, calibrated, pictures, ring_rig, turned

from videogrammetry.errors import CalibrationError
from videogrammetry.geometry import CAMERA_PARAMETERS, vector_from_rotation
from videogrammetry.reconstruction.reorientation import reorient_by_rays

TURN, SHIFT = (3e-4, -5e-4, 2e-4), (0.4, -0.2, 0.1)


def seen(rig, rng, points=30):
    xy = pictures(rig, body(rng, points, 1)[0], rng)
    return xy, np.full(xy.shape, SIGMA_PX**2)


def test_the_truth_lies_within_its_standard_deviations() -> None:
    rng = np.random.default_rng(0)
    draws, of_pose, of_all = 120, [], []
    for _ in range(draws):
        truth = ring_rig(4, rng, sigma=0.5)
        rig = calibrated(truth, rng)
        after = turned(truth, 1, TURN, SHIFT)
        found = reorient_by_rays(rig, "c2", *seen(after, rng))
        new, true = found.rig.cameras["c2"], after.cameras["c2"]
        error = np.concatenate(
            [vector_from_rotation(new.rotation @ true.rotation.T), new.centre_mm - true.centre_mm]
        )
        of_pose.append(error @ np.linalg.solve(found.cov, error))
        of_all.append(_chi2_of_all(found.rig, after))
    # The means of chi-square with 6 and with 40 degrees of freedom: four times their error.
    assert np.mean(of_pose) == pytest.approx(6, abs=4 * np.sqrt(12 / draws))
    assert np.mean(of_all) == pytest.approx(40, abs=4 * np.sqrt(80 / draws))


def _chi2_of_all(rig, truth) -> float:
    """Of all parameters that have an error: the new pose's covariance with the others too."""
    error = []
    for name, camera in rig.cameras.items():
        true = truth.cameras[name]
        error += [
            camera.interior - true.interior,
            vector_from_rotation(camera.rotation @ true.rotation.T),
            camera.translation_mm - true.translation_mm,
        ]
    vector = np.concatenate(error)
    sigma = np.sqrt(np.diag(rig.cov))
    free = sigma > 0
    assert free.sum() == 40
    standard = vector[free] / sigma[free]
    correlation = rig.cov[np.ix_(free, free)] / np.outer(sigma[free], sigma[free])
    return float(standard @ np.linalg.solve(correlation, standard))


def test_points_that_are_something_else_are_left_out() -> None:
    rng = np.random.default_rng(1)
    truth = ring_rig(4, rng)
    xy, variance = seen(turned(truth, 1, TURN), rng)
    xy[4, 1] += 8.0
    found = reorient_by_rays(truth, "c2", xy, variance)
    assert not found.used[4]
    assert found.used.sum() == 29
    assert found.significance > 20
    assert found.rms_px < 1.5 * SIGMA_PX
    np.testing.assert_allclose(found.turn_rad, TURN, atol=5 * np.sqrt(found.cov[0, 0]) + 1e-4)


def test_what_stays_in_all_pictures_of_a_target_is_not_averaged() -> None:
    rng = np.random.default_rng(2)
    truth = dataclasses.replace(ring_rig(4, rng), cov=None, cov_names=())
    xy, variance = seen(truth, rng)
    share = np.full(xy.shape[:2], 0.5)
    once = reorient_by_rays(truth, "c1", xy, variance, share, 1.0)
    often = reorient_by_rays(truth, "c1", xy, variance, share, 9.0)
    np.testing.assert_allclose(often.cov, 5.0 * once.cov)
    assert often.rig.cov is None
    assert set(CAMERA_PARAMETERS[-6:]) <= set(often.rig.cameras["c1"].sigma)


def test_two_other_cameras_are_needed() -> None:
    rng = np.random.default_rng(3)
    rig = ring_rig(2, rng)
    with pytest.raises(CalibrationError, match=r"camera c1: 0 points that it and two other"):
        reorient_by_rays(rig, "c1", *seen(rig, rng))
    with pytest.raises(ValueError, match=r"camera 'x' is not in the rig, which has c1, c2"):
        reorient_by_rays(rig, "x", *seen(rig, rng))
