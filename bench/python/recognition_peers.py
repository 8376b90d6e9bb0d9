"""Recognition beside what others do, on the same pictures in the same run, on one core.

    python bench/python/recognition_peers.py [--frames N] [--repeats R] [--noise C]
        [--method M] [--core K] [--data FOLDER] [--small] [--json FILE] [--markdown FILE]

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

from videogrammetry.recognition import RecognitionOptions, recognize

sys.path.insert(0, str(Path(__file__).parents[1]))
import rendered_scenes as rendered

#: A dot of 8 px at 45 degrees, one of 20 px facing, with a margin.
AREA_PX = (20.0, 420.0)
AXES_PX = (3.0, 24.0)
LEAST_ASPECT = 0.5
#: Twice the same place within this is one find.
SAME_PX = 2.0


@dataclass
class Picture:
    """A picture in the depths that programs take, and where its targets are."""

    deep: np.ndarray
    grey: np.ndarray
    truth_px: np.ndarray
    packed: object = None


@dataclass
class Program:
    """``work`` takes the picture that ``given`` chooses, and returns centres (N, 2)."""

    name: str
    format: str
    given: object
    work: object
    ours: bool = False
    seconds: list = field(default_factory=list)
    found: list = field(default_factory=list)


def ours(method, estimator):
    options = RecognitionOptions(method=method, estimator=estimator)
    return lambda image: recognize(image, options).centre_px


def merged(places):
    """Places without those that stand within SAME_PX of one before them."""
    kept = []
    for x, y in places:
        if all((x - a) ** 2 + (y - b) ** 2 > SAME_PX**2 for a, b in kept):
            kept.append((x, y))
    return np.array(kept).reshape(-1, 2)


def ellipses(image, contours):
    """Centres of ellipses through contours that are of a dot's size, round and bright."""
    height, width = image.shape
    places = []
    for contour in contours:
        if not 8 <= len(contour) <= 200:
            continue
        (x, y), axes, _ = cv2.fitEllipse(contour)
        low, high = min(axes), max(axes)
        if not (AXES_PX[0] <= low and high <= AXES_PX[1] and low >= LEAST_ASPECT * high):
            continue
        if abs(cv2.contourArea(contour) - 0.785 * low * high) > 0.25 * 0.785 * low * high:
            continue
        reach = 0.5 * high + 2.5
        # A ring may stand on one side or two, not all around.
        around = [(x + reach, y), (x - reach, y), (x, y + reach), (x, y - reach)]
        if not (reach <= x < width - 1 - reach and reach <= y < height - 1 - reach):
            continue
        darkest = min(int(image[round(b), round(a)]) for a, b in around)
        if int(image[round(y), round(x)]) > darkest + 20:
            places.append((x, y))
    return merged(places)


def canny(image):
    edges = cv2.Canny(image, 50, 150)
    return ellipses(image, cv2.findContours(edges, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)[0])


