"""Gross errors in a network: found, named, and without effect on the result?

    .venv/bin/python bench/accuracy/network_gross_errors.py [--draws 24] [--jobs 2] [--json FILE]

One camera (4000 x 3000, f 4200 px, 0.05 px) takes 22 photographs around a cross of 49
points and five scale bars of two points each. Planted in every draw: 5 % of the image points
off by 5 sigma to 400 px (evenly by the logarithm, in any direction), two pairs of points
whose names are swapped in one photograph each, one bar wrong by 0.2 to 5 mm (sigma 0.01 mm).
Start values: f 30 % too short or too long, every pose turned by 45 degrees about any axis.

What is printed:

1. Result: the largest and the RMS difference of all points and of the cameras' parameters
   from the adjustment of the same network without the planted rows, in the latter's
   sigmas; also from that adjustment with what was missed put back and what was rejected
   in excess taken out: not zero where the way to the result mattered.
2. Of planted errors beyond 1.5 times their minimal detectable bias (of the network without
   errors, 80 % power): the share listed in ``rejected``.
3. What is listed beside them, and what the test's level makes of as many good coordinates.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy import stats

from videogrammetry.calibration.network_adjustment import adjust_network
from videogrammetry.calibration.network_bars import bars_at
from videogrammetry.calibration.network_input import (
    NetworkCamera,
    NetworkImage,
    NetworkInput,
    NetworkObservations,
    NetworkPoints,
    ScaleBars,
)
from videogrammetry.calibration.network_result import NetworkAdjustment
from videogrammetry.geometry import project, rotation_from_vector
from videogrammetry.recognition import code_family
from videogrammetry.rendering.scenes.cross import cross_target
from videogrammetry.types import RigCamera

SIZE, R0_PX = (4000, 3000), 1500.0
INTERIOR = np.array([4200.0, 15, -10, -4e-9, 1.5e-16, 0, 5e-8, -4e-8, 0, 0])
SIGMA_PX, BAR_SIGMA_MM = 0.05, 0.01
IMAGES, BARS, SHARE, SWAPS = 22, 5, 0.05, 2
LARGEST_PX = 400.0
CRITICAL = 3.29
#: What a normal deviate exceeds by chance in either direction at this critical value.
LEVEL = 2 * stats.norm.sf(CRITICAL)
FREE = ("f", "x0", "y0", "A1", "A2", "B1", "B2")


@dataclass(frozen=True)
class Draw:
    """A network without errors, the same with planted ones, and which those are."""

    good: NetworkInput
    bad: NetworkInput
    rows: np.ndarray
    swapped: np.ndarray
    bar: int
    bar_error_mm: float


def object_points() -> tuple[np.ndarray, np.ndarray]:
    """(59, 3) mm: the cross's front, then the bars' ends; (5, 2) rows of the bars."""
    cross = cross_target(code_family("schneider-14"))
    front = cross.place.centre_mm[cross.side == 0] * [1.0, 1.0, -1.0]
    ends = [
        [[-550, -480, 40], [450, -520, 60]],
        [[-530, 510, 20], [470, 490, 90]],
        [[-560, -400, 70], [-540, 430, 30]],
        [[540, -440, 20], [560, 420, 80]],
        [[-350, 300, 120], [330, -310, 150]],
    ]
    bars = len(front) + np.arange(2 * BARS).reshape(BARS, 2)
    return np.vstack([front, np.reshape(ends, (-1, 3))]), bars


def photographs(rng: np.random.Generator) -> list[tuple[np.ndarray, np.ndarray]]:
    """Poses on two rings around the object, tilted by 25 and 45 degrees, rolled."""
    poses = []
    for i in range(IMAGES):
        turn = 2 * np.pi * (i + rng.uniform(-0.2, 0.2)) / IMAGES
        tilt = np.radians((25.0, 45.0)[i % 2] + rng.uniform(-5, 5))
        look = rotation_from_vector(tilt * np.array([np.cos(turn), np.sin(turn), 0.0]))
        roll = rotation_from_vector([0.0, 0.0, (i % 4) * np.pi / 2 + rng.uniform(-0.2, 0.2)])
        # The object's z points at the cameras.
        flip = np.diag([1.0, -1.0, -1.0])
        shift = [*rng.uniform(-80, 80, 2), rng.uniform(2100, 2500)]
        poses.append((roll @ look @ flip, np.array(shift)))
    return poses


def simulate(seed: int) -> Draw:
    """One draw."""
    rng = np.random.default_rng(seed)
    points, ends = object_points()
    poses = photographs(rng)
    image, point, xy = [], [], []
    for i, (rotation, shift) in enumerate(poses):
        camera = RigCamera(
            image_size_px=SIZE, interior=INTERIOR, r0_px=R0_PX,
            rotation=rotation, translation_mm=shift,
        )  # fmt: skip
        pixel = project(camera, points @ rotation.T + shift)
        inside = ((pixel > 5) & (pixel < np.array(SIZE) - 6)).all(axis=1)
        image.append(np.full(inside.sum(), i, np.int32))
        point.append(np.flatnonzero(inside).astype(np.int32))
        xy.append(pixel[inside])
    measured = np.concatenate(xy)
    measured = measured + rng.normal(0, SIGMA_PX, measured.shape)
    length = np.linalg.norm(points[ends[:, 0]] - points[ends[:, 1]], axis=1)
    f_start = INTERIOR[0] * rng.choice([0.7, 1.3])
    turned = []
    for rotation, shift in poses:
        axis = rng.normal(size=3)
        turn = rotation_from_vector(np.radians(45.0) * axis / np.linalg.norm(axis))
        turned.append((turn @ rotation, shift))
    good = NetworkInput(
        cameras=(
            NetworkCamera(
                name="hand", image_size_px=SIZE, interior=f_start * (np.arange(10) == 0),
                r0_px=R0_PX, free=FREE,
            ),
        ),
        images=tuple(
            NetworkImage(name=f"p{i:02d}", camera=0, rotation=r, translation_mm=t)
            for i, (r, t) in enumerate(turned)
        ),
        points=NetworkPoints(
            name=tuple(f"T{i}" for i in range(len(points))),
            position_mm=np.full(points.shape, np.nan),
            kind=np.full(len(points), "free"),
        ),
        observations=NetworkObservations(
            image=np.concatenate(image), point=np.concatenate(point), xy_px=measured,
            cov_px2=np.tile([SIGMA_PX**2, 0.0, SIGMA_PX**2], (len(measured), 1)),
        ),
        scale_bars=ScaleBars(
            point_a=ends[:, 0].astype(np.int32), point_b=ends[:, 1].astype(np.int32),
            length_mm=length + rng.normal(0, BAR_SIGMA_MM, BARS),
            sigma_mm=np.full(BARS, BAR_SIGMA_MM),
        ),
        sigma_px=SIGMA_PX, critical_value=CRITICAL,
    )  # fmt: skip
    return plant(good, rng)


def plant(good: NetworkInput, rng: np.random.Generator) -> Draw:
    """Gross errors, swapped names, a wrong bar."""
    seen = good.observations
    count = len(seen)
    rows = rng.choice(count, round(SHARE * count), replace=False)
    xy = seen.xy_px.copy()
    for row in rows:
        size = np.exp(rng.uniform(np.log(5 * SIGMA_PX), np.log(LARGEST_PX)))
        while True:
            angle = rng.uniform(0, 2 * np.pi)
            moved = seen.xy_px[row] + size * np.array([np.cos(angle), np.sin(angle)])
            if ((moved >= 0) & (moved <= np.array(SIZE) - 1)).all():
                break
        xy[row] = moved
    point = seen.point.copy()
    swapped = []
    for image in rng.choice(IMAGES, SWAPS, replace=False):
        free = np.setdiff1d(np.flatnonzero(seen.image == image), rows)
        a, b = rng.choice(free, 2, replace=False)
        point[[a, b]] = point[[b, a]]
        swapped += [a, b]
    bars = good.scale_bars
    bar = int(rng.integers(BARS))
    error_mm = float(np.exp(rng.uniform(np.log(0.2), np.log(5.0))) * rng.choice([-1, 1]))
    length = bars.length_mm.copy()
    length[bar] += error_mm
    bad = replace(
        good,
        observations=replace(seen, xy_px=xy, point=point),
        scale_bars=replace(bars, length_mm=length),
    )
    return Draw(good, bad, rows, np.array(swapped), bar, error_mm)


def taken(network: NetworkInput, rows: np.ndarray, bars: np.ndarray) -> NetworkInput:
    """The network of some rows and bars, started anew."""
    seen = network.observations
    return replace(
        network,
        images=tuple(replace(i, rotation=None, translation_mm=None) for i in network.images),
        observations=NetworkObservations(
            image=seen.image[rows], point=seen.point[rows], xy_px=seen.xy_px[rows],
            cov_px2=seen.cov_px2[rows],
        ),
        scale_bars=bars_at(network.scale_bars, bars),
    )  # fmt: skip


def differences(result: NetworkAdjustment, reference: NetworkAdjustment) -> dict[str, float]:
    """Largest and RMS difference of points (best fit of the frames) and camera, in sigmas."""
    a, b = result.points.position_mm, reference.points.position_mm
    mean_a, mean_b = a.mean(axis=0), b.mean(axis=0)
    u, _, vt = np.linalg.svd((b - mean_b).T @ (a - mean_a))
    turn = u @ np.diag([1, 1, np.sign(np.linalg.det(u @ vt))]) @ vt
    # (the sigmas turn with the frame: that of the reference is kept)
    d = (mean_b + (a - mean_a) @ turn.T - b) / reference.points.sigma_mm
    camera, other = result.cameras[0], reference.cameras[0]
    c = np.array([(camera.values[n] - other.values[n]) / other.sigma[n] for n in FREE])
    return {
        "points_max": float(np.abs(d).max()), "points_rms": float(np.sqrt(np.mean(d**2))),
        "camera_max": float(np.abs(c).max()), "camera_rms": float(np.sqrt(np.mean(c**2))),
    }  # fmt: skip


def judge(seed: int) -> dict[str, object]:
    """One draw, adjusted with and without its errors."""
    draw = simulate(seed)
    count = len(draw.good.observations)
    planted = np.zeros(count, bool)
    planted[draw.rows] = planted[draw.swapped] = True
    all_bars = np.ones(BARS, bool)
    clean_bars = np.arange(BARS) != draw.bar
    whole = adjust_network(replace(taken(draw.good, np.ones(count, bool), all_bars),
                                   critical_value=0.0))  # fmt: skip
    # Sizes in minimal detectable biases: of the network without errors.
    truth = draw.good.observations
    size = np.abs(draw.bad.observations.xy_px - truth.xy_px)
    detectable = (CRITICAL + 0.8416) * SIGMA_PX / np.sqrt(whole.observations.redundancy)
    ratio = (size / detectable).max(axis=1)
    ratio[draw.swapped] = np.inf
    result = adjust_network(draw.bad)
    seen = draw.bad.observations
    listed = {(r.image, r.point) for r in result.rejected if r.kind == "observation"}
    names, images = draw.bad.points.name, draw.bad.images
    out = np.array(
        [(images[i].name, names[p]) in listed for i, p in zip(seen.image, seen.point, strict=True)]
    )
    bar_names = [
        f"{names[a]}-{names[b]}"
        for a, b in zip(draw.bad.scale_bars.point_a, draw.bad.scale_bars.point_b, strict=True)
    ]
    bars_out = np.array([any(r.kind == "scale-bar" and r.point == name for r in result.rejected)
                         for name in bar_names])  # fmt: skip
    clean = adjust_network(taken(draw.bad, ~planted, clean_bars))
    same = adjust_network(replace(taken(draw.bad, ~out, ~bars_out), critical_value=0.0))
    big = planted & (ratio > 1.5)
    return {
        "seed": seed, "observations": count, "planted": int(planted.sum()),
        "big": int(big.sum()), "big_found": int((big & out).sum()),
        "small": int((planted & ~big).sum()), "small_found": int((planted & ~big & out).sum()),
        "missed_ratio": sorted(np.round(ratio[planted & ~out], 2).tolist()),
        "false": int((out & ~planted).sum()), "good": int((~planted).sum()),
        "clean_rejected": sum(r.kind == "observation" for r in clean.rejected),
        "bar_found": bool(bars_out[draw.bar]), "bars_false": int(bars_out[clean_bars].sum()),
        "bar_error_mm": draw.bar_error_mm,
        "f_error": result.cameras[0].values["f"] - INTERIOR[0],
        "sigma0": result.summary.sigma0, "images": len(result.images),
        "clean": differences(result, clean), "same": differences(result, same),
    }  # fmt: skip


def guarded(seed: int) -> dict[str, object]:
    """``judge``, or why it came to nothing."""
    try:
        return judge(seed)
    except Exception as error:  # a failed draw is a result of the bench
        return {"seed": seed, "failed": f"{type(error).__name__}: {error}"}


def summarise(table: list[dict]) -> dict[str, object]:
    """All draws together."""
    good = [row for row in table if "failed" not in row]
    total = {k: sum(row[k] for row in good) for k in
             ("big", "big_found", "small", "small_found", "false", "good", "clean_rejected",
              "bars_false")}  # fmt: skip
    chance = 1 - (1 - LEVEL) ** 2  # of either coordinate
    none_missed = [row for row in good if not row["missed_ratio"]]
    worst = {
        f"{which}_{key}": max((row[which][key] for row in rows), default=np.nan)
        for which, rows in (("clean", good), ("same", good))
        for key in ("points_max", "points_rms", "camera_max", "camera_rms")
    }
    return {
        **total, **worst, "draws": len(table), "failed": len(table) - len(good),
        "share": total["big_found"] / max(total["big"], 1),
        "bars_found": sum(row["bar_found"] for row in good),
        "false_expected": chance * total["good"],
        "false_limit": int(stats.binom.ppf(0.99, total["good"], chance)),
        "none_missed": len(none_missed),
        "none_missed_points_max": max((r["clean"]["points_max"] for r in none_missed),
                                      default=np.nan),
        "none_missed_camera_max": max((r["clean"]["camera_max"] for r in none_missed),
                                      default=np.nan),
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=24)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    seeds = range(args.first, args.first + args.draws)
    print("          planted           beside  bar             difference in sigmas: without the"
          "      same rows\n"
          " draw  >1.5 MDB   less   good  mm    found     planted rows: points, camera (largest)"
          "   points  missed")  # fmt: skip
    table = []
    with multiprocessing.get_context("spawn").Pool(args.jobs) as pool:
        for row in pool.imap(guarded, seeds):
            table.append(row)
            if "failed" in row:
                print(f"{row['seed']:5d}  {row['failed']}", flush=True)
                continue
            c, s = row["clean"], row["same"]
            print(
                f"{row['seed']:5d}  {row['big_found']:3d} of {row['big']:3d} "
                f"{row['small_found']:2d} of {row['small']:2d} {row['false']:4d}"
                f" {row['bar_error_mm']:+6.2f} {'yes' if row['bar_found'] else 'NO':>4s}"
                f"{'' if not row['bars_false'] else ' +' + str(row['bars_false']):4s}"
                f"      max {c['points_max']:7.4f} rms {c['points_rms']:7.4f}"
                f"  {c['camera_max']:7.4f}     {s['points_max']:9.6f}  {row['missed_ratio']}",
                flush=True,
            )
    t = summarise(table)
    print(
        f"\n{t['draws']} draws, {t['failed']} failed\n"
        f"beyond 1.5 MDB: {t['big_found']} of {t['big']} listed ({t['share']:.2%}); "
        f"smaller: {t['small_found']} of {t['small']}\n"
        f"wrong bar listed in {t['bars_found']}, other bars {t['bars_false']}\n"
        f"good image points listed: {t['false']} of {t['good']}, expected "
        f"{t['false_expected']:.1f}, 99 % limit {t['false_limit']}; "
        f"without the planted rows {t['clean_rejected']}\n"
        f"differences: all draws points {t['clean_points_max']:.4f} "
        f"(RMS {t['clean_points_rms']:.4f}), camera {t['clean_camera_max']:.4f}; "
        f"the {t['none_missed']} draws that missed nothing: "
        f"{t['none_missed_points_max']:.4f}, {t['none_missed_camera_max']:.4f}; "
        f"same rows: {t['same_points_max']:.2g}, {t['same_camera_max']:.2g}"
    )
    if args.json:
        args.json.write_text(json.dumps({"draws": table, "all": t}, indent=1) + "\n")


if __name__ == "__main__":
    main()
