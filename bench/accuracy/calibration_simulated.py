"""Accuracy of the calibration beside the reference bundle's figures, the bound and the time.

    .venv/bin/python bench/accuracy/calibration_simulated.py [--draws 10]

1. rig-simulated: image RMS, sigma0 and error of 1100.057 mm bars (from
   calibration alone) beside the reference joint bundle and the prediction from
   the covariance; all ten parameters offered; the paper's mean of poses.
2. The same rig with new noise, many draws: RMS bar error over prediction.
3. aicon-panel: per-camera RMS and baseline.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace

import numpy as np
from calibration_data import aicon_panel, bar_lengths, read_bars, rig_simulated

from videogrammetry.calibration import CalibrationOptions, FrameTargets, calibrate
from videogrammetry.calibration.result import CAMERA_PARAMETERS
from videogrammetry.geometry import project, rotation_from_vector
from videogrammetry.types import PointSet, RigCamera

PAIRS = ("12", "34")


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def moved(rig, name, parameter, step):
    """The rig with one parameter of one camera changed."""
    camera = rig.cameras[name]
    k = CAMERA_PARAMETERS.index(parameter)
    if k < 10:
        interior = camera.interior.copy()
        interior[k] += step
        camera = replace(camera, interior=interior)
    elif k < 13:
        turn = rotation_from_vector(step * np.eye(3)[k - 10])
        camera = replace(camera, rotation=turn @ camera.rotation)
    else:
        camera = replace(camera, translation_mm=camera.translation_mm + step * np.eye(3)[k - 13])
    return replace(rig, cameras={**rig.cameras, name: camera})


def predicted(rig, bars, pair):
    """RMS over the bars of the standard deviation that the rig's covariance gives a length."""
    sigma = np.sqrt(np.diag(rig.cov))
    size = len(bar_lengths(rig, bars, pair))
    jacobian = np.zeros((size, len(sigma)))
    for i, (name, s) in enumerate(zip(rig.cov_names, sigma, strict=True)):
        camera, parameter = name.split("/")
        if s == 0 or camera not in pair:
            continue
        ahead = bar_lengths(moved(rig, camera, parameter, 0.5 * s), bars, pair)
        behind = bar_lengths(moved(rig, camera, parameter, -0.5 * s), bars, pair)
        jacobian[:, i] = (ahead - behind) / s
    return rms(np.sqrt(np.einsum("ij,jk,ik->i", jacobian, rig.cov, jacobian)))


def errors(run, bars, truth):
    return {p: rms(bar_lengths(run.rig, bars, p) - truth["bar_length_mm"]) for p in PAIRS}


VARIANTS = (
    ("joint, no snooping", "reference", CalibrationOptions(sigma_mm=0.1, critical_value=0.0)),
    ("joint", "reference", CalibrationOptions(sigma_mm=0.1)),
    ("joint, ten offered", None, CalibrationOptions(sigma_mm=0.1)),
    ("mean of poses", "reference", CalibrationOptions(sigma_mm=0.1, method="mean")),
)


def single_draw(results):
    for kind in ("mild", "table1"):
        bars = read_bars(kind)
        truth = rig_simulated(kind)[2]
        ref = truth["reference_joint_bundle"]
        print(f"\nrig-simulated/{kind}: bar error from calibration alone, mm RMS (predicted)")
        print(f"{'':20} {'RMS px':>9} {'sigma0':>8} {'pair 12':>17} {'pair 34':>17} {'s':>6}")
        e, p = ref["bar_rms_calibration_only_mm"], ref["bar_predicted_mm"]
        print(
            f"{'reference bundle':20} {ref['rms_px']:9.5f} {ref['sigma0']:8.4f} "
            + " ".join(f"{e[k]:8.4f} ({p[k]:6.4f})" for k in PAIRS)
        )
        for label, free, options in VARIANTS:
            cameras, target, _ = rig_simulated(kind, free)
            run = calibrate(cameras, target, options)
            e = errors(run, bars, truth)
            p = {k: predicted(run.rig, bars, k) for k in PAIRS}
            floor = max(run.rig.sigma_floor_px.values())
            print(
                f"{label:20} {run.rms_px:9.5f} {run.sigma0:8.4f} "
                + " ".join(f"{e[k]:8.4f} ({p[k]:6.4f})" for k in PAIRS)
                + f" {run.seconds:6.2f}  floor {floor:.4f} px"
            )
            results[f"{kind}/{label}"] = {
                "rms_px": run.rms_px, "sigma0": run.sigma0, "bar_mm": e, "predicted_mm": p,
                "seconds": run.seconds,
            }  # fmt: skip


