"""Rigid and similarity fits: exact, weighted, of noisy, flat and mirrored points."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from videogrammetry.geometry import fit_rigid, fit_similarity

SHIFT = np.array([10.0, -20.0, 30.0])


def points(seed, count=8):
    return np.random.default_rng(seed).normal(0, 100, (count, 3))


def turn(seed):
    return Rotation.random(random_state=seed).as_matrix()


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("flat", [False, True], ids=["solid", "flat"])
def test_exact_points_give_the_motion_back(seed, flat):
    b = points(seed) * [1, 1, 0 if flat else 1]
    rotation, translation, rms = fit_rigid(b @ turn(seed).T + SHIFT, b)
    np.testing.assert_allclose(rotation, turn(seed), atol=1e-12)
    np.testing.assert_allclose(translation, SHIFT, atol=1e-10)
    assert rms < 1e-10
    scale, rotation, translation, rms = fit_similarity(0.3 * b @ turn(seed).T + SHIFT, b)
    assert scale == pytest.approx(0.3, rel=1e-12)
    np.testing.assert_allclose(rotation, turn(seed), atol=1e-12)
    np.testing.assert_allclose(translation, SHIFT, atol=1e-10)


@pytest.mark.parametrize("seed", range(5))
def test_weighted_as_scipy_has_it(seed):
    rng = np.random.default_rng(100 + seed)
    b, weight = points(seed), rng.uniform(0, 3, 8)
    weight[0] = 0
    a = b @ turn(seed).T + SHIFT + rng.normal(0, 10, b.shape)
    rotation, translation, rms = fit_rigid(a, b, weight)
    mean_a, mean_b = np.average(a, 0, weight), np.average(b, 0, weight)
    peer, rssd = Rotation.align_vectors(a - mean_a, b - mean_b, weights=weight)
    np.testing.assert_allclose(rotation, peer.as_matrix(), atol=1e-10)
    np.testing.assert_allclose(translation, mean_a - rotation @ mean_b, atol=1e-10)
    assert rms == pytest.approx(rssd / np.sqrt(weight.mean() * (3 * 8 - 6)), rel=1e-9)
    # Only ratios count; a weight of two is the point twice, one of nothing leaves it out.
    np.testing.assert_allclose(fit_rigid(a, b, 7 * weight)[2], rms, rtol=1e-12)
    twice = np.r_[np.arange(1, 8), 7]
    np.testing.assert_allclose(
        fit_similarity(a, b, np.r_[0, np.ones(6), 2])[1],
        fit_similarity(a[twice], b[twice])[1], atol=1e-12,
    )  # fmt: skip


def test_the_rms_estimates_the_noise_of_a_coordinate():
    sigma, trials, count = 0.1, 400, 6
    squares = np.zeros((trials, 2))
    for k in range(trials):
        b = points(k, count)
        a = b @ turn(k).T + np.random.default_rng(1000 + k).normal(0, sigma, b.shape)
        squares[k] = fit_rigid(a, b)[2] ** 2, fit_similarity(a, b)[3] ** 2
    # rms^2 (3 N - u) / sigma^2 is chi-square of 3 N - u: a mean of T scatters by sqrt(2 / (f T)).
    for unknowns, mean in zip((6, 7), squares.mean(axis=0) / sigma**2, strict=True):
        assert abs(mean - 1) < 4.5 * np.sqrt(2 / ((3 * count - unknowns) * trials)), unknowns


@pytest.mark.parametrize("seed", range(5))
def test_no_other_similarity_leaves_less(seed):
    rng = np.random.default_rng(200 + seed)
    b, weight = points(seed), rng.uniform(0.1, 3, 8)
    a = 2 * b @ turn(seed).T + rng.normal(0, 30, b.shape)

    def left(scale, rotation, translation):
        return weight @ ((a - scale * b @ rotation.T - translation) ** 2).sum(axis=1)

    scale, rotation, translation, rms = fit_similarity(a, b, weight)
    least = left(scale, rotation, translation)
    assert rms == pytest.approx(np.sqrt(least / weight.mean() / (3 * 8 - 7)), rel=1e-12)
    for _ in range(50):
        other = Rotation.from_rotvec(rng.normal(0, 0.01, 3)).as_matrix() @ rotation
        other_scale = scale * (1 + rng.normal(0, 0.01))
        assert left(other_scale, other, translation + rng.normal(0, 1, 3)) > least


@pytest.mark.parametrize("seed", range(5))
def test_a_reflection_only_where_it_is_asked_for(seed):
    b = points(seed)
    a = 2 * (b * [1, 1, -1]) @ turn(seed).T + SHIFT
    assert np.linalg.det(fit_rigid(a, b)[0]) == pytest.approx(1, abs=1e-12)
    assert fit_similarity(a, b)[3] > 10
    scale, rotation, translation, rms = fit_similarity(a, b, mirrored=True)
    assert np.linalg.det(rotation) == pytest.approx(-1, abs=1e-12)
    assert scale == pytest.approx(2, rel=1e-12)
    assert rms < 1e-10
    np.testing.assert_allclose(scale * b @ rotation.T + translation, a, atol=1e-9)


def test_points_on_a_line_or_alone_still_give_a_rotation():
    b = np.outer(np.arange(4.0), [1.0, 2, 3])
    rotation, translation, rms = fit_rigid(b @ turn(1).T + SHIFT, b)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(b @ rotation.T + translation, b @ turn(1).T + SHIFT, atol=1e-10)
    rotation, translation, rms = fit_rigid(np.array([SHIFT]), np.zeros((1, 3)))
    np.testing.assert_allclose(translation, SHIFT)
    assert rms == 0


@pytest.mark.parametrize(
    ("a", "b", "weight", "message"),
    [
        (np.zeros((3, 3)), np.zeros((2, 3)), None, "equal shapes"),
        (np.zeros((3, 2)), np.zeros((3, 2)), None, "equal shapes"),
        (np.zeros((0, 3)), np.zeros((0, 3)), None, "equal shapes"),
        (np.full((3, 3), np.nan), np.zeros((3, 3)), None, "finite coordinates"),
        (np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3), "weight: expected 3 numbers"),
        (np.zeros((3, 3)), np.zeros((3, 3)), -np.ones(3), "weight: expected 3 numbers"),
        (np.zeros((3, 3)), np.zeros((3, 3)), np.ones(2), "weight: expected 3 numbers"),
    ],
)
@pytest.mark.parametrize("fit", [fit_rigid, fit_similarity])
def test_what_is_no_fit(fit, a, b, weight, message):
    with pytest.raises(ValueError, match=message):
        fit(a, b, weight)


def test_one_place_has_no_scale():
    with pytest.raises(ValueError, match="nothing about a scale"):
        fit_similarity(points(1), np.ones((8, 3)))
