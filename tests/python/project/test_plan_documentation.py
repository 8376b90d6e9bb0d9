"""The plan that the documentation shows is one."""

from __future__ import annotations

import re
from pathlib import Path

from videogrammetry.project import PlanFile, read_plan

PAGE = Path(__file__).parents[3] / "docs" / "how-to" / "plan.md"


def read(text: str, folder: Path) -> PlanFile:
    (folder / "plan.toml").write_text(text)
    return read_plan(folder)


def test_the_example_is_valid_and_its_comments_are_the_defaults(tmp_path: Path) -> None:
    text = re.search(r"```toml\n(.*?)```", PAGE.read_text(), re.DOTALL)[1]
    plan = read(text, tmp_path)
    assert list(plan.rig.cameras) == ["left", "right"]
    left, right = plan.rig.cameras.values()
    assert abs(left.interior[0] - right.interior[0]) < 1e-6
    whole = read(re.sub(r"^#", "", text, flags=re.MULTILINE), tmp_path)
    assert whole.free == ("f", "x0", "y0", "A1", "B1", "B2")
    assert whole.frame == plan.frame
    assert whole.volume.centre_mm.tolist() == plan.volume.centre_mm.tolist() == [0, 0, 0]
    assert whole.target == plan.target
    assert whole.groups == (("left", "right"),)
