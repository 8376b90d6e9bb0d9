"""Recognition beside what others do, on the same pictures in the same run, on one core.

    python bench/python/recognition_peers.py [--frames N] [--repeats R] [--noise C]
        [--film N] [--film-only] [--method M] [--core K] [--data FOLDER] [--small]
        [--json FILE] [--markdown FILE]

Every picture goes through every program in turn, so that what disturbs the
machine disturbs all alike; times are the processor's for the one thread that
works, those of the clock on an idle core. Beside the shortest and the median time stand the
ratio of the shortest to reading the picture from memory once, recall, false
finds and the centres' RMS error: a program that is fast and finds nothing is
told from one that works. Everybody's settings are for bright dots of 8 to 20 px
at up to 45 degrees: area, roundness, contrast. A segment of a ring of code is
false for everybody; an isolated round bright spot counts as a target (there is
none but the targets in the project's own scenes). Peers take 8 bit; of deeper
pictures they get an 8-bit copy that is made beforehand.

A film, whose targets move by 1.5 px from frame to frame, shows what may be known
beforehand: of ours there are rows with the camera's model learned of each picture
(alone) or once for all (model), with dots followed from frame to frame (tracked),
and with the default range of diameters or that of dots that face the camera (7 px
leaves out small ones that are oblique). Each includes reading the codes. The tracked
rows' times are those of frames searched in windows; the first frame of the film and
every 100th take what a whole one takes.

Scenes: the shared rendered pictures where they are present, and the project's
own renderer's of 1024 x 1024 with 49 and of 3888 x 2592 with 104 targets.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from videogrammetry.recognition import (
    RecognitionOptions,
    TrackedOptions,
    learn_camera,
    recognize,
)
from videogrammetry.recognition.recognize import checked_frame
from videogrammetry.recognition.tracked import core_tracker

sys.path.insert(0, str(Path(__file__).parents[1]))
import peer_detectors
import rendered_scenes as rendered

#: The default range of diameters, and that of the scenes' dots, with a margin.
DIAMETERS_PX = ((5, 200), (7, 25))


@dataclass
class Picture:
    """A picture in the depths that programs take, and where its targets are."""

    deep: np.ndarray
    grey: np.ndarray
    truth_px: np.ndarray
    packed: object = None


@dataclass
class Program:
    """``work`` takes the picture that ``given`` chooses, and returns centres (N, 2).

    ``anew``, called before the first of the pictures, gives another ``work``.
    """

    name: str
    format: str
    given: object
    work: object
    ours: bool = False
    anew: object = None
    seconds: list = field(default_factory=list)
    found: list = field(default_factory=list)


def ours(method, estimator):
    options = RecognitionOptions(method=method, estimator=estimator)
    return lambda image: recognize(image, options).centre_px


def ours_on_film(pictures, given, options):
    """Names of the ways to recognise frames of one camera, and what makes each one's work."""
    camera = learn_camera([given(p) for p in pictures], options)

    def follow():
        tracker = core_tracker(options, TrackedOptions(), camera)
        return lambda image: tracker.next(checked_frame(image))["centre_px"]

    yield "alone", lambda: lambda image: recognize(image, options).centre_px
    yield "model", lambda: lambda image: recognize(image, options, camera=camera).centre_px
    yield "tracked", follow


def read_truth(path):
    with open(path) as file:
        rows = list(csv.DictReader(file))
    return np.array([[float(r["ellipse_x_px"]), float(r["ellipse_y_px"])] for r in rows])


def shared_pictures(folder, noise):
    for path in sorted(folder.glob(f"frame*_S{noise:g}.png")):
        deep = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        eight = path.with_name(path.stem + "_8bit.png")
        grey = cv2.imread(str(eight), cv2.IMREAD_UNCHANGED) if eight.exists() else to_8bit(deep)
        truth = read_truth(path.with_name(path.stem.split("_")[0] + "_truth.csv"))
        yield Picture(deep, grey, truth, rendered.packed_frame(deep))


