"""The camera model, derivatives, DLT and triangulation against truth, bounds and OpenCV.

    python bench/accuracy/geometry.py [DATA]

Prints the worst deviation beside what was asked of it.
"""

from __future__ import annotations

import csv
import json
import os
import sys
from pathlib import Path

import cv2
import numpy as np

from videogrammetry import geometry
from videogrammetry.adjustment import direct_linear_transform
from videogrammetry.reconstruction import Rig
from videogrammetry.types import INTERIOR_NAMES, RigCamera

F, X0, Y0 = 2600.0, 12.5, -30.25
K1, K2, P1, P2, K3 = -0.12, 0.3, 4e-4, -7e-4, -0.5


def row(what: str, value: float, bar: str) -> None:
    print(f"{what:62} {value:10.3g}   {bar}")


def camera(interior, r0_px=0.0, measured=True) -> RigCamera:
    return RigCamera(
        image_size_px=(1024, 1024),
        interior=np.asarray(interior, dtype=float),
        r0_px=r0_px,
        rotation=np.eye(3),
        translation_mm=np.zeros(3),
        measured=measured,
    )


def table_1(data: Path) -> list[tuple[RigCamera, np.ndarray, np.ndarray]]:
    """The paper's lenses with points and their pictures from another program."""
    cameras = json.loads((data / "camera-model/cameras.json").read_text())["cameras"]
    with open(data / "camera-model/projections.csv") as file:
        rows = list(csv.DictReader(file))
    result = []
    for name, c in cameras.items():
        mine = [r for r in rows if r["camera"] == name]
        result.append(
            (
                camera(
                    [c["f_px"], c["x0_px"], c["y0_px"], *(c[k] for k in INTERIOR_NAMES[3:])],
                    c["r0_px"],
                ),
                np.array([[float(r[k]) for k in ("X_mm", "Y_mm", "Z_mm")] for r in mine]),
                np.array([[float(r[k]) for k in ("x_px", "y_px")] for r in mine]),
            )
        )
    return result


def against_another_program(data: Path) -> None:
    forward = inverse = 0.0
    for cam, points, pixels in table_1(data):
        forward = max(forward, np.abs(geometry.project(cam, points) - pixels).max())
        rays = geometry.rays_through_pixels(cam, pixels)[:, :2] * cam.interior[0]
        ideal = points[:, :2] / points[:, 2:] * cam.interior[0]
        inverse = max(inverse, np.abs(rays - ideal).max())
    row("projection against camera-model, 240 points, px", forward, "<= 1e-9")
    row("its inverse, px", inverse, "<= 1e-9")


def against_opencv() -> None:
    rng = np.random.default_rng(1)
    interior = [F, X0, Y0, K1 / F**2, K2 / F**4, K3 / F**6, P2 / F, P1 / F, 0, 0]
    coefficients = np.array([K1, K2, P1, P2, K3])
    points = rng.uniform([-2000, -2000, 9000], [2000, 2000, 14000], (2000, 3))
    matrix = np.array([[F, 0, 511.5 + X0], [0, F, 511.5 + Y0], [0, 0, 1]])
    zero = np.zeros(3)
    theirs = cv2.projectPoints(points, zero, zero, matrix, coefficients)[0].reshape(-1, 2)
    ours = geometry.project(camera(interior, measured=False), points)
    row("polynomial of the ideal point against OpenCV, px", np.abs(ours - theirs).max(), "<= 1e-9")
    pixels = rng.uniform(0, 1023, (2000, 2))
    normalised = np.column_stack([(pixels - [511.5 + X0, 511.5 + Y0]) / F, np.ones(2000)])
    plain = np.diag([F, F, 1.0])
    ideal = cv2.projectPoints(normalised, zero, zero, plain, coefficients)[0].reshape(-1, 2)
    rays = geometry.rays_through_pixels(camera(interior), pixels)
    deviation = np.abs(rays[:, :2] * F - ideal).max()
    row("polynomial of the measured point against OpenCV, px", deviation, "<= 1e-9")
    back = geometry.project(camera(interior), 12000 * rays)
    row("and back, px", np.abs(back - pixels).max(), "<= 1e-9")


