"""Time of recognition against the picture's size and the number of targets, one core.

    python bench/python/recognition_cost.py [--method M] [--estimator E] [--small]
        [--svg FILE] [--json FILE]

Two series: pictures of 0.25 to 16 Mpx with 49 targets a Mpx, and one picture
size (16 Mpx) with 10 to 5000 un-coded targets. A straight line is fitted to
each by least squares; R^2 of it says whether the time grows in proportion. A
time is the processor's for the thread, the shortest of several; the pictures are
gone through in turn, so that a busy machine bends no line.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from pathlib import Path

import numpy as np

from videogrammetry.recognition import RecognitionOptions, recognize
from videogrammetry.report.chart import Series, chart

sys.path.insert(0, str(Path(__file__).parents[1]))
import rendered_scenes as rendered

SIZES_PX = (512, 724, 1024, 1448, 2048, 2896, 4096)
COUNTS = (10, 100, 300, 1000, 2000, 3000, 4000, 5000)
NOISE = rendered.GreyNoise(bits=8, contrast_noise=75)


def by_size(sizes):
    """Pictures of constant density."""
    for size in sizes:
        cells = max(2, round(7 * size / 1024))
        scene = rendered.make_scene(
            size, size=(size, size), grid=(cells, cells), coded=cells * cells // 3
        )
        yield size * size / 1e6, len(scene), NOISE.picture(scene.light, size)


def by_count(counts, size):
    """Pictures of one size; cells for the largest number."""
    cells = int(np.ceil(np.sqrt(max(counts))))
    for count in counts:
        scene = rendered.make_scene(
            count,
            size=(size, size),
            grid=(cells, cells),
            count=count,
            coded=0,
            diameter_px=(8.0, 12.0),
        )
        yield count, len(scene), NOISE.picture(scene.light, count)


def measure(pictures, options, rounds):
    """(x, targets found of, milliseconds) of every picture."""
    pictures = list(pictures)
    best = np.full(len(pictures), np.inf)
    found = [0] * len(pictures)
    for _ in range(rounds):
        for k, (_, _, image) in enumerate(pictures):
            begin = time.thread_time()
            found[k] = len(recognize(image, options))
            best[k] = min(best[k], time.thread_time() - begin)
    return [
        {"x": float(x), "targets": n, "found": found[k], "ms": 1e3 * best[k]}
        for k, (x, n, _) in enumerate(pictures)
    ]


def line_through(rows):
    """Slope, offset and R^2 of time over x."""
    x, y = (np.array([r[k] for r in rows]) for k in ("x", "ms"))
    slope, offset = np.polyfit(x, y, 1)
    rest = y - (slope * x + offset)
    return float(slope), float(offset), float(1 - (rest**2).sum() / ((y - y.mean()) ** 2).sum())


def panel(name, x_label, results):
    series = []
    for label, rows in results:
        x, y = [r["x"] for r in rows], [r["ms"] for r in rows]
        slope, offset, _ = line_through(rows)
        end = [min(x), max(x)]
        series.append(Series(name=label, x=x, y=y, line=False, points=True))
        series.append(Series(name="", x=end, y=[slope * v + offset for v in end], colour="#9aa5b4"))
    text = chart(series, x_label=x_label, y_label="time, ms", label=name, width=720, height=360)
    # A page gives the drawings' texts their font and colour; a file says so itself.
    style = (
        "<style>text{font:12px sans-serif;fill:#5b6675}</style>"
        "<rect width='100%' height='100%' fill='#fff'/>"
    )
    head, rest = text.split(">", 1)
    if "xmlns" not in head:
        head += ' xmlns="http://www.w3.org/2000/svg"'
    return f"{head}>{style}{rest}"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--method", choices=rendered.METHODS)
    parser.add_argument("--estimator", choices=rendered.ESTIMATORS, help="default: every one")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--core", type=int, default=0)
    parser.add_argument("--small", action="store_true", help="up to 1 Mpx, 300 targets")
    parser.add_argument("--svg", type=Path, help="two drawings: NAME-size.svg, NAME-count.svg")
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {args.core})
    chosen = rendered.combinations(
        (args.method,) if args.method else rendered.METHODS,
        (args.estimator,) if args.estimator else rendered.ESTIMATORS,
    )
    sizes = tuple(s for s in SIZES_PX if not args.small or s <= 1024)
    counts = tuple(c for c in COUNTS if not args.small or c <= 300)
    kinds = (
        ("size", "Mpx", list(by_size(sizes))),
        ("count", "targets", list(by_count(counts, 1024 if args.small else 4096))),
    )
    table = {}
    for kind, x_label, pictures in kinds:
        results = []
        for method, estimator in chosen:
            options = RecognitionOptions(
                method=method,
                estimator=estimator,
                codes="schneider-14" if kind == "size" else "none",
            )
            rows = measure(pictures, options, args.rounds)
            slope, offset, r2 = line_through(rows)
            print(f"\n{method}, {estimator}: ", end="")
            print(f"{offset:.3f} ms + {slope:.5f} ms a {x_label}, R^2 {r2:.5f}")
            print(f"{x_label:>8} targets   found        ms  ms/{x_label}")
            for row in rows:
                print(
                    f"{row['x']:8.2f} {row['targets']:7} {row['found']:7} {row['ms']:9.3f} "
                    f"{row['ms'] / row['x']:9.4f}"
                )
            results.append((f"{method}, {estimator}", rows))
            table[f"{kind}, {method}, {estimator}"] = {
                "rows": rows,
                "ms_each": slope,
                "ms_offset": offset,
                "r2": r2,
            }
        if args.svg:
            path = args.svg.with_name(f"{args.svg.stem}-{kind}.svg")
            path.write_text(panel(f"time over {x_label}", x_label, results))
            print(f"{path}")
    if args.json:
        args.json.write_text(json.dumps(table, indent=2))


if __name__ == "__main__":
    main()
