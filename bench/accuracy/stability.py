"""Cameras that move during a sequence: when they are found, false alarms, the pose found anew.

    .venv/bin/python bench/accuracy/stability.py [--seeds 20] [--quiet 10]

Cameras on an arc of 25 degrees each, 4 m from a volume 0.7 m wide, f = 2650 px, 50 points
that swing by 20 mm and bend by 50 mm, pictures with 0.02 px of white noise; the rig is one
draw of a calibration (sigmas of tests/python/two_pairs.py times 0.2). Every fourth stage is
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
    EVERY,
    SIGMA_PX,
    body,
    calibrated,
    intersected,
    pictures,
    residuals_of,
    ring_rig,
    scale_of,
    turned,
    watched,
)

from videogrammetry.geometry import vector_from_rotation
from videogrammetry.reconstruction import Triangulator
from videogrammetry.reconstruction.camera_scores import (
    calibration_factor,
    camera_scores,
)
from videogrammetry.reconstruction.reorientation import reorient_by_rays
from videogrammetry.reconstruction.stability import PoseWatch

STAGES, AT = 1000, 500
AXES = {"across x": (1.0, 0, 0), "across y": (0, 1.0, 0), "along z": (0, 0, 1.0)}


def delays(seeds: int) -> None:
    print(f"turned at stage {AT} of {STAGES}, camera by turns, {seeds} seeds a row")
    print("cameras  mrad   axis      found  right alone  right among  median delay  largest  in 20")
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
            within = sum(d <= 20 for d in delay)
            shown = f"{'-':>12}"
            if delay:
                shown = f"{np.median(delay):12.0f}  {max(delay):7d}  {within:5d}"
            print(
                f"{cameras:7d}  {mrad:5.3f}  {axis:8}  {len(delay):5d}  {alone:11d}  {among:11d}"
                f"  {shown}"
            )


def quiet(seeds: int) -> None:
    print("\nfalse alarms in 10000 quiet stages (level: 0.001 a sequence)")
    print("cameras  calibration  sequences  alarms  mean chi2 of 6  largest of windows of 16")
    for cameras, sigma in ((4, 0.02), (4, 0.2), (4, 1.0), (2, 0.2), (3, 0.2)):
        alarms, mean, most = 0, [], 0.0
        for seed in range(seeds):
            watch = watched(100 + seed, cameras=cameras, stages=10_000, sigma=sigma)
            alarms += len(watch.changes)
            value = watch.series().chi2[14:]
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


def information(seeds: int) -> None:
    """What a look says of 0.1 mrad, and after how many looks the best test would know it.

    lambda = d'N d is the non-centrality of a look's chi-square. Whoever looks for a known
    direction with the noise alone, and allows 0.001 false alarms in 10000 stages, decides
    after log(10000 / (0.001 e)) / (lambda / 2) looks in the mean, e the stages between looks
    (Lorden 1971): no test is quicker.
    """
    print("\ninformation of 50 points on 0.1 mrad, one look; delay of the best test, stages")
    print("cameras  axis      lambda median  least  every stage  every fourth")
    for cameras in (4, 3, 2):
        normals = []
        for seed in range(seeds):
            rng = np.random.default_rng(seed)
            rig = ring_rig(cameras, rng, sigma=0.2)
            position = body(rng, 50, 1)[0]
            place, residual = intersected(Triangulator(rig), pictures(rig, position, rng))
            normal = camera_scores(rig, residuals_of(place, residual), 1).normal[0]
            own = 6 * (seed % cameras)
            normals.append(1e-8 * np.diag(normal)[own : own + 3])
        for k, axis in enumerate(AXES):
            of_look = np.array(normals)[:, k]
            looks = [2 * np.log(1e7 / e) / np.median(of_look) for e in (1, EVERY)]
            print(
                f"{cameras:7d}  {axis:8}  {np.median(of_look):13.1f}  {of_look.min():5.1f}"
                f"  {max(looks[0], 1):11.1f}  {EVERY * max(looks[1], 1):12.1f}"
            )


def cost(repeats: int = 60) -> None:
    rng = np.random.default_rng(0)
    rig = ring_rig(4, rng)
    factor, looks = calibration_factor(rig), 25
    position = body(rng, 50, looks).reshape(-1, 3)
    place, residual = intersected(Triangulator(rig), pictures(rig, position, rng))
    residuals = residuals_of(place, residual, looks)
    of_scores, of_test = [], []
    for _ in range(repeats):
        begun = time.perf_counter()
        scores = camera_scores(rig, residuals, looks, factor)
        of_scores.append(time.perf_counter() - begun)
        watch = PoseWatch(scale_of(4), 10_000)
        for k in range(60):  # as many looks as windows reach back to
            begun = time.perf_counter()
            watch.add(EVERY * (looks * k + np.arange(looks)), scores)
            of_test.append((k, time.perf_counter() - begun))
    stages = EVERY * looks
    # Of every batch the quickest of all repeats: other people's load comes and goes.
    late = [min(t for k, t in of_test if k == batch) for batch in range(20, 60)]
    print(
        f"\ncost for 50 points x 4 cameras: scores {1e6 * min(of_scores) / stages:.1f} us, test "
        f"{1e6 * np.mean(late) / stages:.1f} us a stage of the sequence"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--quiet", type=int, default=10)
    arguments = parser.parse_args()
    information(arguments.seeds)
    delays(arguments.seeds)
    quiet(arguments.quiet)
    reorientation(10 * arguments.seeds)
    cost()


if __name__ == "__main__":
    main()
