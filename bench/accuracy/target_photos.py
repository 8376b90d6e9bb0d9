"""The measurement of a target from photographs, beside the truth of the rendered scene.

    .venv/bin/python bench/accuracy/target_photos.py [--folder DIR] [--draws 1]

``simulate target-photos`` renders 24 hand-held photographs of the two-sided cross, boards and
two scale bars; ``measure-target`` measures it from the pictures and the bars alone. Coordinates
after a rigid best fit (no scale) onto the truth, their errors over the predicted standard
deviations, the camera and the side-to-side transform.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from videogrammetry.geometry import fit_rigid
from videogrammetry.project import read_points

VERB = (sys.executable, "-m", "videogrammetry")


def measured(folder, seed):
    photos = folder / f"photos_{seed}"
    if not photos.exists():
        command = [*VERB, "simulate", "target-photos", str(photos), "--seed", str(seed)]
        subprocess.run(command, check=True, capture_output=True)
    out = folder / f"cross_{seed}.csv"
    command = [
        *VERB, "measure-target", str(photos / "photos" / "*"), "--scale-bars",
        str(photos / "scale-bars.csv"), "--diameter-px", "4", "62", "--out", str(out), "--force",
    ]  # fmt: skip
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return photos, out, done.stderr


def show(photos, out):
    truth, found = read_points(photos / "truth" / "points.csv"), read_points(out)
    common, i, k = np.intersect1d(found.id, truth.id, return_indices=True)
    rotation, shift, _ = fit_rigid(truth.position_mm[k], found.position_mm[i])
    error = found.position_mm[i] @ rotation.T + shift - truth.position_mm[k]
    with np.load(out.with_suffix(".npz")) as arrays:
        full = arrays["full_cov_mm2"]
    places = (3 * i[:, None] + np.arange(3)).ravel()
    block = np.kron(np.eye(len(i)), rotation)
    cov = block @ full[np.ix_(places, places)] @ block.T
    sigma = np.sqrt(np.diag(cov)).reshape(-1, 3)
    summary = json.loads(out.with_name(f"{out.stem}-summary.json").read_text())
    spread = np.linalg.norm(found.position_mm[i] - found.position_mm[i].mean(axis=0))
    true_spread = np.linalg.norm(truth.position_mm[k] - truth.position_mm[k].mean(axis=0))
    print(
        f"{len(common)} of {len(truth)} points ({len(found) - len(common)} others), RMS x y z "
        + " ".join(f"{v:.4f}" for v in np.sqrt((error**2).mean(axis=0)))
        + f" mm, largest {np.linalg.norm(error, axis=1).max():.4f} mm; error / sigma "
        f"{np.sqrt(((error / sigma) ** 2).mean()):.3f}; scale {spread / true_spread - 1:+.1e}"
    )
    print(
        f"  sigma0 {summary['sigma0']:.3f}, redundancy {summary['redundancy']}, "
        f"rejected {len(summary['rejected'])}; sides known to "
        f"{np.linalg.norm(summary['sides']['sigma'][3:]):.4f} mm"
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, help="keep pictures and results here")
    parser.add_argument("--draws", type=int, default=1, help="seeds 0, 1, ...")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = options.folder or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        for seed in range(options.draws):
            photos, out, said = measured(folder, seed)
            print(f"seed {seed}: " + said.strip().splitlines()[-2])
            show(photos, out)


if __name__ == "__main__":
    main()
