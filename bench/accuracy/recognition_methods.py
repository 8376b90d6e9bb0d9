"""The fast method beside the paper's, on every set of real and rendered pictures.

    python bench/accuracy/recognition_methods.py [--data FOLDER] [--set NAME] [--list]

Sets: ``aicon`` (20 photographs of a panel, IDs and positions of another program and
the panel's known points), ``camcal`` (21 of a sheet, marks of another program),
``cavity`` (a block of spheres behind glass, from four sides), ``particles`` (12 frames
of particles, counted only), ``rendered`` (known truth), ``high-speed`` (a speckled
beam and a strip without a target, counted only).

``found of``: known places with a target; ``lost``: those that the first method finds
and this one does not; ``elsewhere``: targets on no known place; ``SD x, y``: robust
standard deviation of found minus reference, per coordinate; ``chi``: the same over
the predicted deviation, where the reference is good enough; ``ms``: the shortest of
three runs a picture.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from recognition_aicon import OFF_PANEL, PanelMap, read_points, read_reference
from recognition_other import read_marks
from recognition_rendered import read_truth

from videogrammetry.recognition import RecognitionOptions, recognize
from videogrammetry.sequence import open_sequence

METHODS = {
    "local-canny": {"method": "local-canny", "estimator": "mean-gradient"},
    "canny+model": {"method": "local-canny", "estimator": "model"},
    "edge-pair": {"method": "edge-pair", "estimator": "model"},
}
NEAR_PX = 3.0


@dataclass
class Picture:
    """A picture and what is known of it: places, IDs (-1: none) and how exact they are."""

    name: str
    image: np.ndarray
    options: dict = field(default_factory=dict)
    places: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    ids: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    exact: np.ndarray | None = None  # bool: positions good enough for SD
    ignored: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    near_px: float = NEAR_PX


def panel(folder):
    reference, points = read_reference(folder), read_points(folder)
    names = np.array([i for i in points if i not in OFF_PANEL])
    for path in sorted(folder.glob("*.tif")):
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        seen = reference[path.stem]
        known = [i for i in seen if i in points and i not in OFF_PANEL]
        mapped = PanelMap(np.array([points[i] for i in known]), np.array([seen[i] for i in known]))
        where = mapped(np.array([points[i] for i in names]))
        off = np.array([seen[i] for i in seen if i in OFF_PANEL]).reshape(-1, 2)
        height, width = image.shape
        inside = np.all((where > 12) & (where < [width - 13, height - 13]), axis=1)
        where, ids = where[inside], np.where(names < 1000, names, -1)[inside]
        exact = np.array([i in seen for i in ids])
        where[exact] = [seen[i] for i in ids[exact]]
        extra = [i for i in seen if i in OFF_PANEL]
        yield Picture(
            path.stem, image, {},
            np.concatenate([where, off]), np.concatenate([ids, extra]).astype(int),
            np.concatenate([exact, np.ones(len(extra), bool)]),
        )  # fmt: skip


def sheet(folder):
    marks = read_marks(folder / "camcal-pmexport.txt")
    for index, path in enumerate(sorted(folder.glob("*.JPG"))):
        yield Picture(
            path.name, cv2.imread(str(path), cv2.IMREAD_GRAYSCALE),
            {"polarity": "black-on-white", "codes": "none"},
            marks[index], np.full(len(marks[index]), -1), near_px=1.0,
        )  # fmt: skip


def openptv_projection(path, points):
    """Pinhole part of an orientation file; glass and water are left to what follows."""
    values = [float(v) for v in path.read_text().split()]
    turned = (points - values[:3]) @ np.array(values[6:15]).reshape(3, 3)
    xy = -values[17] * turned[:, :2] / turned[:, 2:] / 0.012  # mm a pixel
    return np.array([640.0, 512.0]) + xy * [1, -1]


def direct_linear(points, xy):
    """Projection (3, 4) by the direct linear transformation, points scaled to a block's size."""
    world = np.c_[points / 40.0, np.ones(len(points))]
    image = (xy - 600) / 600
    rows = np.concatenate([
        np.c_[world, 0 * world, -image[:, :1] * world],
        np.c_[0 * world, world, -image[:, 1:] * world],
    ])  # fmt: skip
    matrix = np.linalg.svd(rows)[2][-1].reshape(3, 4)

    def project(points):
        w = np.c_[points / 40.0, np.ones(len(points))] @ matrix.T
        return 600 + 600 * w[:, :2] / w[:, 2:]

    return project


