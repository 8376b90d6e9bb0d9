"""The project file that the documentation shows is one."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from videogrammetry.project import Project, TargetsSection, read_project

PAGE = Path(__file__).parents[3] / "docs" / "how-to" / "first-measurement.md"


def example() -> str:
    return re.search(r"```toml\n(.*?)```", PAGE.read_text(), re.DOTALL)[1]


def read(text: str, folder: Path) -> Project:
    (folder / "project.toml").write_text(text)
    return read_project(folder)


def test_the_example_is_valid(tmp_path: Path) -> None:
    project = read(example(), tmp_path)
    assert project.name == "falling tyre"
    assert project.cameras["left"].start == {"f_px": 2640.0}
    assert project.targets == TargetsSection()  # "the default that is shown"


def test_so_it_is_with_everything_that_is_commented_out(tmp_path: Path) -> None:
    text = re.sub(r"^#", "", example(), flags=re.MULTILINE)
    project = read(text, tmp_path)
    assert project.sequence.last == 200
    assert project.calibration.scale_bars == tmp_path.resolve() / "bars.csv"
    assert project.stability.points == tmp_path.resolve() / "static.csv"
    assert project.cameras["left"].interface == "front"
    assert project.cameras["right"].first_frame == 4
    assert project.rig_path == tmp_path.resolve() / "../rig.json"
    assert project.interfaces["front"].normal == (0.0, 0.0, 1.0)
    assert project.cameras["right"].r0_px == pytest.approx(482.7)


def test_the_tank_is_one(tmp_path: Path) -> None:
    text = re.search(r"```toml\n(.*?)```", (PAGE.parent / "tank.md").read_text(), re.DOTALL)[1]
    project = read("schema = 1\n" + re.sub(r"^#", "", text, flags=re.MULTILINE), tmp_path)
    window = project.interfaces["front"]
    assert project.cameras["c2"].interface == "front"
    assert (window.glass, window.free) == ((1.5, 6.0), ("normal", "distance"))
    assert (window.sigma_normal_deg, window.sigma_distance_mm) == (1.0, 5.0)
