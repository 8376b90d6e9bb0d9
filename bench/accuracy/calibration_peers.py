"""The joint calibration beside OpenCV's and mrcal's, over many draws of the same observations.

    scripts/setup python3-mrcal
    .venv/bin/python bench/accuracy/calibration_peers.py [--trials 500]

The paper's rig with lenses that every model here can hold (f, x0, y0, A1, B1, B2; "mild"),
its two-sided cross at n = 8, 16 and 24 orientations, 0.02 px, 0.1 mm. Every method gets the
same pictures and frees the same parameters:

- joint: this program's default method, with ``free`` given, from no start values;
- cv2 + mean: cv2.calibrateCamera of every camera with the target fixed, its start value of f
  2 % off, then the mean of the relative poses (the paper's steps);
- cv2 stereo: cv2.stereoCalibrate of each facing pair from those, interior free;
- mrcal + mean: mrcal.optimize of every camera (its points, fixed, one pose a picture) from
  the same start, and the mean again.

error: RMS over bars of 1100.057 mm and trials, from calibration alone; bound: Cramer-Rao, the
covariance of the joint adjustment at the truth propagated to the bars; the interval is a
bootstrap over the trials (95 %). Times: median of a trial, one thread.

Below: the rig's parameters in the same trials over their covariance at the truth, as one
chi-square and each by itself; and linearised trials (one step from the truth).
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import cv2
import experiment_draws as draws
import numpy as np
from experiment_draws import PAIRS, Setup, errors, experiment, rms
from scipy.stats import chi2

from videogrammetry.adjustment import AdjustOptions
from videogrammetry.calibration import CalibrationOptions, calibrate
from videogrammetry.geometry import (
    nearest_rotation,
    project,
    rotation_from_vector,
    vector_from_rotation,
)
from videogrammetry.types import INTERIOR_NAMES, PointSet, RigCamera, RigData

PEERS = ("cv2 + mean", "cv2 stereo", "mrcal + mean")
MRCAL = ("/usr/bin/python3", str(Path(__file__).with_name("mrcal_points.py")))
FLAGS = (
    cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_ASPECT_RATIO | cv2.CALIB_FIX_K2
    | cv2.CALIB_FIX_K3
)  # fmt: skip
CRITERIA = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 200, 1e-12)
START_FACTOR = 1.02
# Lengths do not depend on it; positions are not compared.
SAME_FRAME = SimpleNamespace(rotation=np.eye(3), translation_mm=np.zeros(3))


def opencv_camera(size, matrix, coefficients, rotation, shift):
    """OpenCV's k1, p1, p2 as this program's A1, B2, B1 of the ideal direction with r0 = 0.

    mrcal cannot tie fx to fy: their ratio becomes E1 (what that leaves is the ratio less 1
    times the distortion, under 0.002 px).
    """
    f = matrix[1, 1]
    k1, _, p1, p2 = coefficients[:4]
    interior = np.zeros(len(INTERIOR_NAMES))
    interior[:3] = f, matrix[0, 2] - 0.5 * (size[0] - 1), matrix[1, 2] - 0.5 * (size[1] - 1)
    interior[[3, 6, 7, 8]] = k1 / f**2, p2 / f, p1 / f, matrix[0, 0] / f - 1
    return RigCamera(
        image_size_px=size, interior=interior, r0_px=0.0, rotation=rotation,
        translation_mm=shift, measured=False,
    )  # fmt: skip


def start_matrix(camera):
    w, h = camera.image_size_px
    f = START_FACTOR * camera.interior[0]
    return np.array([[f, 0, 0.5 * (w - 1)], [0, f, 0.5 * (h - 1)], [0, 0, 1.0]])


def views_of(e, k, pixels, position):
    """Stage -> (points, pixels) of a camera's pictures."""
    views = {}
    for s in range(len(e.poses)):
        rows = np.flatnonzero(e.seen[s, :, k])
        if len(rows) >= 6:
            views[s] = (rows, position[rows].astype(np.float32), pixels[s, rows, k])
    return views


