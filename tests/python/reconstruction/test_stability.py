"""Whether a camera that moves is found, and one that stands is not."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from moving_camera import (
    body,
    calibrated,
    intersected,
    pictures,
    residuals_of,
    ring_rig,
    turned,
    watched,
)
from scipy.stats import chi2 as chi2_distribution

from videogrammetry.geometry import project_from_world_with_jacobians
from videogrammetry.reconstruction import Triangulator
from videogrammetry.reconstruction.camera_scores import (
    calibration_factor,
    camera_scores,
)
from videogrammetry.reconstruction.stability import critical_chi2

AXES = {"x": (1e-4, 0, 0), "y": (0, 1e-4, 0), "roll": (0, 0, 1e-4)}


@pytest.mark.parametrize("camera", range(4))
@pytest.mark.parametrize("axis", AXES)
def test_a_tenth_of_a_milliradian_is_found_within_twenty_stages(camera, axis) -> None:
    watch = watched(camera, at=500, camera=camera, turn_rad=AXES[axis])
    assert len(watch.changes) == 1
    change = watch.changes[0]
    assert change.cameras == (camera,)
    assert change.since == "sequence"
    assert change.after < 500 <= change.stage
    assert change.found <= 520
    off = (change.turn_rad - AXES[axis]) / change.sigma_turn_rad
    assert np.abs(off).max() < 4.5


@pytest.mark.parametrize("stage", [491, 492, 500, 501, 502])
def test_the_delay_holds_for_any_stage_between_two_looks(stage) -> None:
    (change,) = watched(3, at=stage, camera=2).changes
    assert change.cameras == (2,)
    assert change.after < stage <= change.stage
    assert change.found - stage <= 20


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "sigma"), [(0, 0.02), (1, 0.2), (2, 1.0), (3, 1.0)])
def test_ten_thousand_quiet_stages_say_nothing(seed, sigma) -> None:
    # The level is 1e-3 for a sequence; the object swings and bends by 50 mm.
    assert watched(seed, stages=10_000, sigma=sigma).changes == []


def test_while_nothing_moves_the_test_is_chi_square() -> None:
    series = watched(5, stages=6000, sigma=0.0, covariance=False).series()
    # Windows of 16 looks, at every fourth: every fourth of these is independent; the first 40
    # looks and one window more lack a full reference.
    value = series.chi2[14::4].ravel()
    # Of the mean of n values with variance 12; the four cameras' are correlated: count one.
    assert value.mean() == pytest.approx(6, abs=4 * np.sqrt(12 / (len(value) / 4)))
    assert (value > chi2_distribution.isf(0.01, 6)).mean() < 0.05


def test_a_step_too_small_for_two_looks_is_found_by_their_sum() -> None:
    (change,) = watched(
        1, at=2001, stages=4000, camera=0, turn_rad=(5e-6, 0, 0), sigma=0.02
    ).changes
    assert change.cameras == (0,)
    assert change.found <= 2001 + 400


def test_of_two_cameras_both_are_named() -> None:
    (change,) = watched(2, cameras=2, at=500, camera=1).changes
    assert set(change.cameras) == {0, 1}
    assert change.found <= 520


@pytest.mark.parametrize("cameras", [2, 4])
def test_without_a_covariance_the_first_stages_are_the_measure(cameras) -> None:
    quiet = watched(7, cameras=cameras, stages=2000, covariance=False, sigma=0.2)
    assert quiet.changes == []
    (change,) = watched(7, cameras=cameras, at=500, covariance=False).changes
    assert 1 in change.cameras
    assert change.found <= 520


def test_a_deforming_object_is_no_moving_camera() -> None:
    # Bent by ten times as much, a tenth of the volume's width.
    assert watched(4, stages=2000, bend_mm=100.0, swing_mm=100.0, sigma=0.5).changes == []


def test_a_camera_that_stood_otherwise_from_the_start_is_found_against_the_calibration() -> None:
    (change,) = watched(6, at=1, camera=2, turn_rad=(5e-4, 0, 0)).changes
    assert change.since == "calibration"
    assert change.cameras[0] == 2
    assert change.stage == 1


def test_two_cameras_one_after_the_other() -> None:
    def second(stage, xy):
        if stage >= 701:
            xy[:, 3] += [0.1, 0.25]

    watch = watched(8, at=301, camera=0, spoil=second)
    assert [change.cameras for change in watch.changes] == [(0,), (3,)]
    assert [change.stage for change in watch.changes] == [301, 701]


def test_one_wrong_point_is_no_moving_camera() -> None:
    def wrong(stage, xy):
        if stage == 501:
            xy[0, 1] += [3.0, 2.0]

    assert watched(9, spoil=wrong).changes == []


def test_scores_have_the_covariance_that_they_state() -> None:
    rng = np.random.default_rng(0)
    truth = ring_rig(3, rng)
    position = body(rng, 30, 1)[0]
    draws, g = 400, []
    for _ in range(draws):
        rig = calibrated(truth, rng)
        place, residual = intersected(Triangulator(rig), pictures(truth, position, rng))
        scores = camera_scores(rig, residuals_of(place, residual), 1, calibration_factor(rig))
        g.append(scores.score[0])
    stated = scores.normal[0] + scores.by_calibration[0] @ scores.by_calibration[0].T
    spread = np.std(g, axis=0) / np.sqrt(np.diag(stated))
    # Good to 1 / sqrt(2 draws) = 3.5 %, of 18 numbers: four of these.
    np.testing.assert_allclose(spread, 1.0, atol=0.14)
    # As a whole: g' cov^-1 g is chi-square; seven of its directions are free motions of all
    # cameras, of which nothing is known.
    value, vector = np.linalg.eigh(stated / np.sqrt(np.outer(*2 * [np.diag(stated)])))
    kept = value > 1e-9
    white = (np.array(g) / np.sqrt(np.diag(stated))) @ vector[:, kept] / np.sqrt(value[kept])
    mean = (white**2).sum(axis=1).mean() / kept.sum()
    assert mean == pytest.approx(1, abs=4 * np.sqrt(2 / (draws * kept.sum())))


def test_the_factor_does_to_pictures_what_the_covariance_does() -> None:
    rng = np.random.default_rng(2)
    rig = ring_rig(2, rng)
    free = np.diag(rig.cov) > 0  # A2, A3 and others are held
    mix = rng.normal(size=(free.sum(), free.sum()))
    sigma = np.sqrt(np.diag(rig.cov)[free])
    cov = np.zeros_like(rig.cov)
    cov[np.ix_(free, free)] = mix @ mix.T * np.outer(sigma, sigma)
    rig = dataclasses.replace(rig, cov=cov)
    factor = calibration_factor(rig)[:16]
    position = rng.uniform(-400, 400, (20, 3))
    _, _, by_camera = project_from_world_with_jacobians(rig.cameras["c1"], position)
    np.testing.assert_allclose(
        np.square(by_camera @ factor).sum(axis=2),
        np.einsum("nij,jk,nik->ni", by_camera, cov[:16, :16], by_camera),
        rtol=1e-6,
    )


def test_the_scores_expect_what_a_motion_does() -> None:
    rng = np.random.default_rng(1)
    rig = ring_rig(4, rng)
    motion = np.array([2e-5, -1e-5, 3e-5, 0.02, -0.01, 0.03])
    after = turned(rig, 2, motion[:3], motion[3:])
    place, residual = intersected(
        Triangulator(rig), pictures(after, body(rng, 40, 1)[0], rng, sigma_px=0.0)
    )
    scores = camera_scores(rig, residuals_of(place, residual), 1)
    expected = scores.normal[0, :, 12:18] @ motion
    np.testing.assert_allclose(
        scores.score[0], expected, rtol=0, atol=2e-3 * np.abs(expected).max()
    )


def test_the_critical_value_is_that_of_chi_square() -> None:
    for level in (0.05, 1e-6, 1e-11):
        assert critical_chi2(level) == pytest.approx(chi2_distribution.isf(level, 6), rel=1e-9)
