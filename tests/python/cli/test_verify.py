"""The verbs verify and motion: tables, documents, exit status."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from two_pairs import falling, write_project

from videogrammetry.cli.main import main
from videogrammetry.project import read_measurement, read_motion

BARS = '[verify]\nscale_bars = "bars.csv"\n'


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    write_project(tmp_path, falling(21, stages=30))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def section(folder: Path, text: str) -> None:
    with (folder / "project.toml").open("a") as file:
        file.write(text)


def test_verify_prints_what_is_asked_for(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    args = ["verify", ".", "--scale-bars", "bars.csv", "--free-fall", "1", "30"]
    assert main([*args, "--truth", "truth", "--points", "1-4,9-12"]) == 0
    out = capsys.readouterr().out
    for word in (
        "1-10",
        "cam1+cam2 | cam3+cam4",
        "this is no VDI/VDE 2634-1 test",
        "regression: y",
    ):
        assert word in out
    for word in ("each of 8 points", "rms_coordinate", "against the truth", "missing: point"):
        assert word in out
    # Columns stand under their headers: every line of the statistics is as long as it has to be.
    assert not any(line.endswith(" ") for line in out.splitlines())


def test_options_win_over_the_project(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    section(folder, BARS + "free_fall = [1, 30]\ngravity_m_s2 = 9.7803\npoints = [1, 2, 3]\n")
    assert main(["verify", "project.toml"]) == 0
    out = capsys.readouterr().out
    assert "known lengths" in out
    assert "free fall, stages 1 to 30" in out
    assert "9.78030" in out
    assert "each of 3 points" in out
    more = ["--free-fall", "3", "20", "--gravity", "9.81", "--points", "1-9", "--drag", "estimate"]
    assert main(["verify", "project.toml", *more, "--vertical", "0", "-1", "0"]) == 0
    out = capsys.readouterr().out
    for word in ("stages 3 to 20", "9.81000", "each of 9 points", "given vertical", "determined"):
        assert word in out


def test_verify_writes_everything_once(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    args = ["verify", ".", "--scale-bars", "bars.csv", "--out", "check.json"]
    assert main(args) == 0
    document = json.loads((folder / "check.json").read_text())
    assert document["provenance"]["inputs_sha256"].keys() >= {"bars.csv", "measurement.h5"}
    assert len(document["scale_bars"]["error_mm"]) == document["scale_bars"]["total"]["count"]
    assert document["free_fall"] is None
    assert main(args) == 1
    assert "check.json is there already" in capsys.readouterr().err
    assert main([*args, "--force"]) == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], "nothing to verify against: give lengths to check (--scale-bars FILE)"),
        (["--free-fall", "9", "3"], "--free-fall 9 3: expected the first and a later stage"),
        (["--free-fall", "1", "9", "--gravity", "0"], "--gravity 0.0: expected a positive number"),
        (["--free-fall", "1", "9", "--vertical", "0", "0", "0"], "is no direction"),
        (["--truth", "truth", "--out", "x.txt"], "--out: expected a name ending in .json"),
    ],
)
def test_wrong_usage_is_status_2(
    folder: Path, capsys: pytest.CaptureFixture[str], options: list[str], message: str
) -> None:
    assert main(["verify", ".", *options]) == 2
    captured = capsys.readouterr()
    assert message in captured.err
    assert captured.out == ""


@pytest.mark.parametrize(
    ("option", "text"),
    [("--points", "4-"), ("--points", "9-4"), ("--points", ""), ("--drag", "much")],
)
def test_wrong_lists_are_refused_by_the_parser(
    capsys: pytest.CaptureFixture[str], option: str, text: str
) -> None:
    with pytest.raises(SystemExit) as exit_info:
        main(["verify", ".", option, text])
    assert exit_info.value.code == 2
    assert f"argument {option}" in capsys.readouterr().err


def test_what_was_not_measured_is_status_1(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["verify", ".", "--free-fall", "1", "9", "--points", "1,77"]) == 1
    assert "points [77] were measured at no stage" in capsys.readouterr().err
    (folder / "measurement.h5").unlink()
    assert main(["verify", ".", "--truth", "truth"]) == 1
    assert "videogrammetry measure PROJECT" in capsys.readouterr().err


def test_motion_with_another_reference_and_centroid(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = read_measurement(folder / "measurement.h5")
    args = ["motion", ".", "--reference-stage", "7", "--centroid-points", "1-4,9"]
    assert main([*args, "--out", "motion.csv"]) == 0
    out = capsys.readouterr().out
    assert "centroid of 5 points (1, 2, 3, 4, 9); displacements are against stage 7" in out
    assert len(out.splitlines()) == 1 + 30 + 1
    after = read_measurement(folder / "measurement.h5")
    np.testing.assert_array_equal(after.trajectories.position_mm, before.trajectories.position_mm)
    assert after.motion.reference_stage == 7
    assert after.motion.centroid_points.tolist() == [1, 2, 3, 4, 9]
    known = np.isfinite(after.motion.displacement_mm[6])
    assert (after.motion.displacement_mm[6][known] == 0).all()
    assert after.provenance["version"] == "0"  # who measured stays
    assert after.provenance["options"]["motion"]["reference_stage"] == 7
    assert "measurement.h5" in after.provenance["motion"]["inputs_sha256"]
    table = read_motion(folder / "motion.csv")
    assert "centroid" in table.point
    origin = json.loads((folder / "motion.csv.provenance.json").read_text())
    assert origin["options"]["centroid_points"] == [1, 2, 3, 4, 9]


def test_motion_takes_the_projects_reference(folder: Path) -> None:
    section(folder, "[motion]\nreference_stage = 5\n")
    assert main(["motion", "."]) == 0
    assert read_measurement(folder / "measurement.h5").motion.reference_stage == 5


def test_motion_refuses_before_it_writes(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = (folder / "measurement.h5").read_bytes()
    (folder / "motion.csv").write_text("mine")
    assert main(["motion", ".", "--reference-stage", "3", "--out", "motion.csv"]) == 1
    assert "--force" in capsys.readouterr().err
    assert main(["motion", ".", "--reference-stage", "99"]) == 1
    assert "reference_stage 99: measured are 1 to 30" in capsys.readouterr().err
    assert main(["motion", ".", "--centroid-points", "1,88"]) == 1
    assert "[88] were measured at no stage" in capsys.readouterr().err
    assert main(["motion", ".", "--out", "motion.txt"]) == 2
    assert (folder / "measurement.h5").read_bytes() == before