def mean_pose(relative):
    """Mean rotation (nearest to the sum) and mean shift of poses."""
    rotation = nearest_rotation(sum(r for r, _ in relative))
    return rotation, np.mean([t for _, t in relative], axis=0)


def rig_of(e, lenses, poses):
    """A rig of one-camera calibrations and their stage -> cam_from_target, by the means."""
    cameras = {}
    for k, name in enumerate(e.rig.cameras):
        rotation, shift = np.eye(3), np.zeros(3)
        if k:
            shared = sorted(set(poses[0]) & set(poses[k]))
            relative = [
                (poses[k][s][0] @ poses[0][s][0].T,
                 poses[k][s][1] - poses[k][s][0] @ poses[0][s][0].T @ poses[0][s][1])
                for s in shared
            ]  # fmt: skip
            rotation, shift = mean_pose(relative)
        size, matrix, coefficients = lenses[k]
        cameras[name] = opencv_camera(size, matrix, coefficients, rotation, shift)
    return RigData(cameras=cameras)


def by_opencv(e, pixels, position):
    """One-camera calibrations: lenses, poses, views."""
    lenses, poses, views = [], [], []
    for k, camera in enumerate(e.rig.cameras.values()):
        view = views_of(e, k, pixels, position)
        points = [p for _, p, _ in view.values()]
        images = [xy.astype(np.float32) for _, _, xy in view.values()]
        _, matrix, coefficients, rvec, tvec = cv2.calibrateCamera(
            points, images, camera.image_size_px, start_matrix(camera), np.zeros(5), flags=FLAGS,
            criteria=CRITERIA,
        )  # fmt: skip
        lenses.append((camera.image_size_px, matrix, coefficients.ravel()))
        poses.append(
            {s: (cv2.Rodrigues(r)[0], t.ravel())
             for s, r, t in zip(view, rvec, tvec, strict=True)}
        )  # fmt: skip
        views.append(view)
    return lenses, poses, views


def by_stereo(e, lenses, views, mean_rig):
    """Each facing pair by stereoCalibrate, from the one-camera calibrations; pair -> rig."""
    names = list(e.rig.cameras)
    cameras = dict(mean_rig.cameras)
    for a, b in ((0, 1), (2, 3)):
        points, left, right = [], [], []
        for s in sorted(set(views[a]) & set(views[b])):
            both, ia, ib = np.intersect1d(views[a][s][0], views[b][s][0], return_indices=True)
            if len(both) < 6:
                continue
            points.append(views[a][s][1][ia])
            left.append(views[a][s][2][ia].astype(np.float32))
            right.append(views[b][s][2][ib].astype(np.float32))
        out = cv2.stereoCalibrate(
            points, left, right, lenses[a][1].copy(), lenses[a][2].copy(), lenses[b][1].copy(),
            lenses[b][2].copy(), lenses[a][0], flags=FLAGS, criteria=CRITERIA,
        )  # fmt: skip
        _, ma, da, mb, db, rotation, shift = out[:7]
        base = cameras[names[a]]
        cameras[names[a]] = opencv_camera(
            lenses[a][0], ma, da.ravel(), base.rotation, base.translation_mm
        )
        cameras[names[b]] = opencv_camera(
            lenses[b][0], mb, db.ravel(), rotation @ base.rotation,
            rotation @ base.translation_mm + shift.ravel(),
        )  # fmt: skip
    return RigData(cameras=cameras)


def by_mrcal(e, views, server):
    """Every camera by mrcal in the system's Python; None where it is not installed."""
    if server is None:
        return None
    request = {"cameras": []}
    for camera, view in zip(e.rig.cameras.values(), views, strict=True):
        request["cameras"].append(
            {
                "size": list(camera.image_size_px), "f": START_FACTOR * camera.interior[0],
                "points": [p.tolist() for _, p, _ in view.values()],
                "pixels": [xy.tolist() for _, _, xy in view.values()],
            }
        )  # fmt: skip
    server.stdin.write(json.dumps(request) + "\n")
    server.stdin.flush()
    answer = json.loads(server.stdout.readline())
    lenses, poses = [], []
    for camera, view, found in zip(
        e.rig.cameras.values(), views, answer["cameras"], strict=True
    ):  # fmt: skip
        fx, fy, cx, cy, k1, k2, p1, p2 = found["intrinsics"]
        matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
        lenses.append((camera.image_size_px, matrix, np.array([k1, k2, p1, p2])))
        poses.append(
            {s: (cv2.Rodrigues(np.array(rt[:3]))[0], np.array(rt[3:]))
             for s, rt in zip(view, found["poses"], strict=True)}
        )  # fmt: skip
    return rig_of(e, lenses, poses), answer["seconds"]