def own_pictures(count, noise, **scene):
    made = (rendered.make_scene(seed, **scene) for seed in range(1, count + 1))
    yield from noisy(made, noise)


def noisy(scenes, noise):
    for seed, made in enumerate(scenes, 1):
        deep = rendered.GreyNoise(bits=12, contrast_noise=noise).picture(made.light, seed)
        grey = rendered.GreyNoise(bits=8, contrast_noise=noise).picture(made.light, seed)
        yield Picture(deep, grey, made.centre_px, rendered.packed_frame(deep))


def to_8bit(deep):
    return np.clip(np.rint(deep / 16.0), 0, 255).astype(np.uint8)


FORMATS = (
    ("8 bit", lambda p: p.grey),
    ("12 in 16 bit", lambda p: p.deep),
    ("12 bit packed", lambda p: p.packed),
)


def programs(size, methods, has_packed):
    listed = []
    formats = FORMATS if has_packed else FORMATS[:2]
    for method, estimator in methods:
        for name, given in formats:
            work = ours(method, estimator)
            listed.append(Program(f"ours {method}, {estimator}", name, given, work, True))
    return listed + peers(size)


def peers(size):
    known = peer_detectors.peers(size)
    return [Program(name, "8 bit", lambda p: p.grey, work) for name, work in known]


def film_programs(pictures, estimator):
    listed = []
    for smallest, largest in DIAMETERS_PX:
        options = RecognitionOptions(
            method="edge-pair", estimator=estimator, diameter_px=(smallest, largest)
        )
        for name, given in FORMATS:
            for way, anew in ours_on_film(pictures, given, options):
                title = f"ours {way}, dots {smallest}-{largest} px"
                listed.append(Program(title, name, given, None, True, anew))
    listed.sort(key=lambda p: p.name.split(",")[0])
    return listed + peers(pictures[0].grey.shape[::-1])


def run(name, pictures, listed, repeats):
    """Rows of the table of one scene."""
    read = Program("memory read", "8 bit", lambda p: p.grey, lambda image: image.max())
    listed = [read, *listed]
    for repeat in range(repeats + 1):
        for program in listed:
            program.work = program.anew() if program.anew else program.work
        for picture in pictures:
            for program in listed:
                image = program.given(picture)
                begin = time.thread_time()
                result = program.work(image)
                taken = time.thread_time() - begin
                if repeat:
                    program.seconds.append(taken)
                elif program is not read:  # the first time warms, and is judged
                    program.found.append(result)
    read_ms = 1e3 * min(listed[0].seconds)
    rows = []
    for program in listed:
        row = {
            "scene": name,
            "program": program.name,
            "format": program.format,
            "ours": program.ours,
            "frames": len(pictures),
            "min_ms": 1e3 * min(program.seconds),
            "median_ms": 1e3 * float(np.median(program.seconds)),
            "of_memory_read": 1e3 * min(program.seconds) / read_ms,
        }
        if program.found:
            row |= judged(program.found, pictures)
        rows.append(row)
    return rows


def judged(found, pictures):
    total = hits = false = 0
    squares = []
    for places, picture in zip(found, pictures, strict=True):
        hit, wrong = rendered.match(picture.truth_px, places)
        total, hits, false = total + len(hit), hits + int((hit >= 0).sum()), false + len(wrong)
        error = places[hit[hit >= 0]] - picture.truth_px[hit >= 0]
        squares.append((error**2).ravel())
    squares = np.concatenate(squares)
    rms = float(np.sqrt(squares.mean())) if squares.size else float("nan")
    return {"recall": hits / total, "false_a_frame": false / len(pictures), "rms_px": rms}


def fastest_peer(rows, least_recall=0.99):
    able = [r for r in rows if not r["ours"] and r.get("recall", 0) >= least_recall]
    return min(able, key=lambda r: r["min_ms"], default=None)


