"""Plans from design to prediction, and the page that shows them."""

from __future__ import annotations

import dataclasses
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from plan_rigs import camera, facing_rig, pair_rig
from plan_targets import two_sided
from two_pairs import two_pair_rig

from videogrammetry.calibration import flat_board
from videogrammetry.errors import MeasurementError
from videogrammetry.geometry import MeasuringVolume
from videogrammetry.pipeline import PlanOptions, plan_columns, plan_document, plan_rig
from videogrammetry.report import plan_page
from videogrammetry.types import RigData

VOLUME = MeasuringVolume(centre_mm=np.zeros(3), size_mm=np.array([800.0, 600, 700]))
BOARD = flat_board((500.0, 400.0))
FAST = PlanOptions(sigma_px=0.03, counts=(4, 8), places=5, section=15, length_mm=300.0)


@pytest.fixture(scope="module")
def plan():
    return plan_rig(pair_rig(), BOARD, volume=VOLUME, options=FAST)


def test_a_plan_has_all_its_parts(plan):
    assert not plan.calibrated
    assert len(plan.design.world_from_target) == 16
    assert plan.options.free == ("f", "x0", "y0", "A1", "B1", "B2")
    for quantity in ("sigma_x", "sigma_y", "sigma_z", "position", "distance"):
        by = plan.statistics[quantity]
        assert 0 < by["image"].median_mm < by["together"].most_mm <= by["together"].worst_mm
        assert by["calibration"].median_mm > 0
    assert [row.count for row in plan.counts] == [4, 8]
    assert plan.counts[0].distance_calibration_mm > plan.counts[1].distance_calibration_mm
    # The table and the statistics are of the same places: their numbers are comparable.
    sixteen = dataclasses.replace(FAST, counts=(16,))
    (row,) = plan_rig(pair_rig(), BOARD, volume=VOLUME, options=sixteen).counts
    assert row.distance_mm == pytest.approx(plan.statistics["distance"]["together"].most_mm)
    assert row.position_mm == pytest.approx(plan.statistics["position"]["together"].most_mm)
    assert len(plan.sections) == 3
    assert [s.axes for s in plan.sections] == [(0, 1, 2), (0, 2, 1), (1, 2, 0)]
    across, up, held = plan.sections[1].axes
    points = plan.sections[1].places.position_mm.reshape(*plan.sections[1].inside.shape, 3)
    np.testing.assert_allclose(points[0, :, across], plan.sections[1].across_mm)
    np.testing.assert_allclose(points[:, 0, up], plan.sections[1].up_mm)
    assert (points[..., held] == 0).all()
    document = plan_document(plan)
    assert document["calibration"] == "simulated design"
    assert set(document["statistics_mm"]["distance"]["image"]) == {
        "median_mm", "most_mm", "worst_mm", "rms_mm",
    }  # fmt: skip
    header, columns = plan_columns(plan)
    assert len(header) == len(columns) == 14
    assert {len(c) for c in columns} == {125}


def test_the_frame_of_the_volume_is_the_quieter_one(plan):
    other = plan_rig(
        pair_rig(), BOARD, volume=VOLUME, options=dataclasses.replace(FAST, frame="rig")
    )
    volume, rig = (p.statistics["position"]["calibration"].rms_mm for p in (plan, other))
    assert volume < 0.8 * rig
    # Distances know no frame.
    assert plan.statistics["distance"]["calibration"].rms_mm == pytest.approx(
        other.statistics["distance"]["calibration"].rms_mm, rel=1e-6
    )


def test_what_is_wanted_takes_as_many_positions_as_it_does():
    base = plan_rig(pair_rig(), BOARD, volume=VOLUME, options=FAST)
    image = base.statistics["distance"]["image"].most_mm
    wanted = dataclasses.replace(FAST, wanted_mm=1.15 * base.counts[1].distance_mm)
    needed = plan_rig(pair_rig(), BOARD, volume=VOLUME, options=wanted).needed
    assert needed.count is not None
    assert 1 < needed.count <= 8
    assert needed.sigma_mm <= wanted.wanted_mm
    assert needed.tried[needed.count - 1] > wanted.wanted_mm
    hopeless = dataclasses.replace(FAST, wanted_mm=0.5 * image, wanted_of="position")
    none = plan_rig(pair_rig(), BOARD, volume=VOLUME, options=hopeless)
    assert none.needed.count is None
    assert "cannot be reached: the image noise alone" in plan_page(none)


def test_a_calibrated_rig_keeps_its_own_covariance_unless_positions_are_asked_for():
    rig = two_pair_rig(np.random.default_rng(1))
    options = dataclasses.replace(FAST, counts=(8,), groups=(("cam1", "cam2"), ("cam3", "cam4")))
    own = plan_rig(rig, two_sided(), options=options)
    assert own.calibrated
    assert own.design is None
    np.testing.assert_array_equal(own.rig.cov, rig.cov)
    assert own.options.free == ("f", "x0", "y0", "A1")  # what its calibration estimated
    low, high = rig.volume_mm.min(axis=0), rig.volume_mm.max(axis=0)
    np.testing.assert_allclose(own.volume.size_mm, high - low)
    new = plan_rig(rig, two_sided(), options=dataclasses.replace(options, positions=10))
    assert not new.calibrated
    assert len(new.design.world_from_target) == 10
    assert "its own" in plan_page(own)


