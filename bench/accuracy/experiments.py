"""The paper's experiments through picture files: accuracy, and what disturbances do to it.

    .venv/bin/python bench/accuracy/experiments.py [--small] [--seeds 1 2 3] [--only NAME]

Every run is `videogrammetry demo` in a temporary folder: the cross at 24
orientations, the tyre in 200 stages, two scale bars in 44 positions each
(`--small`: 12, 40, 11), rendered, recognised, calibrated, measured, verified.
One row a run:

  sigma0, RMS px   of the calibration: over its prediction, and per coordinate
  cal.             RMS error of the bars from the calibration alone (exact pictures)
                   over its prediction, within the pairs / across them
  bar mm           RMS error of the measured lengths, within / across, and over prediction
  mm, ratio, norm. 3-D RMS error of the tyre's points, over its prediction, and
                   normalised by each position's covariance
  measured         positions measured of those that two cameras could see; wrong:
                   beyond 6 sigmas + 0.5 mm
  g %, sigmas      measured acceleration against gravity; slope: of the paper's line
  v                RMS error of the centroid's velocity over its prediction
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
import time
from pathlib import Path

import numpy as np

from videogrammetry.cli.demo_run import ACROSS, BAR, FULL, SMALL, TYRE, DemoOptions, run_demo
from videogrammetry.cli.demo_table import losses
from videogrammetry.rendering.disturbances import Conditions

#: name -> conditions, motion blur in px.
DISTURBANCES = {
    "ten times the noise": ({"contrast_noise": 7.5}, None),
    "20 % occluded": ({"occluded": 0.2}, None),
    "5 % pictures missing": ({"missing": 0.05}, None),
    "2 px motion blur": ({}, 2.0),
}


def rms(values):
    return float(np.sqrt(np.nanmean(np.square(values))))


def bar(scene):
    check = scene.verification
    bars = check.scale_bars
    alone = rms(check.scale_bar_rig_error_mm)
    return {
        "count": bars.total.count,
        "rms_mm": bars.total.rms_mm,
        "ratio": bars.total.ratio,
        "calibration_mm": alone,
        "calibration_ratio": alone / rms(bars.sigma_rig_mm),
    }


def summary(results):
    run, tyre = results.calibration, results.scenes[TYRE]
    truth, fall = tyre.verification.truth, tyre.verification.free_fall
    centroid = truth.centroid
    return {
        "sigma0": run.sigma0,
        "rms_px": run.rms_px,
        "within": bar(results.scenes[BAR]),
        "across": bar(results.scenes[ACROSS]),
        "paper_method_mm": results.bar_error_paper_mm,
        "rms_mm": truth.total.rms_mm,
        "ratio": truth.total.ratio,
        "normalised": truth.total.normalised_rms,
        "measured": truth.measured,
        "visible": truth.visible,
        "wrong": len(truth.wrong),
        "g_percent": fall.fit.deviation_percent,
        "g_sigmas": fall.fit.deviation_sigmas,
        "slope": fall.regression.slope,
        "velocity_ratio": centroid.velocity_rms_mm_s / centroid.velocity_predicted_mm_s,
        "seconds": results.seconds,
        "losses": losses(results),
    }


HEADER = (
    f"{'run':22}{'sigma0':>7}{'RMS px':>8}{'cal.':>12}{'bar mm':>14}{'over pred.':>12}"
    f"{'mm':>7}{'ratio':>7}{'norm.':>7}{'measured':>12}{'wrong':>6}{'g %':>9}{'sigmas':>7}"
    f"{'slope':>9}{'v':>6}"
)


def line(name, s):
    w, a = s["within"], s["across"]
    return (
        f"{name:22}{s['sigma0']:7.3f}{s['rms_px']:8.4f}"
        f"{w['calibration_ratio']:6.2f}{a['calibration_ratio']:6.2f}"
        f"{w['rms_mm']:7.3f}{a['rms_mm']:7.3f}{w['ratio']:6.2f}{a['ratio']:6.2f}"
        f"{s['rms_mm']:7.3f}{s['ratio']:7.2f}{s['normalised']:7.2f}"
        f"{s['measured']:7d}/{s['visible']:4d}{s['wrong']:6d}{s['g_percent']:+9.4f}"
        f"{s['g_sigmas']:+7.1f}{s['slope']:9.5f}{s['velocity_ratio']:6.2f}"
    )


def run(size, conditions, blur_px):
    folder = Path(tempfile.mkdtemp(prefix="videogrammetry-")) / "demo"
    try:
        options = DemoOptions(size=size, conditions=conditions, blur_px=blur_px)
        return summary(run_demo(folder, options))
    finally:
        shutil.rmtree(folder.parent, ignore_errors=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--small", action="store_true")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2, 3, 4, 5])
    parser.add_argument("--only", help="run only what has this in its name")
    parser.add_argument("--json", help="write the figures to this file")
    options = parser.parse_args()
    size = SMALL if options.small else FULL
    jobs = {f"seed {s}": (Conditions(seed=s), None) for s in options.seeds}
    for name, (changed, blur) in DISTURBANCES.items():
        jobs[name] = (Conditions(seed=options.seeds[-1], **changed), blur)
    found = {}
    print(HEADER)
    for name, (conditions, blur) in jobs.items():
        if options.only and options.only not in name:
            continue
        start = time.perf_counter()
        found[name] = run(size, conditions, blur)
        found[name]["wall_s"] = time.perf_counter() - start
        print(line(name, found[name]), flush=True)
    seeds = [found[n] for n in found if n.startswith("seed")]
    if len(seeds) > 1:
        print("\nover the seeds: RMS of the error from calibration alone over its prediction")
        for kind in ("within", "across"):
            ratios = [s[kind]["calibration_ratio"] for s in seeds]
            paper = rms([s["paper_method_mm"][BAR if kind == "within" else ACROSS] for s in seeds])
            ours = rms([s[kind]["calibration_mm"] for s in seeds])
            print(
                f"  {kind:7} {rms(ratios):.2f} ({min(ratios):.2f} ... {max(ratios):.2f}), "
                f"{ours:.3f} mm; the paper's method {paper:.3f} mm"
            )
    print("\nwhat was lost")
    for name, s in found.items():
        for text in s["losses"]:
            print(f"  {name}: {text}")
    if options.json:
        Path(options.json).write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
