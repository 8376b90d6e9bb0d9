"""Refraction at flat windows, held against Snell's law written down again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tanks import WINDOW, block_points, pictures, tank_cameras, without_window

from videogrammetry.geometry import (
    apparent_points,
    interface_model,
    project_from_world,
    project_from_world_with_jacobians,
    rays_from_pixels,
)
from videogrammetry.types import FlatInterface, FloatArray


def test_rays_bend_as_snell_says() -> None:
    points = block_points()
    for camera in tank_cameras().values():
        pixels = project_from_world(camera, points)
        origin, direction = rays_from_pixels(camera, pixels)
        # The refracted ray goes through the point ...
        miss = np.linalg.norm(np.cross(points - origin, direction), axis=1)
        assert miss.max() < 1e-7
        # ... from the glass' back, and its sine is that in air over the index.
        np.testing.assert_allclose(origin[:, 2], 92.0, atol=1e-9)
        _, straight = rays_from_pixels(replace(camera, interface=None), pixels)
        np.testing.assert_allclose(
            np.hypot(*straight[:, :2].T), 1.333 * np.hypot(*direction[:, :2].T), atol=1e-12
        )


def test_index_one_is_no_window() -> None:
    none = replace(WINDOW, fluid_index=1.0, glass_index=1.0)
    points = block_points()
    seen, straight = tank_cameras(none), without_window(tank_cameras())
    for name, xy in pictures(seen, points).items():
        np.testing.assert_allclose(xy, project_from_world(straight[name], points), atol=1e-9)


def test_refraction_is_no_small_matter() -> None:
    points = block_points()
    straight = pictures(without_window(tank_cameras()), points)
    for name, xy in pictures(tank_cameras(), points).items():
        assert np.linalg.norm(xy - straight[name], axis=1).min() > 20.0


def test_apparent_points_are_good_start_values() -> None:
    points = block_points()
    straight = without_window(tank_cameras())
    seen = pictures(tank_cameras(), points)
    for name, camera in straight.items():
        # Of 150 mm depth the fourth order of the angle is left: a few pixels of hundreds.
        away = project_from_world(camera, apparent_points(WINDOW, points)) - seen[name]
        assert np.linalg.norm(away, axis=1).max() < 25.0


def test_derivatives_equal_differences() -> None:
    points = block_points()[::7]
    camera = tank_cameras()["c1"]
    _, by_point, by_camera = project_from_world_with_jacobians(camera, points)

    def moved(k: int, step: float) -> FloatArray:
        shift = camera.translation_mm + step * np.eye(3)[k]
        return project_from_world(replace(camera, translation_mm=shift), points)

    for k in range(3):
        step = 0.1 * np.eye(3)[k]
        numerical = (
            project_from_world(camera, points + step) - project_from_world(camera, points - step)
        ) / 0.2
        np.testing.assert_allclose(by_point[:, :, k], numerical, atol=1e-5)
        numerical = (moved(k, 0.1) - moved(k, -0.1)) / 0.2
        np.testing.assert_allclose(by_camera[:, :, 13 + k], numerical, atol=1e-5)


def test_a_camera_behind_its_window_sees_nothing() -> None:
    camera = replace(tank_cameras()["c0"], interface=replace(WINDOW, distance_mm=800.0))
    assert np.isnan(project_from_world(camera, block_points())).all()


@pytest.mark.parametrize(
    ("window", "said"),
    [
        (replace(WINDOW, normal=np.array([0.0, 0, 2])), "unit length"),
        (replace(WINDOW, fluid_index=0.7), "1 to 4"),
        (replace(WINDOW, glass_index=9.0), "1 to 4"),
        (replace(WINDOW, glass_thickness_mm=-1.0), "negative"),
        (replace(WINDOW, distance_mm=float("nan")), "finite"),
    ],
)
def test_impossible_windows_are_refused(window: FlatInterface, said: str) -> None:
    with pytest.raises(ValueError, match=said) as raised:
        interface_model(window)
    assert "window" in str(raised.value)
