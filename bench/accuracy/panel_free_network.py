"""The real panel as a free network with one known distance.

    .venv/bin/python bench/accuracy/panel_free_network.py [--data DIR] [--pairs 5]

The 20 pictures of aicon-panel, two cameras, measured by ``measure-target``: no coordinates, no
start values, no rig (every picture has a pose of its own); the scale from the distance of the
two coded targets that are farthest apart, as points.csv has it. Coordinates against points.csv
after a rigid best fit. The last lines: the same with other pairs as the distance.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

import numpy as np

from videogrammetry.geometry import fit_rigid
from videogrammetry.pipeline.measure_target import TargetOptions, measure_target, read_photographs
from videogrammetry.project import read_points
from videogrammetry.project.network_tables import NamedScaleBar
from videogrammetry.recognition import RecognitionOptions
from videogrammetry.sequence import open_sequence

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
# Largest number of a coded target; four-digit numbers are un-coded dots.
CODED = 74


def bars_of(points, count):
    """The pairs of coded targets that are farthest apart."""
    coded = np.flatnonzero(points.id <= CODED)
    apart = np.linalg.norm(points.position_mm[coded][:, None] - points.position_mm[coded], axis=2)
    order = np.argsort(-np.triu(apart).ravel())[:count]
    pairs = [divmod(int(k), len(coded)) for k in order]
    return [(int(points.id[coded[i]]), int(points.id[coded[k]]), apart[i, k]) for i, k in pairs]


def bar(a, b, length):
    return NamedScaleBar(
        point_a=str(a), point_b=str(b), length_mm=length, sigma_mm=0.01, calibrated_mm=length
    )


def nearest(found, known, limit_mm):
    """Rows of found and known points that are mutually nearest within a limit."""
    away = np.linalg.norm(found[:, None] - known[None], axis=2)
    near = away.argmin(axis=1)
    good = (away.argmin(axis=0)[near] == np.arange(len(found))) & (away.min(axis=1) < limit_mm)
    return np.flatnonzero(good), near[good]


def judged(result, known):
    names = np.array([int(n) for n in result.points.name])
    coded, i, k = np.intersect1d(names[names <= CODED], known.id, return_indices=True)
    i = np.flatnonzero(np.isin(names, coded))[np.argsort(names[np.isin(names, coded)])]
    rotation, shift, _ = fit_rigid(known.position_mm[k], result.points.position_mm[i])
    placed = result.points.position_mm @ rotation.T + shift
    all_found, all_known = nearest(placed, known.position_mm, 3.0)
    rotation, shift, _ = fit_rigid(
        known.position_mm[all_known], result.points.position_mm[all_found]
    )
    error = result.points.position_mm @ rotation.T + shift
    both = error[all_found] - known.position_mm[all_known]
    alone = error[i] - known.position_mm[k]
    return alone, both, len(result.points)


def rms3(error):
    return float(np.sqrt((error**2).sum(axis=1).mean()))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    default = os.environ.get("VIDEOGRAMMETRY_DATA", str(DATA))
    parser.add_argument("--data", type=Path, default=Path(default))
    parser.add_argument("--pairs", type=int, default=5)
    options = parser.parse_args()
    folder = options.data / "aicon-panel"
    known = read_points(folder / "points.csv")
    source = open_sequence([str(folder / "left_*.tif"), str(folder / "right_*.tif")])
    names = [source.name(i) for i in range(len(source))]
    how = TargetOptions(
        recognition=RecognitionOptions(codes="schneider-14"), cameras=("left_*", "right_*")
    )
    photographs = read_photographs(source, names, how)
    for number, (a, b, length) in enumerate(bars_of(known, options.pairs)):
        result = measure_target(photographs, [bar(a, b, length)], None, how).result
        alone, both, count = judged(result, known)
        s = result.summary
        print(
            f"{a:3d}-{b:<3d} {length:8.3f} mm: {len(alone)} coded {rms3(alone):.4f} mm 3-D RMS "
            f"(x y z {' '.join(f'{v:.4f}' for v in np.sqrt((alone**2).mean(axis=0)))}); all "
            f"{len(both)} of {len(known)} {rms3(both):.4f} mm, {count - len(both)} others"
        )
        if number == 0:
            print(
                f"  {s.images} pictures, sigma0 {s.sigma0:.3f}, RMS {s.rms_px:.4f} px, redundancy "
                f"{s.redundancy}, {s.unknowns} unknowns, {len(result.rejected)} rejected"
            )
            for warning in result.warnings:
                print(f"  warning: {warning}")


if __name__ == "__main__":
    main()
