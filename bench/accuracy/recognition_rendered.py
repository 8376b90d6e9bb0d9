"""Recognition on rendered pictures of known truth: 8 to 20 px dots on clutter.

    python bench/accuracy/recognition_rendered.py [--data FOLDER] [--list]
        [--method edge-pair | local-canny] [--estimator auto | mean-gradient | dual-conic | model]

RMS of the centres per coordinate; `sigma` is the median predicted standard
deviation, `chi` the RMS of error over predicted deviation (1: the covariance
is right); `bound` is Cramer and Rao's for these dots, everything but the centre
unknown too, and `ratio` the RMS over it; `edge rays` are the figures of
mean-gradient rays and an ellipse in the literature of these pictures; `us a
dot` is the whole recognition's time over the dots found, the best of three.
"""

from __future__ import annotations

import argparse
import csv
import os
import sys
import time
from collections import Counter
from pathlib import Path

import cv2
import numpy as np

from videogrammetry.recognition import RecognitionOptions, recognize

NOISE = ("S150", "S75", "S75_8bit", "S32", "S13")
EDGE_RAYS = {"S150": 0.0056, "S75": 0.0092, "S75_8bit": 0.0092, "S32": 0.0195, "S13": 0.046}
BOUND = {"S150": 0.0019, "S75": 0.0041, "S75_8bit": 0.0041, "S32": 0.0098, "S13": 0.025}


def read_truth(path):
    with open(path) as file:
        rows = list(csv.DictReader(file))
    xy = np.array([[float(r["ellipse_x_px"]), float(r["ellipse_y_px"])] for r in rows])
    axes = np.array([[float(r["semi_major_px"]), float(r["semi_minor_px"])] for r in rows])
    ids = np.array([int(r["id"]) if r["coded"] == "1" else -1 for r in rows])
    return xy, axes, ids


def timed(image, options):
    """Targets of a picture, and the shortest of three times in seconds."""
    seconds = []
    for _ in range(3):
        start = time.perf_counter()
        targets = recognize(image, options)
        seconds.append(time.perf_counter() - start)
    return targets, min(seconds)


def judge(image, truth, options, show):
    xy, axes, ids = truth
    targets, seconds = timed(image, options)
    gap = np.hypot(*np.moveaxis(xy[:, None] - targets.centre_px[None], -1, 0))
    nearest = gap.argmin(axis=1)
    found = gap.min(axis=1) < 1.0
    hit = nearest[found]
    error = targets.centre_px[hit] - xy[found]
    repeated = np.array([Counter(ids.tolist())[i] > 1 for i in ids])
    coded = (ids > 0) & ~repeated
    read = targets.id[nearest] == ids
    wrong = int(((targets.id[hit] > 0) & (targets.id[hit] != ids[found])).sum())
    false = np.setdiff1d(np.arange(len(targets)), hit)
    wrong += int((targets.id[false] > 0).sum())
    if show:
        for k in np.flatnonzero(~found):
            print("    missed", xy[k], axes[k].round(2), ids[k])
        for k in np.flatnonzero(found & coded & ~read):
            print("    unread", xy[k], axes[k].round(2), ids[k], targets.ring_status[nearest[k]])
        for k in false:
            print("    false", targets.centre_px[k].round(1), targets.semi_axes_px[k].round(2))
    return {
        "n": len(xy),
        "found": int(found.sum()),
        "coded": int(coded.sum()),
        "read": int((coded & found & read).sum()),
        "wrong": wrong,
        "false": len(false),
        "seconds": seconds,
        "squares": (error**2).mean(axis=1),
        "sigma": targets.sigma_px[hit].mean(axis=1),
        "chi": ((error / targets.sigma_px[hit]) ** 2).mean(axis=1),
        "axes": (targets.semi_axes_px[hit] - axes[found]).mean(axis=1),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    default = os.environ.get("VIDEOGRAMMETRY_DATA", "../shared/data")
    parser.add_argument("--data", type=Path, default=Path(default))
    parser.add_argument("--list", action="store_true", help="name what is missed and false")
    parser.add_argument("--method", default="edge-pair", choices=("edge-pair", "local-canny"))
    parser.add_argument(
        "--estimator", default="auto", choices=("auto", "mean-gradient", "dual-conic", "model")
    )
    args = parser.parse_args()
    options = RecognitionOptions(method=args.method, estimator=args.estimator)
    folder = args.data / "rendered-targets"
    if not folder.is_dir():
        sys.exit(f"{folder} is not there: give --data or set VIDEOGRAMMETRY_DATA")
    print(
        "noise     found of   IDs read of  wrong  false   RMS px   bound  ratio  edge rays"
        "   sigma   chi  axis bias  us a dot"
    )
    for noise in NOISE:
        rows = []
        for frame in range(3):
            image = cv2.imread(str(folder / f"frame{frame}_{noise}.png"), cv2.IMREAD_UNCHANGED)
            truth = read_truth(folder / f"frame{frame}_truth.csv")
            rows.append(judge(image, truth, options, args.list))
        sums = ("n", "found", "coded", "read", "wrong", "false", "seconds")
        s = {k: sum(r[k] for r in rows) for k in sums}
        pooled = {
            k: np.concatenate([r[k] for r in rows]) for k in ("squares", "sigma", "chi", "axes")
        }
        rms = np.sqrt(pooled["squares"].mean())
        print(
            f"{noise:9} {s['found']:5} {s['n']:2} {s['read']:9} {s['coded']:3} {s['wrong']:6} "
            f"{s['false']:6} {rms:9.4f} {BOUND[noise]:7.4f} {rms / BOUND[noise]:6.2f} "
            f"{EDGE_RAYS[noise]:9.4f} "
            f"{np.median(pooled['sigma']):7.4f} {np.sqrt(pooled['chi'].mean()):5.2f} "
            f"{pooled['axes'].mean():10.4f} {1e6 * s['seconds'] / s['found']:9.0f}"
        )


if __name__ == "__main__":
    main()
