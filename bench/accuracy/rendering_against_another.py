"""Recognition's errors on our rendered pictures and on another renderer's.

    python bench/accuracy/rendering_against_another.py [--data FOLDER] [--scenes N] [--png FILE]

The other's pictures: `rendered-targets`, 3 scenes of 49 targets, dots of 8 to
20 px, PSF 0.6 to 0.8 px, clutter, tilt 0 to 45 degrees, 12 bit. Ours repeat
each of its targets' size, shape and place (its ellipse's), as planes before a
pinhole, with other sub-pixel phases, codes, turns and clutter.

RMS of the centres per coordinate [px]; `sigma` is the median predicted standard
deviation, `chi` the RMS of error over predicted deviation, `bias` the mean
error. The last column: ours / the other's RMS, with what chance allows for 147
targets (a standard error of 1 / sqrt(4 * 147) each, errors being dominated by few).
"""

from __future__ import annotations

import argparse
import csv
import os
import sys
from pathlib import Path

import cv2
import numpy as np

from videogrammetry.recognition import code_family, recognize
from videogrammetry.rendering import Background, Illumination, Renderer, SceneTargets, Sensor
from videogrammetry.types import RigCamera

NOISE = {"S75": 75.0, "S32": 32.0}
F_PX, DEPTH_MM = 2650.0, 12000.0
WHITE, BLACK = 0.65, 0.06


def read_truth(path):
    with open(path) as file:
        rows = list(csv.DictReader(file))
    xy = np.array([[float(r["ellipse_x_px"]), float(r["ellipse_y_px"])] for r in rows])
    axes = np.array([[float(r["semi_major_px"]), float(r["semi_minor_px"])] for r in rows])
    ids = np.array([int(r["id"]) if r["coded"] == "1" else -1 for r in rows])
    return xy, axes, ids


def errors(image, xy, ids):
    """Errors (n, 2), predicted deviations (n, 2), and how many codes were read wrongly."""
    targets = recognize(image)
    gap = np.hypot(*np.moveaxis(xy[:, None] - targets.centre_px[None], -1, 0))
    hit, found = gap.argmin(axis=1), gap.min(axis=1) < 1
    read = targets.id[hit[found]]
    wrong = int(((read > 0) & (read != ids[found])).sum())
    unread = int(((ids[found] > 0) & (read < 0)).sum())
    error = targets.centre_px[hit[found]] - xy[found]
    return error, targets.sigma_px[hit[found]], wrong, unread, int((~found).sum())


def like(truth, rng):
    """Targets of the same places, sizes and tilts, with new phases, turns and codes."""
    xy, axes, ids = truth
    n, family = len(xy), code_family("schneider-14")
    mm = DEPTH_MM / F_PX
    at = (xy + rng.uniform(-0.5, 0.5, xy.shape) - 511.5) * mm
    tilt = np.arccos(np.minimum(1, axes[:, 1] / axes[:, 0]))
    azimuth, turn = rng.uniform(0, 2 * np.pi, (2, n))
    ca, sa = np.cos(azimuth), np.sin(azimuth)
    side = np.stack([ca, sa, np.zeros(n)], axis=1)
    normal = np.cos(tilt)[:, None] * [0, 0, -1] + np.sin(tilt)[:, None] * np.stack(
        [-sa, ca, np.zeros(n)], axis=1
    )
    other = np.cross(side, normal)
    x_axis = np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * other
    ray = np.hypot(np.hypot(*at.T), DEPTH_MM) / DEPTH_MM  # keeps the size off the axis
    coded = ids > 0
    new = np.where(coded, rng.permutation(len(family))[:n] + 1, -1)
    return SceneTargets(
        centre_mm=np.c_[at, np.full(n, DEPTH_MM)],
        normal=normal,
        x_axis=x_axis,
        radius_mm=axes[:, 0] * mm / ray,
        id=new,
        num_bits=np.where(coded, 14, 0),
        code=[family.codes[i - 1] if i > 0 else 0 for i in new],
        ring=family.ring,
        sticker_mm=np.where(coded, 3.6, 2.2) * axes[:, 0] * mm,
        white=rng.uniform(0.9, 1.0, n) * WHITE,
        black=BLACK,
    )


