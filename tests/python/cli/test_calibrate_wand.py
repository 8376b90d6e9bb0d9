"""``calibrate`` with a waved bar, an earlier rig and late cameras, from observations."""

from __future__ import annotations

import numpy as np
import pytest

from videogrammetry.geometry import project, rotation_looking_at
from videogrammetry.project import read_rig
from videogrammetry.types import RigCamera

SIZE, SIGMA_PX, LENGTH_MM = (1280, 1024), 0.02, 800.0


def cameras():
    found = {}
    for k, azimuth in enumerate((-0.5, 0.0, 0.5)):
        stand = 4000.0 * np.array([np.sin(azimuth), -0.1 * k, -np.cos(azimuth)])
        rotation = rotation_looking_at(stand, np.zeros(3))
        found[f"c{k}"] = RigCamera(
            image_size_px=SIZE, interior=np.r_[1900.0, 5.0, -8.0, -3e-8, np.zeros(6)],
            r0_px=540.0, rotation=rotation, translation_mm=-rotation @ stand,
        )  # fmt: skip
    return found


@pytest.fixture
def folder(tmp_path):
    """A project of three cameras that saw a bar at 60 stages."""
    rng = np.random.default_rng(0)
    way = rng.normal(size=(60, 3))
    way *= 0.5 * LENGTH_MM / np.linalg.norm(way, axis=1)[:, None]
    middle = rng.uniform(-450, 450, (60, 3))
    text = ["schema = 1"]
    for name, camera in cameras().items():
        rows = ["image,point,x_px,y_px,sigma_px"]
        for stage in range(60):
            for number, end in ((1, middle[stage] - way[stage]), (2, middle[stage] + way[stage])):
                in_cam = camera.rotation @ end + camera.translation_mm
                x, y = project(camera, in_cam[None])[0] + rng.normal(0, SIGMA_PX, 2)
                if 0 < x < SIZE[0] - 1 and 0 < y < SIZE[1] - 1:
                    rows.append(f"s{stage:03d},{number},{x:.5f},{y:.5f},{SIGMA_PX}")
        (tmp_path / f"{name}.csv").write_text("\n".join(rows) + "\n")
        text += [f"[cameras.{name}]", f'calibration = "{name}.csv"']
        text += [f"image_size_px = [{SIZE[0]}, {SIZE[1]}]", 'free = ["f", "x0", "y0", "A1"]']
    text += ["[calibration]", 'scale_bars = "wand.csv"']
    (tmp_path / "wand.csv").write_text(
        f"point_a,point_b,length_mm,sigma_mm\n1,2,{LENGTH_MM},0.01\n"
    )
    (tmp_path / "project.toml").write_text("\n".join(text) + "\n")
    return tmp_path


def test_a_waved_bar_calibrates_the_rig(run, folder):
    done = run("calibrate", folder / "project.toml")
    assert "c2" in done.stdout
    rig = read_rig(folder / "rig.json")
    true = cameras()
    for name in ("c1", "c2"):
        apart = np.linalg.norm(rig.cameras[name].centre_mm - rig.cameras["c0"].centre_mm)
        wanted = np.linalg.norm(true[name].centre_mm - true["c0"].centre_mm)
        # 120 ends of a bar of 0.8 m at 4 m: some 2e-4 of the distance.
        assert apart == pytest.approx(wanted, rel=1e-3)
    assert rig.cov is not None
    page = (folder / "rig-report.html").read_text()
    assert "c1" in page


def test_an_earlier_rig_holds_the_lenses(run, folder):
    run("calibrate", folder / "project.toml", "--out", folder / "first.json")
    text = (folder / "project.toml").read_text()
    (folder / "project.toml").write_text(text + 'rig = "first.json"\nhold_to_rig = true\n')
    run("calibrate", folder / "project.toml")
    first, second = read_rig(folder / "first.json"), read_rig(folder / "rig.json")
    # The same pictures twice, as if new: sigmas shrink by up to the root of two.
    ratio = second.cameras["c1"].sigma["f"] / first.cameras["c1"].sigma["f"]
    assert 0.6 < ratio < 0.95


def test_neither_target_nor_bar_is_an_error_that_names_both(run, folder):
    text = (folder / "project.toml").read_text().replace('scale_bars = "wand.csv"\n', "")
    (folder / "project.toml").write_text(text)
    done = run("calibrate", folder / "project.toml", status=1)
    assert 'target = "points.csv"' in done.stderr
    assert 'scale_bars = "bars.csv"' in done.stderr
