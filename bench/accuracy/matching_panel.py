"""The panel's un-coded dots over two cameras with the codes withheld, against points.csv.

    .venv/bin/python bench/accuracy/matching_panel.py [--data DIR]

aicon-panel: 166 un-coded dots and 73 coded ones on a grid; all are matched as un-coded dots, stage
by stage, by the rig that the other five pairs calibrate. The codes only orient each stage's points
(and judge): a match is right if the targets of both cameras are the nearest ones, within 4 px, to
the pictures of one point of points.csv, wrong if they are of two, `unknown` where one is of none.
Between two cameras geometry alone pairs dots along an epipolar line: the neighbours' surface
decides or the dots are named ambiguous.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import panel

from videogrammetry.geometry import fit_rigid, project_from_world
from videogrammetry.matching import TARGET_STATUS, match_stage
from videogrammetry.pipeline import calibrate_project
from videogrammetry.project import read_points, read_project
from videogrammetry.recognition import RecognitionOptions, recognize
from videogrammetry.reconstruction import CalibrationField, Rig, Triangulator
from videogrammetry.sequence import open_sequence

STAGES = (7, 11, 15, 19, 23)
OWN_PX = 4.0


def owners(camera, known, rotation, shift, centres):
    """(N,) row of the known point whose picture each target is, -1 = none."""
    picture = project_from_world(camera, known.position_mm @ rotation.T + shift)
    away = np.linalg.norm(centres[:, None] - picture[None], axis=2)
    own = away.argmin(axis=1)
    return np.where(away.min(axis=1) < OWN_PX, own, -1)


def judge(data):
    """A row a stage: right, wrong, unknown, ambiguous dots, un-coded dots seen by both."""
    with tempfile.TemporaryDirectory() as folder:
        path = panel.write_project(Path(folder), data)
        project = read_project(path)
        known = read_points(project.calibration.target)
        rig = calibrate_project(project).rig
    field = CalibrationField(Triangulator(Rig.from_data(rig)))
    rows = []
    for stage in STAGES:
        found = []
        for name in rig.cameras:
            picture = open_sequence(data / "aicon-panel" / f"{name}_{stage:04d}.tif")
            found.append(recognize(picture.read(0), RecognitionOptions()))
        coded = match_stage(rig, found)
        pixels = {
            name: t.centre_px[coded.target[coded.id >= 0, c]]
            for c, (name, t) in enumerate(zip(rig.cameras, found, strict=True))
        }
        ids = coded.id[coded.id >= 0]
        row = {int(i): k for k, i in enumerate(known.id)}
        good = np.array([int(i) in row for i in ids])
        points = Rig.from_data(rig).triangulate(pixels)[0][good]
        there = known.position_mm[[row[int(i)] for i in ids[good]]]
        rotation, shift, _ = fit_rigid(points, there)
        blank = [replace(t, id=np.full(len(t), -1, np.int32)) for t in found]
        extra = [field.covariance(c, t.centre_px) for c, t in enumerate(blank)]
        matches = match_stage(rig, blank, None, extra)
        own = [
            owners(camera, known, rotation, shift, t.centre_px)
            for camera, t in zip(rig.cameras.values(), found, strict=True)
        ]
        a, b = (own[c][matches.target[:, c]] for c in (0, 1))
        uncoded = known.id > panel.LARGEST_CODE
        both = np.intersect1d(own[0][own[0] >= 0], own[1][own[1] >= 0])
        status = TARGET_STATUS.index("ambiguous")
        rows.append(
            {
                "stage": stage,
                "right": int(((a == b) & (a >= 0)).sum()),
                "right un-coded": int(((a == b) & (a >= 0) & uncoded[a]).sum()),
                "wrong": int(((a != b) & (a >= 0) & (b >= 0)).sum()),
                "unknown": int(((a < 0) | (b < 0)).sum()),
                "ambiguous": int((matches.status[0] == status).sum()),
                "seen by both": len(both),
                "un-coded of them": int(uncoded[both].sum()),
            }
        )
    return rows


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    default = os.environ.get("VIDEOGRAMMETRY_DATA", str(panel.default_data()))
    parser.add_argument("--data", type=Path, default=Path(default))
    rows = judge(parser.parse_args().data)
    print("  ".join(f"{name:>16}" for name in rows[0]))
    for row in rows:
        print("  ".join(f"{value:16d}" for value in row.values()))


if __name__ == "__main__":
    main()
