"""The verb ``recognize``: tables, overlays, mistakes."""

from __future__ import annotations

import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import tifffile
from command_fakes import Run, complaint, dots, spoil_short
from PIL import Image

from videogrammetry.cli.main import main
from videogrammetry.project import read_targets
from videogrammetry.version import __version__


def test_recognize_writes_a_table_and_overlays(run: Run, tmp_path: Path, pictures: Path) -> None:
    result = run("recognize", "pictures", "--out", "t.csv", "--overlay", "o", "--codes", "none")
    assert result.stdout == ""
    assert "3 pictures: 0 coded, 6 un-coded targets" in result.stderr
    table = read_targets(tmp_path / "t.csv")
    assert table.image == ("img1.tif",) * 2 + ("img2.tif",) * 2 + ("img10.tif",) * 2
    # 8-bit rounding of a ramp one pixel wide, over the 66 edge pixels of such a dot: the
    # centre is sure to a few hundredths.
    assert np.abs(table.xy_px[table.xy_px[:, 0] > 80] - (110, 70.5)).max() < 0.05
    overlays = sorted(p.name for p in (tmp_path / "o").iterdir())
    assert overlays == ["img1.tif.png", "img10.tif.png", "img2.tif.png"]
    with Image.open(tmp_path / "o" / overlays[0]) as image:
        image.load()
    files = ["o", "pictures", "t.csv", "t.csv.provenance.json"]
    assert sorted(p.name for p in tmp_path.iterdir()) == files


def test_recognize_counts_why_targets_have_no_id(run: Run, tmp_path: Path) -> None:
    x, y = np.meshgrid(np.arange(200), np.arange(100))
    ring = np.hypot(x - 15, y - 50)  # its code ring, 20 to 30 px, leaves the picture
    image = dots([(15, 50), (120, 50)], (200, 100))
    image[(ring > 20) & (ring < 30)] = 220
    tifffile.imwrite(tmp_path / "a.tif", image)
    result = run("recognize", "a.tif", "--out", "t.csv")
    assert "1 pictures: 0 coded, 2 un-coded targets (1 no ring, 1 ring cut)" in result.stderr


def test_recognize_to_standard_output(run: Run, pictures: Path) -> None:
    result = run("recognize", "pictures/img*.tif")
    header, *rows = result.stdout.splitlines()
    assert header.startswith("image,camera,stage,id,x_px,y_px,")
    assert len(rows) == 6
    assert rows[0].startswith("img1.tif,,,,")
    assert [p.name for p in pictures.parent.iterdir()] == ["pictures"]
    assert "recognize: 3/3 pictures" in result.stderr


def test_nothing_is_overwritten_without_force(run: Run, tmp_path: Path, pictures: Path) -> None:
    (tmp_path / "t.csv").write_text("mine")
    message = complaint(run("recognize", "pictures", "--out", "t.csv", status=1), "recognize")
    assert "t.csv" in message
    assert "--force" in message
    assert (tmp_path / "t.csv").read_text() == "mine"
    run("recognize", "pictures", "--out", "t.csv", "--force")
    assert len(read_targets(tmp_path / "t.csv")) == 6
    (tmp_path / "o").mkdir()
    (tmp_path / "o" / "img2.tif.png").touch()
    message = complaint(run("recognize", "pictures", "--overlay", "o", status=1), "recognize")
    assert "img2.tif.png" in message


def test_a_table_that_cannot_be_written_leaves_no_overlays(
    run: Run, tmp_path: Path, pictures: Path
) -> None:
    args = ("recognize", "pictures", "--overlay", "new/o", "--out", "nothere/x.csv")
    message = complaint(run(*args, status=1), "recognize")
    assert "nothere/x.csv cannot be written: there is no folder nothere" in message
    assert [p.name for p in tmp_path.iterdir()] == ["pictures"]