def otsu(image):
    _, mask = cv2.threshold(image, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    return ellipses(image, cv2.findContours(mask, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)[0])


def adaptive(image):
    mask = cv2.adaptiveThreshold(image, 255, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY, 41, -15)
    return ellipses(image, cv2.findContours(mask, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)[0])


def components(image):
    """Areas above Otsu's threshold, their grey values' centroid."""
    level, mask = cv2.threshold(image, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask)
    places = []
    for k, (x, y, w, h, area) in enumerate(stats):
        if not (AREA_PX[0] <= area <= AREA_PX[1] and 0.5 * w <= h <= 2 * w):
            continue
        if not 0.65 * w * h < area < 0.9 * w * h:
            continue
        part = labels[y : y + h, x : x + w] == k
        weight = np.where(part, image[y : y + h, x : x + w] - level, 0.0)
        total = weight.sum()
        places.append(
            (x + weight.sum(0) @ np.arange(w) / total, y + weight.sum(1) @ np.arange(h) / total)
        )
    return np.array(places).reshape(-1, 2)


def simple_blob():
    p = cv2.SimpleBlobDetector_Params()
    p.minThreshold, p.maxThreshold, p.thresholdStep = 40, 200, 20
    p.minRepeatability, p.minDistBetweenBlobs = 2, 6
    p.filterByColor, p.blobColor = True, 255
    p.filterByArea, (p.minArea, p.maxArea) = True, AREA_PX
    p.filterByCircularity, p.minCircularity = True, 0.7
    p.filterByConvexity, p.minConvexity = True, 0.9
    p.filterByInertia, p.minInertiaRatio = True, 0.3
    detector = cv2.SimpleBlobDetector_create(p)
    return lambda image: np.array([k.pt for k in detector.detect(image)]).reshape(-1, 2)


def openptv(size):
    """OpenPTV's target_recognition, or None where optv is not installed."""
    try:
        from optv.parameters import ControlParams, TargetParams
        from optv.segmentation import target_recognition
    except ImportError as error:
        print(f"left out: OpenPTV ({error}); pip install optv")
        return None
    control = ControlParams(1)
    control.set_image_size(size)
    targets = TargetParams(
        discont=60,
        gvthresh=[70],
        pixel_count_bounds=tuple(int(a) for a in AREA_PX),
        xsize_bounds=(4, 26),
        ysize_bounds=(4, 26),
        min_sum_grey=1000,
    )

    def work(image):
        found = target_recognition(image, targets, 0, control)
        # Its origin is the corner of the first pixel.
        return np.array([t.pos() for t in found]).reshape(-1, 2) - 0.5

    return work


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
    for seed in range(1, count + 1):
        made = rendered.make_scene(seed, **scene)
        deep = rendered.GreyNoise(bits=12, contrast_noise=noise).picture(made.light, seed)
        grey = rendered.GreyNoise(bits=8, contrast_noise=noise).picture(made.light, seed)
        yield Picture(deep, grey, made.centre_px, rendered.packed_frame(deep))


def to_8bit(deep):
    return np.clip(np.rint(deep / 16.0), 0, 255).astype(np.uint8)


def programs(size, methods, has_packed):
    listed = [Program("memory read", "8 bit", lambda p: p.grey, lambda image: image.max())]
    formats = [("8 bit", lambda p: p.grey), ("12 in 16 bit", lambda p: p.deep)]
    if has_packed:
        formats.append(("12 bit packed", lambda p: p.packed))
    for method, estimator in methods:
        for name, given in formats:
            work = ours(method, estimator)
            listed.append(Program(f"ours {method}, {estimator}", name, given, work, True))
    peers = [
        ("OpenCV Canny + contours + fitEllipse", canny),
        ("OpenCV Otsu + contours + fitEllipse", otsu),
        ("OpenCV adaptive + contours + fitEllipse", adaptive),
        ("OpenCV components + grey centroid", components),
        ("OpenCV SimpleBlobDetector", simple_blob()),
        ("OpenPTV target_recognition", openptv(size)),
    ]
    listed += [Program(name, "8 bit", lambda p: p.grey, work) for name, work in peers if work]
    return listed


def run(name, pictures, methods, repeats):
    """Rows of the table of one scene."""
    height, width = pictures[0].grey.shape
    has_packed = pictures[0].packed is not None
    listed = programs((width, height), methods, has_packed)
    for picture in pictures:
        for program in listed:
            image = program.given(picture)
            result = program.work(image)  # warm, too
            if program.name != "memory read":
                program.found.append(result)
        for _ in range(repeats):
            for program in listed:
                image = program.given(picture)
                begin = time.thread_time()
                program.work(image)
                program.seconds.append(time.thread_time() - begin)
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


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    default = os.environ.get("VIDEOGRAMMETRY_DATA", "../shared/data")
    parser.add_argument("--data", type=Path, default=Path(default))
    parser.add_argument("--frames", type=int, default=6, help="of the own scenes")
    parser.add_argument("--repeats", type=int, default=7, help="of every picture")
    parser.add_argument("--noise", type=float, default=75.0, help="contrast over noise at white")
    parser.add_argument("--method", choices=rendered.METHODS)
    parser.add_argument("--core", type=int, default=0)
    parser.add_argument("--small", action="store_true", help="few, small pictures")
    parser.add_argument("--json", type=Path, help="write the rows to this file too")
    parser.add_argument("--markdown", type=Path, help="write the tables to this file too")
    args = parser.parse_args()
    if args.small:
        args.frames, args.repeats = 2, 2
    cv2.setNumThreads(1)
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {args.core})
    methods = rendered.combinations((args.method,) if args.method else rendered.METHODS)
    rows, texts = [], []
    for name, pictures in scenes(args):
        if not pictures:
            print(f"left out: {name}: no pictures")
            continue
        if pictures[0].packed is None:
            print(f"{name}: recognition takes no packed frames yet")
        rows.append(run(name, pictures, methods, args.repeats))
        texts.append(markdown(name, rows[-1]))
        print(texts[-1], flush=True)
    if args.json:
        args.json.write_text(json.dumps([r for scene in rows for r in scene], indent=2))
    if args.markdown:
        args.markdown.write_text("\n".join(texts) + "\n")


if __name__ == "__main__":
    main()
