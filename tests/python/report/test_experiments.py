"""The experiments' figures and page show their numbers, stand alone and work without parts."""

from __future__ import annotations

import base64
import dataclasses
import io
import json
import re
import xml.etree.ElementTree as ElementTree
from html.parser import HTMLParser

import numpy as np
import pytest
from experiment_fakes import (
    CAMERAS,
    IMPACT,
    POINTS,
    falling_tyre_measurement,
    tyre_page,
    tyre_pictures,
    tyre_rig,
    tyre_scene,
)
from PIL import Image

from videogrammetry.report import (
    ExperimentsPage,
    FileLink,
    Scene,
    deformation_figure,
    displacement_figure,
    displacement_view,
    experiments_page,
    free_fall_figure,
    interactive_view,
    recognised_pictures,
    scale_bar_figure,
    trajectory_figures,
)
from videogrammetry.report.space_view import space_view_script, view_data
from videogrammetry.types import Measurement

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def measurement() -> Measurement:
    return falling_tyre_measurement()


@pytest.fixture(scope="module")
def full() -> ExperimentsPage:
    return tyre_page()


@pytest.fixture(scope="module")
def page(full: ExperimentsPage) -> str:
    return experiments_page(full)


class Elements(HTMLParser):
    """Collects texts, and the places that elements would fetch something from."""

    def __init__(self) -> None:
        super().__init__()
        self.sources: list[str] = []
        self.links: list[str] = []
        self.text: list[str] = []

    def handle_starttag(self, tag: str, attrs: list) -> None:
        for name, value in attrs:
            if name in ("src", "href", "xlink:href", "data", "action", "srcset"):
                (self.links if tag == "a" else self.sources).append(value)

    def handle_data(self, data: str) -> None:
        self.text.append(data)


def elements(page: str) -> Elements:
    parser = Elements()
    parser.feed(page)
    parser.close()
    return parser


def test_the_page_asks_for_nothing(page: str) -> None:
    found = elements(page)
    assert found.sources  # the pictures
    assert all(s.startswith("data:image/") for s in found.sources)
    assert set(re.findall(r"https?://[^\"' <]+", page)) == {"http://www.w3.org/2000/svg"}
    assert not re.search(r"@import|\bfetch\(|XMLHttpRequest|<link|<iframe", page)
    assert all(re.fullmatch(r"url\(#clip-[-\d.]+\)", u) for u in re.findall(r"url\([^)]*\)", page))
    assert found.links == [
        "calibration/rig-report.html",
        "tyre/project.toml",
        "tyre/measurement.h5",
    ]


def test_the_page_has_all_parts(page: str) -> None:
    text = " ".join(elements(page).text)
    for part in (
        "The paper and this run",
        "Calibration",
        "Scale bar",
        "Recognised targets",
        "Displacement in space",
        "Trajectory, displacement and velocity",
        "Free fall",
        "Deformation",
        "Files",
        "How to repeat it",
        "videogrammetry measure tyre/project.toml",
    ):
        assert part in text
    drawings = re.sub(r"<script.*?</script>|base64,[^\"]*", "", page, flags=re.S)
    assert not re.search(r"\bnan\b", drawings)
    for drawing in re.findall(r"<svg.*?</svg>", page, flags=re.S):
        ElementTree.fromstring(drawing)
    assert len(page) < 1_500_000


def test_an_empty_page_and_one_without_any_part(full: ExperimentsPage) -> None:
    text = elements(experiments_page(ExperimentsPage(title="Nothing & more"))).text
    assert "Nothing & more" in text
    assert "Free fall" not in text
    parts = [f.name for f in dataclasses.fields(full) if f.default is None]
    assert len(parts) == 8
    for name in parts:
        without = dataclasses.replace(full, **{name: None})
        if name == "measurement":  # then the targets have to be given, as records or by picture
            without = dataclasses.replace(without, markers=())
        assert "<svg" in experiments_page(without)


def test_texts_do_not_become_markup(full: ExperimentsPage) -> None:
    nasty = "</script><b>&\"'"
    table = dataclasses.replace(full.measurement.trajectories, camera_names=(nasty, *CAMERAS[1:]))
    cameras = {nasty if n == CAMERAS[0] else n: c for n, c in full.rig.cameras.items()}
    changed = dataclasses.replace(
        full,
        title=nasty,
        facts={nasty: nasty},
        measurement=dataclasses.replace(full.measurement, trajectories=table),
        rig=dataclasses.replace(full.rig, cameras=cameras),
        markers=((IMPACT, nasty),),
        stage_notes={1: nasty},
        files=[FileLink(path="http://elsewhere/x", what=nasty), FileLink(path="a&b.csv")],
        provenance={"a": nasty},
    )
    page = experiments_page(changed)
    assert nasty not in page
    assert page.count("</script>") == 2  # data and script of the view
    assert nasty in "".join(elements(page).text)
    found = elements(page)
    assert "a&b.csv" in found.links
    assert not any("elsewhere" in link for link in found.links)