def test_a_table_that_fails_in_the_end_leaves_no_overlays(
    tmp_path: Path, pictures: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    replace = os.replace
    tried: list[str] = []

    def refuse_table(source: Path, target: Path) -> None:
        tried.append(Path(target).name)
        if tried[-1] == "t.csv":
            raise OSError(5, "Input/output error")
        replace(source, target)

    monkeypatch.setattr(os, "replace", refuse_table)
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    args = ["recognize", "pictures", "--codes", "none", "--out", "t.csv"]
    assert main([*args, "--overlay", "new/o"]) == 1
    assert sorted(tmp_path.rglob("*")) == before
    assert tried[-1] == "t.csv"


def test_overlays_go_into_folders_yet_to_be_made(run: Run, tmp_path: Path, pictures: Path) -> None:
    run("recognize", "pictures", "--overlay", "new/o", "--out", "t.csv")
    assert len(list((tmp_path / "new" / "o").iterdir())) == 3
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        *("new", "pictures", "t.csv", "t.csv.provenance.json")
    ]
    (tmp_path / "full").touch()
    message = complaint(run("recognize", "pictures", "--overlay", "full", status=1), "recognize")
    assert "full is no folder" in message


def test_outputs_of_recognize_carry_their_provenance(
    run: Run, tmp_path: Path, pictures: Path
) -> None:
    run("recognize", "pictures", "--codes", "none", "--out", "t.csv", "--overlay", "o")
    origin = json.loads((tmp_path / "t.csv.provenance.json").read_text())
    assert (origin["program"], origin["version"]) == ("videogrammetry", __version__)
    assert origin["options"]["codes"] == "none"
    assert origin["options"]["diameter_px"] == [5.0, 200.0]
    hashes = {
        f"pictures/{path.name}": hashlib.sha256(path.read_bytes()).hexdigest()
        for path in pictures.iterdir()
    }
    assert origin["inputs_sha256"] == hashes
    with Image.open(tmp_path / "o" / "img2.tif.png") as image:
        drawn = json.loads(image.text["provenance"])
    name = "pictures/img2.tif"
    assert drawn == {**origin, "inputs_sha256": {name: hashes[name]}}
    # Provenance is as safe from being overwritten as the table itself.
    (tmp_path / "t.csv").unlink()
    message = complaint(run("recognize", "pictures", "--out", "t.csv", status=1), "recognize")
    assert "t.csv.provenance.json is there already" in message
    run("recognize", "pictures", "--out", "t.csv", "--force")
    origin = json.loads((tmp_path / "t.csv.provenance.json").read_text())
    assert origin["options"]["codes"] == "schneider-14"


def test_a_code_table_is_among_the_inputs(run: Run, tmp_path: Path, pictures: Path) -> None:
    (tmp_path / "table.toml").write_text("bits = 12\ncodes = [65, 71]\n")
    run("recognize", "pictures/img1.tif", "--codes", "table.toml", "--out", "t.csv")
    origin = json.loads((tmp_path / "t.csv.provenance.json").read_text())
    assert list(origin["inputs_sha256"]) == ["table.toml", "pictures/img1.tif"]


def spoil_text(path: Path) -> None:
    path.write_text("this is no picture")


def spoil_empty(path: Path) -> None:
    path.write_bytes(b"")


@pytest.mark.parametrize("spoil", [spoil_text, spoil_short, spoil_empty])
def test_one_bad_picture_is_named_and_nothing_written(
    run: Run, tmp_path: Path, pictures: Path, spoil: Callable[[Path], None]
) -> None:
    spoil(pictures / "img10.tif")
    result = run("recognize", "pictures", "--out", "t.csv", "--overlay", "o", status=1)
    message = complaint(result, "recognize")
    assert "img10.tif" in message
    assert "img1.tif" not in message
    assert [p.name for p in tmp_path.iterdir()] == ["pictures"]


