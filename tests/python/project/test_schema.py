"""project.toml: what is read, and what is said about everything that is wrong."""

from __future__ import annotations

from pathlib import Path

import pytest

from videogrammetry.errors import ProjectFileError
from videogrammetry.pipeline.calibrate import calibration_interfaces
from videogrammetry.pipeline.frames import recognition_options
from videogrammetry.project import read_project

COMPLETE = """\
schema = 1
name = "panel"

[cameras.left]
calibration = "cal/left_*.tif"
sequence = ["seq/left", "more/left.tif"]
image_size_px = [2000, 1333]
free = ["f", "x0", "y0"]
r0_px = 700

[cameras.left.start]
f_mm = 24
pixel_mm = 0.004
A1 = 1e-8

[cameras."right 2"]
calibration = "right.csv"
image_size_px = [2000, 1333]

[calibration]
target = "cross.csv"
sigma_mm = 0.1
scale_bars = "bars.csv"
free = ["f", "x0", "y0", "A1"]
r0_px = 800.5

[targets]
codes = "metashape-12"
direction = "counter-clockwise"
polarity = "black-on-white"
diameter_px = [8, 60]
diameter_mm = 10
thickness_mm = 0.2

[sequence]
frame_rate_hz = 500
first = 3
last = 20

[stability]
points = "static.csv"

[motion]
reference_stage = 3
fill_gaps = 8
leave_out = ["large_residual", "unstable_camera"]
filter = "butterworth"
filter_cutoff_hz = 50.0
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "project.toml"
    path.write_text(text)
    return path


def test_a_complete_project(tmp_path: Path) -> None:
    project = read_project(write(tmp_path, COMPLETE))
    left, right = project.cameras.values()
    assert project.name == "panel"
    assert list(project.cameras) == ["left", "right 2"]
    assert left.calibration == ("cal/left_*.tif",)
    assert left.sequence == ("seq/left", "more/left.tif")
    assert left.image_size_px == (2000, 1333)
    assert left.start == {"f_px": 6000.0, "A1": 1e-8}
    assert (left.free, left.r0_px) == (("f", "x0", "y0"), 700.0)
    assert (right.free, right.r0_px) == (("f", "x0", "y0", "A1"), 800.5)
    assert (left.observations, right.observations) == (None, "right.csv")
    assert project.calibration.target == tmp_path.resolve() / "cross.csv"
    assert project.calibration.sigma_mm == 0.1
    assert project.targets.codes == "metashape-12"
    assert project.targets.diameter_px == (8.0, 60.0)
    assert project.targets.estimator == "auto"
    assert (project.sequence.first, project.sequence.last) == (3, 20)
    assert project.stability.points == tmp_path.resolve() / "static.csv"
    assert project.motion.reference_stage == 3
    assert project.motion.fill_gaps == 8
    assert project.motion.leave_out == ("large_residual", "unstable_camera")
    assert project.rig_path == tmp_path.resolve() / "rig.json"


def test_defaults_and_a_folder_for_its_project_file(tmp_path: Path) -> None:
    write(tmp_path, "schema = 1\n[cameras.1]\n")
    project = read_project(tmp_path)
    assert project.name == tmp_path.name
    assert project.targets.codes == "schneider-14"
    assert project.targets.direction == "clockwise"
    assert project.targets.polarity == "white-on-black"
    assert project.targets.diameter_px == (5.0, 200.0)
    assert project.cameras["1"].free is None
    assert (project.sequence.first, project.sequence.last) == (1, None)


def test_free_by_camera(tmp_path: Path) -> None:
    text = 'schema = 1\n[cameras.a]\n[cameras.b]\n[calibration.free]\na = ["f"]\n'
    project = read_project(write(tmp_path, text))
    assert project.cameras["a"].free == ("f",)
    assert project.cameras["b"].free is None


def test_an_empty_list_frees_nothing(tmp_path: Path) -> None:
    text = 'schema = 1\n[cameras.a]\n[cameras.b]\nfree = ["f"]\n[calibration]\nfree = []\n'
    project = read_project(write(tmp_path, text))
    assert project.cameras["a"].free == ()
    assert project.cameras["b"].free == ("f",)
    own = 'schema = 1\n[cameras.a]\nfree = []\n[calibration]\nfree = ["f"]\n'
    assert read_project(write(tmp_path, own)).cameras["a"].free == ()
    with pytest.raises(ProjectFileError, match="line 3: .*free"):
        read_project(write(tmp_path, 'schema = 1\n[cameras.a]\nfree = [""]\n'))


def test_estimator_is_taken_to_recognition(tmp_path: Path) -> None:
    text = COMPLETE.replace("[targets]\n", '[targets]\nestimator = "model"\n')
    project = read_project(write(tmp_path, text))
    assert recognition_options(project.targets).estimator == "model"
    with pytest.raises(ProjectFileError, match="estimator.*mean-gradient"):
        read_project(write(tmp_path, text.replace('"model"', '"mean"')))


#: (what replaces what in COMPLETE, line that must be named, words that must be there)
WRONG = [
    ("sigma_mm = 0.1", "sigma_m = 0.1", 22, ["sigma_m", "'sigma_mm'", "[calibration]"]),
    ('calibration = "cal/', 'callibration = "cal/', 5, ["callibration", "'calibration'"]),
    ("[stability]", "[stabilty]", 40, ["stabilty", "'stability'"]),
    ("A1 = 1e-8", "A4 = 1e-8", 14, ["A4", "did you mean 'A", "[cameras.left.start]"]),
    ('"x0", "y0", "A1"]', '"x0", "y0", "A9"]', 24, ["A9", "free"]),
    ("sigma_mm = 0.1", 'sigma_mm = "0.1"', 22, ["sigma_mm", "wrong type", "number"]),
    ("sigma_mm = 0.1", "sigma_mm = -0.1", 22, ["sigma_mm", "greater than 0"]),
    ("sigma_mm = 0.1", "sigma_mm = nan", 22, ["sigma_mm", "out of range"]),
    ("sigma_mm = 0.1", "sigma_mm = true", 22, ["sigma_mm", "wrong type"]),
    ("[8, 60]", "[60, 8]", 31, ["diameter_px", "smallest"]),
    ("[8, 60]", "[8]", 31, ["diameter_px"]),
    ("[8, 60]", '["8", 60]', 31, ["diameter_px"]),
    ("first = 3", "first = 0", 37, ["first", "1 or more"]),
    ("last = 20", "last = 2", 38, ["last", "before first"]),
    ("last = 20", "last = 20.5", 38, ["last", "whole number"]),
    ('"counter-clockwise"', '"counterclockwise"', 29, ["direction", "'counter-clockwise'"]),
    ('"metashape-12"', '"metashape12"', 28, ["codes", "schneider-14"]),
    ('calibration = "right.csv"', 'calibration = ["right.csv", "a.tif"]', 17, ["mixes"]),
    ('"right.csv"\nimage_size_px = [2000, 1333]', '"right.csv"', 17, ["image_size_px"]),
    ("pixel_mm = 0.004\n", "", 11, ["f_mm and pixel_mm"]),
    ("pixel_mm = 0.004", "pixel_mm = 0.004\nf_px = 1", 12, ["f_mm", "f_px", "take one away"]),
    ('[cameras."right 2"]', '[cameras."a+b"]', 16, ["a+b", "camera name"]),
    ('["large_residual", ', '["large", ', 46, ("leave_out", "'large'", "two_rays")),
    ("fill_gaps = 8", "fill_gaps = 101", 45, ["fill_gaps", "0 to 100"]),
    ("fill_gaps = 8", "fill_gaps = -1", 45, ["fill_gaps", "0 or more"]),
    ("filter_cutoff_hz = 50.0", "", 47, ["filter_cutoff_hz"]),
    ("schema = 1", "schema = 2", 1, ["newer", "update"]),
    ("schema = 1", "schema = 0", 1, ["schema"]),
    ('sequence = ["seq/left", "more/left.tif"]', "sequence = []", 6, ["sequence"]),
]


@pytest.mark.parametrize(("old", "new", "line", "words"), WRONG)
def test_each_mistake_names_its_line(
    tmp_path: Path, old: str, new: str, line: int, words: list[str]
) -> None:
    assert old in COMPLETE
    path = write(tmp_path, COMPLETE.replace(old, new, 1))
    with pytest.raises(ProjectFileError) as caught:
        read_project(path)
    message = str(caught.value)
    assert message.startswith(f"{path}, line {line}: ")
    assert "\n" not in message
    for word in words:
        assert word in message


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ["schema is missing", "schema = 1"]),
        ("schema = 1\n", ["no camera", "[cameras.NAME]"]),
        ("schema = 1\n[cameras.a\n", ["not valid TOML", "line 2"]),
        ("schema = 1\n[camera.a]\n", ["line 2", "'cameras'"]),
        ("schema = 1\ncameras = 3\n", ["line 2", "cameras", "wrong type"]),
        ("schema = 1\ncameras = { left = { callibration = 'a' } }\n", ["line 2", "calibration"]),
        ("schema = 1\n" + "".join(f"[cameras.c{i}]\n" for i in range(65)), ["65 cameras", "64"]),
    ],
)
def test_broken_files(tmp_path: Path, text: str, words: list[str]) -> None:
    path = write(tmp_path, text)
    with pytest.raises(ProjectFileError) as caught:
        read_project(path)
    for word in (str(path), *words):
        assert word in str(caught.value)


def test_no_such_project(tmp_path: Path) -> None:
    with pytest.raises(ProjectFileError, match="no such project file"):
        read_project(tmp_path / "nothere.toml")


def test_not_text(tmp_path: Path) -> None:
    path = tmp_path / "project.toml"
    path.write_bytes(b"schema = 1\nname = '\xff'\n")
    with pytest.raises(ProjectFileError, match="UTF-8"):
        read_project(path)


WINDOWS = """
[interfaces.front]
normal = [0, 0, 2]
distance_mm = -12.5
fluid = 1.3337
glass = [1.5, 6]
free = ["normal", "distance"]
sigma_normal_deg = 1
sigma_distance_mm = 2