_SERVER = []


def mrcal_server():
    """One process of the system's Python a worker; None where mrcal is missing."""
    if not _SERVER:
        probe = subprocess.run([MRCAL[0], "-c", "import mrcal"], capture_output=True, check=False)
        _SERVER.append(
            subprocess.Popen(MRCAL, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
            if probe.returncode == 0
            else None
        )
    return _SERVER[0]


def parameter_errors(network, poses, e, setup):
    """Estimated less true parameters of the rig, in the order of ``free_places``."""
    found = []
    for k, camera in enumerate(e.rig.cameras.values()):
        step = network.interior(k) - camera.interior
        found += [step[INTERIOR_NAMES.index(name)] for name in setup.free]
        if k:
            rotation, shift = network.pose(poses[k])
            found += list(vector_from_rotation(rotation @ camera.rotation.T))
            found += list(shift - camera.translation_mm)
    return np.array(found)


def free_places(dispersion, poses, setup):
    places = []
    for k, pose in enumerate(poses):
        row = dispersion.interior_index[k]
        places += [int(row[INTERIOR_NAMES.index(name)]) for name in setup.free]
        if k:
            places += [int(dispersion.pose_index[pose]) + i for i in range(6)]
    return np.array(places)


def noisy(setup, seed):
    e, rng = experiment(setup), np.random.default_rng([seed, setup.orientations, 5])
    pixels = e.pixels + rng.normal(0, setup.noise_px, e.pixels.shape)
    position = e.target.position_mm + rng.normal(0, setup.target_mm, e.target.position_mm.shape)
    return e, pixels, position


def bar_errors(rig, e):
    """Kind -> RMS over the bars of the error from calibration alone."""
    found = errors(rig, e, SAME_FRAME)
    return {kind: rms(found[kind]) for kind in PAIRS}


def trial(setup: Setup, seed: int):
    """One draw, calibrated by every method."""
    cv2.setNumThreads(1)
    e, pixels, position = noisy(setup, seed)
    result = {}
    for label, free in (("joint", setup.free), ("joint, ten offered", None)):
        began = time.perf_counter()
        options = CalibrationOptions(sigma_mm=setup.target_mm, num_threads=1)
        run = calibrate(
            draws.observe(e, pixels, setup.noise_px**2, free),
            PointSet(id=e.target.id, position_mm=position), options,
        )  # fmt: skip
        result[label] = {"s": time.perf_counter() - began, "error": bar_errors(run.rig, e)}
    began = time.perf_counter()
    lenses, poses, views = by_opencv(e, pixels, position)
    mean_rig = rig_of(e, lenses, poses)
    alone = time.perf_counter() - began
    result["cv2 + mean"] = {"s": alone, "error": bar_errors(mean_rig, e)}
    began = time.perf_counter()
    stereo = by_stereo(e, lenses, views, mean_rig)
    seconds = alone + time.perf_counter() - began
    error = bar_errors(stereo, e) | {"across": np.nan}  # it ties no pair to the other
    result["cv2 stereo"] = {"s": seconds, "error": error}
    answer = by_mrcal(e, views, mrcal_server())
    if answer is not None:
        result["mrcal + mean"] = {"s": answer[1], "error": bar_errors(answer[0], e)}
    # The same observations by least squares from the truth: what its parameters err.
    network, network_poses = draws.network_at_truth(e, setup, pixels, position)
    network.adjust(
        AdjustOptions(critical_value=0, estimate_floor=False, robust_start=False, num_threads=1)
    )
    result["parameters"] = parameter_errors(network, network_poses, e, setup)
    return result


def linearised(setup: Setup, trials: int, seed: int = 0):
    """Errors of the parameters, (trials, U), of one Gauss-Newton step from the truth.

    The observations' derivatives come from differences of the exact pictures, not from the
    adjustment that is checked.
    """
    e = experiment(setup)
    network, poses = draws.network_at_truth(e, setup, e.pixels, e.target.position_mm)
    design, weight, prior = design_matrix(network, poses, e, setup)
    normal = design.T @ (weight[:, None] * design) + np.diag(prior)
    scale = 1 / np.sqrt(np.diag(normal))
    inverse = scale[:, None] * np.linalg.inv(normal * np.outer(scale, scale)) * scale
    rng = np.random.default_rng(seed)
    noise = rng.normal(size=(trials, len(weight))) * np.sqrt(weight)
    known = prior > 0
    pull = np.zeros((trials, len(prior)))
    pull[:, known] = rng.normal(size=(trials, int(known.sum()))) * np.sqrt(prior[known])
    return (noise @ design + pull) @ inverse


def design_matrix(network, poses, e, setup):
    """Derivatives by central differences: rig parameters as ``free_places``, then the stages'
    poses, then the target's coordinates; weights of the rows; weights of the priors."""
    names = list(e.rig.cameras)
    cameras = [e.rig.cameras[n] for n in names]
    free = [INTERIOR_NAMES.index(n) for n in setup.free]
    per = [len(free) + (6 if k else 0) for k in range(len(cameras))]
    first = np.concatenate([[0], np.cumsum(per)])
    pose0 = first[-1]
    point0 = pose0 + 6 * len(e.poses)
    width = point0 + 3 * len(e.target)
    blocks = []
    turn = [rotation_from_vector(1e-6 * s * np.eye(3)[i]) for i in range(3) for s in (1, -1)]
    for s, (rotation, shift) in enumerate(e.poses):
        for k, camera in enumerate(cameras):
            rows = np.flatnonzero(e.seen[s, :, k])
            if not len(rows):
                continue
            block = np.zeros((len(rows), 2, width))
            points = e.target.position_mm[rows]

            def picture(camera, pose, points):
                in_rig = points @ pose[0].T + pose[1]
                return project(camera, in_rig @ camera.rotation.T + camera.translation_mm)

            pose = (rotation, shift)
            for i, q in enumerate(free):
                step = np.zeros(10)
                step[q] = 1e-3 * max(abs(camera.interior[q]), [1, 1, 1, 1e-8, 0, 0, 1e-7, 1e-7,
                                                               0, 0][q] or 1e-8)  # fmt: skip
                ahead = picture(replace(camera, interior=camera.interior + step), pose, points)
                behind = picture(replace(camera, interior=camera.interior - step), pose, points)
                block[:, :, first[k] + i] = (ahead - behind) / (2 * step[q])
            for i in range(3):
                a, b = turn[2 * i], turn[2 * i + 1]
                step = 1e-3 * np.eye(3)[i]
                if k:
                    at = first[k] + len(free) + i
                    ahead = picture(replace(camera, rotation=a @ camera.rotation), pose, points)
                    behind = picture(replace(camera, rotation=b @ camera.rotation), pose, points)
                    block[:, :, at] = (ahead - behind) / 2e-6
                    moved = [
                        replace(camera, translation_mm=camera.translation_mm + t)
                        for t in (step, -step)
                    ]
                    block[:, :, at + 3] = (
                        picture(moved[0], pose, points) - picture(moved[1], pose, points)
                    ) / 2e-3
                at = pose0 + 6 * s + i
                block[:, :, at] = (
                    picture(camera, (a @ rotation, shift), points)
                    - picture(camera, (b @ rotation, shift), points)
                ) / 2e-6
                block[:, :, at + 3] = (
                    picture(camera, (rotation, shift + step), points)
                    - picture(camera, (rotation, shift - step), points)
                ) / 2e-3
                by_point = (
                    picture(camera, pose, points + step) - picture(camera, pose, points - step)
                ) / 2e-3
                block[np.arange(len(rows)), :, point0 + 3 * rows + i] = by_point
            blocks.append(block.reshape(-1, width))
    design = np.concatenate(blocks)
    prior = np.zeros(width)
    prior[point0:] = 1 / setup.target_mm**2
    return design, np.full(len(design), 1 / setup.noise_px**2), prior


def covariance_at_truth(setup):
    e = experiment(setup)
    network, poses = draws.network_at_truth(e, setup, e.pixels, e.target.position_mm)
    dispersion = network.dispersion()
    places = free_places(dispersion, poses, setup)
    return dispersion.cov[np.ix_(places, places)]


def interval(square, bound):
    """Ratio of RMS to bound and its 95 % bootstrap interval over the trials."""
    rng = np.random.default_rng(0)
    again = square[rng.integers(0, len(square), (4000, len(square)))].mean(axis=1)
    low, high = np.sqrt(np.quantile(again, [0.025, 0.975])) / bound
    return float(np.sqrt(square.mean()) / bound), float(low), float(high)


def show_bars(n, trials, bound, results):
    first = {kind: rms([t["cv2 + mean"]["error"][kind] for t in trials]) for kind in PAIRS}
    for method in ("joint", "joint, ten offered", *PEERS):
        own = [t[method] for t in trials if method in t]
        if not own:
            print(f"{method:19} {n:3d}  not installed")
            continue
        line = f"{method:19} {n:3d}"
        for kind in PAIRS:
            square = np.array([t["error"][kind] for t in own]) ** 2
            ratio, low, high = interval(square, bound[kind])
            error = float(np.sqrt(square.mean()))
            line += (
                f"  {error:6.4f} {ratio:5.2f} [{low:.2f} {high:.2f}] 1/{first[kind] / error:4.1f}"
            )
            results[f"{method}/{n}/{kind}"] = [error, bound[kind], ratio, low, high]
        print(f"{line}  {np.median([t['s'] for t in own]):6.3f}", flush=True)


def show_parameters(n, errors_, cov, label, results):
    """Chi-square of all parameters and the largest deviation of one sigma."""
    sigma = np.sqrt(np.diag(cov))
    scaled = errors_ / sigma
    correlation = cov / np.outer(sigma, sigma)
    square = np.einsum("ti,ti->t", scaled, np.linalg.solve(correlation, scaled.T).T)
    count, u = errors_.shape
    total, freedom = float(square.sum()), count * u
    p = 2 * min(chi2.cdf(total, freedom), chi2.sf(total, freedom))
    each = np.sqrt((scaled**2).mean(axis=0))
    print(
        f"{label:24} {n:3d} {count:6d} trials, {u} parameters: mean square "
        f"{total / freedom:.4f} (p = {p:.3f}), sigma of one over Monte Carlo's "
        f"{each.min():.3f} to {each.max():.3f} (+- {1 / np.sqrt(2 * count):.3f})",
        flush=True,
    )
    results[f"{label}/{n}"] = [total / freedom, p, float(each.min()), float(each.max())]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=500)
    parser.add_argument("--linearised", type=int, default=2000)
    parser.add_argument("--orientations", type=int, nargs="+", default=[8, 16, 24])
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--json")
    options = parser.parse_args()
    results: dict[str, object] = {}
    columns = "".join(f"  {kind + ': mm, / bound [95 %], 1/cv2':37}" for kind in PAIRS)
    print(f"{'method':19} {'n':>3}{columns}  s")
    lines = []
    with ProcessPoolExecutor(options.jobs) as pool:
        for n in options.orientations:
            setup = Setup(n, noise_px=0.02, target_mm=0.1, bars=60, lens="mild")
            trials = list(pool.map(trial, [setup] * options.trials, range(options.trials)))
            show_bars(n, trials, draws.bound(setup), results)
            lines.append((n, setup, np.array([t["parameters"] for t in trials])))
    print()
    for n, setup, found in lines:
        cov = covariance_at_truth(setup)
        show_parameters(n, found, cov, "adjusted", results)
        show_parameters(
            n, linearised(setup, options.linearised)[:, : len(cov)], cov, "linearised", results
        )
    if options.json:
        Path(options.json).write_text(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
