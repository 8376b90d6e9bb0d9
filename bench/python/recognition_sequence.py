"""Time a frame of recognising a sequence of small frames: one by one and in one call.

    python bench/python/recognition_sequence.py [--frames N] [--size PX] [--json FILE]

A Python loop over ``recognize``, and a pool of threads, beside
``recognize_sequence`` of the frames in memory and of a source that is read
frame by frame, with one and two threads.
That the targets are the same, bit for bit, stands beside the time.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from videogrammetry.recognition import recognize, recognize_sequence
from videogrammetry.sequence import as_source

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "python" / "recognition"))
import recognition_scenes as scenes


def made_film(count, size):
    """Frames with nine dots that move, noise in each; ten scenes, over and over."""
    places = size * (np.arange(3) + 0.5) / 3
    picture = []
    for k in range(10):
        dots = [scenes.Dot(x + 0.7 * k, y + 0.3 * k, 8, 7, 0.4) for x in places for y in places]
        picture.append(scenes.quantise(scenes.render((size, size), dots, noise=1.5, seed=k)))
    return np.stack([picture[i % 10] for i in range(count)])


def best_of(work, repeats=5):
    """Least seconds, and the result."""
    best, result = np.inf, None
    for _ in range(repeats):
        begin = time.perf_counter()
        result = work()
        best = min(best, time.perf_counter() - begin)
    return best, result


def in_pool(film, num_threads):
    """What one would write without ``recognize_sequence``."""
    with ThreadPoolExecutor(num_threads) as pool:
        return list(pool.map(recognize, film))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--json", type=Path, help="write the table to this file too")
    args = parser.parse_args()
    film = made_film(args.frames, args.size)
    ways = {
        "loop": lambda: [recognize(frame) for frame in film],
        "pool, 2 threads": lambda: in_pool(film, 2),
        "array, 1 thread": lambda: recognize_sequence(film, num_threads=1),
        "array, 2 threads": lambda: recognize_sequence(film, num_threads=2),
        "source, 1 thread": lambda: recognize_sequence(as_source(film), num_threads=1),
        "source, 2 threads": lambda: recognize_sequence(as_source(film), num_threads=2),
    }
    rows = []
    print(f"{args.frames} frames of {args.size} x {args.size} px, 8 bit")
    print("way                targets  us/frame  loop/this  equal")
    for way, work in ways.items():
        seconds, found = best_of(work)
        if way == "loop":
            expected, loop_s = found, seconds
        row = {
            "way": way,
            "targets": sum(map(len, found)),
            "us_per_frame": 1e6 * seconds / args.frames,
            "ratio": loop_s / seconds,
            "equal": all(
                np.array_equal(a.centre_px, b.centre_px) and np.array_equal(a.cov, b.cov)
                for a, b in zip(found, expected, strict=True)
            ),
        }
        rows.append(row)
        print(
            f"{way:18} {row['targets']:7} {row['us_per_frame']:9.1f} {row['ratio']:10.2f}  "
            f"{row['equal']}"
        )
    if args.json:
        args.json.write_text(json.dumps(rows, indent=2))


if __name__ == "__main__":
    main()
