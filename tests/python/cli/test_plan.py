"""The verb plan: files, summary, exit status."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from plan_rigs import PLAN, pair_rig

from videogrammetry.cli.main import main
from videogrammetry.project import write_rig
from videogrammetry.types import RigData


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "plan.toml").write_text(PLAN)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_plan_writes_page_document_and_table(folder, capsys):
    assert main(["plan", "plan.toml", "--wanted", "0.2", "--out", "out"]) == 0
    out = capsys.readouterr().out
    for words in ("a box of 800 x 600 x 700 mm", "distance 400 mm", "positions", "0.2 mm of a"):
        assert words in out
    document = json.loads((folder / "out" / "plan.json").read_text())
    assert document["needed"]["wanted_mm"] == 0.2
    assert document["options"]["positions"] == 8
    assert "plan.toml" in json.dumps(document["provenance"]["inputs_sha256"])
    assert (folder / "out" / "plan.html").read_text().startswith("<!DOCTYPE html>")
    with (folder / "out" / "plan.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 11**3
    both = [float(rows[0][f"sigma_x_{s}_mm"]) for s in ("image", "calibration", "together")]
    assert both[2] == pytest.approx(np.hypot(both[0], both[1]))
    # Nothing is overwritten without being told to.
    assert main(["plan", "plan.toml", "--out", "out"]) == 1
    assert "--force" in capsys.readouterr().err
    assert main(["plan", "plan.toml", "--out", "out", "--force", "--positions", "5"]) == 0
    assert json.loads((folder / "out" / "plan.json").read_text())["options"]["positions"] == 5


def test_a_rig_file_and_options_alone(folder, capsys):
    write_rig("rig.json", pair_rig())
    volume = ["--centre", "0", "0", "0", "--radius", "300"]
    more = ["--target", "board", "--sigma-px", "0.02", "--target-sigma-mm", "0.03"]
    assert main(["plan", "rig.json", *volume, *more]) == 0
    assert "a ball of 600 mm around (0, 0, 0) mm" in capsys.readouterr().out
    assert json.loads((folder / "plan.json").read_text())["options"]["target_sigma_mm"] == 0.03


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (["absent.toml"], 1, "there is no such file"),
        (["one.json", "--centre", "0", "0", "0", "--radius", "9"], 1, "needs two cameras or more"),
        (["plan.toml", "--centre", "0", "-9000", "0", "--radius", "300"], 1, "nowhere seen by two"),
        (["plan.toml", "--target", "absent.csv"], 1, "absent.csv"),
        (["plan.toml", "--wanted", "-1"], 2, "--wanted -1: expected a number above 0"),
        (["plan.toml", "--positions", "0"], 2, "--positions 0"),
        (["plan.toml", "--size", "1", "1", "0"], 2, "three lengths above 0"),
        (["plan.toml", "--size", "1", "1", "1", "--radius", "4"], 2, "a box or a ball"),
        (["plan.toml", "--centre", "1", "1", "1"], 2, "give --size or --radius"),
        (["one.json", "--radius", "4"], 2, "say where the middle of the volume is"),
    ],
)
def test_what_is_wrong_is_said(folder, capsys, arguments, status, message):
    write_rig("one.json", RigData(cameras={"left": pair_rig().cameras["left"]}))
    assert main(["plan", *arguments]) == status
    assert message in capsys.readouterr().err
    assert not (folder / "plan.html").exists()
