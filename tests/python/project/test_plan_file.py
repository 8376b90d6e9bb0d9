"""plan.toml: everything is read, everything wrong is named with its line."""

from __future__ import annotations

import numpy as np
import pytest
from plan_rigs import PLAN, pair_rig

from videogrammetry.errors import ProjectFileError
from videogrammetry.project import read_plan, write_rig


def plan(tmp_path, text):
    path = tmp_path / "plan.toml"
    path.write_text(text)
    return read_plan(path)


def test_a_plan_is_read(tmp_path):
    found = plan(tmp_path, PLAN)
    assert found.name == "bench"
    assert list(found.rig.cameras) == ["left", "right"]
    left, right = found.rig.cameras.values()
    assert left.interior[0] == right.interior[0] == 2000.0
    np.testing.assert_allclose(left.centre_mm, [-1368, -3758, 0])
    np.testing.assert_allclose(left.rotation @ -left.centre_mm, [0, 0, np.hypot(1368, 3758)],
                               atol=1e-9)  # fmt: skip
    assert found.volume.shape == "box"
    assert found.volume.centre_mm.tolist() == [0, 0, 0]
    assert (found.target.kind, found.target.size_mm) == ("board", (500.0, 400.0))
    assert (found.target.sigma_mm, found.sigma_px, found.positions) == (0.05, 0.03, 8)
    assert found.length_mm == 400


def test_the_rest_of_a_plan(tmp_path):
    write_rig(tmp_path / "rig.json", pair_rig())
    text = """rig = "rig.json"
free = ["f", "A1"]
frame = "rig"
[groups]
front = ["left", "right"]
[volume]
centre_mm = [1, 2, -3]
radius_mm = 250
[target]
points = "cross.csv"
"""
    found = plan(tmp_path, text)
    assert found.groups == (("left", "right"),)
    assert found.free == ("f", "A1")
    assert found.frame == "rig"
    assert found.volume.shape == "sphere"
    assert found.volume.size_mm.tolist() == [500.0] * 3
    assert found.target.points == tmp_path / "cross.csv"
    assert (tmp_path / "rig.json") in found.inputs
    bare = read_plan(tmp_path / "rig.json")
    assert bare.volume is None
    assert list(bare.rig.cameras) == ["left", "right"]
    assert read_plan(tmp_path).frame == "rig"  # the folder's plan.toml


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("sigma_px", "sigma_pix", r"line 3: sigma_pix is not a known key: did you mean 'sigma_px'"),
        ("look_at_mm", "lookat_mm", r"\[cameras.left\] look_at_mm is missing"),
        ("f_mm = 20\n", "", "needs f_px, or f_mm and pixel_mm"),
        ("pixel_mm = 0.01\n", "", "needs f_px, or f_mm and pixel_mm"),
        ("f_px = 2000", "f_px = -5", "f_px = -5 is out of range"),
        ("look_at_mm = [0, 0, 0]", "look_at_mm = [-1368, -3758, 0]", "stands on the point"),
        ("size_mm = [800, 600, 700]", "", "needs size_mm of a box, or radius_mm of a ball"),
        ("size_mm = [800, 600, 700]", "size_mm = [800, 600]", "size_mm = .* is wrong"),
        ('kind = "board"', 'kind = "bord"', "'bord' is not known: did you mean 'board'"),
        ('kind = "board"', 'points = "a.csv"', 'size_mm belongs to kind = "board"'),
        ('kind = "board"', 'kind = "board"\nspan_mm = 3', "span_mm belongs to the cross"),
        ('kind = "board"', 'kind = "board"\ngrid = [1, 5]', "expected 2 x 2 points or more"),
        ("positions = 8", "positions = 0", "positions = 0 is too small"),
        ("positions = 8", 'free = ["g"]', "names no interior parameter 'g'"),
        ("positions = 8", 'frame = "world"', "frame = 'world' is not known"),
        ("positions = 8", 'groups = {a = ["left", "rigth"]}', "names no camera 'rigth'"),
        ("positions = 8", 'groups = {a = ["left"]}', "needs two cameras or more"),
        ("schema = 1", "schema = 9", "is newer than this program"),
        ("schema = 1", 'rig = "rig.json"', r"one of rig = .* and \[cameras.NAME\] must say"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, old, new, message):
    assert old in PLAN
    with pytest.raises(ProjectFileError, match=message) as error:
        plan(tmp_path, PLAN.replace(old, new, 1))
    assert "plan.toml" in str(error.value)


def test_no_file_no_camera(tmp_path):
    with pytest.raises(ProjectFileError, match=r"neither plan.toml nor rig.json"):
        read_plan(tmp_path)
    with pytest.raises(ProjectFileError, match="there is no such file"):
        read_plan(tmp_path / "absent.toml")
    with pytest.raises(ProjectFileError, match="must say which cameras there are"):
        plan(tmp_path, "schema = 1\n")
    with pytest.raises(ProjectFileError, match="no such rig file"):
        plan(tmp_path, 'rig = "none.json"\n')
