"""Recognition on a black-on-white sheet, a block in water, and dots of all sizes.

    python bench/accuracy/recognition_other.py [--data FOLDER]

Sheet: 21 photographs, recall against marks made with another program. Block:
spheres with highlights behind glass, counted only. Sizes: this project's own
synthetic dots, 5 to 200 px, both polarities and types.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

import cv2
import numpy as np

from videogrammetry.recognition import RecognitionOptions, recognize

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "python" / "recognition"))
import recognition_scenes as scenes

CORNER_ORIGIN = 0.5


def read_marks(path):
    """Mark positions by picture index, in our pixel frame (the file's origin is a corner)."""
    marks = {}
    for line in path.read_text().splitlines():
        fields = line.split()
        if len(fields) == 6 and fields[0].isdigit() and fields[1].isdigit():
            xy = np.array([float(fields[2]), float(fields[3])]) - CORNER_ORIGIN
            marks.setdefault(int(fields[0]), []).append(xy)
    return {k: np.array(v) for k, v in marks.items()}


def sheet(folder):
    marks = read_marks(folder / "camcal-pmexport.txt")
    options = RecognitionOptions(polarity="black-on-white", codes="none")
    total, found, extra, squares = 0, 0, 0, []
    for index, path in enumerate(sorted(folder.glob("*.JPG"))):
        targets = recognize(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), options)
        gap = np.hypot(*np.moveaxis(marks[index][:, None] - targets.centre_px[None], -1, 0))
        hit = gap.min(axis=1) < 1.0
        total += len(hit)
        found += hit.sum()
        extra += (gap.min(axis=0) >= 1.0).sum()
        squares.append(gap.min(axis=1)[hit] ** 2 / 2)
        if not hit.all():
            print(f"    {path.name}: no target at", marks[index][~hit].round(1).tolist())
    rms = np.sqrt(np.concatenate(squares).mean())
    print(f"sheet: {found} of {total} marks, RMS {rms:.3f} px a coordinate, {extra} elsewhere")


def block(folder):
    for path in sorted(folder.glob("cam*.tif")):
        targets = recognize(
            cv2.imread(str(path), cv2.IMREAD_UNCHANGED), RecognitionOptions(codes="none")
        )
        print(f"block: {path.name} {len(targets)} targets (73 spheres, not all in view)")


def sizes():
    print("diameter px   found of  false  RMS px   (aspect 0.7, contrast / noise 75 and 13)")
    for diameter in (5, 6, 8, 12, 20, 40, 80, 140, 200):
        a = diameter / 2 / (0.7 if diameter < 20 else 1.0)
        rows = 3 if diameter > 60 else 6
        pitch = int(2 * a + 16)
        dots = scenes.grid_of_dots(rows, rows, pitch, a=a * 0.995, aspect=0.7, seed=diameter)
        if diameter < 20:  # the smallest diameter is that of the minor axis
            dots = [scenes.Dot(d.x, d.y, d.a * 1.03, d.b * 1.03, d.angle) for d in dots]
        grey = scenes.render(
            (pitch * (rows + 1),) * 2, dots, white=3000, black=300, psf=0.7,
            sampling=4 if diameter > 60 else 8,
        )  # fmt: skip
        for snr in (75, 13):
            noise = np.random.default_rng(diameter).normal(0, 2700 / snr, grey.shape)
            image = scenes.quantise(grey + noise, np.uint16)
            for polarity in ("white-on-black", "black-on-white"):
                shown = image if polarity == "white-on-black" else 4000 - image
                targets = recognize(shown, RecognitionOptions(codes="none", polarity=polarity))
                truth = np.array([[d.x, d.y] for d in dots])
                if len(targets) == 0:
                    print(f"{diameter:6} S{snr:<3} {polarity}: none of {len(dots)}")
                    continue
                gap = np.hypot(*np.moveaxis(truth[:, None] - targets.centre_px[None], -1, 0))
                hit = gap.min(axis=1) < 1
                rms = np.sqrt((gap.min(axis=1)[hit] ** 2 / 2).mean())
                print(
                    f"{diameter:6} S{snr:<3} {hit.sum():7} {len(dots):2} "
                    f"{(gap.min(axis=0) >= 1).sum():6} {rms:8.4f}   {polarity}"
                )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    default = os.environ.get("VIDEOGRAMMETRY_DATA", "../shared/data")
    parser.add_argument("--data", type=Path, default=Path(default))
    args = parser.parse_args()
    if (args.data / "camcal").is_dir():
        sheet(args.data / "camcal")
    if (args.data / "test-cavity").is_dir():
        block(args.data / "test-cavity" / "calibration")
    sizes()


if __name__ == "__main__":
    main()
