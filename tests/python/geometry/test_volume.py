"""The measuring volume is filled evenly; a camera that looks at a point has it in its middle."""

from __future__ import annotations

import numpy as np
import pytest

from videogrammetry.geometry import MeasuringVolume, point_nearest_to_axes, rotation_looking_at
from videogrammetry.types import RigCamera, RigData

BALL = MeasuringVolume(centre_mm=np.array([1.0, 2, 3]), size_mm=np.full(3, 4.0), shape="sphere")
BOX = MeasuringVolume(centre_mm=np.array([1.0, 2, 3]), size_mm=np.array([4.0, 6, 8]))


@pytest.mark.parametrize("volume", [BALL, BOX], ids=["ball", "box"])
def test_even_numbers_fill_it_evenly(volume):
    count = 20000
    points = volume.fill(np.random.default_rng(1).uniform(size=(count, 3)))
    assert volume.contains(points).all()
    # The second moment of an even filling: size^2 / 12 in a box, radius^2 / 5 in a ball; its
    # estimate from m values scatters by less than sqrt(2 / m) of it.
    expected = 4.0 / 5 if volume.shape == "sphere" else volume.size_mm**2 / 12
    moment = ((points - volume.centre_mm) ** 2).mean(axis=0)
    assert np.abs(moment / expected - 1).max() < 5 * np.sqrt(2 / count)
    assert np.abs((points - volume.centre_mm).mean(axis=0)).max() < 5 * 2.4 / np.sqrt(count)


def test_the_grid_stands_for_equal_parts():
    grid = BOX.grid(4)
    assert len(grid) == 64
    np.testing.assert_allclose([grid.min(axis=0), grid.max(axis=0)],
                               [[-0.5, -0.25, 0], [2.5, 4.25, 6]])  # fmt: skip
    # A ball fills pi / 6 of its cube; its surface cuts of 30^3 cells some 30^2, to both sides.
    assert abs(len(BALL.grid(30)) / 30**3 - np.pi / 6) < 0.01
    assert BALL.contains(BALL.grid(9)).all()
    assert not BALL.contains(BALL.centre_mm + np.array([[2.0, 1.0, 0.0]])).any()


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ({"shape": "cone"}, "shape: expected one of box, sphere"),
        ({"size_mm": np.array([1.0, 0, 1])}, "three lengths above 0"),
        ({"centre_mm": np.array([1.0, np.nan, 1])}, "centre_mm: expected three numbers"),
    ],
)
def test_what_is_no_volume(kind, message):
    with pytest.raises(ValueError, match=message):
        MeasuringVolume(**{"centre_mm": np.zeros(3), "size_mm": np.ones(3), **kind})


@pytest.mark.parametrize("up", [(0, 0, 1), (0, 1, 0), (1, 2, -3)])
def test_a_camera_that_looks_at_a_point(up):
    rng = np.random.default_rng(3)
    for _ in range(20):
        position, point = rng.normal(0, 1000, (2, 3))
        rotation = rotation_looking_at(position, point, up)
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(rotation) > 0
        seen = rotation @ (point - position)
        np.testing.assert_allclose(seen[:2], 0, atol=1e-9)
        assert seen[2] > 0
        # The top of the picture (-y) is where "up" is; its horizontal stays horizontal.
        assert (rotation @ np.array(up))[1] < 0
        assert abs((rotation @ np.array(up))[0]) < 1e-9


def test_straight_down_and_impossible_views():
    down = rotation_looking_at([0, 0, 1000], [0, 0, 0])
    np.testing.assert_allclose(down[2], [0, 0, -1])
    np.testing.assert_allclose(-down[1], [0, 1, 0], atol=1e-12)
    with pytest.raises(ValueError, match="stands on the point"):
        rotation_looking_at([1, 2, 3], [1, 2, 3])
    with pytest.raises(ValueError, match="up: expected a direction"):
        rotation_looking_at([1, 2, 3], [1, 2, 4], [0, 0, 0])


def test_the_point_nearest_to_the_axes():
    point = np.array([100.0, -50, 30])
    places = [[1000.0, 0, 0], [0, 2000, 100], [0, 0, 3000]]
    cameras = {}
    for k, place in enumerate(places):
        rotation = rotation_looking_at(place, point)
        cameras[f"c{k}"] = RigCamera(
            image_size_px=(100, 100), interior=np.r_[100.0, np.zeros(9)], r0_px=40.0,
            rotation=rotation, translation_mm=-rotation @ np.array(place),
        )  # fmt: skip
    np.testing.assert_allclose(point_nearest_to_axes(RigData(cameras=cameras)), point, atol=1e-9)
