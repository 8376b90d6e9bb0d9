"""Self-calibration of camcal beside DBAT's report: sigma0, redundancy, lens.

    .venv/bin/python bench/accuracy/network_camcal.py [--json FILE]

1. PhotoModeler's 2074 marks, its a-priori sigma of 0.1 px, four control points held,
   nine interior unknowns, no data snooping: the network and the weights of DBAT's report.
2. The same from our own recognition of the photographs, each dot named by the mark
   nearest to it, and again with data snooping.

DBAT's model ("Backward (Photogrammetry) 3") corrects the measured point as ours does:
with (x, y) in mm from the principal point, y up, the pixel's aspect applied,

    x (1 + K1 r^2 + K2 r^4 + K3 r^6) + P1 (r^2 + 2 x^2) + 2 P2 x y = -c X / Z, y alike.

Ours is, in pixels, y down,

    x (1 + A1 (r^2 - r0^2) + A2 (r^4 - r0^4) + A3 (r^6 - r0^6)) + B1 (...) + ... = f X / Z.

Both describe the same rays: with k = 1 - A1 r0^2 - A2 r0^4 - A3 r0^6 and s the pixel's
width in mm, dividing ours by k gives

    c = s f / k,  K1 = A1 / (k s^2),  K2 = A2 / (k s^4),  K3 = A3 / (k s^6),
    P1 = B1 / (k s),  P2 = -B2 / (k s)   (the y axis is turned),
    aspect: theirs is pixel width / height - 1, ours height / width - 1.

The two sets of nine are functions of each other, so sigma0, redundancy and residuals must agree
to rounding, whatever r0 is. Both minimise the residuals of the corrected points (``residuals =
"corrected"``, the default where PhotoModeler's export is read). s is not estimated by either:
DBAT holds the sensor's height (5.43764 mm), so that its pixel's width follows from the aspect.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path

import numpy as np
from calibration_data import data_folder

from videogrammetry.calibration.network_result import AdjustedCamera, NetworkAdjustment
from videogrammetry.pipeline.adjust import adjust_file
from videogrammetry.project import write_csv
from videogrammetry.project.network_file import read_network_file
from videogrammetry.project.photomodeler import read_photomodeler_marks

SIZE = (2272, 1704)
SENSOR_HEIGHT_MM = 5.43764
FREE = ("f", "x0", "y0", "A1", "A2", "A3", "B1", "B2", "aspect")
#: DBAT's report: value and standard deviation, mm.
REFERENCE = {
    "c": (7.45700, 0.00105),
    "px": (3.61546, 0.00082),
    "py": (2.61329, 0.00098),
    "K1": (4.58861e-3, 2.21e-5),
    "K2": (-4.51351e-5, 2.65e-6),
    "K3": (-2.05253e-6, 1.01e-7),
    "P1": (-6.12803e-5, 3.52e-6),
    "P2": (-4.41172e-5, 3.94e-6),
    "aspect": (3.89598e-4, 2.08e-5),
}
REFERENCE_SIGMA0, REFERENCE_REDUNDANCY = 1.6148, 3725
#: The sheet's control points lie one unit apart, which DBAT calls a metre.
UNIT_MM = 1000.0
#: A recognised dot is the mark nearest to it within this distance.
NEAR_PX = 4.0
NETWORK = """\
schema = 1
observations = "{observations}"
points = "points.csv"
fixed = [1001, 1002, 1003, 1004]
sigma_px = 0.1
{residuals}
snooping = {snooping}
[cameras.camera]
image_size_px = [{size[0]}, {size[1]}]
f_mm = 7.4653
pixel_mm = 0.0031911
free = [{free}]
"""


def lens_mm(values: np.ndarray, r0_px: float) -> np.ndarray:
    """DBAT's nine of our nine, in the order of ``REFERENCE``."""
    f, x0, y0, a1, a2, a3, b1, b2, aspect = values
    ratio = 1.0 / (1.0 + aspect)
    s = SENSOR_HEIGHT_MM / SIZE[1] * ratio
    k = 1.0 - a1 * r0_px**2 - a2 * r0_px**4 - a3 * r0_px**6
    # Their origin is the picture's corner, half a pixel from ours; the aspect comes after it.
    px = (x0 + 0.5 * SIZE[0]) * s / ratio
    py = (y0 + 0.5 * SIZE[1]) * s * (1.0 + aspect)
    return np.array(
        [s * f / k, px, py, a1 / (k * s**2), a2 / (k * s**4), a3 / (k * s**6),
         b1 / (k * s), -b2 / (k * s), ratio - 1.0]
    )  # fmt: skip


def converted(camera: AdjustedCamera) -> tuple[np.ndarray, np.ndarray]:
    """The lens in DBAT's terms with standard deviations, propagated through ``lens_mm``."""
    order = [camera.free.index(name) for name in FREE]
    cov = camera.cov[np.ix_(order, order)]
    values = np.array([camera.values[name] for name in FREE])
    steps = np.sqrt(np.diag(cov))
    jacobian = np.stack(
        [
            (lens_mm(values + d, camera.r0_px) - lens_mm(values - d, camera.r0_px)) / (2 * step)
            for step, d in zip(steps, np.diag(steps), strict=True)
        ],
        axis=1,
    )
    return lens_mm(values, camera.r0_px), np.sqrt(np.diag(jacobian @ cov @ jacobian.T))


