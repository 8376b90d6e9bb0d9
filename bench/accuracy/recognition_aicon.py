"""Recognition on twenty photographs of a panel of coded and un-coded dots.

Compares with IDs that another program read, and checks every other target
geometrically: the panel's known points are mapped into each picture by a
homography and a cubic polynomial (lens) through the coded dots.

    python bench/accuracy/recognition_aicon.py [--data FOLDER] [--list]
"""

from __future__ import annotations

import argparse
import csv
import os
import sys
import time
from pathlib import Path

import cv2
import numpy as np

from videogrammetry.recognition import recognize

OFF_PANEL = (72, 73, 74)


def read_reference(folder):
    reference = {}
    with open(folder / "coded_elsewhere.csv") as file:
        for row in csv.DictReader(file):
            xy = np.array([float(row["x_px"]), float(row["y_px"])])
            reference.setdefault(row["image"], {})[int(row["id"])] = xy
    return reference


def read_points(folder):
    with open(folder / "points.csv") as file:
        return {
            int(row["id"]): np.array([float(row["x_mm"]), float(row["y_mm"])])
            for row in csv.DictReader(file)
        }


def _cubic(xy, scale):
    x, y = ((xy - scale[0]) / scale[1]).T
    return np.stack([x**i * y**j for i in range(4) for j in range(4 - i)], axis=1)


class PanelMap:
    """Panel (mm) to picture (px), from dots of known ID; robust."""

    def __init__(self, panel_mm, image_px):
        self.homography, _ = cv2.findHomography(panel_mm, image_px, cv2.RANSAC, 5.0)
        flat = self._flat(panel_mm)
        self.scale = (flat.mean(axis=0), flat.std(axis=0).max())
        use = np.ones(len(flat), bool)
        for _ in range(5):
            self.coefficients = np.linalg.lstsq(
                _cubic(flat[use], self.scale), image_px[use] - flat[use], rcond=None
            )[0]
            error = np.hypot(*(self(panel_mm) - image_px).T)
            use = error < max(0.3, 4 * np.median(error))
        self.residual = error

    def _flat(self, panel_mm):
        return cv2.perspectiveTransform(panel_mm[None], self.homography)[0]

    def __call__(self, panel_mm):
        flat = self._flat(np.atleast_2d(panel_mm))
        return flat + _cubic(flat, self.scale) @ self.coefficients


def judge(image, targets, reference, points, seconds):
    mine = {int(i): c for i, c in zip(targets.id, targets.centre_px, strict=True) if i > 0}
    distance = {i: np.hypot(*(mine[i] - reference[i])) for i in reference if i in mine}
    same = [i for i, d in distance.items() if d < 0.3]
    contradicting = [
        (i, j)
        for i, xy in reference.items()
        for j, c in mine.items()
        if (j == i and np.hypot(*(c - xy)) > 3) or (j != i and np.hypot(*(c - xy)) < 3)
    ]
    known = [i for i in mine if i in points and i not in OFF_PANEL]
    panel = PanelMap(np.array([points[i] for i in known]), np.array([mine[i] for i in known]))
    extra = [i for i in mine if i not in reference]
    wrong_extra = [
        i for i in extra if i not in OFF_PANEL and np.hypot(*(panel(points[i])[0] - mine[i])) > 3
    ]
    wrong_extra += [i for i in extra if i not in points]
    # Un-coded: four-digit names, and coded dots whose ring was not read.
    names = [i for i in points if i not in OFF_PANEL]
    where = panel(np.array([points[i] for i in names]))
    height, width = image.shape
    inside = np.all((where > 12) & (where < [width - 13, height - 13]), axis=1)
    gap = np.hypot(*np.moveaxis(where[:, None] - targets.centre_px[None], -1, 0))
    found = gap.min(axis=1) < 3
    plain = np.array([i > 1000 for i in names])
    on_point = (gap.min(axis=0) < 3) | np.isin(targets.id, OFF_PANEL)
    return {
        "ms": 1e3 * seconds,
        "targets": len(targets),
        "reference": len(reference),
        "same": len(same),
        "rms": np.sqrt(np.mean([distance[i] ** 2 for i in same])),
        "wrong": len(contradicting) + len(wrong_extra),
        "extra": len(extra),
        "plain": int((plain & inside & found).sum()),
        "plain_in": int((plain & inside).sum()),
        "false": int((~on_point).sum()),
        "missed": [(i, *np.round(reference[i], 1).tolist()) for i in reference if i not in same],
        "extra_ids": extra,
        "missed_plain": where[plain & inside & ~found].round().astype(int).tolist(),
        "false_at": targets.centre_px[~on_point].round().astype(int).tolist(),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    default = os.environ.get("VIDEOGRAMMETRY_DATA", "../shared/data")
    parser.add_argument("--data", type=Path, default=Path(default))
    parser.add_argument("--list", action="store_true", help="name what is missed, extra and false")
    args = parser.parse_args()
    folder = args.data / "aicon-panel"
    if not folder.is_dir():
        sys.exit(f"{folder} is not there: give --data or set VIDEOGRAMMETRY_DATA")
    reference, points = read_reference(folder), read_points(folder)
    print(
        "picture        ms  targets  coded: ref same  RMS px  wrong  extra"
        "  un-coded: found of in view  elsewhere"
    )
    rows = []
    for path in sorted(folder.glob("*.tif")):
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        begin = time.perf_counter()
        targets = recognize(image)
        seconds = time.perf_counter() - begin
        row = judge(image, targets, reference[path.stem], points, seconds)
        rows.append(row)
        print(
            f"{path.stem:11} {row['ms']:5.1f} {row['targets']:8} {row['reference']:11} "
            f"{row['same']:4} {row['rms']:7.4f} {row['wrong']:6} {row['extra']:6} "
            f"{row['plain']:16} {row['plain_in']:10} {row['false']:10}"
        )
        if args.list:
            for key in ("missed", "extra_ids", "missed_plain", "false_at"):
                if row[key]:
                    print(f"    {key}: {row[key]}")
    total = {k: sum(r[k] for r in rows) for k in rows[0] if not isinstance(rows[0][k], list)}
    print(
        f"all         {total['ms']:5.0f} {total['targets']:8} {total['reference']:11} "
        f"{total['same']:4} {np.sqrt(np.mean([r['rms'] ** 2 for r in rows])):7.4f} "
        f"{total['wrong']:6} {total['extra']:6} {total['plain']:16} {total['plain_in']:10} "
        f"{total['false']:10}"
    )
    print(f"same ID within 0.3 px: {100 * total['same'] / total['reference']:.2f} %")


if __name__ == "__main__":
    main()
