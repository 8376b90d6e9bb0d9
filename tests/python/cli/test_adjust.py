"""``videogrammetry adjust``: the files it writes, and what it says of bad ones."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from command_fakes import Run
from network_fakes import simulate, write_network

from videogrammetry.project.network_tables import read_network_points

FILES = {
    "points.csv", "points.npz", "cameras.json", "images.csv", "residuals.csv", "summary.json",
    "report.html",
}  # fmt: skip


def rows(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


def complaint(run: Run, *args: object, status: int = 1) -> str:
    result = run("adjust", *args, status=status)
    assert result.stdout == ""
    return result.stderr.splitlines()[-1]


def test_the_files(run: Run, tmp_path: Path) -> None:
    simulated = simulate(1, bars=2)
    path = write_network(tmp_path, simulated.network, "snooping = false")
    result = run("adjust", path, "--out", "out")
    out = tmp_path / "out"
    assert {p.name for p in out.iterdir()} == FILES | {"scale_bars.csv"}
    assert "redundancy" in result.stderr
    assert "wrote out" in result.stderr
    summary = json.loads((out / "summary.json").read_text())
    m = 2 * len(simulated.network.observations) + 2
    unknowns = 7 + 60 + 78
    assert (summary["observations"], summary["unknowns"]) == (m, unknowns)
    assert summary["redundancy"] == m - unknowns
    assert summary["sigma0_px"] == pytest.approx(0.05 * summary["sigma0"])
    assert isinstance(summary["rejected"], list)
    assert set(summary["how"]["inputs_sha256"]) == {
        "network.toml", "observations.csv", "points.csv", "bars.csv"
    }  # fmt: skip
    camera = json.loads((out / "cameras.json").read_text())["cameras"]["hand"]
    assert abs(camera["f_px"] - 2000) < 5 * camera["sigma"]["f_px"]
    assert np.shape(camera["correlation"]["matrix"]) == (7, 7)
    points = read_network_points(out / "points.csv")
    assert points.full_cov_mm2 is not None
    free = points.sigma_mm[:, 0] > 0
    assert free.sum() == 26
    error = (points.position_mm - simulated.position_mm)[free] / points.sigma_mm[free]
    assert np.abs(error).max() < 6
    images = rows(out / "images.csv")
    assert len(images) == 10
    assert float(images[0]["sigma_x_mm"]) > 0
    residuals = rows(out / "residuals.csv")
    assert len(residuals) == len(simulated.network.observations)
    assert {row["used"] for row in residuals} <= {"0", "1"}
    assert len(rows(out / "scale_bars.csv")) == 2
    page = (out / "report.html").read_text()
    assert ">hand</h2>" in page
    assert "src=" not in page


def test_what_was_adjusted_goes_in_again(run: Run, tmp_path: Path) -> None:
    """points.csv with points.npz of a free network are weighted points of the next."""
    simulated = simulate(1, kind="free", bars=2)
    path = write_network(tmp_path, simulated.network)
    run("adjust", path, "--out", "first")
    text = path.read_text().replace('"points.csv"', '"first/points.csv"')
    (tmp_path / "second.toml").write_text(text.replace('scale_bars = "bars.csv"\n', ""))
    run("adjust", "second.toml", "--out", "second")
    first = read_network_points(tmp_path / "first" / "points.csv")
    second = read_network_points(tmp_path / "second" / "points.csv")
    summary = json.loads((tmp_path / "second" / "summary.json").read_text())
    assert summary["datum"] == "weighted"
    moved = np.abs(second.position_mm - first.position_mm)
    assert (moved < 5 * first.sigma_mm).all()


def test_nothing_is_overwritten_without_force(run: Run, tmp_path: Path) -> None:
    path = write_network(tmp_path, simulate(1).network)
    run("adjust", path)
    assert (tmp_path / "adjusted" / "summary.json").is_file()
    assert "--force" in complaint(run, path)
    (tmp_path / "adjusted" / "notes.txt").write_text("mine")
    run("adjust", path, "--force")
    assert (tmp_path / "adjusted" / "notes.txt").read_text() == "mine"


def test_points_without_any_start(run: Run, tmp_path: Path) -> None:
    """Observations and scale bars alone: relative orientation finds the rest."""
    simulated = simulate(1, kind="free", bars=2)
    path = write_network(tmp_path, simulated.network)
    path.write_text(path.read_text().replace('points = "points.csv"\n', ""))
    run("adjust", path, "--out", "out")
    points = read_network_points(tmp_path / "out" / "points.csv")
    number = [int(name[1:]) for name in points.name]
    truth = simulated.position_mm[number]
    lengths = np.linalg.norm(np.diff(points.position_mm, axis=0), axis=1)
    np.testing.assert_allclose(lengths, np.linalg.norm(np.diff(truth, axis=0), axis=1), atol=0.5)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('fixed = ["T0"', 'fixed = ["T99", "T0"', "names point T99"),
        ('points = "points.csv"', 'points = "pionts.csv"', "no such table"),
        ("sigma_px", "sigma_pixel", "did you mean 'sigma_px'"),
        ("image_size_px = [1600, 1200]", "image_size_px = [800, 600]", "outside the picture"),
    ],
)
def test_bad_files(run: Run, tmp_path: Path, old: str, new: str, message: str) -> None:
    path = write_network(tmp_path, simulate(1).network)
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    said = complaint(run, path, "--out", "out")
    assert said.startswith("videogrammetry adjust: ")
    assert message in said
    assert not (tmp_path / "out").exists()


def test_a_bar_between_unknown_points(run: Run, tmp_path: Path) -> None:
    path = write_network(tmp_path, simulate(1, bars=1).network)
    (tmp_path / "bars.csv").write_text("point_a,point_b,length_mm,sigma_mm\nT0,T1x,100,0.1\n")
    assert "ends in point T1x" in complaint(run, path)


def test_a_picture_of_no_camera(run: Run, tmp_path: Path) -> None:
    path = write_network(tmp_path, simulate(1).network)
    with path.open("a") as file:
        file.write("[cameras.other]\nimage_size_px = [10, 10]\n[images.p00]\ncamera = 'hand'\n")
    assert "picture p01 of observations.csv has no table [images.p01]" in complaint(run, path)


def test_usage(run: Run, tmp_path: Path) -> None:
    path = write_network(tmp_path, simulate(1).network)
    assert "--threads" in complaint(run, path, "--threads", "-1", status=2)
    run("adjust", status=2)
