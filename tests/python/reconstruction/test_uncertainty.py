"""Covariances of predict, intersect and distance are the scatter of what they predict."""

from __future__ import annotations

import numpy as np
import pytest
from two_pairs import NAMES, PAIRS, moved, two_pair_rig

from videogrammetry.accuracy.true_points import measured_from_true
from videogrammetry.reconstruction import Rig

DRAWS = 500
SIGMA_PX = 0.02


@pytest.fixture(scope="module")
def rig():
    return Rig.from_data(two_pair_rig(np.random.default_rng(1)))


@pytest.fixture(scope="module")
def drawn(rig):
    """Rigs as calibrations with the rig's covariance might have found them, with their frames."""
    rng = np.random.default_rng(5)
    sigma = np.sqrt(np.diag(rig.cov))
    rigs = [moved(rig, rng.normal(size=len(sigma)) * sigma) for _ in range(DRAWS)]
    return [(Rig.from_data(r), measured_from_true(r, rig)) for r in rigs]


@pytest.fixture(scope="module")
def points():
    return np.random.default_rng(2).uniform(-1200, 1200, (6, 3))


def assert_scatter(errors, cov, what):
    """The mean of chi-square with d degrees of freedom over m draws is d +- sqrt(2 d / m).

    Held at 4.5 standard deviations. What is not linear is far below that: the
    largest steps move pictures by 0.1 px in 2650 px, a relative 4e-5 of the errors.
    """
    d, m = cov.shape[-1], len(errors)
    chi2 = np.einsum("mi,ij,mj->m", errors, np.linalg.inv(cov), errors)
    assert abs(chi2.mean() - d) < 4.5 * np.sqrt(2 * d / m), what


@pytest.mark.parametrize("frame", ["rig", "volume"])
def test_predicted_pictures_scatter_as_the_calibration_says(rig, drawn, points, frame):
    seen = rig.predict(points, frame=frame)
    assert seen.rig_known
    for name in NAMES:
        errors = []
        for other, fit in drawn:
            x = points if frame == "rig" else points @ fit.rotation.T + fit.translation_mm
            errors.append(other.project(x)[name] - seen.xy_px[name])
        errors = np.array(errors)
        for i in range(len(points)):
            cov = seen.cov_rig_px2[name][i]
            assert_scatter(errors[:, i], cov, (frame, name, i))


def test_predicted_pictures_of_uncertain_points(rig, points):
    rng = np.random.default_rng(8)
    root = rng.normal(0, 0.3, (3, 3))
    cov = np.broadcast_to(root @ root.T, (len(points), 3, 3))
    seen = rig.predict(points, cov_mm2=cov, sigma_px=0.05)
    moved_points = points + rng.normal(size=(4000, 1, 3)) @ root.T
    for name in NAMES:
        flat = rig.project(moved_points.reshape(-1, 3))[name].reshape(4000, -1, 2)
        for i in range(len(points)):
            error = flat[:, i] - seen.xy_px[name][i]
            assert_scatter(error, seen.cov_point_px2[name][i], (name, i))
            noisy = error + rng.normal(0, 0.05, error.shape)
            together = seen.cov_px2[name][i] - seen.cov_rig_px2[name][i]
            assert_scatter(noisy, together, (name, i, "with noise"))


def measured(rig, drawn, points, used, rng):
    """(draws, N, 3) errors in the volume's frame, and in the rig's axes."""
    pixels = {}
    for k, (name, xy) in enumerate(rig.project(points).items()):
        pixels[name] = np.where(used[:, k, None], xy, np.nan)
    volume, axes = [], []
    for other, fit in drawn:
        noisy = {n: xy + rng.normal(0, SIGMA_PX, xy.shape) for n, xy in pixels.items()}
        found, _ = other.triangulate(noisy, SIGMA_PX)
        axes.append(found - points)
        volume.append((found - fit.translation_mm) @ fit.rotation - points)
    return pixels, np.array(volume), np.array(axes)


def test_intersected_points_and_distances_scatter_as_predicted(rig, drawn, points):
    used = np.array([PAIRS[0], PAIRS[0], PAIRS[1], PAIRS[1], [True] * 4, [True] * 4])
    pixels, volume, axes = measured(rig, drawn, points, used, np.random.default_rng(3))
    found = rig.intersect(pixels, SIGMA_PX)
    in_rig = rig.intersect(pixels, SIGMA_PX, frame="rig")
    np.testing.assert_allclose(found.position_mm, points, atol=1e-6)
    for i in range(len(points)):
        assert_scatter(volume[:, i], found.cov_mm2[i], ("volume", i))
        assert_scatter(axes[:, i], in_rig.cov_mm2[i], ("rig", i))
    # Points of one pair, of two pairs: what they share is in the blocks beside the diagonal.
    for rows in ([0, 1], [1, 2], [3, 4, 5]):
        together = found.covariance(rows)
        assert_scatter(volume[:, rows].reshape(DRAWS, -1), together, ("together", rows))
    pairs = np.array([[0, 1], [0, 2], [2, 3], [4, 5]])
    expected = found.distance(*pairs.T)
    ends = axes + points
    lengths = np.linalg.norm(ends[:, pairs[:, 1]] - ends[:, pairs[:, 0]], axis=2)
    for k in range(len(pairs)):
        error = (lengths[:, k] - expected.length_mm[k])[:, None]
        assert_scatter(error, expected.sigma_mm[k] ** 2 * np.eye(1), ("distance", pairs[k]))


