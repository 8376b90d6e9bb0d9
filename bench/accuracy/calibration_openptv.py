"""Calibration on OpenPTV's data beside OpenPTV's own figures.

    .venv/bin/python bench/accuracy/calibration_openptv.py [--data DIR]

test-cavity: one picture of a 73-point block a camera, through glass and water. The spheres are
recognised, numbered from OpenPTV's own orientations (its f of 70 mm held), and each camera's
pose is adjusted alone: median distance of the points. Then all four with more and more
parameters free: none may diverge.

four-camera-points: correspondences on planes in integer pixels. Calibrated on the planes 26, 150
and 274 mm ("interpolation") or on all five ("all"), judged on all of them: every point
triangulated from the four cameras, compared without a best fit. OpenPTV: 0.383 / 0.423 mm.
"""

from __future__ import annotations

import argparse
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from videogrammetry.adjustment import AdjustOptions, Network, resect
from videogrammetry.calibration import CalibrationOptions, CameraFrames, FrameTargets, calibrate
from videogrammetry.geometry import camera_model, project
from videogrammetry.recognition import RecognitionOptions, recognize
from videogrammetry.reconstruction import Rig
from videogrammetry.types import PointSet, RigCamera

CAVITY_SIZE, PIXEL_MM = (1280, 1024), 0.012
DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
SIZE = (2560, 2160)  # not stated; the largest coordinates are 2318 and 2018
OPENPTV_MM = {"all": 0.423, "interpolation": 0.383}
# A coordinate rounded to whole pixels errs by 1 / sqrt(12).
ROUNDED_PX = 12.0**-0.5
CHOICES = {
    "significant of ten": None,
    "f, x0, y0, A1": ("f", "x0", "y0", "A1"),
    "f, x0, y0, A1, B1, B2": ("f", "x0", "y0", "A1", "B1", "B2"),
    "all ten": ("f", "x0", "y0", "A1", "A2", "A3", "B1", "B2", "E1", "E2"),
}


def correspondences(folder):
    """(N, 3) points and (N, 4, 2) pixels."""
    tables = [np.loadtxt(folder / f"markers_c{k}.txt") for k in range(4)]
    return tables[0][:, 2:], np.stack([t[:, :2] for t in tables], axis=1)


def calibrated(points, pixels, free):
    cov = np.tile([ROUNDED_PX**2, 0.0, ROUNDED_PX**2], (len(points), 1))
    number = np.arange(1, len(points) + 1, dtype=np.int32)
    cameras = [
        CameraFrames(
            name=f"c{k}", image_size_px=SIZE, free=free,
            frames=[FrameTargets(stage=1, image=f"c{k}", id=number, xy_px=pixels[:, k],
                                 cov_px2=cov)],
        )
        for k in range(4)
    ]  # fmt: skip
    return calibrate(cameras, PointSet(id=number, position_mm=points), CalibrationOptions())


def four_camera_points(data):
    points, pixels = correspondences(data / "four-camera-points" / "all")
    print(f"{'calibrated on':14} {'free':24} {'RMS px':>7} {'sigma0':>7} {'rejected':>8} "
          f"{'3-D RMS mm':>10} {'x':>6} {'y':>6} {'z':>6}  OpenPTV")  # fmt: skip
    for name, openptv in OPENPTV_MM.items():
        train = correspondences(data / "four-camera-points" / name)
        for label, free in CHOICES.items():
            run = calibrated(*train, free)
            rig = Rig.from_data(run.rig)
            found, _ = rig.triangulate({f"c{k}": pixels[:, k] for k in range(4)})
            # The rig's frame is the first camera's: the one pose of the target leads there.
            rotation, shift = run.rig_from_target[1]
            error = (found - shift) @ rotation - points
            axis = np.sqrt((error**2).mean(axis=0))
            print(
                f"{name:14} {label:24} {run.rms_px:7.3f} {run.sigma0:7.3f} "
                f"{(~run.observations.used).sum():8d} "
                f"{np.sqrt((error**2).sum(axis=1).mean()):10.3f} {axis[0]:6.3f} {axis[1]:6.3f} "
                f"{axis[2]:6.3f}  {openptv:.3f}",
                flush=True,
            )


def read_orientation(path):
    """f in px, rotation and translation cam_from_world, place of the glass of an .ori file."""
    numbers = [float(word) for word in path.read_text().split()]
    centre, rotation = np.array(numbers[:3]), np.reshape(numbers[6:15], (3, 3))
    # OpenPTV's camera looks along -z with y up.
    turn = np.diag([1.0, -1.0, -1.0]) @ rotation.T
    return numbers[17] / PIXEL_MM, turn, -turn @ centre, numbers[20]


def pictures(camera, points):
    return project(camera, points @ camera.rotation.T + camera.translation_mm)


def spheres(path):
    """Centres and covariances of the block's bright spheres."""
    options = RecognitionOptions(codes="none", diameter_px=(4.0, 40.0))
    found = recognize(np.array(Image.open(path)), options)
    cov = np.stack([found.cov[:, 0, 0], found.cov[:, 0, 1], found.cov[:, 1, 1]], axis=1)
    return found.centre_px, cov


