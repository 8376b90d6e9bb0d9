"""Cameras that move during a sequence: when they are found, false alarms, the pose found anew.

    .venv/bin/python bench/accuracy/stability.py [--seeds 20] [--quiet 10]

Cameras on an arc of 25 degrees each, 4 m from a volume 0.7 m wide, f = 2650 px, 50 points
that swing by 20 mm and bend by 50 mm, pictures with 0.02 px of white noise; the rig is one
draw of a calibration (sigmas of tests/python/two_pairs.py times 0.2). Every tenth stage is
looked at. tests/python/moving_camera.py makes all of it.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests" / "python"))
from moving_camera import (
    DISTANCE_MM,
    SIGMA_PX,
    body,
    calibrated,
    intersected,
    pictures,
    ring_rig,
    turned,
    watched,
)

from videogrammetry.geometry import vector_from_rotation
from videogrammetry.reconstruction import Triangulator
from videogrammetry.reconstruction.camera_scores import (
    PointResiduals,
    calibration_factor,
    camera_scores,
)
from videogrammetry.reconstruction.reorientation import reorient_by_rays
from videogrammetry.reconstruction.stability import PoseWatch

STAGES, AT = 1000, 500
AXES = {"across x": (1.0, 0, 0), "across y": (0, 1.0, 0), "along z": (0, 0, 1.0)}


def delays(seeds: int) -> None:
    print(f"turned at stage {AT} of {STAGES}, camera by turns, {seeds} seeds a row")
    print("cameras  mrad   axis      found  right alone  right among  median delay  largest")
    cases = [(4, 0.1), (4, 0.02), (4, 0.005), (3, 0.1), (2, 0.1)]
    for cameras, mrad in cases:
        for axis, unit in AXES.items():
            delay, alone, among = [], 0, 0
            for seed in range(seeds):
                camera = seed % cameras
                turn = 1e-3 * mrad * np.array(unit)
                watch = watched(seed, cameras=cameras, at=AT, camera=camera, turn_rad=turn)
                if not watch.changes:
                    continue
                change = watch.changes[0]
                delay.append(change.found - AT)
                alone += change.cameras == (camera,)
                among += camera in change.cameras
            shown = f"{np.median(delay):12.0f}  {max(delay):7d}" if delay else f"{'-':>12}"
            print(
                f"{cameras:7d}  {mrad:5.3f}  {axis:8}  {len(delay):5d}  {alone:11d}  {among:11d}"
                f"  {shown}"
            )


def quiet(seeds: int) -> None:
    print("\nfalse alarms in 10000 quiet stages (level: 0.001 a sequence)")
    print("cameras  calibration  sequences  alarms  mean chi2 of 6  largest of windows of 8")
    for cameras, sigma in ((4, 0.02), (4, 0.2), (4, 1.0), (2, 0.2), (3, 0.2)):
        alarms, mean, most = 0, [], 0.0
        for seed in range(seeds):
            watch = watched(100 + seed, cameras=cameras, stages=10_000, sigma=sigma)
            alarms += len(watch.changes)
            value = watch.series().chi2[40:]
            mean.append(value.mean())
            most = max(most, float(value.max()))
        print(
            f"{cameras:7d}  {sigma:11.2f}  {seeds:9d}  {alarms:6d}  {np.mean(mean):14.2f}"
            f"  {most:6.1f} of {watch.critical:.1f}"
        )


def reorientation(draws: int) -> None:
    print(f"\npose found anew by the rays of the others, 30 points once, {draws} draws")
    print("cameras  calibration  RMS turn mrad  stated  RMS shift mm  stated  chi2 of 6")
    for cameras, sigma in ((4, 0.02), (4, 0.2), (4, 1.0), (3, 0.2)):
        rng = np.random.default_rng(1)
        error, stated, chi2 = [], [], []
        for _ in range(draws):
            truth = ring_rig(cameras, rng, sigma=sigma)
            rig = calibrated(truth, rng)
            after = turned(truth, 1, (3e-4, -5e-4, 2e-4), (0.4, -0.2, 0.1))
            xy = pictures(after, body(rng, 30, 1)[0], rng)
            found = reorient_by_rays(rig, "c2", xy, np.full(xy.shape, SIGMA_PX**2))
            new, true = found.rig.cameras["c2"], after.cameras["c2"]
            off = vector_from_rotation(new.rotation @ true.rotation.T)
            error.append(np.concatenate([off, new.centre_mm - true.centre_mm]))
            stated.append(np.diag(found.cov))
            chi2.append(error[-1] @ np.linalg.solve(found.cov, error[-1]))
        rms = np.sqrt(np.mean(np.square(error), axis=0).reshape(2, 3).sum(axis=1))
        said = np.sqrt(np.mean(stated, axis=0).reshape(2, 3).sum(axis=1))
        print(
            f"{cameras:7d}  {sigma:11.2f}  {1e3 * rms[0]:13.4f}  {1e3 * said[0]:6.4f}"
            f"  {rms[1]:12.3f}  {said[1]:6.3f}  {np.mean(chi2):9.2f}"
            f" (+- {np.sqrt(12 / draws):.2f})"
        )


def cost(repeats: int = 15) -> None:
    rng = np.random.default_rng(0)
    rig = ring_rig(4, rng)
    factor, looks = calibration_factor(rig), 10
    position = body(rng, 50, looks).reshape(-1, 3)
    place, residual = intersected(Triangulator(rig), pictures(rig, position, rng))
    residuals = PointResiduals(
        look=np.repeat(np.arange(looks), 50),
        position_mm=place,
        residual_px=residual,
        variance_px2=np.full(residual.shape, SIGMA_PX**2),
        systematic=np.zeros(residual.shape[:2]),
    )
    scale = np.tile([1 / 2650] * 3 + [DISTANCE_MM / 2650] * 3, (4, 1))
    of_scores, of_test = [], []
    for _ in range(repeats):
        begun = time.perf_counter()
        scores = camera_scores(rig, residuals, looks, factor)
        of_scores.append(time.perf_counter() - begun)
        watch = PoseWatch(scale, 1000)
        begun = time.perf_counter()
        for k in range(40):
            watch.add(np.arange(looks) * 10 + 100 * k, scores)
        watch.finish()
        of_test.append((time.perf_counter() - begun) / 40)
    print(
        f"\ncost for 50 points x 4 cameras: scores {1e4 * min(of_scores):.1f} us, test "
        f"{1e4 * min(of_test):.1f} us a stage of the sequence"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--quiet", type=int, default=10)
    arguments = parser.parse_args()
    delays(arguments.seeds)
    quiet(arguments.quiet)
    reorientation(10 * arguments.seeds)
    cost()


if __name__ == "__main__":
    main()
