"""The paper's calibration experiment over many draws of its observations, without pictures.

    .venv/bin/python bench/accuracy/experiment_draws.py [--draws 100]

Four cameras with all ten parameters of Table 1, the two-sided cross at n = 8, 16
and 24 orientations, white noise on exact pictures of its targets and on its
coordinates. What a calibration does to bars of 1100.057 mm that fill the volume:
the exact pictures of their true ends, triangulated with the estimated rig.

- error: RMS over bars and draws, from the calibration alone; total: with noise
  on the pictures of the ends too.
- bound: Cramer-Rao, from the covariance of the joint adjustment at the true
  values with all ten parameters of every camera free, propagated to the bars.
- paired: over the error of least squares on the same observations, started at the
  truth with the true weights and all ten free, which attains the bound: the
  target's scale, one number a draw, makes most of the error and scatters both alike.
- predicted: what the runs say of themselves, RMS over bars and draws.

Places: 1-2 and 3-4: both ends by one pair; across: one end by each; point: 3-D
error of all these ends in the frame of the calibrated volume.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from videogrammetry.accuracy import CalibrationPart
from videogrammetry.accuracy.true_points import (
    exact_pictures,
    measured_from_true,
    rigid_frame,
    triangulate_pictures,
)
from videogrammetry.adjustment import AdjustOptions, Network
from videogrammetry.calibration import CalibrationOptions, CameraFrames, FrameTargets, calibrate
from videogrammetry.geometry import CAMERA_PARAMETERS
from videogrammetry.recognition import code_family
from videogrammetry.rendering.scenes import calibration_scene, cross_target, lab_frame
from videogrammetry.types import INTERIOR_NAMES, PointSet, RigData

BAR_MM = 1100.057
HALF_VOLUME_MM = (1500.0, 1000.0, 1500.0)  # x, y (depth), z (height) about the lab's origin
PAIRS = {"1-2": (0, 0), "3-4": (1, 1), "across": (0, 1)}  # pair of cameras of either end
PLACES = (*PAIRS, "point")
BORDER_PX = 4.0
MILD_NAMES = ("f", "x0", "y0", "A1", "B1", "B2")
METHODS = {
    "joint": (None, "joint"),
    "joint, ten fixed free": (INTERIOR_NAMES, "joint"),
    "mean of poses": (None, "mean"),
}


@dataclass(frozen=True)
class Setup:
    """Noise of an experiment, its lens and how many bars of a kind measure it.

    ``lens``: "table1" has all ten parameters; "mild" has f, x0, y0, A1 and a tenth of
    B1, B2, which other programs' models hold too.
    """

    orientations: int
    noise_px: float = 0.008
    target_mm: float = 0.1
    bars: int = 60
    lens: str = "table1"

    @property
    def free(self) -> tuple[str, ...]:
        """The parameters that the lens has."""
        return INTERIOR_NAMES if self.lens == "table1" else MILD_NAMES


@dataclass(frozen=True)
class Experiment:
    """The truth: rig, places of the cross's points at every stage, what is seen, bars' ends.

    ``places_mm`` (S, P, 3), ``pixels`` (S, P, C, 2), ``seen`` (S, P, C); ``ends_mm`` and
    ``used``: kind of bar -> (B, 2, 3) and (B, 2, C).
    """

    rig: RigData
    poses: list
    target: PointSet
    pixels: np.ndarray
    places_mm: np.ndarray
    seen: np.ndarray
    ends_mm: dict
    used: dict


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def inside(rig, pixels):
    """(..., C) whether there is a picture and it lies in it."""
    size = np.array([c.image_size_px for c in rig.cameras.values()])
    there = (pixels > BORDER_PX) & (pixels < size - 1 - BORDER_PX)
    return np.isfinite(pixels).all(axis=-1) & there.all(axis=-1)


def with_lens(rig, lens):
    """The rig with Table 1's lenses or the mild ones."""
    if lens == "table1":
        return rig
    keep = np.array([name in MILD_NAMES for name in INTERIOR_NAMES], dtype=float)
    keep[[INTERIOR_NAMES.index("B1"), INTERIOR_NAMES.index("B2")]] = 0.1
    cameras = {n: replace(c, interior=c.interior * keep) for n, c in rig.cameras.items()}
    return replace(rig, cameras=cameras)


