"""The bench's bound against closed forms and numerical derivatives."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[3] / "bench" / "accuracy"))
import centre_bound

PSF = 0.7


def bound(radius, **changed):
    values = {
        "white": 3000.0,
        "black": 300.0,
        "psf": PSF,
        "psf_sigma": 0.05,
        "gradient": 1e-5,
        "variance": lambda grey: np.full_like(grey, 36.0**2),
        "free_radii": 3.0,
    }
    cov = centre_bound.centre_covariance(
        np.array([20.3, 21.1]), np.array([radius, radius]), 0.0, **(values | changed)
    )
    return np.sqrt(np.diag(cov))


@pytest.mark.parametrize("radius", [4.0, 6.0, 10.0])
def test_bound_of_a_disc_is_the_closed_form(radius):
    # An edge of spread s has the information C^2 / (2 sqrt(pi) s sigma^2) a pixel of contour
    # about its place, half of it along x; closed forms are to the order of (s / r)^2.
    spread = np.sqrt(PSF**2 + 1 / 12)
    expected = 36 / 2700 * np.sqrt(2 * spread / (np.sqrt(np.pi) * radius))
    np.testing.assert_allclose(bound(radius), expected, rtol=0.1)


def test_what_is_not_known_costs():
    assert (bound(6.0, gradient=0.02) > 1.1 * bound(6.0)).all()
    assert (bound(6.0, free_radii=1.6) >= bound(6.0)).all()
    np.testing.assert_allclose(bound(6.0, psf_sigma=1.0), bound(6.0), rtol=0.01)


def test_coverage_is_that_of_points():
    x = np.arange(41.0)
    shape = np.array([[6.0, 1.0], [1.0, 4.0]])
    centre = np.array([20.3, 19.6])
    cover = centre_bound.coverage(x, x, centre, shape, PSF)
    # Normal points of the blur and even ones of the pixel, about a pixel on the contour:
    # a share p from n points is known to sqrt(p (1 - p) / n).
    rng = np.random.default_rng(1)
    n = 200_000
    for column, row in ((26, 20), (20, 24), (23, 16), (20, 20)):
        at = np.array([column, row]) + rng.normal(0, PSF, (n, 2)) + rng.uniform(-0.5, 0.5, (n, 2))
        inside = (np.linalg.solve(shape, (at - centre).T) ** 2).sum(axis=0) <= 1
        assert abs(inside.mean() - cover[row, column]) < 5 * np.sqrt(0.25 / n)
    np.testing.assert_allclose(cover.sum(), np.pi * np.linalg.det(shape), rtol=1e-9)