def test_pictures_are_cropped_and_marked_at_their_place() -> None:
    stages = (1, 60)
    pictures = tyre_pictures(stages)
    targets = falling_tyre_measurement(60).targets
    svg = recognised_pictures(
        pictures, targets, stages=stages, camera_names=CAMERAS, crops=dict.fromkeys(
            CAMERAS, (300, 200, 700, 800)
        )
    )  # fmt: skip
    root = ElementTree.fromstring(svg)
    cells = [g for g in root.findall(f"{SVG}g") if g.get("transform")]
    assert len(cells) == 8
    image = cells[0].find(f"{SVG}image")
    scale = float(image.get("width")) / 400
    assert float(image.get("height")) == pytest.approx(600 * scale, abs=0.02)
    with Image.open(io.BytesIO(base64.b64decode(image.get("href").split(",")[1]))) as jpeg:
        assert jpeg.size == (400, 600)
    first = targets.centre_px[(targets.stage == 1) & (targets.camera == 0)]
    ellipses = cells[0].findall(f".//{SVG}ellipse")
    places = [(float(e.get("cx")), float(e.get("cy"))) for e in ellipses]
    # Pixel (300, 200) spans 0 to 1 of the crop. Two decimals: 0.005.
    assert places == pytest.approx((first - (300, 200) + 0.5) * scale, abs=0.02)
    numbers = [t.text for t in cells[0].findall(f"{SVG}text")]
    assert sorted(numbers, key=int) == [str(n) for n in POINTS if n < 12]


def test_automatic_crops_hold_all_targets_and_pictures_may_be_missing() -> None:
    pictures = tyre_pictures((1, 60))
    del pictures[60, CAMERAS[2]]
    targets = falling_tyre_measurement(60).targets
    svg = recognised_pictures(pictures, targets, stages=(1, 60), camera_names=CAMERAS)
    root = ElementTree.fromstring(svg)
    drawn = len(root.findall(f".//{SVG}ellipse"))
    assert drawn == 2 * (2 * 8 + 2 * 10) - 10
    assert svg.count("no picture") == 1
    nothing = recognised_pictures({}, {}, stages=(1,), camera_names=CAMERAS)
    assert nothing.count("no picture") == 4


def points_of(svg: str) -> dict[int, tuple[float, float]]:
    """Place of each point: circles of radius 3 with their title."""
    root = ElementTree.fromstring(svg)
    places = {}
    for circle in root.iter(f"{SVG}circle"):
        title = circle.find(f"{SVG}title")
        if title is not None:
            number = int(re.match(r"point (\d+)", title.text)[1])
            places[number] = (float(circle.get("cx")), float(circle.get("cy")))
    return places


@pytest.mark.parametrize(("view", "axis"), [("front", 0), ("right", 2)])
def test_views_are_to_scale_and_upright(measurement: Measurement, view: str, axis: int) -> None:
    svg = displacement_view(measurement, 60, view=view, scene=tyre_scene())
    drawn = points_of(svg)
    here = dict(zip(POINTS.tolist(), measurement.trajectories.position_mm[59], strict=True))
    first, second = 8, 25
    moved = np.subtract(drawn[second], drawn[first])
    true = here[second] - here[first]
    scale = moved[1] / true[1]  # down in the drawing is y in the camera's frame
    assert scale > 0
    assert moved[0] == pytest.approx(scale * true[axis], abs=0.3)


def test_up_is_what_the_scene_says(measurement: Measurement) -> None:
    """The same fall in a frame with z up, seen along y, gives the same drawing."""
    turn = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # x, z, -y
    turned = dataclasses.replace(
        measurement,
        trajectories=dataclasses.replace(
            measurement.trajectories,
            position_mm=measurement.trajectories.position_mm @ turn.T,
        ),
        motion=dataclasses.replace(
            measurement.motion,
            displacement_mm=measurement.motion.displacement_mm @ turn.T,
            centroid_displacement_mm=measurement.motion.centroid_displacement_mm @ turn.T,
        ),
    )
    other = Scene(up=(0, 0, 1), away=(0, 1, 0))
    for view in ("front", "right"):
        expected = points_of(displacement_view(measurement, 60, view=view))
        found = points_of(displacement_view(turned, 60, view=view, scene=other))
        for number, place in expected.items():
            assert found[number] == pytest.approx(place, abs=0.11)


