"""The camera against an outside program's figures and against OpenCV."""

from __future__ import annotations

import csv
import json

import cv2
import numpy as np
import pytest

from videogrammetry import geometry
from videogrammetry.types import INTERIOR_NAMES, RigCamera


def make_camera(interior, *, r0_px=0.0, measured=True, size=(1024, 1024)):
    return RigCamera(
        image_size_px=size,
        interior=np.asarray(interior, dtype=float),
        r0_px=r0_px,
        rotation=np.eye(3),
        translation_mm=np.zeros(3),
        measured=measured,
    )


@pytest.mark.data
def test_projections_of_table_1_cameras(data):
    cameras = json.loads((data / "camera-model/cameras.json").read_text())["cameras"]
    with open(data / "camera-model/projections.csv") as file:
        rows = list(csv.DictReader(file))
    checked = 0
    for name, c in cameras.items():
        camera = make_camera(
            [c["f_px"], c["x0_px"], c["y0_px"], *(c[k] for k in INTERIOR_NAMES[3:])],
            r0_px=c["r0_px"],
            size=tuple(c["image_size_px"]),
        )
        mine = [r for r in rows if r["camera"] == name]
        points = np.array([[float(r[k]) for k in ("X_mm", "Y_mm", "Z_mm")] for r in mine])
        pixels = np.array([[float(r[k]) for k in ("x_px", "y_px")] for r in mine])
        np.testing.assert_allclose(geometry.project(camera, points), pixels, rtol=0, atol=1e-9)
        rays = geometry.rays_through_pixels(camera, pixels)
        np.testing.assert_allclose(
            rays[:, :2] * c["f_px"], points[:, :2] / points[:, 2:] * c["f_px"], rtol=0, atol=1e-9
        )
        checked += len(mine)
    assert checked == len(rows) == 240


# OpenCV: x_d = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2), x = X/Z;
# in pixels and with r0 = 0: A1 = k1/f^2, A2 = k2/f^4, A3 = k3/f^6, B1 = p2/f, B2 = p1/f.
F = 2600.0
K1, K2, P1, P2, K3 = -0.12, 0.3, 4e-4, -7e-4, -0.5


def _opencv(points, x0, y0):
    matrix = np.array([[F, 0, 511.5 + x0], [0, F, 511.5 + y0], [0, 0, 1]])
    pixels, _ = cv2.projectPoints(
        points, np.zeros(3), np.zeros(3), matrix, np.array([K1, K2, P1, P2, K3])
    )
    return pixels.reshape(-1, 2)


def _interior(x0, y0):
    return [F, x0, y0, K1 / F**2, K2 / F**4, K3 / F**6, P2 / F, P1 / F, 0, 0]


@pytest.mark.peer
@pytest.mark.parametrize("seed", [1, 2])
def test_ideal_direction_is_opencvs(seed):
    rng = np.random.default_rng(seed)
    points = rng.uniform([-2000, -2000, 9000], [2000, 2000, 14000], (500, 3))
    camera = make_camera(_interior(12.5, -30.25), measured=False)
    np.testing.assert_allclose(
        geometry.project(camera, points), _opencv(points, 12.5, -30.25), rtol=0, atol=1e-9
    )


@pytest.mark.peer
def test_measured_direction_is_opencvs_polynomial_on_the_measured_point():
    # ideal = measured + d(measured): OpenCV, fed the measured point as a
    # direction, gives the ideal one; then our projection must invert it.
    rng = np.random.default_rng(3)
    pixels = rng.uniform(0, 1023, (500, 2))
    x0, y0 = 12.5, -30.25
    centre = np.array([511.5 + x0, 511.5 + y0])
    measured = np.column_stack([(pixels - centre) / F, np.ones(len(pixels))])
    ideal = _opencv(measured, 0.0, 0.0) - 511.5
    camera = make_camera(_interior(x0, y0))
    rays = geometry.rays_through_pixels(camera, pixels)
    np.testing.assert_allclose(rays[:, :2] * F, ideal, rtol=0, atol=1e-9)
    back = geometry.project(camera, 12000 * rays)
    np.testing.assert_allclose(back, pixels, rtol=0, atol=1e-9)


def test_jacobians_of_the_binding():
    camera = make_camera(_interior(12.5, -30.25))
    points = np.array([[800.0, -900.0, 12000.0], [-300.0, 200.0, 9000.0]])
    _, by_point, by_interior = geometry.project_with_jacobians(camera, points)
    step = 0.05  # central difference: (h^2/6) f''' / f' is below 1e-9 here
    for k in range(3):
        moved = np.zeros(3)
        moved[k] = step
        numeric = (
            geometry.project(camera, points + moved) - geometry.project(camera, points - moved)
        ) / (2 * step)
        np.testing.assert_allclose(by_point[:, :, k], numeric, rtol=1e-6, atol=1e-9)
    plus, minus = (make_camera(np.add(_interior(12.5, -30.25), s * np.eye(10)[0])) for s in (1, -1))
    numeric = (geometry.project(plus, points) - geometry.project(minus, points)) / 2
    np.testing.assert_allclose(by_interior[:, :, 0], numeric, rtol=1e-6)


def test_behind_the_camera_is_nan_not_a_place():
    camera = make_camera(_interior(0, 0))
    assert np.isnan(geometry.project(camera, [[0.0, 0.0, -1.0], [0.0, 0.0, 0.0]])).all()


def test_wrong_shape_names_the_argument():
    with pytest.raises(ValueError, match=r"points_in_cam: expected shape \(N, 3\), got \(3,\)"):
        geometry.project(make_camera(_interior(0, 0)), [1.0, 2.0, 3.0])
