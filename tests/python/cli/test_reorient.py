"""``calibrate --reorient``: a camera that has moved, from targets that stand still."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from videogrammetry.geometry import rotation_from_vector, vector_from_rotation
from videogrammetry.project import read_rig, write_rig
from videogrammetry.types import RigData

PROJECT = """\
schema = 1
[cameras.a]
sequence = "photos/photos_000001.tif"
[cameras.b]
sequence = "photos/photos_000002.tif"
[stability]
points = "truth/points.csv"
[targets]
diameter_px = [4, 60]
"""


@pytest.fixture
def project(run, tmp_path):
    """Two cameras before the cross; the file says of one that it stands elsewhere."""
    folder = tmp_path / "scene"
    run("simulate", "target-photos", folder, "--heights-mm", 1400, "--step-deg", 90,
        "--size-px", 1944, 1296)  # fmt: skip
    truth = read_rig(folder / "truth" / "rig.json")
    a, b = truth.cameras["photos_000001"], truth.cameras["photos_000002"]
    turned = replace(a, rotation=rotation_from_vector(np.array([1e-3, -5e-4, 2e-3])) @ a.rotation)
    write_rig(folder / "rig.json", RigData(cameras={"a": turned, "b": b}))
    (folder / "moved.toml").write_text(PROJECT)
    return folder, a


def test_the_new_pose_is_found_and_said(run, project):
    folder, truth = project
    done = run("calibrate", folder / "moved.toml", "--reorient", "a", "--out", folder / "new.json")
    found = read_rig(folder / "new.json").cameras["a"]
    turn = vector_from_rotation(found.rotation @ truth.rotation.T)
    # The circles' eccentricity, up to 0.04 px of a board's dots here, is not modelled: at
    # f = 1950 px 0.02 mrad, and 0.1 mm at 3.2 m.
    assert np.linalg.norm(turn) < 5e-5
    assert np.linalg.norm(found.centre_mm - truth.centre_mm) < 0.3
    assert "camera a: turned by 2.2" in done.stdout
    assert read_rig(folder / "new.json").cameras["b"].sigma == {}


def test_what_is_missing_is_named(run, project):
    folder, _ = project
    done = run("calibrate", folder / "moved.toml", "--reorient", "x", "--force", status=1)
    assert "there is no camera 'x'; it has a, b" in done.stderr
    text = (
        (folder / "moved.toml")
        .read_text()
        .replace('[stability]\npoints = "truth/points.csv"\n', "")
    )
    (folder / "moved.toml").write_text(text)
    done = run("calibrate", folder / "moved.toml", "--reorient", "a", "--force", status=1)
    assert "[stability] names no points" in done.stderr