def numbered(expected, centres, limit_px):
    """Rows of points and of the pictures nearest to where they are expected, mutually."""
    distance = np.linalg.norm(expected[:, None] - centres[None], axis=2)
    near = distance.argmin(axis=1)
    mutual = distance.argmin(axis=0)[near] == np.arange(len(expected))
    good = mutual & (distance[np.arange(len(expected)), near] < limit_px)
    return np.flatnonzero(good), near[good]


def refracted(camera, points, glass_mm):
    """Where rays of points behind the plane z = glass_mm leave the water (index 1.333)."""
    centre = camera.centre_mm
    side = np.sign(glass_mm)
    above, below = (centre[2] - glass_mm) * side, (glass_mm - points[:, 2]) * side
    away = points[:, :2] - centre[:2]
    rho = np.linalg.norm(away, axis=1)
    x = rho * above / (above + below / 1.333)
    for _ in range(8):  # Newton on Snell's law
        air, water = np.hypot(x, above), np.hypot(rho - x, below)
        law = x / air - 1.333 * (rho - x) / water
        x = x - law / (above**2 / air**3 + 1.333 * below**2 / water**3)
    return np.column_stack([centre[:2] + away * (x / rho)[:, None], np.full(len(x), glass_mm)])


def pose_adjusted(camera, points, xy, cov, free=()):
    """The camera after a robust adjustment of its pose and of ``free``; its residuals."""
    network = Network()
    lens = replace(camera, rotation=np.eye(3), translation_mm=np.zeros(3))
    index = network.add_camera("camera", lens, free=free)
    pose = network.add_pose("pose", camera.rotation, camera.translation_mm)
    network.add_image("picture", index, inner=pose)
    network.set_points(np.arange(len(points)), points)
    n = len(points)
    network.set_observations(np.zeros(n), np.arange(n), xy, cov)
    done = network.adjust(AdjustOptions(critical_value=4.0))
    rotation, shift = network.pose(pose)
    found = replace(
        camera, rotation=rotation, translation_mm=shift, interior=network.interior(index)
    )
    return found, done


def best_numbers(camera, points, glass, centres, cov):
    """Numbers and pose: of the shifts by which expected places and spheres agree, the best.

    A row's spheres are 40 px apart: a shift by one of them agrees nearly as well, but for
    the ends of the rows.
    """
    expected = pictures(camera, refracted(camera, points, glass))
    apart = (centres[None] - expected[:, None]).reshape(-1, 2)
    apart = apart[np.abs(apart).max(axis=1) < 60.0]
    votes = (np.linalg.norm(apart[:, None] - apart[None], axis=2) < 4.0).sum(axis=1)
    best = None
    for _ in range(4):
        shift = apart[votes.argmax()]
        votes[np.linalg.norm(apart - shift, axis=1) < 12.0] = 0
        rows, own = numbered(expected + shift, centres, 12.0)
        found = resect(camera_model(camera), points[rows], centres[own], threshold_px=6.0)
        if not found:
            continue
        trial = replace(camera, rotation=found[0].rotation, translation_mm=found[0].translation_mm)
        for limit in (6.0, 4.0, 2.5):
            rows, own = numbered(pictures(trial, points), centres, limit)
            if len(rows) < 10:
                break
            trial, done = pose_adjusted(trial, points[rows], centres[own], cov[own])
        if len(rows) >= 10 and (best is None or done.used.sum() > best[3].used.sum()):
            best = trial, rows, own, done
    return best


def test_cavity(data):
    folder = data / "test-cavity" / "calibration"
    points = np.loadtxt(folder / "target.csv", delimiter=",", skiprows=1)[:, 1:]
    print("camera  spheres numbered rejected median px  RMS px   bar  reference")
    cameras = []
    for k in range(1, 5):
        f, rotation, shift, glass = read_orientation(folder / f"cam{k}.tif.ori")
        camera = RigCamera(
            image_size_px=CAVITY_SIZE, interior=np.r_[f, np.zeros(9)], r0_px=500.0,
            rotation=rotation, translation_mm=shift,
        )  # fmt: skip
        centres, cov = spheres(folder / f"cam{k}.tif")
        camera, rows, own, done = best_numbers(camera, points, glass, centres, cov)
        away = np.linalg.norm(done.residual_px, axis=1)
        rms = np.sqrt(np.mean(done.residual_px[done.used] ** 2))
        print(f"cam{k}    {len(centres):7d} {len(rows):8d} {int((~done.used).sum()):8d} "
              f"{np.median(away):9.3f} {rms:7.3f} {0.25:5.2f}  0.17-0.32", flush=True)  # fmt: skip
        cameras.append((camera, points[rows], centres[own], cov[own]))
    print("\nmore free, each camera alone (RMS px of what is used, converged):")
    for label, free in CHOICES.items():
        free = CHOICES["all ten"] if free is None else free
        if label == "significant of ten":
            continue
        line = []
        for camera, p, xy, cov in cameras:
            found, done = pose_adjusted(camera, p, xy, cov, free)
            rms = np.sqrt(np.mean(done.residual_px[done.used] ** 2))
            line.append(f"{rms:.3f} {'yes' if done.converged else 'NO'} f {found.interior[0]:.0f}")
        print(f"{label:24} " + "   ".join(line), flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    default = os.environ.get("VIDEOGRAMMETRY_DATA", str(DATA))
    parser.add_argument("--data", type=Path, default=Path(default))
    data = parser.parse_args().data
    test_cavity(data)
    print()
    four_camera_points(data)


if __name__ == "__main__":
    main()
