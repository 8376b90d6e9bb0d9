"""Free falls: the paper's line, and the fit with its sigma by Monte Carlo."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from two_pairs import PAIRS, calibrated, falling, measure, two_pair_rig

from videogrammetry.accuracy import (
    CalibrationPart,
    FreeFallOptions,
    check_free_fall,
    fall_regression,
)
from videogrammetry.accuracy.fall_model import drag_path


def check(scene, first=1, last=60, options=None, **more):
    return check_free_fall(scene.table, first, last, CalibrationPart(scene.rig), options, **more)


def test_the_papers_line():
    """Measured falls 1.85 % short of g t^2 / 2 give its slope of 1.0188 (not 1.88 % short)."""
    time = np.arange(100) / 500
    y = -500 * 9.80665 * time**2
    slope, offset, _, rms = fall_regression((y - 0.9643) / 1.0188, time)
    assert (slope, offset) == pytest.approx((1.0188, 0.9643))
    assert rms < 1e-9
    assert (1 - 1 / slope) * 100 == pytest.approx(1.845, abs=0.001)


# Sigma is right: the squared deviation over m draws is 1 +- sqrt(2/m); the bias is that of a mean
# of m. The calibration is drawn anew each time, a fifth of the positions is missing.
@pytest.mark.slow
@pytest.mark.parametrize("lost", [0.0, 0.2])
def test_deviations_are_as_predicted(lost):
    draws = 120
    fits = []
    for seed in range(draws):
        fits.append(check(falling(seed, stages=40, lost=lost), last=40).fit)
    deviation = np.array([f.deviation_sigmas for f in fits])
    assert (deviation**2).mean() == pytest.approx(1, abs=4 * np.sqrt(2 / draws))
    assert abs(deviation.mean()) < 4 / np.sqrt(draws)
    # Some 4 000 coordinates: each sigma0 scatters by sqrt(1 / 2 / 4000).
    sigma0 = np.array([f.sigma0 for f in fits])
    assert sigma0.mean() == pytest.approx(1, abs=0.005)
    # Noise and calibration both count here, or the test would be of one of them alone.
    ratio = np.mean([f.sigma_rig_m_s2 / f.sigma_image_m_s2 for f in fits])
    assert 0.2 < ratio < 5
    angle = np.array([np.arccos(np.clip(-f.up[1], -1, 1)) / f.up_sigma_rad for f in fits])
    # Rayleigh with the larger of two sigmas: mean square 2 or less.
    assert 0.5 < (angle**2).mean() < 2 + 4 * np.sqrt(4 / draws)


def test_a_lost_point_of_a_turning_body_does_not_matter():
    whole, gaps = falling(4, lost=0.0), falling(4, lost=0.3)
    fits = [check(scene) for scene in (whole, gaps)]
    for test in fits:
        assert abs(test.fit.deviation_sigmas) < 4
        np.testing.assert_allclose(test.fit.spin_rad_s, [0.3, 0.5, -0.8], atol=2e-3)
        # 16 points of 0.1 to 0.3 mm; the falls are 1.8 m at most.
        assert abs(test.regression.short_percent) < 0.1
        assert test.regression.residual_rms_mm < 0.1
    assert fits[1].fit.observations < 0.8 * fits[0].fit.observations


def test_points_and_stages_can_be_chosen():
    scene = falling(5)
    test = check(scene, 10, 50, points=[1, 2, 9])
    assert test.fit.point_id.tolist() == [1, 2, 9]
    assert (test.first, test.last) == (10, 50)
    assert test.regression.stage[0] >= 10
    assert test.fit.point_stages.max() <= 41
    # From stage 10 on it is falling already: the fit does not mind, the regression does.
    assert abs(test.fit.deviation_percent) < 1
    assert abs(test.regression.short_percent) > 10


def test_a_point_seen_too_rarely_is_named():
    scene = falling(6, lost=0.0)
    position = scene.table.position_mm.copy()
    position[2:, 3] = np.nan
    scene = dataclasses.replace(scene, table=dataclasses.replace(scene.table, position_mm=position))
    assert check(scene).fit.dropped.tolist() == [4]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_wrong_positions_are_left_out_and_named(seed):
    scene = falling(seed, lost=0.0)
    clean = check(scene).fit
    position = scene.table.position_mm.copy()
    for stage, point in ((5, 3), (6, 3), (40, 12)):
        position[stage - 1, point - 1] += [30.0, -40, 0]
    scene = dataclasses.replace(scene, table=dataclasses.replace(scene.table, position_mm=position))
    test = check(scene)
    assert clean.rejected.shape == (0, 2)
    assert test.fit.rejected.tolist() == [[5, 3], [6, 3], [40, 12]]
    assert test.fit.observations == clean.observations - 9
    # 9 of 2880 coordinates less: the result moves by a share of its sigma.
    assert abs(test.fit.g_m_s2 - clean.g_m_s2) < 0.5 * clean.sigma_image_m_s2
    assert test.regression.residual_rms_mm < 0.1


def test_the_vertical_may_be_given():
    scene = falling(7)
    test = check(scene, options=FreeFallOptions(up=(0, -2.0, 0)))
    assert test.fit.tilt_rad < 5 * test.fit.up_sigma_rad
    tilted = check(scene, options=FreeFallOptions(up=(0.0, -np.cos(0.1), np.sin(0.1))))
    assert tilted.fit.tilt_rad == pytest.approx(0.1, abs=1e-3)
    assert tilted.fit.g_m_s2 == pytest.approx(9.80665 * np.cos(0.1), abs=0.01)


def test_a_vertical_that_points_down_is_refused():
    with pytest.raises(ValueError, match="give the direction that points up"):
        check(falling(9, stages=20), last=20, options=FreeFallOptions(up=(0.0, 1.0, 0.0)))


def test_without_a_covariance_of_the_rig_the_noise_alone_is_predicted():
    scene = falling(8)
    bare = dataclasses.replace(scene.rig, cov=None, cov_names=())
    fit = check_free_fall(scene.table, 1, 60, CalibrationPart(bare)).fit
    assert fit.sigma_rig_m_s2 == 0
    assert fit.sigma_m_s2 == fit.sigma_image_m_s2 > 0


def with_drag(k_per_mm, seed, stages=60, rate_hz=60.0):
    """Points that fall with drag, not turning, from 1 m/s upwards."""
    rng = np.random.default_rng(seed)
    truth = two_pair_rig(rng)
    rig = calibrated(truth, rng)
    time = np.arange(stages) / rate_hz
    start = np.array([300.0, -1000, 0])

    def slope(_, state):
        v = state[3:]
        return np.r_[v, [0, 9806.65, 0] - k_per_mm * np.linalg.norm(v) * v]

    begin = np.r_[0, 0, 0, start]
    path = solve_ivp(slope, (0, time[-1]), begin, t_eval=time, rtol=1e-11, atol=1e-9).y[:3].T
    position = path[:, None] + rng.uniform(-300, 300, (16, 3)) - [0, 1500, 0]
    table = measure(truth, rig, position, np.repeat(PAIRS, 8, axis=0), rng, rate_hz=rate_hz)
    return table, CalibrationPart(rig)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_known_drag_is_taken_into_account(seed):
    k = 5e-5  # 0.05 per metre: a light ball
    table, part = with_drag(k, seed)
    given = check_free_fall(table, 1, 60, part, FreeFallOptions(drag_per_m=0.05)).fit
    assert abs(given.deviation_sigmas) < 4
    assert given.sigma0 == pytest.approx(1, abs=4 * np.sqrt(0.5 / given.redundancy))
    ignored = check_free_fall(table, 1, 60, part).fit
    assert ignored.deviation_percent < -5


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_drag_is_estimated_where_the_fall_determines_it(seed):
    table, part = with_drag(5e-5, seed)
    fit = check_free_fall(table, 1, 60, part, FreeFallOptions(estimate_drag=True)).fit
    assert fit.drag_determined
    assert abs(fit.drag_per_m - 0.05) < 4 * fit.drag_sigma_per_m
    assert abs(fit.deviation_sigmas) < 4
    table, part = with_drag(0.0, seed)
    fit = check_free_fall(table, 1, 60, part, FreeFallOptions(estimate_drag=True)).fit
    assert fit.drag_determined is False
    assert abs(fit.drag_per_m) < 4 * fit.drag_sigma_per_m
    assert abs(fit.deviation_sigmas) < 4


def test_drag_against_the_closed_solution():
    time, g, k = np.linspace(-0.4, 0.9, 14), 9806.65, 1e-4
    fall = drag_path(time, np.zeros(3), np.array([0, -g, 0]), k)
    down = time >= 0
    exact = -np.log(np.cosh(time * np.sqrt(g * k))) / k + g * time**2 / 2
    np.testing.assert_allclose(fall[down, 1], exact[down], atol=1e-5)
    # Before the turning point it rises, held back as well: s = -ln(cos(t sqrt(g k))) / k.
    rise = np.log(np.cos(time[~down] * np.sqrt(g * k))) / k + g * time[~down] ** 2 / 2
    np.testing.assert_allclose(fall[~down, 1], rise, atol=1e-5)


def test_what_cannot_be_done_is_said():
    scene = falling(9, lost=0.0)
    with pytest.raises(ValueError, match=r"points \[77\] were measured at no stage"):
        check(scene, points=[1, 77])
    with pytest.raises(ValueError, match="stages 58 to 60 hold 3 measured stages, 4 or more"):
        check(scene, 58, 60)
    timeless = dataclasses.replace(scene.table, time_s=np.full(60, np.nan))
    with pytest.raises(ValueError, match="no times"):
        check_free_fall(timeless, 1, 60, CalibrationPart(scene.rig))
    with pytest.raises(ValueError, match="gravity_m_s2: expected a positive number"):
        FreeFallOptions(gravity_m_s2=0)
