"""The rig's user face: projection and triangulation against OpenCV and by Monte Carlo."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from tests.synthetic import arc_rig

from videogrammetry.reconstruction import Rig, triangulate


@pytest.fixture(scope="module")
def rig():
    return Rig.from_data(arc_rig(3))


def points(rng, count=50):
    return rng.uniform([-200, -150, 1800], [200, 150, 2200], (count, 3))


@pytest.mark.peer
def test_two_exact_views_against_opencv(rig):
    truth = points(np.random.default_rng(1))
    pixels = rig.project(truth)
    matrices = []
    for c in list(rig.cameras.values())[:2]:
        k = np.array(
            [
                [c.interior[0], 0, 319.5 + c.interior[1]],
                [0, c.interior[0], 239.5 + c.interior[2]],
                [0, 0, 1],
            ]
        )
        matrices.append(k @ np.column_stack([c.rotation, c.translation_mm]))
    homogeneous = cv2.triangulatePoints(*matrices, pixels["cam1"].T, pixels["cam2"].T)
    theirs = (homogeneous[:3] / homogeneous[3]).T
    ours, _ = rig.triangulate({k: pixels[k] for k in ("cam1", "cam2")}, 0.05)
    # 1e-10 px of the projection is 1e-9 mm here; OpenCV's linear solution loses
    # some digits to its scaling.
    np.testing.assert_allclose(ours, truth, atol=1e-7)
    np.testing.assert_allclose(ours, theirs, atol=1e-5)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_covariance_is_the_scatter(rig, seed):
    rng = np.random.default_rng(seed)
    truth = np.repeat(points(rng, 1), 3000, axis=0)
    noisy = {k: v + rng.normal(0, 0.1, v.shape) for k, v in rig.project(truth).items()}
    found, cov = rig.triangulate(noisy, 0.1)
    error = found - truth
    chi2 = np.einsum("ni,nij,nj->n", error, np.linalg.inv(cov), error)
    # Chi-square with 3 degrees of freedom: the mean of m is 3 +- sqrt(6/m).
    assert abs(chi2.mean() - 3) < 4 * np.sqrt(6 / len(chi2))


def test_a_point_that_one_camera_sees_is_nan(rig):
    pixels = rig.project(points(np.random.default_rng(4), 2))
    pixels["cam2"][0] = pixels["cam3"][0] = np.nan
    found, cov = rig.triangulate(pixels, 0.1)
    assert np.isnan(found[0]).all()
    assert np.isnan(cov[0]).all()
    assert np.isfinite(found[1]).all()


def test_more_cameras_are_surer(rig):
    pixels = rig.project(points(np.random.default_rng(5)))
    _, two = rig.triangulate({k: pixels[k] for k in ("cam1", "cam2")}, 0.1)
    _, three = rig.triangulate(pixels, 0.1)
    assert (np.trace(three, axis1=1, axis2=2) < np.trace(two, axis1=1, axis2=2)).all()


def test_wrong_arguments_are_named(rig):
    pixels = rig.project(points(np.random.default_rng(6), 3))
    with pytest.raises(ValueError, match="camera 'left' is not in the rig, which has cam1, cam2"):
        rig.triangulate({"left": pixels["cam1"], "cam2": pixels["cam2"]})
    with pytest.raises(ValueError, match="needs two cameras"):
        rig.triangulate({"cam1": pixels["cam1"]})
    with pytest.raises(ValueError, match=r"points_in_world: expected shape \(N, 3\)"):
        rig.project([1.0, 2.0, 3.0])
    with pytest.raises(ValueError, match="outside the rig's 3 cameras"):
        triangulate(rig, [0, 2], [0, 7], np.zeros((2, 2)), np.ones((2, 3)))
