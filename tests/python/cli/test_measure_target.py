"""``measure-target``: from rendered photographs to coordinates, and what it refuses."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys

import numpy as np
import pytest

from videogrammetry.geometry import fit_rigid
from videogrammetry.project import read_points
from videogrammetry.types import matrix_from_cov6


def command(*args):
    line = [sys.executable, "-m", "videogrammetry", *map(str, args)]
    done = subprocess.run(line, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done


@pytest.fixture(scope="module")
def photos(tmp_path_factory):
    """Sixteen small photographs all round the cross."""
    folder = tmp_path_factory.mktemp("photos") / "scene"
    command("simulate", "target-photos", folder, "--size-px", 1944, 1296, "--heights-mm", 500, 1800)
    return folder


def arguments(photos, out):
    return (
        "measure-target", str(photos / "photos" / "*.tif"), "--scale-bars",
        str(photos / "scale-bars.csv"), "--diameter-px", "4", "60", "--out", str(out),
    )  # fmt: skip


@pytest.fixture(scope="module")
def measured(photos):
    out = photos / "cross.csv"
    return out, command(*arguments(photos, out)).stderr


def test_coordinates_agree_with_the_truth_within_their_sigmas(photos, measured):
    out, _ = measured
    truth, found = read_points(photos / "truth" / "points.csv"), read_points(out)
    common, i, k = np.intersect1d(found.id, truth.id, return_indices=True)
    assert len(common) >= 50
    assert len(found) >= len(common) + 30  # un-coded dots too
    rotation, shift, _ = fit_rigid(truth.position_mm[k], found.position_mm[i])
    error = found.position_mm[i] @ rotation.T + shift - truth.position_mm[k]
    cov = np.einsum("ab,nbc,dc->nad", rotation, matrix_from_cov6(found.cov_mm2[i]), rotation)
    scaled = np.abs(error / np.sqrt(np.diagonal(cov, axis1=1, axis2=2))).max(axis=1)
    # Of some 170 coordinates the largest is within 4.5 sigmas; their RMS within a fifth of 1.
    assert scaled.max() < 4.5
    whole = error / np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
    assert np.sqrt((whole**2).mean()) == pytest.approx(1.0, abs=0.4)
    assert np.sqrt((error**2).mean()) < 0.01


def test_the_summary_holds_sides_camera_and_provenance(measured):
    out, said = measured
    summary = json.loads(out.with_name("cross-summary.json").read_text())
    sides = summary["sides"]
    transform = np.array(sides["front_from_back"])
    # The cross's sides look opposite ways; bars and boards lean their planes a little.
    assert transform[2, 2] < -0.9
    assert max(sides["sigma"][3:]) < 0.02
    assert "known to" in said
    camera = summary["cameras"]["camera1"]
    assert camera["f_px"] == pytest.approx(2600.0 * 1944 / 2592, abs=0.5)
    assert summary["how"]["inputs_sha256"]
    with np.load(out.with_suffix(".npz")) as arrays:
        full = arrays["full_cov_mm2"]
    # Inner constraints: the points' mean has no variance.
    n = len(full) // 3
    mean = np.kron(np.ones(n) / n, np.eye(3))
    of_mean = np.abs(np.diag(mean @ full @ mean.T))
    assert of_mean.max() < 1e-6 * np.diag(full).max()


def test_the_result_is_a_calibration_target(measured):
    points = read_points(measured[0])
    assert points.full_cov_mm2 is not None
    assert points.full_cov_mm2.shape == (3 * len(points),) * 2


def test_nothing_is_overwritten_and_bad_input_is_named(run, photos, measured, tmp_path):
    again = run(*arguments(photos, measured[0]), status=1)
    assert "--force" in again.stderr
    one = run("measure-target", str(photos / "photos" / "photos_000001.tif"), "--out",
              str(tmp_path / "a.csv"), status=2)  # fmt: skip
    assert "two photographs or more" in one.stderr
    bars = tmp_path / "bars.csv"
    bars.write_text("point_a,point_b,length_mm,sigma_mm\n57,499,1000.0,0.01\n")
    lost = run(
        "measure-target", str(photos / "photos" / "photos_00000[12].tif"), "--scale-bars",
        str(bars), "--out", str(tmp_path / "b.csv"), status=1,
    )  # fmt: skip
    assert "499 was read in none" in lost.stderr


def test_photographs_without_a_link_are_named(run, photos, tmp_path):
    # Two from the front and one from the back, which shares no target with them.
    for name in ("photos_000001.tif", "photos_000009.tif", "photos_000005.tif"):
        shutil.copy(photos / "photos" / name, tmp_path / name)
    done = run(
        "measure-target", str(tmp_path / "*.tif"), "--out", str(tmp_path / "c.csv"), status=1
    )
    assert "photos_000005" in done.stderr
    assert not (tmp_path / "c.csv").exists()