def ours(truth, snr, seed):
    """One frame of ours, its ellipses and IDs."""
    rng = np.random.default_rng(seed)
    targets = like(truth, rng)
    camera = RigCamera(
        image_size_px=(1024, 1024),
        interior=np.r_[F_PX, np.zeros(9)],
        r0_px=482.7,
        rotation=np.eye(3),
        translation_mm=np.zeros(3),
    )
    # Contrast / noise at white, most of it shot noise, as a camera has it.
    sigma = (WHITE - BLACK) * 4095 / snr
    sensor = Sensor(
        psf_sigma_px=rng.uniform(0.6, 0.8),
        read_noise=0.4 * sigma,
        shot_noise_gain=0.84 * sigma**2 / (WHITE * 4095),
        bit_depth=12,
    )
    renderer = Renderer(
        camera,
        background=Background(clutter=0.35, seed=seed),
        illumination=Illumination(gradient=tuple(rng.uniform(-0.15, 0.15, 2))),
        sensor=sensor,
    )
    frame = renderer.render(targets, seed=seed)
    keep = frame.truth.visible
    return frame.image, frame.truth.centre_px[keep], np.asarray(targets.id)[keep]


def row(samples):
    error = np.concatenate([s[0] for s in samples])
    sigma = np.concatenate([s[1] for s in samples])
    return {
        "n": len(error),
        "missed": sum(s[4] for s in samples),
        "wrong": sum(s[2] for s in samples),
        "unread": sum(s[3] for s in samples),
        "rms": np.sqrt((error**2).mean()),
        "sigma": np.median(sigma),
        "chi": np.sqrt(((error / sigma) ** 2).mean()),
        "bias": np.abs(error.mean(axis=0)).max(),
    }


def compare(folder, scenes):
    """noise -> (the other's row, ours)."""
    table = {}
    for name, snr in NOISE.items():
        theirs, mine = [], []
        for frame in range(3):
            truth = read_truth(folder / f"frame{frame}_truth.csv")
            image = cv2.imread(str(folder / f"frame{frame}_{name}.png"), cv2.IMREAD_UNCHANGED)
            theirs.append(errors(image, truth[0], truth[2]))
            mine += [errors(*ours(truth, snr, 100 * frame + s)) for s in range(scenes)]
        table[name] = row(theirs), row(mine)
    return table


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    default = os.environ.get("VIDEOGRAMMETRY_DATA", "../shared/data")
    parser.add_argument("--data", type=Path, default=Path(default))
    parser.add_argument("--scenes", type=int, default=4, help="of ours for each of the other's")
    parser.add_argument("--png", type=Path, help="write one of our frames")
    args = parser.parse_args()
    folder = args.data / "rendered-targets"
    if not folder.is_dir():
        sys.exit(f"{folder} is not there: give --data or set VIDEOGRAMMETRY_DATA")
    if args.png:
        image = ours(read_truth(folder / "frame0_truth.csv"), 75.0, 0)[0]
        cv2.imwrite(str(args.png), (image / 16).astype(np.uint8))
    print("noise renderer    n missed unread wrong   RMS px    sigma   chi     bias   ours/other")
    for name, rows in compare(folder, args.scenes).items():
        for who, r in zip(("other", "ours"), rows, strict=True):
            ratio = f"{rows[1]['rms'] / rows[0]['rms']:8.3f} +- 0.05" if who == "ours" else ""
            print(
                f"{name:5} {who:8} {r['n']:4} {r['missed']:6} {r['unread']:6} {r['wrong']:5} "
                f"{r['rms']:8.4f} {r['sigma']:8.4f} {r['chi']:5.2f} {r['bias']:8.4f}   {ratio}"
            )


if __name__ == "__main__":
    main()
