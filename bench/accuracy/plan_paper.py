"""The plan's prediction for the paper's rig beside the bound of other programs' simulation.

    .venv/bin/python bench/accuracy/plan_paper.py [--json FILE]

Two facing pairs, 12 m, a mild lens (f, x0, y0, A1, A2, B1, B2 free), the two-sided cross of 1.4 m,
0.02 px, 0.1 mm of the target's coordinates; bars of 1100.057 mm in 5 x 5 x 2 m, seen by one
pair.

1. RMS standard deviation of the bar from the calibration alone: the bound (mean over many draws
   of random positions), ours for random positions by the same rule, and for the plan's own,
   which fill the volume evenly, tilt up to 45 degrees, and use what is in the picture.
2. The simulated data set (needs ../shared/data or $VIDEOGRAMMETRY_DATA): the bars of its
   table, predicted by its reference bundle, by ours from the same 16 positions, and by the plan.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math

import numpy as np
from calibration_data import bar_ends, data_folder, rig_simulated, true_rig

from videogrammetry.calibration import (
    CalibrationOptions,
    DesignOptions,
    calibrate,
    design_at_positions,
    design_calibration,
)
from videogrammetry.cli.plan import plan_target
from videogrammetry.geometry import MeasuringVolume, point_nearest_to_axes, rotation_from_vector
from videogrammetry.project import PlanTarget
from videogrammetry.reconstruction import Rig
from videogrammetry.rendering.scenes.paper_rig import paper_rig
from videogrammetry.types import INTERIOR_NAMES

BAR_MM = 1100.057
SIGMA_PX = 0.02
#: ANCHORS of the field: bound of the bar's RMS error from the calibration alone, mm.
MILD_MM = {8: 0.225, 16: 0.108, 24: 0.076}
ALL_TEN_MM = {8: 1.04, 16: 0.417, 24: 0.29}
WITHOUT_A3_MM = {16: 0.112}
IMAGE_NOISE_MM = 0.254
#: What their joint bundles estimate.
SEVEN = ("f", "x0", "y0", "A1", "A2", "B1", "B2")


def mild_rig():
    """Table 1's cameras with A2, A3, E1, E2 = 0 and a tenth of B1, B2."""
    keep = np.array([1, 1, 1, 1, 0, 0, 0.1, 0.1, 0, 0])
    rig = paper_rig()
    cameras = {
        n: dataclasses.replace(c, interior=c.interior * keep) for n, c in rig.cameras.items()
    }
    return dataclasses.replace(rig, cameras=cameras)


def volume_of(rig):
    """5 x 5 x 2 m where the cameras look."""
    return MeasuringVolume(
        centre_mm=point_nearest_to_axes(rig), size_mm=np.array([5000.0, 5000.0, 2000.0])
    )


def groups_of(rig):
    names = list(rig.cameras)
    return [names[:2], names[2:]]


def random_bars(rig, count=400, seed=1):
    """Exact pictures of both ends of bars, middles in the volume, any direction, for each pair."""
    rng = np.random.default_rng(seed)
    bare, volume, result = Rig.from_data(rig), volume_of(rig), []
    for group in groups_of(rig):
        middle = volume.fill(rng.uniform(size=(20 * count, 3)))
        half = rng.normal(size=middle.shape)
        half *= 0.5 * BAR_MM / np.linalg.norm(half, axis=1, keepdims=True)
        ends = [{n: bare.project(middle + s * half)[n] for n in group} for s in (-1, 1)]
        seen = np.all([((v >= 0) & (v <= 1023)).all(axis=1) for e in ends for v in e.values()], 0)
        chosen = np.flatnonzero(seen)[:count]
        result.append([{n: v[chosen] for n, v in e.items()} for e in ends])
    return result


def rms_sigma(rig, bars):
    """RMS over the bars of a length's sigma, mm: from the calibration, from the image noise."""
    found = [Rig.from_data(rig).distance(*ends, SIGMA_PX) for ends in bars]
    return tuple(
        math.sqrt(float(np.mean(np.concatenate([getattr(f, name) for f in found]) ** 2)))
        for name in ("sigma_rig_mm", "sigma_image_mm")
    )


def with_normals(target):
    """The data set's cross: its first 49 points face -z, the others +z."""
    normal = np.repeat([[0.0, 0, -1], [0.0, 0, 1]], 49, axis=0)
    return dataclasses.replace(target, normal=normal)


