"""Photographs of the cross: what they see, where they stand."""

from __future__ import annotations

import numpy as np
import pytest

from videogrammetry.recognition import code_family
from videogrammetry.rendering import Renderer
from videogrammetry.rendering.scenes import photos_scene
from videogrammetry.rendering.scenes.photos import BARS_MM

FAMILY = code_family("schneider-14")
SEEDS = (0, 1, 2)


@pytest.fixture(scope="module", params=SEEDS)
def photos(request):
    return photos_scene(FAMILY, seed=request.param)


def test_photographs_see_every_point_and_tie_the_sides(photos):
    targets = photos.targets()
    seen = np.array([Renderer(c).truth(targets).visible for c in photos.cameras.values()])
    on_cross = np.arange(len(photos.marks)) < len(photos.cross.marks)
    assert seen[:, on_cross].sum(axis=0).min() >= 6
    coded = (seen & (photos.marks.id > 0)).astype(int)
    common = coded @ coded.T >= 4
    reached = {0}
    for _ in range(len(common)):
        reached |= {int(k) for k in np.flatnonzero(common[sorted(reached)].any(axis=0))}
    assert len(reached) == len(photos.cameras)
    # Both sides are seen, never in one picture: only the surroundings tie them.
    front = seen[:, :49].sum(axis=1) > 10
    back = seen[:, 49:98].sum(axis=1) > 10
    assert front.sum() > 5
    assert back.sum() > 5


def test_photographs_stand_where_they_are_asked_to(photos):
    assert list(photos.cameras)[:2] == ["photos_000001", "photos_000002"]
    floor = 1050.0
    for index, camera in enumerate(photos.cameras.values()):
        ring, station = divmod(index, 8)
        x, y, z = camera.centre_mm
        # A hand's scatter is 40 mm and 0.04 rad: five of them.
        assert floor - y == pytest.approx((500, 1400, 2400)[ring], abs=200)
        assert np.hypot(x, z) == pytest.approx(3200, abs=200)
        turn = np.arctan2(x, -z) - np.radians(45 * station)
        off = np.angle(np.exp(1j * (turn - np.radians(7.0 * ring))))
        assert abs(off) < 5 * (0.04 + 40 / 3200)
        down = camera.rotation @ [0, 1, 0]  # of the world, in the picture
        rolled = abs(down[0]) > abs(down[1])
        assert rolled == ((station + ring) % 3 == 0)


def test_photographed_bars_are_exact(photos):
    assert [length for _, _, length in photos.bars] == list(BARS_MM)
    places = dict(zip(photos.marks.point.tolist(), photos.place.centre_mm, strict=True))
    for a, b, length in photos.bars:
        assert np.linalg.norm(places[a] - places[b]) == pytest.approx(length, abs=1e-9)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"step_deg": 1.0}, "step: expected 5"),
        ({"distance_mm": 500.0}, "distance"),
        ({"distance_mm": np.nan}, "distance"),
        ({"heights_mm": []}, "heights"),
        ({"heights_mm": [500.0, -10.0]}, "heights"),
        ({"heights_mm": [np.nan]}, "heights"),
        ({"image_size_px": (0, 100)}, "size"),
    ],
)
def test_impossible_photographs(options, message):
    with pytest.raises(ValueError, match=message):
        photos_scene(FAMILY, **options)
