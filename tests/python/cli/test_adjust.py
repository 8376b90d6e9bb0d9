"""``videogrammetry adjust``: the files it writes, and what it says of bad ones."""

from __future__ import annotations

import csv
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_fakes import Run
from network_fakes import simulate, write_network

from videogrammetry.calibration.network_input import NetworkInput
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


# Networks that cannot be right: refused, or solved with a warning that names the cause.


def with_rows(network: NetworkInput, keep: np.ndarray) -> NetworkInput:
    seen = network.observations
    return replace(
        network,
        observations=replace(
            seen, image=seen.image[keep], point=seen.point[keep], xy_px=seen.xy_px[keep],
            cov_px2=seen.cov_px2[keep],
        ),
    )  # fmt: skip


def with_xy(network: NetworkInput, xy_px: np.ndarray) -> NetworkInput:
    return replace(network, observations=replace(network.observations, xy_px=xy_px))


def with_positions(network: NetworkInput, position_mm: np.ndarray, **more: object) -> NetworkInput:
    return replace(network, points=replace(network.points, position_mm=position_mm, **more))


def with_free(network: NetworkInput, *free: str) -> NetworkInput:
    return replace(network, cameras=(replace(network.cameras[0], free=free),))


def with_longer_bar(network: NetworkInput, bar: int, by_mm: float) -> NetworkInput:
    length = network.scale_bars.length_mm.copy()
    length[bar] += by_mm
    return replace(network, scale_bars=replace(network.scale_bars, length_mm=length))


def shuffled_names(network: NetworkInput) -> NetworkInput:
    """In every picture all names stand at wrong points."""
    seen, rng = network.observations, np.random.default_rng(1)
    point = seen.point.copy()
    for image in range(len(network.images)):
        rows = np.flatnonzero(seen.image == image)
        point[rows] = rng.permutation(point[rows])
    return replace(network, observations=replace(seen, point=point))