def markdown(name, rows):
    peer = fastest_peer(rows)
    lines = [
        f"\n{name}, {rows[0]['frames']} pictures\n",
        "| program | format | min ms | median ms | x memory read | x fastest peer "
        "| recall | false a frame | RMS px |",
        "| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for row in rows:
        against = f"{row['min_ms'] / peer['min_ms']:.2f}" if peer else "-"
        quality = (
            " | | "
            if "recall" not in row
            else (f"{row['recall']:.3f} | {row['false_a_frame']:.1f} | {row['rms_px']:.4f}")
        )
        lines.append(
            f"| {row['program']} | {row['format']} | {row['min_ms']:.3f} | {row['median_ms']:.3f} "
            f"| {row['of_memory_read']:.1f} | {against} | {quality} |"
        )
    if peer:
        lines.append(f"\nFastest peer of recall >= 0.99: {peer['program']}.")
    else:
        lines.append("\nNo peer reaches a recall of 0.99.")
    return "\n".join(lines)


def scenes(args):
    folder = args.data / "rendered-targets"
    if folder.is_dir():
        yield f"rendered-targets S{args.noise:g}", list(shared_pictures(folder, args.noise))
    else:
        print(f"left out: {folder} is not there")
    yield "own 1024 x 1024, 49 targets", list(own_pictures(args.frames, args.noise))
    if not args.small:
        large = {"size": (3888, 2592), "grid": (8, 13), "coded": 35}
        yield (
            "own 3888 x 2592, 104 targets",
            list(own_pictures(max(1, args.frames // 2), args.noise, **large)),
        )


def tables(args, methods):
    """(name, pictures, programs) of each table."""
    for name, pictures in () if args.film_only else scenes(args):
        if not pictures:
            print(f"left out: {name}: no pictures")
            continue
        if pictures[0].packed is None:
            print(f"{name}: recognition takes no packed frames yet")
        height, width = pictures[0].grey.shape
        yield name, pictures, programs((width, height), methods, pictures[0].packed is not None)
    if args.film:
        film = list(noisy(rendered.make_film(1, args.film), args.noise))
        for estimator in ("mean-gradient", "model"):
            name = f"film 1024 x 1024, 49 targets that move, {estimator}"
            yield name, film, film_programs(film, estimator)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    default = os.environ.get("VIDEOGRAMMETRY_DATA", "../shared/data")
    parser.add_argument("--data", type=Path, default=Path(default))
    parser.add_argument("--frames", type=int, default=6, help="of the own scenes")
    parser.add_argument("--film", type=int, default=24, help="frames of the film; 0: none")
    parser.add_argument("--film-only", action="store_true", help="nothing but the film")
    parser.add_argument("--repeats", type=int, default=7, help="of every picture")
    parser.add_argument("--noise", type=float, default=75.0, help="contrast over noise at white")
    parser.add_argument("--method", choices=rendered.METHODS)
    parser.add_argument("--core", type=int, default=0)
    parser.add_argument("--small", action="store_true", help="few, small pictures")
    parser.add_argument("--json", type=Path, help="write the rows to this file too")
    parser.add_argument("--markdown", type=Path, help="write the tables to this file too")
    args = parser.parse_args()
    if args.small:
        args.frames, args.film, args.repeats = 2, min(args.film, 20), 2
    cv2.setNumThreads(1)
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {args.core})
    methods = rendered.combinations((args.method,) if args.method else rendered.METHODS)
    rows, texts = [], []
    for name, pictures, listed in tables(args, methods):
        rows.append(run(name, pictures, listed, args.repeats))
        texts.append(markdown(name, rows[-1]))
        print(texts[-1], flush=True)
    if args.json:
        args.json.write_text(json.dumps([r for scene in rows for r in scene], indent=2))
    if args.markdown:
        args.markdown.write_text("\n".join(texts) + "\n")


if __name__ == "__main__":
    main()