def block(folder):
    points = np.genfromtxt(folder / "target.csv", delimiter=",", skip_header=1)[:, 1:]
    for path in sorted(folder.glob("cam*.tif")):
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        spots = bright_spots(image)
        where = openptv_projection(path.with_name(path.name + ".ori"), points)
        where = register(where, spots)
        for reach in (12, 8, 5, 4, 4):
            gap = np.linalg.norm(where[:, None] - spots, axis=2)
            use = gap.min(axis=1) < reach
            where = direct_linear(points[use], spots[gap.argmin(axis=1)[use]])(points)
        gap = np.linalg.norm(where[:, None] - spots, axis=2)
        seen = gap.min(axis=1) < 5
        yield Picture(
            path.name, image, {"codes": "none"}, where[seen], np.full(seen.sum(), -1), near_px=5.0
        )


def bright_spots(image):
    """Centres of what stands out from its surroundings by a sphere's size."""
    grey = image.astype(np.float32)
    size = cv2.GaussianBlur(grey, (0, 0), 2.5) - cv2.GaussianBlur(grey, (0, 0), 6)
    peak = (size == cv2.dilate(size, np.ones((9, 9)))) & (size > 8)
    return np.argwhere(peak)[:, ::-1].astype(float)


def register(where, spots):
    """Scale and shift of the places so that most lie on spots."""
    best, placed = -1.0, where
    middle = where.mean(axis=0)
    for scale in np.arange(0.96, 1.16, 0.02):
        scaled = middle + scale * (where - middle)
        gap = scaled[:, None] - spots
        shift = -gap[np.abs(gap).max(axis=2) < 120]
        count, x, y = np.histogram2d(*shift.T, bins=40, range=[[-120, 120]] * 2)
        i = np.unravel_index(count.argmax(), count.shape)
        offset = np.array([x[i[0]], y[i[1]]]) + 3.0
        hits = (np.linalg.norm(scaled[:, None] + offset - spots, axis=2).min(axis=1) < 8).sum()
        score = hits - 0.02 * np.linalg.norm(offset)
        if score > best:
            best, placed = score, scaled + offset
    return placed


def particles(folder):
    for path in sorted(folder.glob("*.tif")):
        yield Picture(path.name, cv2.imread(str(path), cv2.IMREAD_UNCHANGED), {"codes": "none"})


def rendered(folder):
    for path in sorted(folder.glob("*.png")):
        xy, _, ids = read_truth(folder / f"{path.stem.split('_')[0]}_truth.csv")
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        yield Picture(path.stem, image, {}, xy, ids, near_px=1.0)


def high_speed(folder):
    for name in ("beam.cihx", "data_showcase.cih"):
        source = open_sequence(folder / name)
        for polarity in ("white-on-black", "black-on-white"):
            yield Picture(f"{name} {polarity}", source.read(0), {"polarity": polarity})


SETS = {
    "aicon": ("aicon-panel", panel),
    "camcal": ("camcal", sheet),
    "cavity": ("test-cavity/calibration", block),
    "particles": ("test-cavity/frames", particles),
    "rendered": ("rendered-targets", rendered),
    "high-speed": ("high-speed", high_speed),
}


def timed(image, options, repeats):
    seconds = []
    for _ in range(repeats):
        begin = time.perf_counter()
        targets = recognize(image, options)
        seconds.append(time.perf_counter() - begin)
    return targets, 1e3 * min(seconds)