def test_a_png_that_ends_early_is_found_while_reading(run: Run, tmp_path: Path) -> None:
    for name in ("a.png", "b.png"):
        Image.fromarray(dots([(50, 50)])).save(tmp_path / name)
    whole = (tmp_path / "b.png").read_bytes()
    (tmp_path / "b.png").write_bytes(whole[: len(whole) // 2])
    result = run("recognize", "*.png", "--out", "t.csv", "--overlay", "o", status=1)
    assert "b.png: PNG picture cut short" in complaint(result, "recognize")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.png", "b.png"]


@pytest.mark.parametrize("spec", ["nothere", "pictures/cam7*", "nothere/*.tif"])
def test_nothing_matches(run: Run, pictures: Path, spec: str) -> None:
    message = complaint(run("recognize", spec, status=1), "recognize")
    assert spec.split("/")[-1] in message


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (("--diameter-px", "20", "5"), "--diameter-px: expected 3 <= smallest < largest"),
        (("--diameter-px", "2", "200"), "--diameter-px: expected 3 <= smallest < largest"),
        (("--diameter-px", "nan", "200"), "--diameter-px: expected 3 <= smallest < largest"),
        (("--codes", "schneider-13"), "--codes: expected one of "),
        (("--codes", "nothere.toml"), "--codes: nothere.toml: cannot be read"),
        (("--method", "guess"), "--method: expected 'edge-pair' or 'local-canny', got 'guess'"),
    ],
)
def test_options_out_of_range(run: Run, options: tuple, word: str) -> None:
    # The pictures are not there: options are looked at first, and no picture is blamed.
    message = complaint(run("recognize", "pictures", *options, status=2), "recognize")
    assert message.startswith(f"videogrammetry recognize: {word}")


def test_a_bad_code_table_is_no_wrong_usage(run: Run, tmp_path: Path, pictures: Path) -> None:
    (tmp_path / "table.toml").write_text("bits = 2\ncodes = [1]\n")
    result = run("recognize", "pictures", "--codes", "table.toml", status=1)
    assert "recognize: table.toml: bits" in complaint(result, "recognize")


def test_output_of_an_unknown_kind_is_wrong_usage(run: Run) -> None:
    # There is no project: options are looked at first.
    message = complaint(run("export", "nothere", "out.xyz", status=2), "export")
    assert "'.xyz'" in message
    assert ".csv" in message
    message = complaint(run("export", "nothere", "o.csv", "--stage", "3", status=2), "export")
    assert "--what points" in message
    message = complaint(run("calibrate", "nothere", "--out", "foo.txt", status=2), "calibrate")
    assert "--out: expected a name ending in .json, got foo.txt" in message


def test_equal_names_get_their_folders(run: Run, tmp_path: Path) -> None:
    for folder in ("left", "right"):
        (tmp_path / folder).mkdir()
        tifffile.imwrite(tmp_path / folder / "1.tif", dots([(50, 50)]))
    rows = run("recognize", "left", "right", "--overlay", "o").stdout.splitlines()[1:]
    assert [row.split(",")[0] for row in rows] == ["left/1.tif", "right/1.tif"]
    assert sorted(p.name for p in (tmp_path / "o").iterdir()) == [
        "left_1.tif.png",
        "right_1.tif.png",
    ]
    message = complaint(run("recognize", "left", "left/1.tif", status=1), "recognize")
    assert "given twice" in message


@pytest.mark.skipif(os.name != "posix", reason="needs POSIX signals")
def test_interrupted_is_130_and_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    frames = np.stack([dots([(30 + i, 40 + j) for i in (0, 60) for j in (0, 40)])] * 4000)
    tifffile.imwrite(tmp_path / "in" / "s.tif", frames[..., None][..., 0], photometric="minisblack")
    command = [sys.executable, "-m", "videogrammetry", "recognize", "in", "--out", "t.csv"]
    process = subprocess.Popen(
        [*command, "--overlay", "o"], cwd=tmp_path, stderr=subprocess.PIPE, text=True
    )
    deadline = time.monotonic() + 60
    while not list(tmp_path.glob(".overlay-*/*.png")) and time.monotonic() < deadline:
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    _, stderr = process.communicate(timeout=60)
    assert process.returncode == 130, stderr
    assert "interrupted" in stderr
    assert "Traceback" not in stderr
    assert [p.name for p in tmp_path.iterdir()] == ["in"]
