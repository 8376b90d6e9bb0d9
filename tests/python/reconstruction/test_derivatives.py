"""Derivatives of points by the rig: numerically, and against the covariance of triangulate."""

from __future__ import annotations

import numpy as np
import pytest
from two_pairs import PAIRS, measure, moved, two_pair_rig

from videogrammetry.accuracy.true_points import (
    exact_pictures,
    measured_from_true,
    triangulate_pictures,
)
from videogrammetry.geometry import full_covariance
from videogrammetry.reconstruction import Triangulator
from videogrammetry.types import matrix_from_cov6

# A step of each parameter that moves a picture by some 0.05 px.
STEP = np.tile(
    [0.1, 0.05, 0.05, 1e-10, 1e-15, 1e-20, 1e-7, 1e-7, 1e-4, 1e-4] + [2e-5] * 3 + [0.2] * 3, 4
)


@pytest.fixture(scope="module")
def rig():
    return two_pair_rig(np.random.default_rng(1))


@pytest.fixture(scope="module")
def points():
    return np.random.default_rng(2).uniform(-1500, 1500, (6, 3)), np.repeat(PAIRS, 3, axis=0)


@pytest.mark.parametrize("frame", ["rig", "volume"])
def test_against_numeric_differentiation(rig, points, frame):
    position, used = points
    pixels = exact_pictures(rig, position)
    by_parameters = Triangulator(rig, frame=frame).derivatives(position, used)
    assert by_parameters.shape == (6, 3, 64)

    def found(change):
        other = moved(rig, change)
        x = triangulate_pictures(other, pixels, used)
        if frame == "rig":
            return x
        fit = measured_from_true(other, rig)  # the frame moves with the volume
        return (x - fit.translation_mm) @ fit.rotation

    for k in range(64):
        h = np.zeros(64)
        h[k] = STEP[k]
        numeric = (found(h) - found(-h)) / 2
        # Central differences of a smooth function: the third-order term is (0.05 px / 2650 px)^2
        # of the effect; the inversion of the distortion and the intersection keep 1e-10 px, 1e-6 mm
        # in depth here.
        np.testing.assert_allclose(
            by_parameters[:, :, k] * STEP[k], numeric, atol=1e-5, rtol=1e-4, err_msg=str(k)
        )


@pytest.mark.parametrize("frame", ["rig", "volume"])
def test_they_give_the_covariance_of_triangulate(rig, points, frame):
    position, used = points
    triangulator = Triangulator(rig, frame=frame)
    pixels = exact_pictures(rig, position)
    point, camera = np.nonzero(used)
    sigma = np.random.default_rng(3).uniform(0.01, 0.2, used.shape)
    variance = sigma[point, camera] ** 2
    result = triangulator(
        np.arange(0, 13, 2), camera, pixels[point, camera],
        np.stack([variance, 0 * variance, variance], axis=1),
    )  # fmt: skip
    g = triangulator.derivatives(result["position_mm"], used, sigma)
    expected = result["cov_rig_mm2"]
    found = g @ full_covariance(rig) @ np.swapaxes(g, 1, 2)
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


def test_covariances_between_points_are_those_of_differences(rig):
    """Two points of one pair move alike: their difference is surer than either."""
    position = np.array([[100.0, 0, 0], [110.0, 0, 0]])
    used = PAIRS[[0, 0]]
    g = Triangulator(rig, frame="rig").derivatives(position, used)
    c = full_covariance(rig)
    own = np.trace(g[0] @ c @ g[0].T)
    between = (g[1] - g[0]) @ c @ (g[1] - g[0]).T
    assert np.trace(between) < 1e-3 * own


def test_what_is_not_determined_is_nan(rig):
    position = np.array([[0.0, 0, 0], [np.nan, 0, 0], [0, 0, -20000.0], [0, 0, 0]])
    used = np.array([PAIRS[0], PAIRS[0], PAIRS[0], [True, False, False, False]])
    g = Triangulator(rig).derivatives(position, used)
    assert np.isfinite(g[0]).all()
    assert np.isnan(g[1:]).all()
    assert Triangulator(rig).derivatives(np.empty((0, 3)), np.empty((0, 4), bool)).shape == (
        0,
        3,
        64,
    )


def test_wrong_shapes_are_named(rig):
    with pytest.raises(ValueError, match=r"position_mm: expected \(P, 3\), got \(3,\)"):
        Triangulator(rig).derivatives(np.zeros(3), PAIRS[:1])
    with pytest.raises(ValueError, match=r"cameras_used: expected \(1, 4\), got \(1, 2\)"):
        Triangulator(rig).derivatives(np.zeros((1, 3)), np.ones((1, 2), bool))


def test_the_fake_measurement_uses_the_same_weights(rig, points):
    position, used = points
    table = measure(rig, rig, position[None], used, None)
    g = Triangulator(rig).derivatives(position, used)
    expected = matrix_from_cov6(table.cov_mm2 - table.cov_image_mm2)[0]
    found = g @ full_covariance(rig) @ np.swapaxes(g, 1, 2)
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())
