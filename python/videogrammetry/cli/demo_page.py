"""The demo's page: what the figures of the paper show, from this run."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from videogrammetry.accuracy import camera_statistics
from videogrammetry.cli.demo_run import ACROSS, BAR, CALIBRATION, TYRE, DemoResults
from videogrammetry.cli.demo_table import losses
from videogrammetry.pipeline.verify import true_points
from videogrammetry.project import read_trajectories
from videogrammetry.report import (
    CalibrationPart,
    CentroidTruth,
    ComparisonRow,
    DeformationPart,
    ExperimentsPage,
    FileLink,
    FreeFallPart,
    RecognitionPart,
    ScaleBarPart,
    Scene,
    experiments_page,
)
from videogrammetry.sequence import open_sequence
from videogrammetry.types import FloatArray

_OUTLINE_POINTS = 73


def demo_page(results: DemoResults, rows: Sequence[ComparisonRow]) -> str:
    """The page as HTML text; ``rows`` of the table beside the paper."""
    measurement = results.scenes[TYRE].measurement
    stages, notes = _stages(results)
    return experiments_page(
        ExperimentsPage(
            title="The paper's experiments, rendered and measured",
            summary="Four cameras, two facing pairs at 12 m, see a cross, a scale bar and a "
            "falling tyre. Their pictures were rendered with known truth, written as recordings, "
            "and measured as a laboratory would: recognition, calibration, matching, "
            "triangulation, tracking, motion.",
            facts=_facts(results),
            comparison=rows,
            comparison_text="H. Hu et al., Optics and Lasers in Engineering 50 (2012) 800-811, "
            "this run, and the truth it was rendered from.",
            calibration=_calibration(results),
            scale_bar=_scale_bar(results),
            recognition=_recognition(results, stages),
            measurement=measurement,
            rig=results.calibration.rig,
            scene=_scene(results),
            truth=_truth(results),
            free_fall=_free_fall(results),
            deformation=_deformation(results),
            stages=stages,
            stage_notes=notes,
            markers=_markers(results),
            files=_files(),
            commands=_commands(results),
            remarks=_remarks(results),
            provenance=measurement.provenance,
        )
    )


def _facts(results: DemoResults) -> dict[str, str]:
    scene = results.scenes[TYRE]
    check, fall = scene.verification.truth, scene.verification.free_fall
    bars = results.scenes[BAR].verification.scale_bars
    facts = {"px, RMS of the calibration's residuals": f"{results.calibration.rms_px:.4f}"}
    if bars is not None:
        facts["mm, RMS error of 1100.057 mm (the paper: 0.312)"] = f"{bars.total.rms_mm:.3f}"
    if check is not None:
        facts["mm, 3-D RMS error of the tyre's points"] = f"{check.total.rms_mm:.3f}"
        facts["3-D error over its prediction"] = f"{check.total.ratio:.2f}"
    if fall is not None:
        facts["per cent, deviation from gravity (the paper: 1.85)"] = (
            f"{abs(fall.fit.deviation_percent):.3f}"
        )
    pictures = 4 * results.options.size.stages
    facts["ms a picture, from file to motion"] = f"{1e3 * scene.measure_s / pictures:.1f}"
    return facts


def _stages(results: DemoResults) -> tuple[list[int], dict[int, str]]:
    """Stages like the paper's 1, 60, 120: start, half-way down, most deformed."""
    tyre, rate = results.tyre, results.tyre.frame_rate_hz
    present = results.scenes[TYRE].measurement.trajectories.stage.tolist()
    times = [0.0, 59 / 250.0, 119 / 250.0]
    stages = [min(present, key=lambda s: abs(tyre.time_s(s) - t)) for t in times]
    words = ["released", "falling", "on the ground"]
    assert rate > 0
    return stages, dict(zip(stages, words, strict=True))


def _markers(results: DemoResults) -> list[tuple[int, str]]:
    touch = float(results.tyre.facts["touch_s"])
    stage = round(touch * results.tyre.frame_rate_hz) + 1
    return [(stage, "touch")] if stage <= results.tyre.num_stages else []


def _calibration(results: DemoResults) -> CalibrationPart:
    run = results.calibration
    table = run.observations
    share = np.full(int(table.used.sum()), run.redundancy / max(1, int(table.used.sum())))
    statistics = camera_statistics(
        table.residual_px[table.used], table.camera[table.used], share, run.camera_names
    )
    rows = [
        [
            s.name,
            str(s.count),
            f"{s.rms_coordinate_px:.4f}",
            f"{s.mean_distance_px:.4f}",
            f"{s.p95_distance_px:.4f}",
            f"{s.max_distance_px:.4f}",
            f"{s.sigma0_px:.4f}",
        ]
        for s in statistics
    ]
    return CalibrationPart(
        text=f"{results.options.size.orientations} orientations of the two-sided cross: cameras "
        "1-2 see one side, 3-4 the other; the cross ties them together. Residuals in px.",
        columns=("camera", "points", "RMS a coordinate", "mean distance", "95 %", "largest",
                 "sigma0"),
        rows=rows,
        report=f"{CALIBRATION}/rig-report.html",
    )  # fmt: skip


