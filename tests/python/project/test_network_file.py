"""network.toml: what is read, and what is said about everything that is wrong."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from videogrammetry.errors import ProjectFileError
from videogrammetry.project.network_file import read_network_file

COMPLETE = """\
schema = 1
observations = "obs.csv"
points = "points.csv"
scale_bars = "bars.csv"
fixed = [1001, "CP2", "007"]
sigma_px = 0.2
datum = "weighted"
snooping = 4
diameter_mm = 12

[cameras.left]
image_size_px = [2272, 1704]
f_mm = 7.5
pixel_mm = 0.003
x0_px = 3.5
A1 = -1e-8
aspect = -4e-4
r0_px = 500
free = ["f", "x0", "aspect"]
sigma = { f = 10.0 }
distortion = "ideal"

[cameras.right]
image_size_px = [2272, 1704]
f_px = 2400

[images."P1.JPG"]
camera = "left"
rotation = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
translation_mm = [0, 0, 1000]

[images.P2]
camera = "right"
cam_from_world = { rotation_rad = [0, 0, 1.5707963267948966], translation_mm = [1, 2, 3] }

[images.P3]
camera = "right"
"""
MINIMAL = """\
schema = 1
observations = "obs.csv"
[cameras.a]
image_size_px = [100, 80]
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "network.toml"
    path.write_text(text)
    return path


def test_a_complete_file(tmp_path: Path) -> None:
    file = read_network_file(write(tmp_path, COMPLETE))
    left, right = file.cameras.values()
    assert file.observations == tmp_path / "obs.csv"
    assert (file.points, file.scale_bars) == (tmp_path / "points.csv", tmp_path / "bars.csv")
    assert file.fixed == ("1001", "CP2", "7")
    assert (file.sigma_px, file.datum, file.critical_value) == (0.2, "weighted", 4.0)
    assert file.diameter_mm == 12
    assert left.start == {"f": 2500.0, "x0": 3.5, "A1": -1e-8, "aspect": -4e-4}
    assert (left.free, left.sigma, left.measured) == (("f", "x0", "aspect"), {"f": 10.0}, False)
    assert (left.r0_px, right.r0_px) == (500.0, None)
    assert (right.free, right.sigma, right.measured) == (None, {}, True)
    first, second, third = file.images.values()
    assert (first.name, first.camera) == ("P1.JPG", "left")
    np.testing.assert_array_equal(first.rotation, [[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    np.testing.assert_allclose(second.rotation, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15)
    np.testing.assert_array_equal(second.translation_mm, [1, 2, 3])
    assert (third.rotation, third.translation_mm) == (None, None)


def test_what_is_not_said(tmp_path: Path) -> None:
    file = read_network_file(write(tmp_path, MINIMAL).parent)
    assert (file.points, file.scale_bars, file.fixed, file.datum) == (None, None, (), None)
    assert (file.sigma_px, file.critical_value, file.images) == (None, 3.29, {})
    assert file.cameras["a"].start == {}


@pytest.mark.parametrize(("value", "critical"), [("false", 0.0), ("true", 3.29), ("2.5", 2.5)])
def test_snooping(tmp_path: Path, value: str, critical: float) -> None:
    file = read_network_file(write(tmp_path, f"snooping = {value}\n" + MINIMAL))
    assert file.critical_value == critical


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("schema = 1", "schema = 2", 1, "newer than this program"),
        ("schema = 1\n", "", None, "schema is missing"),
        ('observations = "obs.csv"\n', "", None, "observations is missing"),
        ("sigma_px = 0.2", "sigma = 0.2", 6, "did you mean 'sigma_px'"),
        ("sigma_px = 0.2", "sigma_px = -1", 6, "greater than 0"),
        ('datum = "weighted"', 'datum = "fre"', 7, "did you mean 'free'"),
        ("snooping = 4", "snooping = 0.01", 8, "critical value from 1"),
        ('fixed = [1001, "CP2", "007"]', "fixed = [1, 1]", 5, "names point 1 twice"),
        ('fixed = [1001, "CP2", "007"]', "fixed = [1.5]", 5, "names or whole numbers"),
        ('points = "points.csv"\n', "", 4, "there is no table of them"),
        ("f_mm = 7.5", "f_px = 7.5", None, "f_mm and pixel_mm together"),
        ("image_size_px = [2272, 1704]\nf_mm", "f_mm", None, "image_size_px is missing"),
        ("x0_px = 3.5", "x0 = 3.5", 15, "did you mean 'x0_px'"),
        ('free = ["f", "x0", "aspect"]', 'free = ["f", "K1"]', 19, "'K1', which is no parameter"),
        ("sigma = { f = 10.0 }", "sigma = { A1 = 1e-9 }", 20, "free does not name"),
        ("sigma = { f = 10.0 }", "sigma = { g = 10.0 }", 20, "g is not a known key"),
        ("aspect = -4e-4", "aspect = 1.0", 17, "square pixels: 0"),
        ('distortion = "ideal"', 'distortion = "brown"', 21, "known: measured, ideal"),
        ('camera = "left"', 'camera = "lift"', 28, "did you mean 'left'"),
        ("translation_mm = [0, 0, 1000]\n", "", 27, "together"),
        ("[0, 0, -1]", "[0, 0, 1]", 29, "no rotation matrix"),
        ("[0, 0, -1]", "[0, 0]", 29, "3 rows of 3 numbers"),
    ],
)
def test_what_is_wrong_is_named(
    tmp_path: Path, old: str, new: str, line: int | None, message: str
) -> None:
    assert old in COMPLETE
    path = write(tmp_path, COMPLETE.replace(old, new, 1))
    with pytest.raises(ProjectFileError) as error:
        read_network_file(path)
    assert message in str(error.value)
    assert str(path) in str(error.value)
    if line is not None:
        assert f"line {line}:" in str(error.value)


def test_no_camera_and_no_file(tmp_path: Path) -> None:
    with pytest.raises(ProjectFileError, match="names no camera"):
        read_network_file(write(tmp_path, 'schema = 1\nobservations = "a.csv"\n'))
    with pytest.raises(ProjectFileError, match="no such network file"):
        read_network_file(tmp_path / "missing.toml")


def test_the_documented_example(tmp_path: Path) -> None:
    """docs/how-to/adjust.md, as it stands and with all that is commented out."""
    page = Path(__file__).parents[3] / "docs" / "how-to" / "adjust.md"
    found = re.search(r"```toml\n(.*?)```", page.read_text(), re.DOTALL)
    assert found is not None
    short = read_network_file(write(tmp_path, found[1]))
    assert short.cameras["hand"].start == {"f": 7.5 / 0.0032}
    full = read_network_file(write(tmp_path, re.sub(r"^#", "", found[1], flags=re.MULTILINE)))
    assert full.cameras["hand"].sigma == {"f": 5.0}
    assert full.images["P1.JPG"].rotation is not None
    assert full.scale_bars == tmp_path / "bars.csv"
