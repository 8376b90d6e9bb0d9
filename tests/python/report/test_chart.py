"""Charts put numbers where their axes say, leave gaps open and let no text become markup."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from videogrammetry.report.axes import Axes, tick_labels, ticks
from videogrammetry.report.chart import Marker, Series, chart
from videogrammetry.report.labels import Labels

SVG = "{http://www.w3.org/2000/svg}"


def drawn(series: list[Series], **options) -> ElementTree.Element:
    labels = {"x_label": "time, s", "y_label": "way, mm", **options}
    return ElementTree.fromstring(chart(series, **labels))


def plot(root: ElementTree.Element) -> tuple[float, ...]:
    """Left, top, width, height of the clip rectangle: the plot's."""
    rect = root.find(f"{SVG}clipPath/{SVG}rect")
    return tuple(float(rect.get(k)) for k in ("x", "y", "width", "height"))


def inside(root: ElementTree.Element) -> list[ElementTree.Element]:
    return list(next(g for g in root.findall(f"{SVG}g") if g.get("clip-path")))


def test_points_stand_at_their_values() -> None:
    x, y = np.array([0.0, 2.0, 10.0]), np.array([-1.0, 3.0, 0.5])
    root = drawn(
        [Series(name="a", x=x, y=y, line=False, points=True)], x_range=(0, 10), y_range=(-1, 4)
    )
    left, top, width, height = plot(root)
    circles = [e for e in inside(root) if e.tag == f"{SVG}circle"]
    places = [(float(c.get("cx")), float(c.get("cy"))) for c in circles]
    expected = np.stack([left + x / 10 * width, top + (4 - y) / 5 * height], axis=1)
    # Places are written with one decimal, the rectangle's too: 0.05 each, twice.
    assert places == pytest.approx(expected, abs=0.16)
    assert [c.find(f"{SVG}title").text for c in circles] == ["0, -1", "2, 3", "10, 0.5"]


def test_ticks_stand_at_their_values() -> None:
    root = drawn([Series(name="", x=[0, 1], y=[0, 1])], x_range=(0, 8), y_range=(-2, 2))
    left, _, width, _ = plot(root)
    texts = root.findall(f"{SVG}text")
    four = next(t for t in texts if t.text == "4" and t.get("text-anchor") == "middle")
    assert float(four.get("x")) == pytest.approx(left + width / 2, abs=0.1)
    assert root.get("role") == "img"
    assert root.get("aria-label") == "way, mm over time, s"


def test_a_gap_stays_open_and_a_lonely_point_is_seen() -> None:
    y = [1.0, 2.0, np.nan, 5.0, np.nan, 1.0, 2.0]
    root = drawn([Series(name="a", x=np.arange(7), y=y)])
    line = next(e for e in inside(root) if e.get("fill") == "none")
    assert line.get("d").count("M") == 3
    assert "h0.01" in line.get("d")
    assert "nan" not in ElementTree.tostring(root, "unicode").lower()


def test_a_band_is_two_sigma_high_and_none_where_it_cannot_be_seen() -> None:
    y, sigma = np.zeros(5), np.full(5, 0.5)
    root = drawn([Series(name="a", x=np.arange(5), y=y, sigma=sigma)], y_range=(-2, 2))
    height = plot(root)[3]
    band = next(e for e in inside(root) if e.get("stroke") == "none")
    levels = [float(v) for v in re.findall(r"[\d.]+ ([\d.]+)", band.get("d"))]
    assert max(levels) - min(levels) == pytest.approx(height / 4, abs=0.2)
    fine = drawn([Series(name="a", x=np.arange(5), y=y, sigma=sigma / 1e3)], y_range=(-2, 2))
    assert len(inside(fine)) == 1


def test_bars_are_two_sigma_high() -> None:
    one = Series(name="a", x=[1], y=[0], sigma=[0.5], sigma_inner=[0.25], line=False, points=True)
    root = drawn([one], y_range=(-2, 2))
    height = plot(root)[3]
    bars = [e.get("d") for e in inside(root) if e.tag == f"{SVG}path"]
    lengths = [float(re.search(r"v([\d.]+)", d)[1]) for d in bars]
    assert lengths == pytest.approx([height / 4, height / 8], abs=0.1)


def test_equal_aspect_makes_units_equally_long() -> None:
    axes = Axes(left=0, top=0, width=300, height=200, x_range=(0, 1), y_range=(0, 10)).equal()
    assert axes.x(1) - axes.x(0) == pytest.approx(axes.y(0) - axes.y(1))
    assert axes.y_range == pytest.approx((0, 10))
    assert sum(axes.x_range) / 2 == pytest.approx(0.5)


def test_markers_keep_out_of_each_other() -> None:
    close = [Marker(5.0, "impact <b>"), Marker(5.1, "largest"), Marker(9.9, "the end of it")]
    root = drawn([Series(name="", x=[0, 10], y=[0, 1])], markers=close)
    text = {t.text: t for t in root.findall(f"{SVG}text")}
    assert float(text["largest"].get("y")) > float(text["impact <b>"].get("y"))
    assert text["the end of it"].get("text-anchor") == "end"  # or it would leave the plot
    # A marker beyond the axis is not drawn.
    assert "far" not in chart([], x_label="x", y_label="y", markers=[Marker(1e9, "far")])


@pytest.mark.parametrize("values", [[], [np.nan, np.nan], [3.0], [0.0, 0.0], [1e-9, 1e9]])
def test_any_values_make_a_chart(values: list[float]) -> None:
    one = Series(name="a & b", x=np.arange(len(values)), y=values, points=True)
    root = drawn([one], equal_aspect=True)
    written = ElementTree.tostring(root, "unicode")
    assert "nan" not in written.lower().replace("and", "")
    assert ("nothing to show" in written) == (not np.isfinite(values).any())


@pytest.mark.parametrize(
    ("low", "high"), [(0, 1), (-3.2, 7.9), (1e-6, 9e-6), (-500, -499), (0, 3e5), (-330, 330)]
)
def test_ticks_are_round_inside_and_few(low: float, high: float) -> None:
    for wanted in (2, 3, 5, 8):
        values = ticks(low, high, wanted)
        assert 2 <= len(values) <= wanted + 3
        assert values[0] >= low - 1e-9 * (high - low)
        assert values[-1] <= high + 1e-9 * (high - low)
        step = values[1] - values[0]
        assert f"{step:.1e}"[:3] in ("1.0", "2.0", "5.0")
        assert len(set(tick_labels(values))) == len(values)


def test_labels_stay_apart() -> None:
    labels = Labels((0, 0, 200, 200))
    texts = [labels.place(str(n), 100 + n, 100, 3, "") for n in range(6)]
    places = {re.search(r'x="([\d.]+)" y="([\d.]+)"', t).groups() for t in texts}
    assert len(places) == 6
    corner = labels.place("12345", 199, 1, 3, "")
    x, y = map(float, re.search(r'x="([\d.]+)" y="([\d.]+)"', corner).groups())
    assert x < 175
    assert y > 8
    crowd = [labels.place("12", 100, 100, 3, "") for _ in range(60)]
    assert crowd[-1] == ""  # no room: better no label than two on each other
