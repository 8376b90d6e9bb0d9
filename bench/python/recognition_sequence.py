"""Time a frame of recognising a sequence: of small frames in memory, and of recordings.

    python bench/python/recognition_sequence.py [--frames N] [--size PX]
        [--recorded N] [--recorded-size PX] [--json FILE]

A Python loop over ``recognize``, and a pool of threads, beside
``recognize_sequence`` of the frames in memory and of a source that is read
frame by frame, with one and two threads.
That the targets are the same, bit for bit, stands beside the time.

Then Photron recordings of 8 bit, 16 bit and packed 12 bit, mapped into memory
and recognised by ``edge-pair`` with the model: frames a second on one and two
threads, learning the camera included; each depth beside the rate of reading
the same bytes alone, and the 12 bit beside unpacking before recognition.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from videogrammetry.recognition import RecognitionOptions, recognize, recognize_sequence
from videogrammetry.sequence import as_source, create_sequence, open_sequence

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "python" / "recognition"))
sys.path.insert(0, str(Path(__file__).parents[1]))
import recognition_scenes as scenes
from rendered_scenes import GreyNoise, make_scene

FAST = RecognitionOptions(method="edge-pair", estimator="model")


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


def small_frames(count, size):
    """Rows of the first table, printed as they come."""
    film = made_film(count, size)

    def array(num_threads):
        return lambda: recognize_sequence(film, camera=None, num_threads=num_threads)

    ways = {
        "loop": lambda: [recognize(frame) for frame in film],
        "pool, 2 threads": lambda: in_pool(film, 2),
        "array, 1 thread": array(1),
        "array, 2 threads": array(2),
        "source, 1 thread": lambda: recognize_sequence(as_source(film), camera=None, num_threads=1),
        "source, 2 threads": lambda: recognize_sequence(
            as_source(film), camera=None, num_threads=2
        ),
    }
    rows = []
    print(f"{count} frames of {size} x {size} px, 8 bit")
    print("way                targets  us/frame  loop/this  equal")
    for way, work in ways.items():
        seconds, found = best_of(work)
        if way == "loop":
            expected, loop_s = found, seconds
        row = {
            "way": way,
            "targets": sum(map(len, found)),
            "us_per_frame": 1e6 * seconds / count,
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
    return rows


def overhead(repeats=2000):
    """Microseconds a call of ``recognize`` where there is nothing to find: Python's share."""
    blank = np.zeros((8, 8), np.uint8)
    best = min(best_of(lambda: recognize(blank, FAST), repeats)[0] for _ in range(3))
    stack = np.zeros((2000, 8, 8), np.uint8)
    batch = best_of(lambda: recognize_sequence(stack, FAST, camera=None, num_threads=1))[0]
    print(
        f"\nframes of 8 x 8 px: {1e6 * best:.1f} us a call of recognize, "
        f"{1e6 * batch / len(stack):.1f} us a frame of an array"
    )
    return {"us_a_call": 1e6 * best, "us_a_frame": 1e6 * batch / len(stack)}


class Unpacked:
    """A source that has to be read: what is packed is unpacked first."""

    def __init__(self, source):
        self._source = source
        self.read = source.read

    def __len__(self):
        return len(self._source)


def record(folder, bits, count, size):
    """A recording of ``bits``, four scenes over and over, 49 targets in 1024 x 1024."""
    side = max(1, round(7 * size / 1024))
    pictures = []
    for seed in range(4):
        scene = make_scene(seed, size=(size, size), grid=(side, side), coded=side * side // 3)
        noise = GreyNoise(bits=min(bits, 12), contrast_noise=75)
        pictures.append(noise.picture(scene.light, seed))
    with create_sequence(
        folder / f"bits{bits}",
        format="mraw",
        image_size_px=(size, size),
        num_frames=count,
        bit_depth=bits,
    ) as writer:
        for i in range(count):
            writer.append(pictures[i % 4])
    return open_sequence(folder / f"bits{bits}.cihx")


def recordings(count, size, repeats=5):
    """Rows of the second table: frames a second of recordings, and of reading their bytes."""
    with tempfile.TemporaryDirectory() as folder:
        sources = {f"{bits} bit": record(Path(folder), bits, count, size) for bits in (8, 16, 12)}
        sources["12 bit, in place"] = packed = sources.pop("12 bit")
        sources["12 bit, unpacked"] = Unpacked(packed)
        rows = {way: {"samples": way, "seconds": {1: np.inf, 2: np.inf}} for way in sources}
        # In turn, so that what else the machine does meets all alike.
        for _ in range(repeats):
            for way, source in sources.items():
                for threads, best in rows[way]["seconds"].items():
                    begin = time.perf_counter()
                    found = recognize_sequence(source, FAST, num_threads=threads)
                    rows[way]["seconds"][threads] = min(best, time.perf_counter() - begin)
                rows[way]["targets"] = len(found.targets)
        for way, source in sources.items():
            rows[way]["read_s"] = seconds_to_read(packed if way.endswith("unpacked") else source)
        del packed, sources, source  # or Windows keeps the files
    print(f"\n{count} recorded frames of {size} x {size} px, edge-pair, model")
    print("samples           targets  1 thread  2 threads  bytes alone  (frames/s)")
    for way, row in rows.items():
        print(
            f"{way:17} {row['targets']:7} {count / row['seconds'][1]:9.0f} "
            f"{count / row['seconds'][2]:10.0f} {count / row['read_s']:12.0f}"
        )
    return list(rows.values())


def seconds_to_read(source):
    """Least seconds to read the bytes of a recording once."""
    path = next(p for p in source.paths if p.suffix == ".mraw")
    samples = np.memmap(path, np.uint8, mode="r")
    words = samples[: samples.size // 8 * 8].view(np.uint64)
    return best_of(lambda: np.bitwise_or.reduce(words))[0]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--recorded", type=int, default=200, help="frames a recording; 0: none")
    parser.add_argument("--recorded-size", type=int, default=1024)
    parser.add_argument("--json", type=Path, help="write the tables to this file too")
    args = parser.parse_args()
    tables = {"memory": small_frames(args.frames, args.size), "overhead": overhead()}
    if args.recorded:
        tables["recordings"] = recordings(args.recorded, args.recorded_size)
    if args.json:
        args.json.write_text(json.dumps(tables, indent=2))


if __name__ == "__main__":
    main()
