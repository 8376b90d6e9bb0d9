"""Other programs' lenses against OpenCV's own projection."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from videogrammetry.geometry import LensModel, project_lens, rays_through_lens

COEFFICIENTS = np.array(
    [-0.21, 0.13, 4e-4, -7e-4, 0.05, 0.02, 0.01, -0.03, 2e-3, -1e-3, 1e-3, 3e-3, 0.02, -0.015]
)
FISHEYE = np.array([0.04, -0.01, 0.003, -0.0005])


def lens_of(count, kind="opencv"):
    values = COEFFICIENTS[:count] if kind == "opencv" else FISHEYE
    return LensModel(
        kind=kind,
        focal_px=np.array([1500.0, 1490.0]),
        centre_px=np.array([600.0, 530.5]),
        coefficients=values,
    )


def points(seed):
    return np.random.default_rng(seed).uniform([-3, -3, 6], [3, 3, 12], (400, 3))


def matrix(lens):
    fx, fy, cx, cy = *lens.focal_px, *lens.centre_px
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])


@pytest.mark.peer
@pytest.mark.parametrize("count", [0, 4, 5, 8, 12, 14])
@pytest.mark.parametrize("seed", [1, 2])
def test_projection_is_opencvs(count, seed):
    lens, p = lens_of(count), points(seed)
    theirs, _ = cv2.projectPoints(
        p, np.zeros(3), np.zeros(3), matrix(lens), COEFFICIENTS[:count] if count else None
    )
    # Rounding of numbers of 1e3 px: 1e3 * 2^-52 * a few operations.
    np.testing.assert_allclose(project_lens(lens, p), theirs.reshape(-1, 2), rtol=0, atol=1e-9)


@pytest.mark.peer
def test_equidistant_is_opencvs_fisheye():
    lens, p = lens_of(4, "equidistant"), points(3)
    theirs, _ = cv2.fisheye.projectPoints(
        p[:, None], np.zeros(3), np.zeros(3), matrix(lens), FISHEYE
    )
    np.testing.assert_allclose(project_lens(lens, p), theirs.reshape(-1, 2), rtol=0, atol=1e-9)


@pytest.mark.parametrize(("count", "kind"), [(0, "opencv"), (14, "opencv"), (4, "equidistant")])
def test_rays_invert_the_projection(count, kind):
    lens, p = lens_of(count, kind), points(4)
    rays = rays_through_lens(lens, project_lens(lens, p))
    # 1e-9 px at the inner slope of the model, over f = 1500 px.
    np.testing.assert_allclose(rays[:, :2], p[:, :2] / p[:, 2:], rtol=0, atol=2e-12)


def test_where_there_is_no_ray_it_is_nan():
    # x (1 - x^2) is largest at x = 0.577: 577 px from the centre.
    lens = LensModel(
        kind="opencv", focal_px=np.array([1500.0] * 2), centre_px=np.zeros(2),
        coefficients=np.array([-1.0, 0, 0, 0]),
    )  # fmt: skip
    rays = rays_through_lens(lens, [[300.0, 0.0], [1500 * 0.6, 0.0]])
    assert np.isfinite(rays[0]).all()
    assert np.isnan(rays[1]).all()


def test_behind_the_camera_is_nan():
    assert np.isnan(project_lens(lens_of(5), [[0.1, 0.1, -1.0], [0.0, 0.0, 0.0]])).all()


def test_wrong_numbers_are_named():
    with pytest.raises(ValueError, match=r"coefficients: opencv has 0, 4, 5, 8, 12, 14 of them"):
        LensModel(
            kind="opencv", focal_px=np.ones(2), centre_px=np.zeros(2), coefficients=np.zeros(6)
        )
    with pytest.raises(ValueError, match="focal_px: expected two positive"):
        LensModel(
            kind="opencv", focal_px=-np.ones(2), centre_px=np.zeros(2), coefficients=np.zeros(4)
        )