def judge(picture, targets):
    """What of a picture's places was found, which IDs, and what lies elsewhere."""
    places, centres = picture.places, targets.centre_px
    if not len(places) or not len(centres):
        hit = np.zeros(len(places), bool)
        return {
            "hit": hit, "nearest": None, "read": 0, "wrong": 0, "coded": 0,
            "elsewhere": centres, "error": np.zeros((0, 2)), "chi": np.zeros((0, 2)),
        }  # fmt: skip
    gap = np.linalg.norm(places[:, None] - centres, axis=2)
    nearest, hit = gap.argmin(axis=1), gap.min(axis=1) < picture.near_px
    got = np.where(hit, targets.id[nearest], -1)
    free = gap.min(axis=0) >= picture.near_px
    twice = np.array([(picture.ids == i).sum() > 1 for i in picture.ids])
    coded = (picture.ids > 0) & ~twice
    if picture.exact is not None:
        coded &= picture.exact
    wrong = int(((got > 0) & (got != picture.ids)).sum() + (targets.id[free] > 0).sum())
    exact = hit if picture.exact is None else hit & picture.exact
    error = centres[nearest[exact]] - places[exact]
    return {
        "hit": hit,
        "read": int((coded & (got == picture.ids)).sum()),
        "wrong": wrong,
        "coded": int(coded.sum()),
        "elsewhere": centres[free],
        "error": error,
        "chi": error / targets.sigma_px[nearest[exact]],
    }


def robust_sd(error):
    if not len(error):
        return np.full(2, np.nan)
    return 1.4826 * np.median(np.abs(error - np.median(error, axis=0)), axis=0)


def unshared(ours, others):
    if not len(ours) or not len(others):
        return ours
    return ours[np.linalg.norm(ours[:, None] - others, axis=2).min(axis=1) >= NEAR_PX]


def compare(name, pictures, methods, repeats, show):
    results = {m: [] for m in methods}
    milliseconds = dict.fromkeys(methods, 0.0)
    for picture in pictures:
        for m in methods:
            options = RecognitionOptions(**picture.options, **METHODS[m])
            targets, ms = timed(picture.image, options, repeats)
            milliseconds[m] += ms
            results[m].append(judge(picture, targets) | {"targets": len(targets), "of": picture})
    first = methods[0]
    for m in methods:
        rows = results[m]
        lost = [a["hit"] & ~b["hit"] for a, b in zip(results[first], rows, strict=True)]
        error = np.concatenate([r["error"] for r in rows])
        chi = np.concatenate([r["chi"] for r in rows])
        sd, chi = robust_sd(error), robust_sd(chi).mean()
        total = {k: sum(r[k] for r in rows) for k in ("read", "wrong", "coded", "targets")}
        print(
            f"{name:10} {m:12} {sum(r['hit'].sum() for r in rows):5} "
            f"{sum(len(r['hit']) for r in rows):5} {sum(x.sum() for x in lost):5} "
            f"{total['read']:5} {total['coded']:5} {total['wrong']:5} {total['targets']:7} "
            f"{sum(len(r['elsewhere']) for r in rows):9}   {sd[0]:6.4f} {sd[1]:6.4f} {chi:6.2f} "
            f"{milliseconds[m] / len(rows):7.1f}",
            flush=True,
        )
        if not show:
            continue
        for a, b, gone in zip(results[first], rows, lost, strict=True):
            picture = b["of"]
            for title, places in (
                ("lost", picture.places[gone]),
                ("gained", picture.places[b["hit"] & ~a["hit"]]),
                ("missed by both", picture.places[~b["hit"] & ~a["hit"]]),
                ("no longer elsewhere", unshared(a["elsewhere"], b["elsewhere"])),
                ("newly elsewhere", unshared(b["elsewhere"], a["elsewhere"])),
            ):
                if m != first and len(places):
                    print(f"    {picture.name} {title}:", places.round(1).tolist())
    return results


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    default = os.environ.get("VIDEOGRAMMETRY_DATA", "../shared/data")
    parser.add_argument("--data", type=Path, default=Path(default))
    parser.add_argument("--set", choices=tuple(SETS), action="append")
    parser.add_argument("--method", choices=tuple(METHODS), action="append")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--list", action="store_true", help="name what only one method has")
    args = parser.parse_args()
    print(
        "set        method       found    of  lost  read    of wrong targets elsewhere"
        "     SD x,     y    chi      ms"
    )
    for name in args.set or SETS:
        folder, read = SETS[name]
        if not (args.data / folder).is_dir():
            print(f"{name:10} {args.data / folder} is not there", file=sys.stderr)
            continue
        methods = args.method or list(METHODS)
        compare(name, list(read(args.data / folder)), methods, args.repeats, args.list)


if __name__ == "__main__":
    main()
