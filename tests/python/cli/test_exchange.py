"""``videogrammetry export`` of cameras, and back: files, residuals, complaints."""

from __future__ import annotations

import json

import numpy as np
import pytest
from command_fakes import Run, complaint
from export.lens_rigs import usual_rig

from videogrammetry.export import read_lens_cameras
from videogrammetry.project import read_rig, write_rig


@pytest.fixture
def rig(tmp_path):
    write_rig(tmp_path / "rig.json", usual_rig(2))
    return tmp_path


def residuals(printed: str) -> dict[str, float]:
    header, *rows = (line.split() for line in printed.splitlines())
    assert header[-2:] == ["largest", "px"] or "roll" in header
    return {row[0]: float(row[3]) for row in rows}


@pytest.mark.parametrize(
    ("out", "options", "files"),
    [
        ("c.yaml", (), ["c.yaml"]),
        ("c.json", (), ["c.json"]),
        ("k.yaml", ("--format", "kalibr"), ["k.yaml"]),
        ("r.yaml", ("--format", "ros", "--camera", "cam2"), ["r.yaml"]),
        ("ros", ("--format", "ros"), ["ros/cam1.yaml", "ros/cam2.yaml"]),
        ("m", ("--format", "mrcal"), ["m/cam1.cameramodel", "m/cam2.cameramodel"]),
        ("c.cameramodel", ("--camera", "cam1", "--model", "opencv8"), ["c.cameramodel"]),
        ("sparse", ("--format", "colmap"), ["sparse/cameras.txt", "sparse/images.txt"]),
    ],
)
def test_every_format_says_its_residual(run: Run, rig, out, options, files):
    result = run("export", "rig.json", out, *options)
    stated = residuals(result.stdout)
    for name in files:
        assert (rig / name).is_file()
        text = (rig / name).read_text()
        assert "residual" in text
    beside = rig / (f"{out}.provenance.json" if "." in out else f"{out}/provenance.json")
    origin = json.loads(beside.read_text())
    assert list(origin["inputs_sha256"]) == ["rig.json"]
    for name, value in stated.items():
        assert origin["cameras"][name]["residual"]["max_px"] == pytest.approx(value, rel=0.1)
    assert f"as {'opencv' if out in ('c.yaml', 'c.json') else ''}" in result.stderr


def test_a_project_exports_its_rig(run: Run, rig):
    (rig / "project.toml").write_text('schema = 1\nname = "p"\n[cameras.cam1]\n[cameras.cam2]\n')
    run("export", "project.toml", "a.yaml")
    run("export", "rig.json", "b.yaml")
    assert (rig / "a.yaml").read_text() == (rig / "b.yaml").read_text()


def test_there_and_back_by_three_programs(run: Run, rig):
    run("export", "rig.json", "c.yaml")
    run("export", "rig.json", "m", "--format", "mrcal")
    run("export", "rig.json", "ros", "--format", "ros")
    result = run("export", "c.yaml", "opencv.json")
    assert "without covariance" in result.stderr
    assert max(residuals(result.stdout).values()) < 0.01
    run(
        "export",
        "m/cam1.cameramodel",
        "m/cam2.cameramodel",
        "mrcal.json",
        "--distortion",
        "measured",
    )
    run("export", "ros/cam1.yaml", "ros/cam2.yaml", "ros.json")
    there = read_rig(rig / "rig.json")
    for name in ("opencv.json", "mrcal.json", "ros.json"):
        found = read_rig(rig / name)
        assert list(found.cameras) == ["cam1", "cam2"]
        for key, camera in found.cameras.items():
            assert camera.interior[0] == pytest.approx(there.cameras[key].interior[0], rel=2e-3)
            if name != "ros.json":  # a camera_info has no orientation
                np.testing.assert_allclose(
                    camera.centre_mm, there.cameras[key].centre_mm, rtol=0, atol=1e-6
                )
        assert found.how["residual"]["cam1"]["max_px"] < 0.02
    assert "2 cameras" in run("info", "mrcal.json").stdout


def test_size_of_the_pictures_can_be_given(run: Run, tmp_path):
    (tmp_path / "k.json").write_text(
        json.dumps({"K": [[900, 0, 320], [0, 900, 240], [0, 0, 1]], "D": [0.1, 0, 0, 0]})
    )
    message = complaint(run("export", "k.json", "rig.json", status=1), "export")
    assert "give --image-size" in message
    run("export", "k.json", "rig.json", "--image-size", "640", "480")
    assert read_rig(tmp_path / "rig.json").cameras["k"].image_size_px == (640, 480)
    message = complaint(run("export", "k.json", "rig.json", status=1), "export")
    assert "there already" in message


@pytest.mark.parametrize(
    ("args", "status", "message"),
    [
        (("rig.json", "c.cameramodel"), 2, "holds one camera, the rig has cam1, cam2"),
        (("rig.json", "c.yaml", "--format", "colmap"), 2, "it is a folder"),
        (("rig.json", "c.yaml", "--camera", "left"), 2, "rig.json has cam1, cam2"),
        (("rig.json", "k", "--format", "kalibr"), 2, "one file for all cameras"),
        (
            ("rig.json", "k.yaml", "--format", "kalibr", "--model", "opencv8"),
            2,
            "kalibr has opencv4, equidistant, not opencv8",
        ),
        (("rig.json", "rig.json", "x.yaml"), 2, "one rig.json or project"),
        (("nothere.json", "x.yaml"), 1, "no such rig file"),
        (("nothere.yaml", "x.json"), 1, "there is no such file"),
        (("rig.json", "x.yaml", "--image-size", "3", "4"), 2, "go with what becomes a rig.json"),
        (("some.yaml", "x.csv"), 2, "name a rig.json"),
    ],
)
def test_complaints(run: Run, rig, args, status, message):
    (rig / "some.yaml").write_text("x: 1\n")
    before = sorted(p.name for p in rig.iterdir())
    assert message in complaint(run("export", *args, status=status), "export")
    assert sorted(p.name for p in rig.iterdir()) == before


def test_nothing_is_overwritten_without_force(run: Run, rig):
    (rig / "c.yaml").write_text("mine")
    complaint(run("export", "rig.json", "c.yaml", status=1), "export")
    assert (rig / "c.yaml").read_text() == "mine"
    run("export", "rig.json", "c.yaml", "--force")
    assert len(read_lens_cameras(rig / "c.yaml")) == 2
