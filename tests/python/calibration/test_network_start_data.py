"""Networks of real photographs start without any start value: no f, no pose, no coordinate."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from videogrammetry.calibration.network_adjustment import adjust_network
from videogrammetry.calibration.network_input import (
    NetworkCamera,
    NetworkImage,
    NetworkInput,
    NetworkObservations,
    NetworkPoints,
)
from videogrammetry.calibration.network_start import start_network
from videogrammetry.geometry import default_r0_px
from videogrammetry.project.photomodeler import read_photomodeler_marks


def network_of(rows, size_px, camera_of, sigma_px):
    """A free network of (image, point, x, y), one camera a name that ``camera_of`` gives."""
    images = sorted({row[0] for row in rows})
    points = sorted({row[1] for row in rows})
    cameras = sorted({camera_of(image) for image in images})
    unknown = np.zeros(10)
    unknown[0] = np.nan
    return NetworkInput(
        cameras=tuple(
            NetworkCamera(
                name=name, image_size_px=size_px, interior=unknown.copy(),
                r0_px=default_r0_px(size_px), free=None,
            )
            for name in cameras
        ),
        images=tuple(NetworkImage(name=i, camera=cameras.index(camera_of(i))) for i in images),
        points=NetworkPoints(
            name=tuple(points),
            position_mm=np.full((len(points), 3), np.nan),
            kind=np.full(len(points), "free"),
        ),
        observations=NetworkObservations(
            image=np.array([images.index(row[0]) for row in rows], np.int32),
            point=np.array([points.index(row[1]) for row in rows], np.int32),
            xy_px=np.array([row[2:] for row in rows], dtype=float),
            cov_px2=np.tile([sigma_px**2, 0.0, sigma_px**2], (len(rows), 1)),
        ),
        sigma_px=sigma_px,
        datum="free",
    )  # fmt: skip


def camcal(data: Path) -> NetworkInput:
    marks = read_photomodeler_marks(data / "camcal" / "camcal-pmexport.txt")
    rows = [
        (image, point, *xy)
        for image, point, xy in zip(marks.image, marks.point, marks.xy_px.tolist(), strict=True)
    ]
    return network_of(rows, (2272, 1704), lambda image: "camera", 0.1)


def panel(data: Path) -> NetworkInput:
    with (data / "aicon-panel" / "coded_elsewhere.csv").open() as file:
        rows = [
            (row["image"], row["id"], float(row["x_px"]), float(row["y_px"]))
            for row in csv.DictReader(file)
        ]
    return network_of(rows, (2000, 1333), lambda image: image.split("_")[0], 0.05)


def similarity(found, true):
    """What is left of found points after the best shift, turn and scale onto the true ones."""
    a, b = found - found.mean(axis=0), true - true.mean(axis=0)
    u, s, vt = np.linalg.svd(b.T @ a)
    sign = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    scale = (s * np.diag(sign)).sum() / (a**2).sum()
    return b - scale * a @ (u @ sign @ vt).T


@pytest.mark.data
def test_a_sheet_in_21_photographs(data: Path) -> None:
    """DBAT's f is 7.45700 mm of pixels of 5.43764 / 1704 mm less 3.9e-4, 2336.9 px."""
    network = camcal(data)
    report = start_network(network).report
    assert len(report.placed) == 21, report.left_out
    assert len(report.groups) == 1
    # A flat sheet, distortion of 4e-3 per mm^2 mostly unmodelled yet: f to some per cent.
    assert report.f_px["camera"] == pytest.approx(2336.9, rel=0.05)
    # DBAT's 0.161 px are of all marks, too, but with the control points held.
    result = adjust_network(replace(network, critical_value=0.0))
    assert len(result.images) == 21
    assert 0.1 < result.summary.sigma0_px < 0.161
    # Theirs has its distortion zero at the centre, ours at r0: c = f / k.
    camera = result.cameras[0]
    r0_2 = camera.r0_px**2 * np.ones(3)
    k = 1.0 - np.cumprod(r0_2) @ [camera.values[name] for name in ("A1", "A2", "A3")]
    assert camera.values["f"] / k == pytest.approx(2336.9, rel=3e-3)


@pytest.mark.data
def test_a_panel_before_a_pair_of_cameras(data: Path) -> None:
    """Ten positions of 70 coded dots; AICON measured them to some hundredths of a millimetre."""
    network = panel(data)
    report = start_network(network).report
    assert len(report.placed) == 20, report.left_out
    result = adjust_network(network)
    assert len(result.images) == 20
    with (data / "aicon-panel" / "points.csv").open() as file:
        known = {
            r["id"]: [float(r[k]) for k in ("x_mm", "y_mm", "z_mm")] for r in csv.DictReader(file)
        }
    rows = [i for i, name in enumerate(result.points.name) if name in known]
    assert len(rows) >= 60
    true = np.array([known[result.points.name[i]] for i in rows])
    left = similarity(result.points.position_mm[rows], true)
    # Their stereo triangulation after a calibration left 0.018 to 0.037 mm a coordinate.
    assert np.sqrt(np.mean(left**2)) < 0.05