def test_a_distance_knows_no_frame_and_what_both_ends_share(rig, points):
    pixels = {n: xy for n, xy in rig.project(points).items() if n in ("cam1", "cam2")}
    a, b = [0, 1, 2], [3, 4, 5]
    lengths = [rig.intersect(pixels, 0.02, frame=f).distance(a, b) for f in ("rig", "volume")]
    # A common motion changes no length, so that the frames agree to rounding.
    np.testing.assert_allclose(lengths[0].sigma_rig_mm, lengths[1].sigma_rig_mm, rtol=1e-6)
    found = rig.intersect(pixels, 0.02, frame="rig")
    apart = np.sqrt(
        np.trace(found.cov_rig_mm2[a], axis1=1, axis2=2)
        + np.trace(found.cov_rig_mm2[b], axis1=1, axis2=2)
    )
    # Without their correlation the ends would carry the frame's uncertainty twice.
    assert (lengths[0].sigma_rig_mm < 0.7 * apart).all()
    direct = rig.distance(
        {n: xy[a] for n, xy in pixels.items()}, {n: xy[b] for n, xy in pixels.items()}, 0.02
    )
    np.testing.assert_allclose(direct.sigma_mm, lengths[1].sigma_mm, rtol=1e-12)
    np.testing.assert_allclose(direct.length_mm, np.linalg.norm(points[b] - points[a], axis=1))


def test_blocks_of_the_full_covariance_are_the_points_own(rig, points):
    found = rig.intersect(rig.project(points), 0.03)
    full = found.rig_covariance()
    assert full.shape == (18, 18)
    np.testing.assert_allclose(full, full.T, atol=1e-15)
    blocks = np.array([full[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] for i in range(6)])
    np.testing.assert_allclose(blocks, found.cov_rig_mm2, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(found.covariance([2]), found.cov_mm2[2], rtol=1e-6, atol=1e-12)


def test_without_a_covariance_nothing_is_claimed(rig, points):
    bare = Rig(cameras=rig.cameras)
    found = bare.intersect(bare.project(points), 0.03)
    assert not found.rig_known
    assert (found.cov_rig_mm2 == 0).all()
    assert (found.distance(0, 1).sigma_rig_mm == 0).all()
    assert (found.rig_covariance([0, 1]) == 0).all()
    assert not bare.predict(points).rig_known


def test_residuals_and_status(rig, points):
    pixels = rig.project(points)
    pixels["cam1"][0] = pixels["cam2"][0] = pixels["cam3"][0] = np.nan
    pixels["cam4"][1, 1] += 5.0
    found = rig.intersect(pixels, 0.03)
    assert found.status.tolist() == [1, 0, 0, 0, 0, 0]
    assert np.isnan(found.position_mm[0]).all()
    assert np.isnan(found.distance(0, 1).sigma_mm).all()
    assert np.abs(found.residual_px["cam4"][1, 1]) > 1
    assert found.chi2[1] > 1000
    behind = rig.predict([[0.0, 0.0, 50000.0]])
    assert np.isnan(behind.xy_px["cam3"]).all() != np.isnan(behind.xy_px["cam1"]).all()
    assert np.isnan(behind.cov_px2["cam3"]).all() or np.isnan(behind.cov_px2["cam1"]).all()


def test_wrong_arguments_are_named(rig, points):
    pixels = rig.project(points)
    found = rig.intersect(pixels)
    with pytest.raises(ValueError, match="a: row 6 is outside the 6 points"):
        found.distance(6, 0)
    with pytest.raises(ValueError, match="b: expected 2 rows as in a, got 1"):
        found.distance([0, 1], 2)
    with pytest.raises(ValueError, match=r"cov_mm2: expected \(6, 3, 3\), got \(3, 3\)"):
        rig.predict(points, cov_mm2=np.eye(3))
    with pytest.raises(ValueError, match=r"expected \(N, 2\) for every camera, got cam1 \(5, 2\)"):
        rig.intersect({"cam1": pixels["cam1"][:5], "cam2": pixels["cam2"]})
    with pytest.raises(ValueError, match="frame: expected 'volume' or 'rig'"):
        rig.predict(points, frame="world")
    with pytest.raises(ValueError, match="as many points as pixels_a"):
        rig.distance(pixels, {n: xy[:2] for n, xy in pixels.items()})
    with pytest.raises(ValueError, match="camera 'left' is not in the rig"):
        rig.distance(pixels, {"left": pixels["cam1"]})