def _scale_bar(results: DemoResults) -> ScaleBarPart | None:
    parts = [results.scenes[name].verification.scale_bars for name in (BAR, ACROSS)]
    tests = [part for part in parts if part is not None and len(part)]
    if not tests:
        return None
    joined = {
        name: np.concatenate([getattr(test, name) for test in tests])
        for name in ("error_mm", "sigma_mm", "sigma_rig_mm", "speed_mm_s")
    }
    within = results.scenes[BAR].verification.scale_bars
    count = 0 if within is None else len(within)
    return ScaleBarPart(
        error_mm=joined["error_mm"],
        sigma_mm=joined["sigma_mm"],
        sigma_calibration_mm=joined["sigma_rig_mm"],
        speed_mm_s=joined["speed_mm_s"],
        text=f"Lengths of the moving bar: the first {count} with both ends seen by one pair of "
        "cameras, the rest with one end seen by cameras 1-2 and the other by 3-4, which no pair "
        "alone can measure. The error that the calibration makes is common to all of them.",
    )


def _recognition(results: DemoResults, stages: list[int]) -> RecognitionPart:
    scene = results.scenes[TYRE]
    pictures = {}
    for name, camera in scene.project.cameras.items():
        source = open_sequence(list(camera.sequence or ()), scene.project.folder)
        for stage in stages:
            pictures[stage, name] = source.read(stage - 1)
    return RecognitionPart(pictures=pictures)


def _carried(results: DemoResults, points: FloatArray) -> FloatArray:
    """Places in the true rig's frame, in the measured one."""
    fit = results.scenes[TYRE].verification.truth
    assert fit is not None
    return np.asarray(points @ fit.rotation.T + fit.translation_mm)


def _scene(results: DemoResults) -> Scene:
    facts = results.tyre.facts
    ground, above = np.array(facts["ground_mm"]), np.array(facts["up"])
    ground, above = _carried(results, np.stack([ground, ground + above]))
    targets = results.tyre.place(0.0).centre_mm[results.tyre.marks.is_target]
    targets = _carried(results, targets)
    count = len(facts["front_points"])
    front, back = targets[:count], targets[count:]
    away = back.mean(axis=0) - front.mean(axis=0)
    radius_mm = float(facts["radius_mm"])
    return Scene(
        up=tuple((above - ground).tolist()),
        away=tuple(away.tolist()),
        ground_mm=ground,
        outline_mm=[_circle(front, radius_mm), _circle(back, radius_mm)],
    )


def _circle(points: FloatArray, radius_mm: float) -> FloatArray:
    """The circle of a radius about the points' mean, in their plane."""
    centre = points.mean(axis=0)
    axes = np.linalg.svd(points - centre)[2][:2]
    angle = np.linspace(0, 2 * np.pi, _OUTLINE_POINTS)
    return np.asarray(
        centre + radius_mm * (np.outer(np.cos(angle), axes[0]) + np.outer(np.sin(angle), axes[1]))
    )


def _truth(results: DemoResults) -> CentroidTruth | None:
    """The centroid of the same points, in the measured frame; velocities by differences."""
    scene = results.scenes[TYRE]
    table, motion = scene.measurement.trajectories, scene.measurement.motion
    if not len(motion.centroid_points):
        return None
    path = scene.project.folder / "truth" / "trajectories.csv"
    points = true_points(read_trajectories(path), table.camera_names)
    rows = np.searchsorted(points.stage, table.stage)
    columns = np.flatnonzero(np.isin(points.point_id, motion.centroid_points))
    if len(columns) != len(motion.centroid_points):
        return None  # un-coded points have numbers of their own
    mean = _carried(results, points.position_mm[np.ix_(rows, columns)].mean(axis=1))
    velocity = np.full_like(mean, np.nan)
    if len(mean) > 2:
        span = (table.time_s[2:] - table.time_s[:-2])[:, None]
        velocity[1:-1] = (mean[2:] - mean[:-2]) / span
    return CentroidTruth(position_mm=mean, velocity_mm_s=velocity)