def derivatives(data: Path) -> None:
    """Central differences; steps move the picture by some 1e-3 px."""
    steps = np.array([1, 1, 1, 1e-10, 1e-16, 1e-22, 1e-9, 1e-9, 1e-5, 1e-5])
    worst_point = worst_interior = 0.0
    for cam, points, _ in table_1(data):
        _, by_point, by_interior = geometry.project_with_jacobians(cam, points)
        for k in range(3):
            step = 0.05 * np.eye(3)[k]
            numeric = (
                geometry.project(cam, points + step) - geometry.project(cam, points - step)
            ) / 0.1
            error = np.linalg.norm(by_point[:, :, k] - numeric, axis=1)
            worst_point = max(worst_point, (error / np.linalg.norm(by_point, axis=(1, 2))).max())
        for k in range(10):
            step = steps[k] * np.eye(10)[k]
            plus, minus = (camera(cam.interior + s * step, cam.r0_px) for s in (1, -1))
            numeric = geometry.project(plus, points) - geometry.project(minus, points)
            numeric /= 2 * steps[k]
            analytic = by_interior[:, :, k]
            # Where a derivative is nearly zero, rounding over the step decides.
            floor = 1e-12 / steps[k] / 1e-6
            error = np.linalg.norm(analytic - numeric, axis=1)
            scale = np.maximum(np.linalg.norm(analytic, axis=1), floor)
            worst_interior = max(worst_interior, (error / scale).max())
    row("derivatives by the point against numerical ones, relative", worst_point, "<= 1e-6")
    row("derivatives by the ten parameters, relative", worst_interior, "<= 1e-6")


def dlt() -> None:
    """11 parameters of 2 N coordinates: the expected residual is sigma sqrt(1 - 11 / 2N)."""
    rng = np.random.default_rng(2)
    exact, ratios = 0.0, []
    for _ in range(200):
        points = rng.uniform(-300, 300, (60, 3))
        in_cam = points + np.array([20, -30, 3000])
        pixels = 2600 * in_cam[:, :2] / in_cam[:, 2:] + 500
        truth = direct_linear_transform(points, pixels)
        exact = max(exact, abs(truth.calibration[0, 0] - 2600))
        noisy = direct_linear_transform(points, pixels + rng.normal(0, 0.05, pixels.shape))
        ratios.append(noisy.rms_px / (0.05 * np.sqrt(1 - 11 / 120)))
    row("DLT, exact pictures: error of f = 2600 px, px", exact, "<= 1e-6")
    row("DLT, noise: residual RMS over its expectation", float(np.mean(ratios)), "1.0 ... 1.1")


def triangulation() -> None:
    """Normalised squared errors are chi-square with 3 degrees of freedom."""
    rng = np.random.default_rng(3)
    for count in (2, 3, 4):
        cameras = {}
        for k in range(count):
            angle = (k - (count - 1) / 2) * 0.4
            c, s = np.cos(angle), np.sin(angle)
            rotation = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
            target = np.array([0, 0, 12000.0])
            cameras[f"c{k}"] = RigCamera(
                image_size_px=(1024, 1024),
                interior=np.r_[2650.0, 10, -20, -2e-8, np.zeros(6)],
                r0_px=400.0,
                rotation=rotation,
                translation_mm=target - rotation @ target,
            )
        rig = Rig(cameras=cameras)
        truth = rng.uniform([-1500, -1500, 10500], [1500, 1500, 13500], (20000, 3))
        pixels = {n: p + rng.normal(0, 0.05, p.shape) for n, p in rig.project(truth).items()}
        found, cov = rig.triangulate(pixels, 0.05)
        error = found - truth
        chi2 = np.einsum("ni,nij,nj->n", error, np.linalg.inv(cov), error)
        row(
            f"triangulation, {count} views: mean normalised squared error / 3",
            chi2.mean() / 3,
            f"1 +- {3 * np.sqrt(6 / 20000) / 3:.3f}",
        )


def main() -> None:
    default = os.environ.get("VIDEOGRAMMETRY_DATA", Path(__file__).parents[3] / "shared" / "data")
    data = Path(sys.argv[1] if len(sys.argv) > 1 else default)
    print(f"{'':62} {'measured':>10}   asked for")
    against_another_program(data)
    against_opencv()
    derivatives(data)
    dlt()
    triangulation()


if __name__ == "__main__":
    main()
