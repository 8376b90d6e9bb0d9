"""Time of recognition beside OpenCV's full-frame chain and a memory read, one core.

    python bench/python/recognition.py [--data FOLDER] [--small] [--json FILE]

OpenCV: Canny + findContours + fitEllipse of every contour, on the whole frame.
Both sides once with decoding of the file and once without. On the panel
photographs where they are present, on synthetic pictures otherwise (or with
--small); the error on the synthetic ones stands beside the time.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

from videogrammetry.recognition import recognize

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "python" / "recognition"))
import recognition_scenes as scenes


def best_ms(work, repeats):
    best = np.inf
    for _ in range(repeats):
        begin = time.perf_counter()
        work()
        best = min(best, time.perf_counter() - begin)
    return 1e3 * best


def opencv_chain(image):
    edges = cv2.Canny(image, 50, 150)
    contours, _ = cv2.findContours(edges, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    return [cv2.fitEllipse(c) for c in contours if len(c) >= 5]


def synthetic(folder):
    """A picture of 2000 x 1333 with dots on uneven ground, and the dots."""
    dots = scenes.grid_of_dots(12, 18, 100, a=10, seed=1)
    grey = scenes.render((1333, 2000), dots, white=180, black=15, psf=0.7)
    random = np.random.default_rng(2)
    clutter = cv2.resize(random.normal(0, 12, (170, 250)), (2000, 1333))
    grey += np.maximum(clutter, 0) * (grey < 40) + random.normal(0, 1.5, grey.shape)
    path = Path(folder) / "synthetic.tif"
    cv2.imwrite(str(path), scenes.quantise(grey))
    return path, dots


def measure(path, repeats):
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    targets = recognize(image)
    row = {
        "picture": path.stem,
        "targets": len(targets),
        "read_memory_ms": best_ms(lambda: image.max(), repeats),
        "decode_ms": best_ms(lambda: cv2.imread(str(path), cv2.IMREAD_UNCHANGED), repeats),
        "ours_ms": best_ms(lambda: recognize(image), repeats),
        "opencv_ms": best_ms(lambda: opencv_chain(image), repeats),
    }
    row["ratio"] = row["ours_ms"] / row["opencv_ms"]
    row["ratio_with_decode"] = (row["ours_ms"] + row["decode_ms"]) / (
        row["opencv_ms"] + row["decode_ms"]
    )
    row["ratio_memory"] = row["ours_ms"] / row["read_memory_ms"]
    return row, targets


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    default = os.environ.get("VIDEOGRAMMETRY_DATA", "../shared/data")
    parser.add_argument("--data", type=Path, default=Path(default))
    parser.add_argument("--small", action="store_true", help="the synthetic picture alone")
    parser.add_argument("--json", type=Path, help="write the table to this file too")
    args = parser.parse_args()
    cv2.setNumThreads(1)
    photographs = [] if args.small else sorted((args.data / "aicon-panel").glob("*.tif"))
    repeats = 3 if args.small else 7
    rows = []
    print(
        "picture      targets  ours ms  OpenCV ms  decode ms  memory ms"
        "  ours/OpenCV  with decode  ours/memory  RMS px"
    )
    with tempfile.TemporaryDirectory() as folder:
        made, dots = synthetic(folder)
        for path in [made, *photographs]:
            row, targets = measure(path, repeats)
            if path == made:
                gap = np.hypot(
                    *np.moveaxis(
                        np.array([[d.x, d.y] for d in dots])[:, None] - targets.centre_px, -1, 0
                    )
                ).min(axis=1)
                row["rms_px"] = float(np.sqrt((gap[gap < 1] ** 2 / 2).mean()))
                row["recall"] = float((gap < 1).mean())
            rows.append(row)
            print(
                f"{row['picture']:12} {row['targets']:7} {row['ours_ms']:8.2f} "
                f"{row['opencv_ms']:10.2f} {row['decode_ms']:10.2f} {row['read_memory_ms']:10.3f} "
                f"{row['ratio']:12.2f} {row['ratio_with_decode']:12.2f} "
                f"{row['ratio_memory']:12.1f}  {row.get('rms_px', float('nan')):.4f}"
            )
    if len(rows) > 1:
        for key in ("ratio", "ratio_with_decode", "ratio_memory"):
            print(f"median {key}: {np.median([r[key] for r in rows[1:]]):.2f}")
    if args.json:
        args.json.write_text(json.dumps(rows, indent=2))


if __name__ == "__main__":
    main()