def test_displacement_figure_names_what_it_cannot_show(measurement: Measurement) -> None:
    with pytest.raises(ValueError, match="stage: 500 was not measured"):
        displacement_figure(measurement, (1, 500))
    with pytest.raises(ValueError, match="view: expected 'front' or 'right', got 'left'"):
        displacement_view(measurement, 1, view="left")
    with pytest.raises(ValueError, match="along up"):
        Scene(up=(0, 0, 1)).axes()
    empty = dataclasses.replace(
        measurement,
        trajectories=dataclasses.replace(
            measurement.trajectories,
            position_mm=np.full_like(measurement.trajectories.position_mm, np.nan),
        ),
        motion=dataclasses.replace(
            measurement.motion,
            displacement_mm=np.full_like(measurement.motion.displacement_mm, np.nan),
        ),
    )
    assert "no point measured" in displacement_figure(empty, (1, 60))
    json.dumps(view_data(empty, None, Scene(), tyre_rig(), 25.0), allow_nan=False)


def test_the_interactive_view_holds_the_measurement(measurement: Measurement) -> None:
    html = interactive_view(measurement, stage=120, scene=tyre_scene(), rig=tyre_rig())
    data = json.loads(re.search(r'application/json">(.*?)</script>', html, flags=re.S)[1])
    assert data["stages"][data["first"]] == 120
    assert data["ids"] == POINTS.tolist()
    here = np.array(data["points"][59], dtype=float).reshape(-1, 3) / 100
    expected = measurement.trajectories.position_mm[59] * (1, -1, 1)  # right, up, away
    assert here == pytest.approx(expected, abs=0.0051)
    gap = np.array(data["points"][41], dtype=object).reshape(-1, 3)[9]
    assert gap.tolist() == [None, None, None]
    assert [c["name"] for c in data["cameras"]] == list(CAMERAS)
    assert len(data["cameras"][0]["corners"]) == 5
    # Every control that the script looks for is there.
    script = space_view_script()
    for name in set(re.findall(r'find\("(\w+)"\)', script)):
        assert f'data-is="{name}"' in html
    assert set(re.findall(r'data-view="(\w+)"', html)) <= set(
        re.findall(r"(\w+): \[", script.split("VIEWS =")[1].split(";")[0])
    )


def test_trajectory_figures_draw_truth_errors_and_markers(
    measurement: Measurement, full: ExperimentsPage
) -> None:
    with_truth = trajectory_figures(measurement, truth=full.truth, markers=((IMPACT, "impact"),))
    assert len(with_truth) == 5
    assert all("impact" in f.svg for f in with_truth)
    assert len(trajectory_figures(measurement)) == 3
    table = dataclasses.replace(measurement.trajectories, time_s=np.full(200, np.nan))
    untimed = trajectory_figures(dataclasses.replace(measurement, trajectories=table))
    assert ">stage<" in untimed[1].svg


def test_free_fall_says_line_and_deviation() -> None:
    x = -np.linspace(0, 800, 100)
    # The paper's line: y = 1.0188 x + 0.9643 is 1.85 % short.
    drawn = free_fall_figure(x, 1.0188 * x + 0.9643, 1.0188, 0.9643)
    assert "y = 1.01880 x + 0.964 mm" in drawn[0].svg
    assert "1.8 % too short" in drawn[0].note
    assert "RMS 0.000 mm" in drawn[1].svg
    assert "too long" in free_fall_figure(x, x, 0.99, -0.5)[0].note
    empty = free_fall_figure([], [], 1.0, 0.0)
    assert "nothing to show" in empty[0].svg
    assert "nan" not in empty[0].svg + empty[1].svg


def test_scale_bar_shows_each_error_and_the_papers() -> None:
    error = np.array([0.1, -0.2, np.nan])
    drawn = scale_bar_figure(error, np.full(3, 0.1), speed_mm_s=[0, 500, 900], limit_mm=0.5)
    assert len(drawn) == 2
    assert "position 1: +0.100 mm" in drawn[0].svg
    assert "position 2: -0.200 mm" in drawn[0].svg
    assert drawn[0].svg.count("<title>paper, position") == 11
    assert "paper" not in drawn[1].svg
    assert len(scale_bar_figure(error, np.full(3, 0.1))) == 1


def test_deformation_map_has_a_pixel_a_value() -> None:
    change = np.array([[0.0, 2.0, -2.0], [np.nan, 1.0, 0.0]])
    drawn = deformation_figure(change, (4, 5, 21))
    data = re.search(r'base64,([^"]+)"', drawn[0].svg)[1]
    with Image.open(io.BytesIO(base64.b64decode(data))) as image:
        pixels = np.asarray(image)
    assert pixels.shape == (3, 2, 3)  # a row a point, a column a stage
    assert pixels[0, 0].tolist() == [247, 248, 250]
    assert pixels[1, 0, 0] > pixels[1, 0, 2]  # longer: red
    assert pixels[2, 0, 2] > pixels[2, 0, 0]  # shorter: blue
    assert pixels[0, 1].tolist() == [208, 213, 220]  # not measured: grey
    assert "point 5" in drawn[1].svg
    assert "point 21" in drawn[1].svg
    deformation_figure(np.full((3, 2), np.nan), (1, 2))
