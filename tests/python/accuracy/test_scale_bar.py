"""Known lengths: the paper's own numbers, and predictions by Monte Carlo."""

from __future__ import annotations

import numpy as np
import pytest
from two_pairs import PAIRS, calibrated, measure, two_pair_rig, without

from videogrammetry.accuracy import (
    CalibrationPart,
    KnownLength,
    check_scale_bars,
    length_statistics,
)
from videogrammetry.accuracy.acceptance import acceptance_checks
from videogrammetry.accuracy.scale_bar import speed_classes

# Hu et al. (2012), Table 2, as printed: mm, and measured - 1100.057 mm.
LENGTHS = [1100.336, 1100.366, 1100.315, 1100.337, 1100.424, 1100.445, 1100.603, 1100.405]
LENGTHS += [1099.944, 1099.954, 1099.887]


def test_the_papers_table_2():
    s = length_statistics(np.array(LENGTHS) - 1100.057)
    # The printed lengths are rounded to 0.001 mm: every figure holds to 0.001 mm.
    assert s.count == 11
    assert s.mean_mm == pytest.approx(0.217, abs=0.001)
    assert s.sd_mm == pytest.approx(0.235, abs=0.001)  # "RMS: 0.235" in the paper
    assert s.rms_mm == pytest.approx(0.312, abs=0.001)
    assert s.largest_mm == pytest.approx(0.545, abs=0.0011)


def bars_of(position, pairs, sigma_mm=0.002):
    return [
        KnownLength(
            point_a=a,
            point_b=b,
            length_mm=float(np.linalg.norm(position[0, b - 1] - position[0, a - 1])),
            sigma_mm=sigma_mm,
        )
        for a, b in pairs
    ]


def swung(stages, rng):
    """Points 1, 2 seen by the first pair, 3, 4 by the second; the bars 1-2 and 1-3 are rigid."""
    start = np.array([[-550.0, 0, 0], [550, 0, 0], [-550, 0, 300], [550, 0, 300]])
    path = np.linspace(0, 1, stages)[:, None] ** 2 * [300.0, -200, 100]
    return start + path[:, None] + rng.uniform(-200, 200, 3), PAIRS[[0, 0, 1, 1]]


@pytest.mark.parametrize("seed", [1, 2])
def test_predicted_sigmas_are_the_scatter(seed):
    rng = np.random.default_rng(seed)
    truth = two_pair_rig(rng)
    draws = 300
    normalised, means, rig_only = [], [], []
    for _ in range(draws):
        rig = calibrated(truth, rng)
        position, used = swung(4, rng)
        table = measure(truth, rig, position, used, rng)
        test = check_scale_bars(
            table, bars_of(position, [(1, 2), (1, 3)], 1e-6), CalibrationPart(rig)
        )
        normalised.append(test.error_mm / test.sigma_mm)
        means.append([s.mean_mm / s.mean_sigma_mm for s in (*test.by_bar, test.total)])
        rig_only.append(test.sigma_rig_mm / test.sigma_mm)
    # Squared standard normals: the mean of m independent ones is 1 +- sqrt(2/m). The four
    # stages share the calibration, so that only the draws are counted.
    bound = 4 * np.sqrt(2 / draws)
    assert np.mean(np.square(normalised), axis=0) == pytest.approx(1, abs=bound)
    assert np.mean(np.square(means), axis=0) == pytest.approx(1, abs=bound)
    assert np.mean(rig_only) > 0.1  # the calibration does play its part


def test_groups_name_the_cameras_of_both_ends():
    rng = np.random.default_rng(5)
    truth = two_pair_rig(rng)
    position, used = swung(6, rng)
    bars = bars_of(position, [(1, 2), (3, 2)])
    table = measure(truth, truth, position, used, rng)
    missing = np.zeros((6, 4), dtype=bool)
    missing[3, 2] = True
    test = check_scale_bars(without(table, missing), bars, CalibrationPart(truth))
    groups = {s.name: s.count for s in test.by_cameras}
    assert groups == {"cam1+cam2 | cam1+cam2": 6, "cam3+cam4 | cam1+cam2": 5}
    assert test.total.count == len(test) == 11
    assert [s.count for s in test.by_bar] == [6, 5]
    # Central differences: no speed at both ends, nor where a neighbour is missing.
    assert np.isnan(test.speed_mm_s[[0, 5]]).all()
    assert np.isnan(test.speed_mm_s[test.bar == 1][[2, 3]]).all()
    path = np.linspace(0, 1, 6) ** 2
    expected = np.linalg.norm([300, -200, 100]) * (path[2:] - path[:-2]) / (2 / 500)
    # The noise of a position, 0.1 to 0.4 mm, over 2 stages at 500 Hz.
    np.testing.assert_allclose(test.speed_mm_s[1:5], expected, atol=5 * 0.4 * 500 / 2)


def test_bars_not_measured_are_told():
    rng = np.random.default_rng(6)
    truth = two_pair_rig(rng)
    position, used = swung(3, rng)
    table = measure(truth, truth, position, used, rng)
    unknown = KnownLength(point_a=1, point_b=99, length_mm=500, sigma_mm=0.01)
    part = CalibrationPart(truth)
    assert check_scale_bars(table, [unknown], part) is None
    test = check_scale_bars(table, [unknown, *bars_of(position, [(1, 2)])], part)
    assert test.not_measured == (0,)
    assert (test.bar == 1).all()


def test_speed_classes_are_at_most_four():
    assert speed_classes(np.full(9, np.nan)) == []
    classes = speed_classes(np.arange(100.0))
    assert [int(mask.sum()) for _, mask in classes] == [25, 25, 25, 25]
    assert len(speed_classes(np.zeros(30))) == 1  # a bar at rest


def box_test(lines, per_line, length):
    """Bars along x through the volume of 2 m, beside each other."""
    across = np.linspace(-1000, 1000, lines)
    starts = np.stack([np.full(lines, -1000.0), across, -across], axis=1)
    a = np.repeat(starts, per_line, axis=0)
    nominal = np.tile(np.linspace(length / 2, length, per_line), lines)
    volume = np.array([[-1000.0, -1000, -1000], [1000, 1000, 1000]])
    checks = acceptance_checks(a, a + nominal[:, None] * [1, 0, 0], nominal, 0 * nominal, volume)
    return [check.met for check in checks]


def test_what_the_guideline_asks_for():
    # Seven lines of five lengths to 2.4 m: 0.69 of the diagonal; only two corners are reached.
    assert box_test(7, 5, 2400.0) == [True, True, True, True, False, None]
    assert box_test(6, 4, 1100.0) == [False, False, False, False, False, None]
