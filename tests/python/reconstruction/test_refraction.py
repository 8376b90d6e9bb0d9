"""Points in water: triangulation through windows, its covariance, and matching."""

from __future__ import annotations

import numpy as np
import pytest
from tanks import WINDOW, block_points, pictures, tank_cameras, without_window

from videogrammetry.errors import CalibrationError
from videogrammetry.export.rig_formats import convert_for
from videogrammetry.reconstruction import Rig
from videogrammetry.types import RigData

POINTS = np.random.default_rng(3).uniform([-50, -40, -80], [50, 40, 60], (200, 3))


def rig() -> Rig:
    return Rig.from_data(RigData(cameras=tank_cameras(), reference="tank"))


def test_exact_pictures_give_the_points() -> None:
    position, _ = rig().triangulate(rig().project(POINTS))
    # Pixels are good to 1e-10 px, 0.16 mm each, and depth is weaker by less than ten.
    np.testing.assert_allclose(position, POINTS, atol=1e-8)


def test_points_before_and_behind_the_window_alike() -> None:
    above = POINTS + np.array([0.0, 0.0, 200.0])  # all in air
    position, _ = rig().triangulate(rig().project(above))
    np.testing.assert_allclose(position, above, atol=1e-8)
    straight = Rig.from_data(RigData(cameras=without_window(tank_cameras())))
    for name, xy in straight.project(above).items():
        np.testing.assert_allclose(rig().project(above)[name], xy, atol=1e-9)


def test_the_covariance_is_the_scatter() -> None:
    """The mean of chi-square with 3 degrees of freedom over m trials is 3 +- sqrt(6 / m)."""
    rng = np.random.default_rng(4)
    points = np.tile(POINTS, (10, 1))
    sigma_px = 0.1
    noisy = {n: xy + rng.normal(0, sigma_px, xy.shape) for n, xy in rig().project(points).items()}
    found = rig().intersect(noisy, sigma_px)
    error = found.position_mm - points
    squares = np.einsum("ni,nij,nj->n", error, np.linalg.inv(found.cov_image_mm2), error)
    assert abs(squares.mean() - 3.0) < 4.5 * np.sqrt(6.0 / len(points))
    # Eight coordinates less three: chi-square with five degrees of freedom.
    assert abs(found.chi2.mean() - 5.0) < 4.5 * np.sqrt(10.0 / len(points))


def test_ignoring_the_window_is_wrong_by_millimetres() -> None:
    straight = Rig.from_data(RigData(cameras=without_window(tank_cameras())))
    position, _ = straight.triangulate(pictures(tank_cameras(), block_points()))
    assert np.abs(position - block_points()).max() > 10.0


def test_predicted_pictures_follow_the_rays() -> None:
    seen = rig().predict(POINTS[:5], cov_mm2=np.tile(0.01 * np.eye(3), (5, 1, 1)), sigma_px=0.1)
    moved = rig().project(POINTS[:5] + [0.05, 0.0, 0.0])
    still = rig().project(POINTS[:5] - [0.05, 0.0, 0.0])
    for name in seen.xy_px:
        by_x = (moved[name] - still[name]) / 0.1
        total = seen.cov_point_px2[name]
        # 0.01 (J J') holds 0.01 of each column of J: x's alone is less than all.
        assert (np.trace(total, axis1=1, axis2=2) > 0.01 * (by_x**2).sum(axis=1)).all()


def test_formats_without_refraction_refuse_the_rig() -> None:
    with pytest.raises(CalibrationError, match="looks through the interface 'window'"):
        convert_for(rig(), "opencv")
    assert WINDOW.name == "window"
