"""Circles' pictures against OpenCV's projection of their rims, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from videogrammetry.geometry import ellipse_centres, estimate_normals, project
from videogrammetry.types import RigCamera

cv2 = pytest.importorskip("cv2")

F, K1, K2, P1, P2 = 1900.0, -0.08, 0.12, 3e-4, -5e-4


def opencv_camera() -> RigCamera:
    """The same lens as ``K1`` ... ``P2``: the polynomial of the ideal point, r0 = 0."""
    interior = np.array([F, 12.0, -9.0, K1 / F**2, K2 / F**4, 0, P2 / F, P1 / F, 0, 0])
    return RigCamera(
        image_size_px=(1024, 1024), interior=interior, r0_px=1e-9, rotation=np.eye(3),
        translation_mm=np.zeros(3), measured=False,
    )  # fmt: skip


def fitted_centre(rim: np.ndarray) -> np.ndarray:
    """Centre of the algebraic least-squares conic of points scaled to their own size."""
    middle, scale = rim.mean(axis=0), rim.std()
    x, y = ((rim - middle) / scale).T
    a, b, c, d, e = np.linalg.lstsq(
        np.stack([x * x, x * y, y * y, x, y], axis=1), np.ones(len(x)), rcond=None
    )[0]
    return middle + scale * np.linalg.solve([[2 * a, b], [b, 2 * c]], [-d, -e])


@pytest.mark.parametrize("tilt_deg", [0, 30, 60])
@pytest.mark.parametrize("off_mm", [0.0, 110.0, 220.0])
def test_centres_are_those_of_rims_projected_by_opencv(tilt_deg: float, off_mm: float) -> None:
    camera = opencv_camera()
    matrix = np.array([[F, 0, 511.5 + 12], [0, F, 511.5 - 9], [0, 0, 1]])
    t = np.radians(tilt_deg)
    normal = np.array([np.sin(t) * 0.6, np.sin(t) * 0.8, -np.cos(t)])
    centre = np.array([off_mm, -0.7 * off_mm, 1000.0])
    u = np.cross(normal, [0, 1.0, 0.1])
    u /= np.linalg.norm(u)
    angle = np.linspace(0, 2 * np.pi, 360, endpoint=False)[:, None]
    rim = centre + 8.0 * (np.cos(angle) * u + np.sin(angle) * np.cross(normal, u))
    pixels = cv2.projectPoints(
        rim, np.zeros(3), np.zeros(3), matrix, np.array([K1, K2, P1, P2])
    )[0].reshape(-1, 2)  # fmt: skip
    model = ellipse_centres(camera, centre[None], normal[None], 16.0)[0]
    # The lens' curve shifts the centre by up to 6 |K1| r a^2 / f^2 / 4, r = 510 px and
    # a = 15 px: 4e-3 px. How a fit weights the points of a flat ellipse (its sine) changes
    # a fifth of that, at a round one only the third order: 1 % of it.
    curve = 6 * abs(K1) * 510 * 15**2 / F**2 / 4
    assert np.linalg.norm(model - fitted_centre(pixels)) < curve * (0.01 + 0.2 * np.sin(t))
    if tilt_deg:
        assert np.linalg.norm(model - project(camera, centre[None])[0]) > 10 * curve / 4


@pytest.mark.parametrize(
    ("normal", "diameter", "said"),
    [
        ([0, 0, -1.0], -5.0, "positive"),
        ([0, 0, -1.0], 0.0, "positive"),
        ([0, 0, -1.0], np.nan, "positive"),
        ([0, 0, 0.0], 5.0, "unit length"),
        ([0, 0, np.nan], 5.0, "unit length"),
    ],
)
def test_what_is_no_circle_is_named(normal: list[float], diameter: float, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        ellipse_centres(opencv_camera(), [[0, 0, 1000.0]], [normal], diameter)


def test_a_round_ellipse_faces_its_camera() -> None:
    camera = opencv_camera()
    found = estimate_normals(
        [camera], [0, 1], [0], [[523.5, 502.5, 15.2, 15.2, 0.3]],
        [np.diag([1e-4, 1e-4, 0.5])], [[0, 0, 1000.0]],
    )  # fmt: skip
    # b / a of 1 to 0.01 / 15 sqrt 2 allows tilts of sqrt(2 * 1e-3) = 0.04 rad.
    assert found.normal[0, 2] < -0.99
    assert 0.005 < np.sqrt(np.trace(found.cov[0])) < 0.2
    assert found.diameter_mm[0] == pytest.approx(16.0, rel=1e-3)