def test_without_a_volume_it_is_where_the_cameras_look():
    found = plan_rig(pair_rig(), BOARD, options=FAST).volume
    assert found.shape == "sphere"
    np.testing.assert_allclose(found.centre_mm, 0, atol=1e-6)
    # 0.9 of half the picture at 4000 mm and f = 2000 px.
    np.testing.assert_allclose(found.size_mm, 2 * 0.9 * 500 * 4000 / 2000)
    parallel = RigData(
        cameras={"a": camera([0, 0, 0], (0, 1000, 0)), "b": camera([500, 0, 0], (500, 1000, 0))}
    )
    with pytest.raises(ValueError, match="do not look at one place"):
        plan_rig(parallel, BOARD, options=FAST)


def test_what_cannot_be_planned_is_said():
    one = RigData(cameras={"left": pair_rig().cameras["left"]})
    with pytest.raises(ValueError, match="a plan needs two cameras or more, got 1"):
        plan_rig(one, BOARD, volume=VOLUME, options=FAST)
    away = MeasuringVolume(centre_mm=np.array([0.0, -9000, 0]), size_mm=np.full(3, 500.0))
    with pytest.raises(MeasurementError, match="nowhere seen by two cameras .*left 0 %, right 0 %"):
        plan_rig(pair_rig(), BOARD, volume=away, options=FAST)
    wrong = dataclasses.replace(FAST, groups=(("left", "top"),))
    with pytest.raises(ValueError, match="groups: camera 'top' is not in the rig"):
        plan_rig(pair_rig(), BOARD, volume=VOLUME, options=wrong)
    too_long = dataclasses.replace(FAST, length_mm=5000.0, wanted_mm=1.0)
    with pytest.raises(MeasurementError, match="shorter length_mm"):
        plan_rig(pair_rig(), BOARD, volume=VOLUME, options=too_long)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"wanted_of": "area"}, "wanted_of: expected distance or position"),
        ({"sigma_px": -1.0}, "sigma_px: expected a number above 0"),
        ({"wanted_mm": float("nan")}, "wanted_mm: expected a number above 0"),
        ({"positions": 0}, "positions: expected 1 or more"),
        ({"free": ("K1",)}, "'K1' is no interior parameter"),
    ],
)
def test_wrong_options(wrong, message):
    with pytest.raises(ValueError, match=message):
        PlanOptions(**wrong)


def test_what_is_partly_seen_is_said():
    wide = MeasuringVolume(centre_mm=np.zeros(3), size_mm=np.array([2600.0, 600, 600]))
    plan = plan_rig(pair_rig(), BOARD, volume=wide, options=FAST)
    assert 0 < plan.part_seen < 1
    assert any("seen by fewer than two cameras" in w for w in plan.warnings)
    assert "not seen by two" in plan_page(plan)


class Texts(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.text: list[str] = []
        self.images = 0

    def handle_starttag(self, tag: str, attrs: list) -> None:
        self.images += tag == "image"

    def handle_data(self, data: str) -> None:
        self.text.append(data)


def test_the_page_shows_it_and_asks_for_nothing(plan):
    page = plan_page(plan, "Hall <3> & more", {"version": "x<y"})
    parser = Texts()
    parser.feed(page)
    text = " ".join(parser.text)
    assert "Hall <3> & more" in text
    for words in (
        "Where the cameras stand", "Over the volume", "Where it is how sure", "Coordinates",
        "Cameras and angles", "How many positions of the target", "Angles and bases",
        "distance of 300 mm", "xz at y = 0 mm", "x<y",
    ):  # fmt: skip
        assert words in text, words
    assert f"{plan.statistics['distance']['together'].most_mm:.3g}" in text
    # Three sections: of the position by three causes, of x, y, z by three, of cameras and angles.
    assert parser.images == 3 * (3 + 3 + 3 + 3 + 2)
    assert not re.search(r"<(script|link|img|iframe)|@import", page)
    assert set(re.findall(r"https?://[^\"' ]+", page)) == {"http://www.w3.org/2000/svg"}
    assert set(re.findall(r'href="([^,"]*)', page)) == {"data:image/png;base64"}


def test_facing_pairs_need_a_target_with_two_sides():
    plan = plan_rig(facing_rig(), two_sided(), volume=VOLUME, options=FAST)
    assert len(plan.pairs) == 6
    assert plan.statistics["position"]["together"].most_mm > 0


def test_what_is_said_of_bases_and_of_positions(plan):
    page = plan_page(plan)
    assert "left and right meet at 40 degrees" in page
    wide = plan_rig(pair_rig(70.0), BOARD, volume=VOLUME, options=FAST)
    assert "meet at" not in plan_page(wide)
    # A poor target: its scale, which all positions share, is all that is left.
    poor = dataclasses.replace(FAST, target_sigma_mm=3.0, counts=(8, 32), sigma_px=0.005)
    assert "the target's own coordinates (sigma 3 mm)".replace("'", "&#x27;") in plan_page(
        plan_rig(pair_rig(), BOARD, volume=VOLUME, options=poor)
    )
    assert "own coordinates" not in page