def redraw(kind, truth, poses, cameras, target, seed):
    """The same rig, target and positions with new noise of 0.02 px and 0.1 mm."""
    rng = np.random.default_rng(seed)
    result = []
    for camera in cameras:
        t = truth["cameras"][camera.name]
        keys = ("f_px", "x0_px", "y0_px", "A1", "A2", "A3", "B1", "B2", "E1", "E2")
        pose = t["cam_from_world"]
        model = RigCamera(
            image_size_px=camera.image_size_px, interior=np.array([t[k] for k in keys]),
            r0_px=t["r0_px"], rotation=np.array(pose["rotation"]),
            translation_mm=np.array(pose["translation_mm"]),
        )  # fmt: skip
        rows = {int(n): i for i, n in enumerate(target.id)}
        frames = []
        for frame in camera.frames:
            rotation, shift = poses[frame.stage]
            points = target.position_mm[[rows[int(n)] for n in frame.id]]
            in_rig = points @ rotation.T + shift
            xy = project(model, in_rig @ model.rotation.T + model.translation_mm)
            frames.append(
                FrameTargets(
                    stage=frame.stage,
                    image=frame.image,
                    id=frame.id,
                    xy_px=xy + rng.normal(0, 0.02, xy.shape),
                    cov_px2=frame.cov_px2,
                )
            )
        result.append(replace(camera, frames=frames))
    noisy = target.position_mm + rng.normal(0, 0.1, target.position_mm.shape)
    return result, PointSet(id=target.id, position_mm=noisy)


def many_draws(count, results):
    print(f"\nnew noise, {count} draws: RMS bar error / predicted, mm")
    for kind in ("mild", "table1"):
        bars = read_bars(kind)
        _, _, truth = rig_simulated(kind)
        for label, free, options in VARIANTS[1:]:
            cameras, target, _ = rig_simulated(kind, free)
            base = calibrate(cameras, target, VARIANTS[0][2])
            found = {p: [] for p in PAIRS}
            bound = {p: [] for p in PAIRS}
            for seed in range(count):
                drawn, measured = redraw(kind, truth, base.rig_from_target, cameras, target, seed)
                run = calibrate(drawn, measured, options)
                for p, e in errors(run, bars, truth).items():
                    found[p].append(e)
                    bound[p].append(predicted(run.rig, bars, p))
            row = {p: (rms(found[p]), rms(bound[p])) for p in PAIRS}
            print(
                f"{kind:7} {label:20} "
                + "   ".join(
                    f"pair {p}: {e:.4f} / {b:.4f} = {e / b:.2f}" for p, (e, b) in row.items()
                )
            )
            results[f"{kind}/{label}/draws"] = row


def aicon(results):
    print("\naicon-panel (5 pairs, ids and positions of another program)")
    for label, options in (
        ("joint, target as weighted observations (default sigma)", CalibrationOptions()),
        ("joint, sigma_mm = 0.02", CalibrationOptions(sigma_mm=0.02)),
        ("mean of poses, target fixed", CalibrationOptions(method="mean")),
    ):
        cameras, target = aicon_panel()
        run = calibrate(cameras, target, options)
        baseline = float(np.linalg.norm(run.rig.cameras["right"].translation_mm))
        print(
            f"{label:56} RMS left {run.camera_rms_px['left']:.4f} right "
            f"{run.camera_rms_px['right']:.4f} px, |t| = {baseline:.3f} mm, {run.seconds:.2f} s"
        )
        results[f"aicon/{label}"] = {"rms_px": dict(run.camera_rms_px), "baseline_mm": baseline}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=10)
    parser.add_argument("--json", help="write the figures to this file")
    options = parser.parse_args()
    results: dict[str, object] = {}
    single_draw(results)
    aicon(results)
    if options.draws:
        many_draws(options.draws, results)
    if options.json:
        with open(options.json, "w") as file:
            json.dump(results, file, indent=1)


if __name__ == "__main__":
    main()
