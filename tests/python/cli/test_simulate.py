"""``videogrammetry simulate``: recordings for the other verbs, one paragraph for mistakes."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from videogrammetry.cli import simulate
from videogrammetry.cli.main import main
from videogrammetry.project import (
    read_measurement,
    read_project,
    read_rig,
    read_trajectories,
)
from videogrammetry.rendering.simulate import Simulated
from videogrammetry.sequence import open_sequence

Run = Callable[..., str]


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> Run:
    """Runs ``simulate`` in ``tmp_path``; returns the complaint, or what was printed."""
    monkeypatch.chdir(tmp_path)

    def call(*args: object, status: int = 0) -> str:
        found = main(["simulate", *map(str, args)])
        out, err = capsys.readouterr()
        assert found == status, err
        if status == 0:
            return out
        assert out == ""
        message = err.splitlines()[-1]
        assert message.startswith("videogrammetry simulate: "), err
        assert ".part" not in message
        return message

    return call


TYRE = ("tyre", "out", "--stages", "2")


@pytest.mark.parametrize("scene", ["", *simulate.SCENES])
def test_help_shows_an_example(scene: str, capsys: pytest.CaptureFixture) -> None:
    with pytest.raises(SystemExit) as left:
        main(["simulate", *([scene] if scene else []), "--help"])
    assert left.value.code == 0
    text = capsys.readouterr().out
    assert f"example:\n  videogrammetry simulate {scene}" in text
    assert "usage: videogrammetry simulate" in text


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (("--contrast-noise", "-5"), "noise cannot be negative"),
        (("--contrast-noise", "0"), "contrast over noise"),
        (("--contrast-noise", "nan"), "contrast over noise"),
        (("--psf-px", "-1"), "PSF"),
        (("--occluded", "1.5"), "occluded: expected a share from 0 to 1, got 1.5"),
        (("--missing", "-0.1"), "missing"),
        (("--clutter", "2"), "clutter"),
        (("--gradient", "1", "1"), "gradient"),
        (("--spots", "-1"), "spots"),
        (("--seed", "-1"), "seed"),
        (("--codes", "schneider-99"), "schneider-99"),
        (("--dot-mm", "70"), "do not fit on a side wall"),
        (("--dot-mm", "0"), "dot"),
        (("--exposure-us", "5000"), "longer than a frame"),
        (("--exposure-us", "-1"), "exposure"),
        (("--exposure-us", "nan"), "exposure"),
        (("--exposure-us", "100", "--blur-px", "1"), "leave one out"),
        (("--blur-px", "-1"), "blur"),
        (("--blur-px", "1000"), "longer than a frame"),
        (("--frame-rate", "0"), "frame rate"),
        (("--frame-rate", "inf"), "frame rate"),
        (
            ("--frame-rate", "2", "--speed", "4000", "--exposure-us", "400000"),
            "an exposure of 0.4 s (end_pose: expected a way of at most 200",
        ),
        (("--stages", "0"), "stages"),
        (("--gravity", "-9.8"), "gravity"),
        (("--drag", "0.1", "--speed", "100"), "from rest only"),
        (("--height-mm", "nan"), "height"),
        (("--height-mm", "10000000"), "lies behind camera"),
    ],
)
def test_impossible_options_are_2(
    run: Run, tmp_path: Path, args: tuple[str, ...], message: str
) -> None:
    assert message in run(*TYRE, *args, status=2)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (("calibration", "o", "--orientations", "0"), "orientations"),
        (("calibration", "o", "--tilt-deg", "80"), "tilt"),
        (("calibration", "o", "--span-mm", "1000"), "dot: targets of 40 mm overlap on a cross"),
        (("calibration", "o", "--span-mm", "9000"), "span"),
        (("calibration", "o", "--target-sigma-mm", "-1"), "target sigma: expected 0 mm or more"),
        (("calibration", "o", "--codes", "schneider-8"), "has only"),
        (("scale-bar", "o", "--speeds", "0"), "speeds"),
        (("scale-bar", "o", "--length-mm", "100"), "too short"),
        (("scale-bar", "o", "--stages", "1"), "stages"),
        (("target-photos", "o", "--step-deg", "0"), "step"),
        (("target-photos", "o", "--heights-mm", "-1"), "heights"),
        (("target-photos", "o", "--size-px", "0", "0"), "size"),
    ],
)
def test_impossible_scenes_are_2(
    run: Run, tmp_path: Path, args: tuple[str, ...], message: str
) -> None:
    assert message in run(*args, status=2)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "args",
    [
        ("simulate",),
        ("simulate", "cake", "out"),
        ("simulate", "tyre"),
        ("simulate", "tyre", "o", "--bits", "10"),
        ("simulate", "tyre", "o", "--format", "avi"),
        ("simulate", "target-photos", "o", "--format", "mraw"),
        ("simulate", "target-photos", "o", "--occluded", "0.1"),
        ("simulate", "tyre", "o", "--stages", "many"),
    ],
)
def test_wrong_usage_is_2(args: tuple[str, ...], capsys: pytest.CaptureFixture) -> None:
    with pytest.raises(SystemExit) as left:
        main(args)
    assert left.value.code == 2
    assert "usage: videogrammetry" in capsys.readouterr().err


def test_what_cannot_be_used_or_written_is_1(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert "nothere" in run(*TYRE, "--calibration", "nothere", status=1)
    (tmp_path / "file").write_text("mine")
    (tmp_path / "empty").mkdir()
    before = sorted(tmp_path.rglob("*"))
    for name in ("file", "empty", "."):
        message = run("tyre", name, "--stages", "1", status=1)
        assert "is there already, and nothing is overwritten" in message
    assert "file is no folder" in run("tyre", "file/out", "--stages", "1", status=1)
    # Asked for, because the administrator may write everywhere.
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    for name in ("out", "made/too/out"):
        message = run("tyre", name, "--stages", "1", status=1)
        assert "no permission to write in folder" in message
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX users")
def test_a_folder_that_may_not_be_written_to(tmp_path: Path) -> None:
    if os.geteuid() == 0:
        pytest.skip("the administrator may write everywhere")
    (tmp_path / "locked").mkdir(mode=0o555)
    command = [sys.executable, "-m", "videogrammetry", "simulate", "tyre", "locked/out"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "no permission" in done.stderr
    assert list((tmp_path / "locked").iterdir()) == []


def test_an_interruption_is_130_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    def stop(*args: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(simulate.Progress, "__call__", stop)
    assert main(["simulate", "tyre", str(tmp_path / "a" / "out"), "--stages", "1"]) == 130
    assert "interrupted; nothing was left half-written" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_the_parent_is_made_and_the_empty_pictures_are_named(run: Run, tmp_path: Path) -> None:
    text = run("tyre", "made/too/out", "--stages", "2", "--missing", "0.5", "--format", "png")
    assert text.startswith("8 pictures, ")
    assert "camera cam" in text
    assert "delivers an empty picture" in text
    found = read_project(tmp_path / "made" / "too" / "out")
    for camera in found.cameras.values():
        assert len(open_sequence(camera.sequence, found.folder)) == 2


def test_options_reach_the_scene(run: Run, tmp_path: Path, monkeypatch) -> None:
    built: list = []

    def keep(scene: object, out: object, family: object, options: object, **_: object):
        built.append((scene, options))
        return Simulated(0, 0, 0, {})

    for name in ("simulate", "simulate_photos"):
        monkeypatch.setattr(simulate, name, keep)
    run(*TYRE, "--frame-rate", "500", "--blur-px", "0.01", "--bits", "8", "--psf-px", "1.1",
        "--spots", "7", "--seed", "5", "--occluded", "0.25", "--missing", "0.5", "--uncoded",
        "--drag", "0.2", "--gravity", "9.81", "--height-mm", "800", "--calibration", "cal",
        "--contrast-noise", "33", "--clutter", "0.5", "--gradient", "0.1", "0.2", "--dot-mm",
        "30")  # fmt: skip
    scene, options = built.pop()
    assert (scene.frame_rate_hz, scene.num_stages) == (500, 2)
    assert 0 < scene.exposure_s < 1 / 500
    assert (scene.facts["drag_per_m"], scene.facts["gravity_m_s2"]) == (0.2, 9.81)
    assert (scene.marks.id == -1).all()
    assert scene.marks.radius_mm[scene.marks.is_target].tolist() == [15.0] * 18
    used = options.conditions
    assert (used.bit_depth, used.psf_sigma_px, used.spots, used.seed) == (8, 1.1, 7, 5)
    assert (used.occluded, used.missing, used.contrast_noise) == (0.25, 0.5, 33)
    assert (used.clutter, used.gradient) == (0.5, (0.1, 0.2))
    assert options.calibration == Path("cal")
    run("scale-bar", "o", "--cross-pair", "--length-mm", "900", "--stages", "5",
        "--exposure-us", "77")  # fmt: skip
    scene, _ = built.pop()
    assert (scene.facts["length_mm"], scene.facts["bars"]) == (900, [(1, 4)])
    assert scene.exposure_s == pytest.approx(77e-6)
    run("calibration", "o", "--orientations", "9", "--target-sigma-mm", "0.3", "--codes",
        "metashape-14")  # fmt: skip
    scene, options = built.pop()
    assert (scene.num_stages, options.target_sigma_mm, scene.marks.num_bits) == (9, 0.3, 14)
    run("target-photos", "o", "--step-deg", "60", "--heights-mm", "900", "--size-px", "900", "600")
    photos, options = built.pop()
    assert len(photos.cameras) == 6
    assert next(iter(photos.cameras.values())).image_size_px == (900, 600)
    assert options.format == "tiff"


@pytest.mark.slow
def test_calibrate_measure_and_verify_run_through(tmp_path: Path) -> None:
    """8 orientations and 6 stages; the errors in space are what the sigmas predict."""

    def call(*args: object) -> str:
        command = [sys.executable, "-m", "videogrammetry", *map(str, args)]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return done.stdout

    call("simulate", "calibration", "cal", "--orientations", 8, "--seed", 3)
    call("simulate", "tyre", "drop", "--stages", 6, "--frame-rate", 20, "--calibration", "cal")
    call("calibrate", "drop")
    measured = call("measure", "drop")
    call("verify", "drop")
    result = read_measurement(tmp_path / "drop" / "measurement.h5")
    true = read_trajectories(tmp_path / "drop" / "truth" / "trajectories.csv")
    rig = read_rig(tmp_path / "drop" / "rig.json")
    assert list(rig.cameras) == ["cam1", "cam2", "cam3", "cam4"], measured
    truth = dict(zip(zip(true.stage.tolist(), true.point, strict=True), true.position_mm,
                     strict=True))  # fmt: skip
    found = result.trajectories
    points = [str(p) for p in found.point_id]
    errors = []
    for i, stage in enumerate(np.asarray(found.stage).tolist()):
        for k, point in enumerate(points):
            position = found.position_mm[i, k]
            if np.isfinite(position).all() and (stage, point) in truth:
                sigma = np.sqrt(found.cov_mm2[i, k][[0, 3, 5]])
                errors.append((truth[stage, point], position, sigma))
    assert len(errors) >= 0.9 * 6 * 18
    true_mm, found_mm, sigma_mm = np.array(errors).transpose(1, 0, 2)
    # The frame is that of the calibrated camera 1, which is free to turn by a share of a pixel.
    a, b = true_mm - true_mm.mean(axis=0), found_mm - found_mm.mean(axis=0)
    u, _, vt = np.linalg.svd(b.T @ a)
    turn = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
    assert np.arccos((np.trace(turn) - 1) / 2) < 1 / 2600
    # 324 errors, of which the frame has taken 6: five sigmas hold for all of them.
    assert np.abs((b - a @ turn.T) / sigma_mm).max() < 5
    assert 0.005 < sigma_mm.mean() < 0.2
