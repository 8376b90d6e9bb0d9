"""Reports find the very pictures that were measured."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from videogrammetry.pipeline.calibrate import calibration_pictures
from videogrammetry.pipeline.measure_target import picture_by_name
from videogrammetry.project import read_project
from videogrammetry.sequence import open_sequence

PROJECT = """schema = 1
[cameras.left]
calibration = "left/*.png"
[cameras.right]
calibration = "right/*.png"
[calibration]
target = "cross.csv"
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    rng = np.random.default_rng(4)
    for camera in ("left", "right"):
        (tmp_path / camera).mkdir()
        for k in range(3):
            grey = rng.integers(0, 255, (30, 40), dtype=np.uint8)
            # Cameras name their pictures alike: only the camera tells them apart.
            Image.fromarray(grey).save(tmp_path / camera / f"{k:02d}.png")
    (tmp_path / "cross.csv").write_text("id,x_mm,y_mm,z_mm\n1,0,0,0\n")
    (tmp_path / "project.toml").write_text(PROJECT)
    return tmp_path


def test_calibration_pictures_by_camera_and_stage(folder: Path) -> None:
    pictures = calibration_pictures(read_project(folder))
    for camera in ("left", "right"):
        for stage in (1, 2, 3):
            expected = np.array(Image.open(folder / camera / f"{stage - 1:02d}.png"))
            np.testing.assert_array_equal(pictures(camera, stage), expected)
    assert pictures("left", 4) is None
    assert pictures("left", 0) is None
    assert pictures("none", 1) is None


def test_tables_have_no_pictures(folder: Path) -> None:
    (folder / "seen.csv").write_text("image,point_id,x_px,y_px\na,1,3,4\n")
    (folder / "project.toml").write_text(
        'schema = 1\n[cameras.left]\ncalibration = "seen.csv"\nimage_size_px = [40, 30]\n'
        '[calibration]\ntarget = "cross.csv"\n'
    )
    assert calibration_pictures(read_project(folder))("left", 1) is None


def test_photographs_by_their_names(folder: Path) -> None:
    source = open_sequence([str(folder / "left")])
    names = ("a", "b", "c")
    picture = picture_by_name(source, names)
    np.testing.assert_array_equal(picture("b"), np.array(Image.open(folder / "left" / "01.png")))
    assert picture("d") is None
