"""A tank from its project file: observations, calibration through the window, rig.json."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from tanks import SIZE, block_points, pictures, tank_cameras

from videogrammetry.pipeline import calibrate_project
from videogrammetry.project import read_project, write_observations, write_points
from videogrammetry.reconstruction import Rig
from videogrammetry.types import Observations, PointSet

SIGMA_PX = 0.05

WINDOW = """
[interfaces.front]
normal = [0, 0, 3]
distance_mm = 102
glass = [1.5, 8]
free = ["normal", "distance"]
sigma_distance_mm = 5

[calibration]
target = "block.csv"
sigma_mm = 0.01
free = ["f", "x0", "y0", "A1"]
"""


def test_from_the_project_to_points_in_water(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    points = block_points()
    number = np.arange(1, len(points) + 1, dtype=np.int32)
    write_points(tmp_path / "block.csv", PointSet(id=number, position_mm=points))
    text = "schema = 1\n"
    for name, xy in pictures(tank_cameras(), points).items():
        seen = Observations(
            image=("block.tif",),
            image_index=np.zeros(len(xy), np.int32),
            point_id=number,
            xy_px=xy + rng.normal(0, SIGMA_PX, xy.shape),
            cov_px2=np.tile([SIGMA_PX**2, 0, SIGMA_PX**2], (len(xy), 1)),
        )
        write_observations(tmp_path / f"{name}.csv", seen)
        text += (
            f'[cameras.{name}]\ncalibration = "{name}.csv"\nimage_size_px = {list(SIZE)}\n'
            'interface = "front"\n'
        )
    (tmp_path / "project.toml").write_text(text + WINDOW)
    run = calibrate_project(read_project(tmp_path))
    Rig.from_data(run.rig).save(tmp_path / "rig.json")
    rig = Rig.load(tmp_path / "rig.json")
    window = rig.cameras["c2"].interface
    assert window is not None
    assert (window.name, window.fluid_index, window.glass_thickness_mm) == ("front", 1.333, 8.0)
    assert abs(window.distance_mm - 100.0) < 4.5 * window.sigma["distance"] < 4.5 * 5.0
    inside = np.random.default_rng(4).uniform([-45, -35, -55], [45, 35, -5], (20, 3))
    position, cov = rig.triangulate(pictures(tank_cameras(), inside), SIGMA_PX)
    error = position - inside
    # Exact pictures: only the calibration's error is left, below the noise of one picture.
    assert (np.abs(error) < 3 * np.sqrt(np.diagonal(cov, axis1=1, axis2=2))).all()
    assert run.rig.how["options"]["interfaces"][0]["interface"]["name"] == "front"