def _free_fall(results: DemoResults) -> FreeFallPart | None:
    fall = results.scenes[TYRE].verification.free_fall
    if fall is None:
        return None
    line, fit = fall.regression, fall.fit
    return FreeFallPart(
        measured_mm=line.measured_mm,
        theoretical_mm=line.gravity_mm,
        slope=line.slope,
        offset_mm=line.offset_mm,
        slope_sigma=line.slope_sigma,
        text=f"Stages {fall.first} to {fall.last}. A fit of s0 + v0 t + a t^2/2 to all points "
        f"gives {fit.g_m_s2:.5f} +- {fit.sigma_m_s2:.5f} m/s^2 (of the pictures "
        f"{fit.sigma_image_m_s2:.5f}, of the calibration {fit.sigma_rig_m_s2:.5f}); local gravity "
        f"is {fall.gravity_m_s2:.5f}.",
    )


def _deformation(results: DemoResults) -> DeformationPart | None:
    """Distance of every point from the middle of its side, less that of the first stage."""
    table = results.scenes[TYRE].measurement.trajectories
    facts = results.tyre.facts
    change = np.full(table.position_mm.shape[:2], np.nan)
    for side in (facts["front_points"], facts["back_points"]):
        columns = np.flatnonzero(np.isin(table.point_id, side))
        whole = columns[np.isfinite(table.position_mm[:, columns, 0]).mean(axis=0) > 0.5]
        if len(whole) < 3:
            continue
        middle = table.position_mm[:, whole].mean(axis=1, keepdims=True)
        distance = np.linalg.norm(table.position_mm[:, columns] - middle, axis=2)
        known = np.isfinite(distance)
        first = np.where(known.any(axis=0), known.argmax(axis=0), 0)
        change[:, columns] = distance - distance[first, np.arange(len(columns))]
    if not np.isfinite(change).any():
        return None
    return DeformationPart(
        radial_change_mm=change,
        point_id=table.point_id.tolist(),
        text="Distance of each point from the middle of its side wall, less that of the first "
        "stage: flattening while the tyre is on the ground, ringing afterwards.",
    )


def _files() -> list[FileLink]:
    what = {
        f"{CALIBRATION}/project.toml": "the cross: recordings, cross.csv, rig.json",
        f"{CALIBRATION}/rig-report.html": "report of the calibration",
        f"{CALIBRATION}/rig.json": "the calibrated cameras; rig.npz has the full covariance",
        f"{TYRE}/project.toml": "the tyre: recordings of four cameras",
        f"{TYRE}/measurement.h5": "trajectories and motion with covariances (opens with xarray)",
        f"{TYRE}/verification.json": "all figures of the checks",
        f"{TYRE}/truth/trajectories.csv": "where the points really were",
        f"{BAR}/project.toml": "the scale bar, both ends seen by one pair",
        f"{BAR}/verification.json": "its figures",
        f"{ACROSS}/project.toml": "the scale bar, one end seen by each pair",
        f"{ACROSS}/verification.json": "its figures",
        "results.json": "the table above, and times",
    }
    return [FileLink(path=path, what=text) for path, text in what.items()]


def _commands(results: DemoResults) -> list[str]:
    size, conditions = results.options.size, results.options.conditions
    common = f" --seed {conditions.seed}"
    if conditions.contrast_noise != 75:
        common += f" --contrast-noise {conditions.contrast_noise:g}"
    moving = f"{common} --calibration {CALIBRATION}"
    for name in ("occluded", "missing"):
        if getattr(conditions, name):
            moving += f" --{name} {getattr(conditions, name):g}"
    if results.options.blur_px is not None:
        moving += f" --blur-px {results.options.blur_px:g}"
    return [
        f"videogrammetry simulate calibration {CALIBRATION} --orientations "
        f"{size.orientations}{common}",
        f"videogrammetry calibrate {CALIBRATION}",
        f"videogrammetry simulate tyre {TYRE} --stages {size.stages} --frame-rate "
        f"{size.frame_rate_hz:g}{moving}",
        f"cp {CALIBRATION}/rig.json {CALIBRATION}/rig.npz {TYRE}/",
        f"videogrammetry measure {TYRE}",
        f"videogrammetry verify {TYRE}",
    ]


def _remarks(results: DemoResults) -> list[str]:
    return [
        "The pictures are rendered: lens, noise, clutter, glare and light are simulated, and the "
        "cross is given with 0.1 mm of error in every coordinate, as photogrammetry would.",
        "Circles are recognised by the centre of their ellipse, which perspective moves by up to "
        "0.003 px here; the correction is not applied yet.",
        "One calibration is one draw: its error is common to all lengths and positions and "
        "scatters from run to run; over many draws see docs/verification.md.",
        *losses(results),
    ]