def control_points(folder: Path) -> list[tuple[str, float, float, float]]:
    """camcal-fixed.txt in mm."""
    rows = []
    for line in (data_folder() / "camcal" / "camcal-fixed.txt").read_text().splitlines():
        if line and not line.startswith("#"):
            name, _, x, y, z = line.split(",")
            rows.append((name, UNIT_MM * float(x), UNIT_MM * float(y), UNIT_MM * float(z)))
    return rows


def adjusted(
    folder: Path, observations: Path, snooping: str, free: tuple[str, ...] = FREE
) -> NetworkAdjustment:
    """The network of observations and control points, through the command's own way."""
    write_csv(
        folder / "points.csv",
        ("id", "x_mm", "y_mm", "z_mm"),
        list(zip(*control_points(folder), strict=True)),
    )
    names = ", ".join(f'"{name}"' for name in free)
    path = folder / "network.toml"
    # Of PhotoModeler's export it is the default.
    residuals = "" if observations.suffix == ".txt" else 'residuals = "corrected"'
    path.write_text(
        NETWORK.format(
            observations=observations, residuals=residuals, snooping=snooping, size=SIZE, free=names
        )
    )
    return adjust_file(read_network_file(path)).result


def recognised(folder: Path) -> tuple[Path, int, float]:
    """Observations by our recognition; their number and the median distance from the marks."""
    from videogrammetry.recognition import RecognitionOptions, recognize
    from videogrammetry.sequence import open_sequence

    source = data_folder() / "camcal"
    marks = read_photomodeler_marks(source / "camcal-pmexport.txt")
    assert marks is not None
    options = RecognitionOptions(codes="none", polarity="black-on-white", diameter_px=(5.0, 100.0))
    rows, distances = [], []
    image, point = np.array(marks.image), np.array(marks.point)
    for name in dict.fromkeys(marks.image):
        centres = recognize(open_sequence(source / name).read(0), options).centre_px
        of = np.flatnonzero(image == name)
        away = np.linalg.norm(marks.xy_px[of][:, None] - centres[None], axis=2)
        nearest = away.argmin(axis=1)
        mutual = away.argmin(axis=0)[nearest] == np.arange(len(of))
        for i in np.flatnonzero(mutual & (away.min(axis=1) < NEAR_PX)):
            rows.append((name, point[of[i]], *centres[nearest[i]]))
            distances.append(away[i, nearest[i]])
    path = folder / "recognised.csv"
    write_csv(path, ("image", "point", "x_px", "y_px"), list(zip(*rows, strict=True)))
    return path, len(rows), float(np.median(distances))


def report(title: str, result: NetworkAdjustment) -> dict[str, object]:
    """Prints a result beside the reference."""
    s = result.summary
    values, sigmas = converted(result.cameras[0])
    print(f"\n{title}")
    print(
        f"  sigma0 {s.sigma0:.4f} ({s.sigma0_px:.5f} px), reference {REFERENCE_SIGMA0}; redundancy "
        f"{s.redundancy}, reference {REFERENCE_REDUNDANCY}; {s.image_coordinates // 2} marks, "
        f"{s.unknowns} unknowns, {len(result.rejected)} rejected"
    )
    print("           value         sigma      reference      its sigma   difference / its sigma")
    lens = {}
    for (name, (value, sigma)), mine, my_sigma in zip(
        REFERENCE.items(), values, sigmas, strict=True
    ):
        off = (mine - value) / sigma
        lens[name] = {"value": mine, "sigma": my_sigma, "difference_in_sigmas": off}
        print(f"  {name:6s} {mine:13.6g} {my_sigma:10.3g} {value:13.6g} {sigma:12.3g} {off:+12.3f}")
    return {
        "sigma0": s.sigma0, "sigma0_px": s.sigma0_px, "redundancy": s.redundancy,
        "unknowns": s.unknowns, "rejected": len(result.rejected), "lens": lens,
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    table = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        marks = data_folder() / "camcal" / "camcal-pmexport.txt"
        table["marks"] = report("PhotoModeler's marks", adjusted(folder, marks, "false"))
        affine = adjusted(folder, marks, "false", (*FREE[:-1], "E1"))
        table["affine"] = {"sigma0": affine.summary.sigma0}
        print(f"\nE1 instead of the aspect: sigma0 {affine.summary.sigma0:.4f}, README 1.6122")
        own, count, distance = recognised(folder)
        print(f"\n{count} of 2074 marks recognised, median distance from them {distance:.3f} px")
        table["recognised"] = report("our recognition", adjusted(folder, own, "false"))
        table["snooped"] = report(
            "our recognition, data snooping 3.29", adjusted(folder, own, "3.29")
        )
    if args.json:
        args.json.write_text(json.dumps(table, indent=1) + "\n")


if __name__ == "__main__":
    main()
