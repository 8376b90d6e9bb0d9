"""``measure-target``: from rendered photographs to coordinates, and what it refuses."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from dataclasses import fields, replace

import numpy as np
import pytest

from videogrammetry.errors import CalibrationError
from videogrammetry.geometry import fit_rigid
from videogrammetry.pipeline.measure_target import (
    Photographs,
    TargetOptions,
    measure_target,
    read_photographs,
)
from videogrammetry.project import read_points
from videogrammetry.project.network_tables import read_network_points, read_network_scale_bars
from videogrammetry.recognition import RecognitionOptions
from videogrammetry.sequence import open_sequence
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


@pytest.fixture(scope="module")
def recognised(photos):
    """The photographs' targets, recognised once."""
    source = open_sequence([str(photos / "photos")])
    options = RecognitionOptions(diameter_px=(4.0, 60.0))
    names = [f"photo{k + 1}" for k in range(len(source))]
    return read_photographs(source, names, TargetOptions(recognition=options))


def some(photographs, rows, **change):
    """Some of the photographs, in another order or twice."""
    parts = {
        field.name: tuple(getattr(photographs, field.name)[k] for k in rows)
        for field in fields(photographs)
    }
    parts["names"] = tuple(f"photo{k + 1}" for k in range(len(rows)))
    return Photographs(**{**parts, **change})


def with_noise(photographs, row, count):
    """One photograph ``count`` times, as if taken from one place: the noise differs."""
    rng = np.random.default_rng(1)
    own = photographs.targets[row]
    targets = tuple(
        replace(own, centre_px=own.centre_px + rng.normal(0, 0.01, own.centre_px.shape))
        for _ in range(count)
    )
    return some(photographs, [row] * count, targets=targets)


def bars_of(photos, factors):
    return [
        replace(bar, length_mm=bar.length_mm * factor)
        for bar, factor in zip(
            read_network_scale_bars(photos / "scale-bars.csv"), factors, strict=True
        )
    ]


def drawn(photos, change):
    """The true coordinates, changed, as a drawing."""
    table = read_network_points(photos / "truth" / "points.csv")
    return replace(table, position_mm=change(table.position_mm))


def exchanged(position_mm):
    return position_mm[np.random.default_rng(1).permutation(len(position_mm))]


def test_what_no_photographs_can_give_is_refused(photos, recognised):
    """Each in one paragraph that names the cause."""
    everything, bars = range(len(recognised.names)), bars_of(photos, (1, 1))
    for photographs, lengths, nominal, words in (
        (some(recognised, [0, 1]), (), None, "too few observations|do not determine all unknowns"),
        (some(recognised, [0] * 5), (), None, "one photograph is given twice"),
        (some(recognised, [*everything, 3]), bars, None, "photo4 and photo17 hold the same"),
        (with_noise(recognised, 0, 5), (), None, "seen from places apart"),
        (recognised, bars_of(photos, (1, 1.02)), None, "the scale bars contradict each other"),
        (recognised, bars, drawn(photos, lambda x: x / 1000), "0.001 times as large"),
        (recognised, bars, drawn(photos, lambda x: x * [1, 1, -1]), "mirror image"),
        (recognised, bars, drawn(photos, exchanged), "not those of the object"),
    ):
        with pytest.raises(CalibrationError, match=words):
            measure_target(photographs, lengths, nominal)


def test_what_may_be_wrong_is_solved_with_a_warning(photos, recognised):
    bars = bars_of(photos, (1e-3, 1e-3))
    said = measure_target(recognised, bars).result.warnings
    assert any("in other units than millimetres" in w for w in said)
    assert len(set(said)) == len(said)
    wrong = replace(TargetOptions(), f_px=200.0)
    said = measure_target(recognised, bars_of(photos, (1, 1)), options=wrong).result.warnings
    assert any("200 px was given" in w for w in said)


def test_a_rough_drawing_places_the_object(photos, recognised):
    """Off by 5 mm a coordinate: that is what drawings are, and the scale is the bars'."""
    rng = np.random.default_rng(2)
    rough = drawn(photos, lambda x: x + rng.normal(0, 5.0, x.shape))
    measured = measure_target(recognised, bars_of(photos, (1, 1)), rough)
    points, true = measured.result.points, read_network_points(photos / "truth" / "points.csv")
    at = {name: i for i, name in enumerate(points.name)}
    rows = [(at[name], k) for k, name in enumerate(true.name) if name in at]
    found, wanted = points.position_mm[[i for i, _ in rows]], true.position_mm[[k for _, k in rows]]
    rotation, shift, _ = fit_rigid(wanted, found)
    assert np.abs(found @ rotation.T + shift - wanted).max() < 0.1
    # Five millimetres of each of fifty points: below one of the frame.
    assert np.linalg.norm((found - wanted).mean(axis=0)) < 5 * 5 / np.sqrt(len(rows))