@cache
def experiment(setup: Setup) -> Experiment:
    scene = calibration_scene(code_family("schneider-14"), num_orientations=setup.orientations)
    rig = with_lens(scene.rig, setup.lens)
    target = cross_target(code_family("schneider-14")).points()
    places, pixels, seen, poses = [], [], [], []
    centres = np.array([c.centre_mm for c in rig.cameras.values()])
    for stage in range(1, scene.num_stages + 1):
        place = scene.place(scene.time_s(stage))
        xy = exact_pictures(rig, place.centre_mm)
        to_camera = centres[None] - place.centre_mm[:, None]
        facing = np.einsum("pci,pi->pc", to_camera, place.normal) > 0
        places.append(place.centre_mm)
        pixels.append(xy)
        seen.append(facing & inside(rig, xy))
        pose = rigid_frame(place.centre_mm, target.position_mm)
        poses.append((pose.rotation, pose.translation_mm))
    ends, used = draw_bars(rig, setup.bars)
    return Experiment(
        rig=rig, poses=poses, target=target,
        pixels=np.array(pixels), places_mm=np.array(places), seen=np.array(seen),
        ends_mm=ends, used=used,
    )  # fmt: skip


def draw_bars(rig, count):
    """Bars at random places and in random directions, the ends in sight of their cameras."""
    lab, rng = lab_frame(rig), np.random.default_rng(1)
    ends, used = {}, {}
    for kind, sides in PAIRS.items():
        mask = np.array([[c // 2 == side for c in range(4)] for side in sides])
        found = []
        while len(found) < count:
            way = rng.normal(size=3)
            middle = rng.uniform(-1, 1, 3) * HALF_VOLUME_MM
            bar = middle + 0.5 * BAR_MM * np.outer([-1, 1], way / np.linalg.norm(way))
            if (np.abs(bar) > HALF_VOLUME_MM).any():
                continue
            bar = bar @ lab.rotation.T + lab.origin_mm
            if inside(rig, exact_pictures(rig, bar))[mask].all():
                found.append(bar)
        ends[kind] = np.array(found)
        used[kind] = np.broadcast_to(mask, (count, 2, 4))
    return ends, used


def network_at_truth(e: Experiment, setup: Setup, pixels, position_mm):
    """The joint adjustment with all of the lens' parameters free, standing at the true values."""
    network, poses = Network(), []
    for k, (name, camera) in enumerate(e.rig.cameras.items()):
        network.add_camera(name, camera, free=setup.free)
        poses.append(network.add_pose(name, camera.rotation, camera.translation_mm, free=k > 0))
    images, points, measured = [], [], []
    for s, pose in enumerate(e.poses):
        inner = network.add_pose(f"stage {s + 1}", *pose)
        for k in range(len(poses)):
            image = network.add_image(f"{k}/{s}", k, outer=poses[k] if k else -1, inner=inner)
            rows = np.flatnonzero(e.seen[s, :, k])
            images.append(np.full(len(rows), image))
            points.append(rows)
            measured.append(pixels[s, rows, k])
    cov = np.tile(np.eye(3) * setup.target_mm**2, (len(e.target), 1, 1))
    network.set_points(e.target.id, position_mm, cov)
    xy = np.concatenate(measured)
    variance = setup.noise_px**2
    network.set_observations(
        np.concatenate(images), np.concatenate(points), xy,
        np.tile([variance, 0, variance], (len(xy), 1)),
    )  # fmt: skip
    return network, poses


def rig_at_truth(e: Experiment, setup: Setup) -> RigData:
    """The true rig with the covariance that no unbiased calibration can be better than."""
    network, poses = network_at_truth(e, setup, e.pixels, e.target.position_mm)
    dispersion = network.dispersion()  # a priori: nothing is adjusted
    place = []
    for k, pose in enumerate(poses):
        first = int(dispersion.pose_index[pose])
        place += [int(p) for p in dispersion.interior_index[k]]
        place += [first + i if first >= 0 else -1 for i in range(6)]
    place = np.array(place)
    free = np.flatnonzero(place >= 0)
    cov = np.zeros((len(place),) * 2)
    cov[np.ix_(free, free)] = dispersion.cov[np.ix_(place[free], place[free])]
    names = tuple(f"{c}/{p}" for c in e.rig.cameras for p in CAMERA_PARAMETERS)
    return with_volume(replace(e.rig, cov=cov, cov_names=names), e)


def with_volume(rig: RigData, e: Experiment) -> RigData:
    twice = e.seen.sum(axis=2) >= 2
    return replace(rig, volume_mm=e.places_mm[twice], volume_seen=e.seen[twice])


def least_squares_from_truth(e: Experiment, setup: Setup, pixels, position_mm) -> RigData:
    """What attains the bound: true start, true weights, all of the lens free, nothing rejected."""
    network, poses = network_at_truth(e, setup, pixels, position_mm)
    network.adjust(
        AdjustOptions(critical_value=0, estimate_floor=False, robust_start=False, num_threads=1)
    )
    cameras = {}
    for k, (name, camera) in enumerate(e.rig.cameras.items()):
        rotation, shift = network.pose(poses[k])
        cameras[name] = replace(
            camera, interior=network.interior(k), rotation=rotation, translation_mm=shift
        )
    return with_volume(RigData(cameras=cameras), e)


def predicted(rig, e: Experiment, fit=None):
    """Kind -> (B,) standard deviations of lengths, and of points (3-D), that a rig states."""
    part = CalibrationPart(rig)
    result, points = {}, []
    for kind, ends in e.ends_mm.items():
        if fit is not None:
            ends = ends @ fit.rotation.T + fit.translation_mm
        effect = part.effects(ends.reshape(-1, 3), e.used[kind].reshape(-1, 4))
        effect = effect.reshape(*ends.shape, -1)
        along = ends[:, 1] - ends[:, 0]
        along /= np.linalg.norm(along, axis=1)[:, None]
        by_length = np.einsum("bi,bir->br", along, effect[:, 1] - effect[:, 0])
        result[kind] = np.linalg.norm(by_length, axis=1)
        points.append(np.sqrt((effect**2).sum(axis=(2, 3))).ravel())
    return {**result, "point": np.concatenate(points)}


def errors(rig, e: Experiment, fit, noise=None):
    """Kind -> (B,) errors of lengths, and of points (3-D); ``noise``: kind -> px on the ends."""
    result, points = {}, []
    for kind, ends in e.ends_mm.items():
        pixels = exact_pictures(e.rig, ends.reshape(-1, 3))
        if noise is not None:
            pixels = pixels + noise[kind]
        found = triangulate_pictures(rig, pixels, e.used[kind].reshape(-1, 4)).reshape(ends.shape)
        result[kind] = np.linalg.norm(found[:, 1] - found[:, 0], axis=1) - BAR_MM
        true = ends @ fit.rotation.T + fit.translation_mm
        points.append(np.linalg.norm(found - true, axis=2).ravel())
    return {**result, "point": np.concatenate(points)}


def observe(e: Experiment, pixels, variance, free):
    """The cameras' pictures: what is seen, under its number."""
    cameras = []
    for k, (name, camera) in enumerate(e.rig.cameras.items()):
        frames = []
        for s in range(len(e.poses)):
            rows = e.seen[s, :, k]
            frames.append(
                FrameTargets(
                    stage=s + 1, image=f"{name}_{s + 1}", id=e.target.id[rows],
                    xy_px=pixels[s, rows, k],
                    cov_px2=np.tile([variance, 0, variance], (int(rows.sum()), 1)),
                )
            )  # fmt: skip
        cameras.append(
            CameraFrames(name=name, image_size_px=camera.image_size_px, frames=frames, free=free)
        )
    return cameras


def draw(setup: Setup, seed: int, methods=tuple(METHODS)):
    """One draw of observations, calibrated by every method: method -> figures."""
    e, rng = experiment(setup), np.random.default_rng([seed, setup.orientations])
    pixels = e.pixels + rng.normal(0, setup.noise_px, e.pixels.shape)
    position = e.target.position_mm + rng.normal(0, setup.target_mm, e.target.position_mm.shape)
    noise = {kind: rng.normal(0, setup.noise_px, (2 * setup.bars, 4, 2)) for kind in PAIRS}
    target = PointSet(id=e.target.id, position_mm=position)
    efficient = least_squares_from_truth(e, setup, pixels, position)
    alone = errors(efficient, e, measured_from_true(efficient, e.rig))
    result = {"truth": {"error": {k: rms(v) for k, v in alone.items()}}}
    for method in methods:
        free, way = METHODS[method]
        options = CalibrationOptions(method=way, sigma_mm=setup.target_mm, num_threads=1)
        run = calibrate(observe(e, pixels, setup.noise_px**2, free), target, options)
        fit = measured_from_true(run.rig, e.rig)
        figures = {
            "error": errors(run.rig, e, fit), "total": errors(run.rig, e, fit, noise),
            "predicted": predicted(run.rig, e, fit),
        }  # fmt: skip
        result[method] = {key: {k: rms(v) for k, v in f.items()} for key, f in figures.items()}
        result[method] |= {
            "sigma0": run.sigma0, "redundancy": run.redundancy, "rms_px": run.rms_px,
            "floor_px": list(run.rig.sigma_floor_px.values()), "seconds": run.seconds,
            "rejected": int((~run.observations.used).sum()),
            "dropped": [
                f"{name} {p}" for name, kept in run.parameters_kept.items()
                for p in INTERIOR_NAMES if p not in kept
            ],
        }  # fmt: skip
    return result


def bound(setup: Setup):
    """Kind -> RMS over the bars of the Cramer-Rao bound, from the calibration alone."""
    e = experiment(setup)
    return {k: rms(v) for k, v in predicted(rig_at_truth(e, setup), e).items()}


def ratio_of(error, other):
    """RMS(error) / RMS(other) and its standard error from the scatter over the draws."""
    square = (error**2).mean() / (other**2).mean()
    rest = error**2 - square * other**2
    scatter = rest.std(ddof=1) if len(rest) > 1 else np.nan
    of_square = scatter / np.sqrt(len(error)) / (other**2).mean()
    return float(np.sqrt(square)), float(of_square / (2 * np.sqrt(square)))


def summary(draws, efficient, bounds):
    """Rows of the table: place -> figures over the draws of one method."""
    rows = {}
    for place in PLACES:
        error, own, total = (
            np.array([d[key][place] for d in draws]) for key in ("error", "predicted", "total")
        )
        limit = np.full(len(draws), bounds[place])
        best = np.array([d["error"][place] for d in efficient])
        rows[place] = {
            "error_mm": rms(error), "total_mm": rms(total), "bound_mm": bounds[place],
            "ratio": ratio_of(error, limit), "paired": ratio_of(error, best),
            "predicted_mm": rms(own), "over_predicted": rms(error) / rms(own),
            "single": [float(f(error / limit)) for f in (np.min, np.median, np.max)],
        }  # fmt: skip
    return rows


HEAD = (
    f"{'method':21} {'n':>3} {'place':6} {'error':>7} {'bound':>7} {'ratio':>6} {'+-':>5} "
    f"{'paired':>6} {'+-':>5} {'predicted':>9} {'ratio':>6} {'total':>7}  single draws / bound"
)

RUN = ("sigma0", "redundancy", "rms_px", "floor_px", "rejected", "seconds")
RUN_HEAD = (
    f"{'method':21} {'n':>3} {'sigma0':>7} {'scatter':>8} {'expected':>8} {'RMS px':>8} "
    f"{'floor px':>8} {'rejected':>8} {'s':>5}  dropped"
)


def show(method, n, rows):
    for place, r in rows.items():
        low, middle, high = r["single"]
        print(
            f"{method:21} {n:3d} {place:6} {r['error_mm']:7.4f} {r['bound_mm']:7.4f} "
            f"{r['ratio'][0]:6.3f} {r['ratio'][1]:5.3f} {r['paired'][0]:6.3f} "
            f"{r['paired'][1]:5.3f} {r['predicted_mm']:9.4f} {r['over_predicted']:6.3f} "
            f"{r['total_mm']:7.4f}  {low:.2f} {middle:.2f} {high:.2f}",
            flush=True,
        )


def show_runs(method, n, draws):
    """sigma0, what was dropped, and time."""
    column = {key: np.array([d[key] for d in draws]) for key in RUN}
    expected = 1 / np.sqrt(2 * column["redundancy"].mean())
    names = [name.split()[1] for d in draws for name in d["dropped"]]
    counts = [f"{p} {names.count(p)}" for p in INTERIOR_NAMES if p in names]
    print(
        f"{method:21} {n:3d} {column['sigma0'].mean():7.4f} {column['sigma0'].std():8.4f} "
        f"{expected:8.4f} {rms(column['rms_px']):8.5f} {rms(column['floor_px']):8.4f} "
        f"{column['rejected'].mean():8.2f} {np.median(column['seconds']):5.2f}  "
        f"{', '.join(counts) or 'none'} of {4 * len(draws)} each"
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=100, help="at n = 24; half of it at 8, 16")
    parser.add_argument("--noise-px", type=float, default=0.008)
    parser.add_argument("--target-mm", type=float, default=0.1, help="noise of its coordinates")
    parser.add_argument("--bars", type=int, default=60, help="of every kind")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes")
    parser.add_argument("--json", help="write the figures to this file")
    options = parser.parse_args()
    results: dict[str, object] = {}
    began, lines = time.perf_counter(), []
    print(HEAD)
    with ProcessPoolExecutor(options.jobs) as pool:
        for n in (24, 16, 8):
            setup = Setup(n, options.noise_px, options.target_mm, options.bars)
            count = options.draws if n == 24 else max(1, options.draws // 2)
            drawn = list(pool.map(draw, [setup] * count, range(count)))
            bounds = bound(setup)
            for method in METHODS:
                own = [d[method] for d in drawn]
                rows = summary(own, [d["truth"] for d in drawn], bounds)
                show(method, n, rows)
                lines.append((method, n, own))
                results[f"{method}/{n}"] = {"places": rows, "draws": own}
    print("\n" + RUN_HEAD)
    for line in lines:
        show_runs(*line)
    print(f"\n{time.perf_counter() - began:.0f} s")
    if options.json:
        with open(options.json, "w") as file:
            json.dump(results, file, indent=1)


if __name__ == "__main__":
    main()