[interfaces.back]
normal = [0, 0, -1]
distance_mm = 125
frame = "rig"
"""


def with_windows(old: str = "", new: str = "") -> str:
    text = COMPLETE.replace("r0_px = 700", 'r0_px = 700\ninterface = "front"') + WINDOWS
    return text.replace(old, new, 1)


def test_windows(tmp_path: Path) -> None:
    project = read_project(write(tmp_path, with_windows()))
    assert project.cameras["left"].interface == "front"
    assert project.cameras["right 2"].interface is None
    front, back = project.interfaces["front"], project.interfaces["back"]
    assert front.normal == (0.0, 0.0, 1.0)
    assert (front.distance_mm, front.fluid, front.glass) == (-12.5, 1.3337, (1.5, 6.0))
    assert (front.free, front.frame) == (("normal", "distance"), "target")
    assert (back.free, back.frame, back.glass, back.fluid) == ((), "rig", None, 1.333)
    one, two = calibration_interfaces(project)
    assert one.interface.glass_thickness_mm == 6.0
    assert one.prior_sigma == pytest.approx({"normal": 0.0174533, "distance": 2.0}, rel=1e-5)
    assert (two.interface.name, two.frame, two.prior_sigma) == ("back", "rig", {})


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('interface = "front"', 'interface = "frnt"', ["[interfaces.frnt]", "'front'"]),
        ("normal = [0, 0, 2]", "normal = [0, 0, 0]", ["normal", "not all zero"]),
        ("fluid = 1.3337", "fluid = 0.75", ["fluid", "1 to 4"]),
        ("glass = [1.5, 6]", "glass = [6, 1.5]", ["glass", "thickness"]),
        ('"normal", "distance"', '"normal", "index"', ["free", "'index'"]),
        ('frame = "rig"', 'frame = "world"', ["frame", "known: target, rig"]),
        ("distance_mm = 125\n", "", ["distance_mm"]),
        ("fluid = 1.3337", "fluids = 1.3337", ["fluids", "'fluid'"]),
    ],
)
def test_wrong_windows(tmp_path: Path, old: str, new: str, words: list[str]) -> None:
    with pytest.raises(ProjectFileError) as raised:
        read_project(write(tmp_path, with_windows(old, new)))
    for word in words:
        assert word in str(raised.value)