def random_positions(rig, target, count, rng):
    """As theirs: whole in all pictures, 1.5 m around the middle, tilted by 15 degrees or so."""
    poses = []
    middle, bare = point_nearest_to_axes(rig), Rig.from_data(rig)
    while len(poses) < count:
        across = rng.normal(size=2)
        tilt = np.radians(15) * rng.normal() * np.r_[across / np.linalg.norm(across), 0]
        roll = np.array([0, 0, rng.uniform(-1, 1) * np.radians(30)])
        rotation = rotation_from_vector(tilt) @ rotation_from_vector(roll)
        shift = middle + rng.uniform(-1, 1, 3) * [1500, 1500, 1000]
        seen = bare.project(target.position_mm @ rotation.T + shift).values()
        if all(((xy >= 0) & (xy <= 1023)).all() for xy in seen):
            poses.append((rotation, shift))
    return poses


def options_of(free, count=1, **how):
    return DesignOptions(count=count, sigma_px=SIGMA_PX, target_sigma_mm=0.1, free=free, **how)


def random_mean(rig, bars, count, free, draws=12):
    """Mean over draws of random positions, mm."""
    rng, target = np.random.default_rng(count), plan_target(PlanTarget())
    values = []
    for _ in range(draws):
        poses = random_positions(rig, target, count, rng)
        design = design_at_positions(rig, target, poses, options_of(free, whole=True))
        values.append(rms_sigma(design.rig, bars)[0])
    return float(np.mean(values))


def even(rig, bars, count, free):
    """The plan's own positions, mm."""
    options = options_of(free, count)
    design = design_calibration(rig, plan_target(PlanTarget()), volume_of(rig), options)
    return rms_sigma(design.rig, bars)[0]


def table(results):
    """Random positions as theirs, and the plan's own."""
    have = data_folder().is_dir()
    rig = true_rig(rig_simulated("mild")[2]) if have else mild_rig()
    bars = random_bars(rig)
    without_a3 = tuple(n for n in INTERIOR_NAMES if n != "A3")
    cases = [(f"seven free, n = {n}", n, SEVEN, bound) for n, bound in MILD_MM.items()]
    cases += [(f"all ten, n = {n}", n, INTERIOR_NAMES, b) for n, b in ALL_TEN_MM.items()]
    cases += [(f"without A3, n = {n}", n, without_a3, b) for n, b in WITHOUT_A3_MM.items()]
    print(f"{'bar, calibration alone, mm RMS':32} {'bound':>8} {'random':>8} {'ratio':>6} "
          f"{'plan':>8} {'ratio':>6}")  # fmt: skip
    for label, count, free, bound in cases:
        random, own = random_mean(rig, bars, count, free), even(rig, bars, count, free)
        print(f"{label:32} {bound:8.3f} {random:8.3f} {random / bound:6.2f} {own:8.3f} "
              f"{own / bound:6.2f}")  # fmt: skip
        results[label] = {"bound_mm": bound, "random_mm": random, "plan_mm": own}
    image = rms_sigma(rig, bars)[1]
    print(f"{'bar, image noise alone':32} {IMAGE_NOISE_MM:8.3f} {image:8.3f} "
          f"{image / IMAGE_NOISE_MM:6.2f}")  # fmt: skip
    results["image noise"] = {"bound_mm": IMAGE_NOISE_MM, "plan_mm": image}


def data_set(results):
    """The data set's own positions beside its reference bundle's prediction."""
    if not data_folder().is_dir():
        print("\nthe simulated data set is not here")
        return
    print(f"\n{'rig-simulated, its bars, mm RMS':32} {'pair':>4} {'bundle':>8} {'design':>8} "
          f"{'ratio':>6} {'plan':>8}")  # fmt: skip
    for kind in ("mild", "table1"):
        cameras, target, truth = rig_simulated(kind)
        reference, rig = truth["reference_joint_bundle"], true_rig(truth)
        free = tuple(reference["free"])
        run = calibrate(cameras, target, CalibrationOptions(sigma_mm=0.1, critical_value=0.0))
        poses = [run.rig_from_target[s] for s in sorted(run.rig_from_target)]
        design = design_at_positions(rig, with_normals(target), poses, options_of(free))
        for pair in ("12", "34"):
            bars, theirs = [bar_ends(kind, pair)], reference["bar_predicted_mm"][pair]
            same, own = rms_sigma(design.rig, bars)[0], even(rig, bars, 16, free)
            print(f"{kind:32} {pair:>4} {theirs:8.3f} {same:8.3f} {same / theirs:6.3f} {own:8.3f}")
            results[f"{kind}/{pair}"] = {"bundle_mm": theirs, "design_mm": same, "plan_mm": own}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", help="write the figures to this file")
    arguments = parser.parse_args()
    results: dict[str, object] = {}
    table(results)
    data_set(results)
    if arguments.json:
        with open(arguments.json, "w") as file:
            json.dump(results, file, indent=1)


if __name__ == "__main__":
    main()