FIXED, FREE = simulate(1).network, simulate(1, kind="free", bars=2).network
Y_DOWN, Y_UP = np.array([1, -1]), np.array([0, 1199])
SQUARE = simulate(1, kind="free", bars=2, flat=True, tilt=0.01).network
REFUSED = {
    "too few points of the pictures": (
        with_rows(FIXED, np.isin(FIXED.observations.point, [4, 5, 6])),
        "too few common points.*p00: only 3 of its points",
    ),
    "too few common points": (
        with_rows(FREE, np.isin(FREE.observations.point, [0, 1, 2, 4, 5])),
        "the most common points, 5, are in p00 and p01; 8 are needed",
    ),
    "one picture of unknown points": (
        simulate(1, kind="free", count=1).network,
        "one picture alone cannot tell where points are",
    ),
    "four known points in one picture, seven of the camera": (
        simulate(1, count=1).network,
        r"rank defect.; free to move: .*hand f.* 4 image points of 4 points .* in 1 pictures.*"
        "free fewer",
    ),
    "two bars": (with_longer_bar(FREE, 1, 1.0), "scale bars contradict each other.*T1-T2"),
    "a bar and fixed points": (
        with_longer_bar(simulate(1, bars=1).network, 0, 3.0),
        "bars and the fixed or weighted points contradict each other: bar T0-T1 is 983.6",
    ),
    "points in metres": (
        with_positions(simulate(1, bars=2).network, 1e-3 * FIXED.points.position_mm),
        "are these metres",
    ),
    "pixels in millimetres": (
        with_xy(FIXED, 0.005 * FIXED.observations.xy_px), "these are millimetres, not pixels"
    ),
    "millimetres from the middle": (
        with_xy(FIXED, 0.005 * (FIXED.observations.xy_px - [800, 600])), "these are millimetres"
    ),
    "y upwards, known points": (
        with_xy(FIXED, FIXED.observations.xy_px * Y_DOWN + Y_UP), "left-handed.*mirror"
    ),
    "y upwards, start values": (
        with_xy(FREE, FREE.observations.xy_px * Y_DOWN + Y_UP), "y upwards, or .* left-handed"
    ),
    "names at wrong points": (
        shuffled_names(FREE), "no two pictures can be oriented.*the numbers.*are wrong"
    ),
    "two fixed points": (
        with_positions(
            FIXED, FIXED.points.position_mm,
            kind=np.where(np.arange(30) < 2, "fixed", "free"),
        ),
        "2 points .* and a frame needs three",
    ),
    "three fixed points on a line": (
        with_positions(
            FIXED, np.where(np.arange(30)[:, None] < 3, np.arange(30)[:, None] * [100.0, 0, 0],
                            FIXED.points.position_mm),
            kind=np.where(np.arange(30) < 3, "fixed", "free"),
        ),
        "lie on one line",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_refused(run: Run, tmp_path: Path, case: str) -> None:
    network, message = REFUSED[case]
    path = write_network(tmp_path, network, "snooping = 3.29")
    said = complaint(run, path, "--out", "out")
    assert said.startswith("videogrammetry adjust: ")
    assert re.search(message, said), said
    assert not (tmp_path / "out").exists()


HALF = np.where(FREE.observations.image < 6, FREE.observations.point < 15,
                FREE.observations.point >= 15)  # fmt: skip
TIED = np.where(FREE.observations.image < 6, FREE.observations.point < 16,
                FREE.observations.point >= 14)  # fmt: skip
WARNED = {
    "two groups of pictures": (with_rows(FREE, HALF), "", "2 groups without a common point.*p06"),
    "two groups with two common points": (
        with_rows(FREE, TIED), "", r"too few common points tie together.*2 points in common \(T14, "
    ),
    "f, E1 and aspect are one": (
        with_free(FREE, "f", "x0", "y0", "A1", "A2", "B1", "B2", "E1", "aspect"), "",
        "f is not determined|highly correlated: f and|E1 is not determined|aspect is not",
    ),
    "two bars, not tested": (
        with_longer_bar(FREE, 1, 1.0), "snooping = false", "bar T1-T2 contradicts.*snooping = false"
    ),
    "one bar of three": (
        with_longer_bar(simulate(1, kind="free", bars=3).network, 1, 1.0), "",
        "bar T1-T2 contradicts the others by 0.99.* left out",
    ),
    "a plane seen square": (SQUARE, "", "f is not determined.*held.*in a plane"),
    "fixed points in metres": (
        with_positions(FIXED, 1e-3 * FIXED.points.position_mm), "", "the object is 0.96 mm long"
    ),
    "start values in metres": (
        with_positions(FREE, 1e-3 * FREE.points.position_mm), "",
        "start values are 0.00099.* times as large .*: are these metres",
    ),
    "bars in metres": (
        replace(FREE, scale_bars=replace(FREE.scale_bars,
                                         length_mm=1e-3 * FREE.scale_bars.length_mm)), "",
        "start values are 999.* are the bars' lengths in metres",
    ),
    "a wrong fixed point": (
        with_positions(FIXED, FIXED.points.position_mm + 80.0 * np.eye(30, 3)[:, [0]] * [1, 0, 0]),
        "", "1 of 4 known points do not fit the block.*: T0",
    ),
    "no scale": (simulate(1, kind="free").network, "", "no scale bar and no known point gives"),
}  # fmt: skip


@pytest.mark.parametrize("case", WARNED)
def test_solved_with_a_warning(run: Run, tmp_path: Path, case: str) -> None:
    network, more, message = WARNED[case]
    path = write_network(tmp_path, network, more)
    said = run("adjust", path, "--out", "out").stderr
    assert any(re.search(message, line) for line in said.splitlines()), said
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert any(re.search(message, line) for line in summary["warnings"])
    assert "RuntimeWarning" not in said


def test_a_plane_seen_tilted_is_right(run: Run, tmp_path: Path) -> None:
    """Flat objects are no fault: distances within five of their standard deviations."""
    simulated = simulate(1, kind="free", bars=2, flat=True)
    result = run("adjust", write_network(tmp_path, simulated.network), "--out", "out")
    assert "warning" not in result.stderr
    points = read_network_points(tmp_path / "out" / "points.csv")
    error = np.linalg.norm(points.position_mm[0] - points.position_mm[2]) - np.linalg.norm(
        simulated.position_mm[0] - simulated.position_mm[2]
    )
    assert abs(error) < 5 * np.hypot(*np.linalg.norm(points.sigma_mm[[0, 2]], axis=1))


def test_one_picture_of_known_points(run: Run, tmp_path: Path) -> None:
    """A resection by 30 fixed points, the lens held at the truth but for what is free."""
    simulated = simulate(1, count=1, free=("f", "x0", "y0", "A1", "A2"))
    network = with_positions(simulated.network, simulated.position_mm, kind=np.full(30, "fixed"))
    run("adjust", write_network(tmp_path, network), "--out", "out")
    camera = json.loads((tmp_path / "out" / "cameras.json").read_text())["cameras"]["hand"]
    assert abs(camera["f_px"] - 2000) < 5 * camera["sigma"]["f_px"]


@pytest.mark.parametrize(
    ("row", "column", "value", "message"),
    [
        (6, 2, "nan", "line 7, column x_px: 'nan' is not a finite number"),
        (6, 3, "inf", "line 7, column y_px: 'inf' is not a finite number"),
        (6, 1, "T0", "observation p00 T0 stands twice, first on line 2"),
    ],
)
def test_bad_observations(
    run: Run, tmp_path: Path, row: int, column: int, value: str, message: str
) -> None:
    path = write_network(tmp_path, FIXED)
    table = tmp_path / "observations.csv"
    lines = table.read_text().splitlines()
    cells = lines[row].split(",")
    cells[column] = value
    table.write_text("\n".join([*lines[:row], ",".join(cells), *lines[row + 1 :]]) + "\n")
    assert message in complaint(run, path, "--out", "out")


def test_whose_residuals(run: Run, tmp_path: Path) -> None:
    """Corrected residuals are those over what the lens stretches; the ideal direction has none."""
    path = write_network(tmp_path, FIXED, 'residuals = "corrected"\nsnooping = false')
    run("adjust", path, "--out", "corrected")
    path.write_text(path.read_text().replace('"corrected"', '"measured"'))
    run("adjust", path, "--out", "measured")
    f_px, moved, sigma0 = [], [], []
    for name in ("corrected", "measured"):
        camera = json.loads((tmp_path / name / "cameras.json").read_text())["cameras"]["hand"]
        f_px.append(camera["f_px"])
        moved.append(camera["sigma"]["f_px"])
        sigma0.append(json.loads((tmp_path / name / "summary.json").read_text())["sigma0"])
    # Corners stretched by some per cent: other weights, the same lens within its sigma.
    assert 0 < abs(f_px[0] - f_px[1]) < moved[0]
    assert 0 < abs(sigma0[0] / sigma0[1] - 1) < 0.05
    text = path.read_text().replace('"measured"', '"corrected"')
    path.write_text(text + 'distortion = "ideal"\n')
    assert 'needs distortion = "measured", and camera hand has' in complaint(run, path, "--force")
