"""A tyre that never fell, for tests of the pages and figures that show one."""

from __future__ import annotations

import numpy as np

from videogrammetry.motion import compute_motion
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
)
from videogrammetry.types import Measurement, RigCamera, RigData, TargetRecords, Trajectories

CAMERAS = ("camera-1", "camera-2", "camera-3", "camera-4")
RATE_HZ, FALL_MM, G_MM_S2 = 250.0, 1040.0, 9810.0
RADIUS_MM, MIDDLE_MM, HALF_WIDTH_MM = 325.0, np.array([60.0, -700.0, 12000.0]), 90.0
POINTS = np.array([*range(4, 12), *range(21, 31)], dtype=np.int32)
IMPACT = 116
SIZE = 1024


def tyre_points() -> np.ndarray:
    """(18, 3) at stage 1: 8 points towards cameras 1 and 2, 10 towards 3 and 4."""
    sides = []
    for count, z, radius in ((8, -HALF_WIDTH_MM, 250.0), (10, HALF_WIDTH_MM, 265.0)):
        angle = np.arange(count) * 2 * np.pi / count + 0.2
        side = [radius * np.cos(angle), radius * np.sin(angle), np.full(count, z)]
        sides.append(np.stack(side, axis=1))
    return np.concatenate(sides) + MIDDLE_MM


def tyre_scene() -> Scene:
    angle = np.linspace(0, 2 * np.pi, 49)
    circle = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1) * RADIUS_MM + MIDDLE_MM
    sides = tuple(circle + np.array([0, 0, z]) for z in (-HALF_WIDTH_MM, HALF_WIDTH_MM))
    ground = MIDDLE_MM + np.array([0, RADIUS_MM + FALL_MM, 0])
    return Scene(ground_mm=tuple(ground), outline_mm=sides)


def true_positions(stages: int) -> np.ndarray:
    """(S, 18, 3): free fall, flattening of 55 mm at impact, rebound with ringing."""
    time = np.arange(stages) / RATE_HZ
    impact = np.sqrt(2 * FALL_MM / G_MM_S2)
    contact, after = 0.030, np.maximum(time - impact, 0)
    speed = G_MM_S2 * impact
    pressed = 55.0 * np.sin(np.pi * np.clip(after / contact, 0, 1))
    risen = np.maximum(after - contact, 0)
    fall = np.where(
        time < impact, G_MM_S2 * time**2 / 2, FALL_MM + 0.7 * pressed - 0.65 * speed * risen
    )
    fall = fall + np.where(risen > 0, G_MM_S2 * risen**2 / 2, 0)
    start = tyre_points()
    out = start - MIDDLE_MM
    ring = 9 * np.exp(-risen / 0.06) * np.sin(2 * np.pi * 45 * risen) * (risen > 0)
    squash = (pressed * 0.5 + ring) / RADIUS_MM
    shape = np.stack([1 + 0.6 * squash, 1 - squash, np.ones(stages)], axis=1)
    moved = np.stack([18 * time, fall, -9 * time], axis=1)
    return MIDDLE_MM + out * shape[:, None] + moved[:, None]


def tyre_rig() -> RigData:
    """Two pairs on opposite sides, 12 m from the tyre."""
    cameras = {}
    for name, turn in zip(CAMERAS, (0.0, -27.0, 180.0, 153.0), strict=True):
        a = np.deg2rad(turn)
        rotation = np.array([[np.cos(a), 0, -np.sin(a)], [0, 1, 0], [np.sin(a), 0, np.cos(a)]])
        interior = np.array([2640.0, *np.zeros(9)])
        centre = np.array([0, 0, 12000.0]) - 12000.0 * rotation[2]
        cameras[name] = RigCamera(
            image_size_px=(SIZE, SIZE),
            interior=interior,
            r0_px=480.0,
            rotation=rotation,
            translation_mm=-rotation @ centre,
        )
    return RigData(cameras=cameras, reference="camera camera-1")


def projected(camera: RigCamera, points: np.ndarray) -> np.ndarray:
    local = points @ camera.rotation.T + camera.translation_mm
    return camera.interior[0] * local[:, :2] / local[:, 2:] + (SIZE - 1) / 2


def _seen(camera: int) -> np.ndarray:
    return np.flatnonzero(POINTS < 12 if camera < 2 else POINTS > 12)


def tyre_targets(positions: np.ndarray) -> TargetRecords:
    rows = []
    for s in range(len(positions)):
        for c, camera in enumerate(tyre_rig().cameras.values()):
            columns = _seen(c)
            for p, xy in zip(columns, projected(camera, positions[s, columns]), strict=True):
                rows.append((s + 1, c, *xy, POINTS[p]))
    table = np.array(rows)
    n = len(table)
    number = table[:, 4].astype(np.int32)
    return TargetRecords(
        stage=table[:, 0].astype(np.int32),
        camera=table[:, 1].astype(np.int32),
        centre_px=table[:, 2:4],
        semi_axes_px=np.tile([3.6, 3.2], (n, 1)),
        angle_rad=np.full(n, 0.3),
        sigma_px=np.full((n, 2), 0.02),
        code_id=number,
        point_id=number,
        residual_px=np.zeros((n, 2)),
        match_status=np.zeros(n, np.uint8),
        ring_status=np.zeros(n, np.uint8),
    )


def falling_tyre_measurement(stages: int = 200, seed: int = 1) -> Measurement:
    """The fall as it would be measured: 0.1 mm noise a coordinate, some gaps."""
    rng = np.random.default_rng(seed)
    truth = true_positions(stages)
    position = truth + rng.normal(0, 0.1, truth.shape)
    position[40:43, 9] = np.nan
    position[118:121, 2] = np.nan
    cov = np.tile([0.01, 0, 0, 0.01, 0, 0.01], (*position.shape[:2], 1))
    used = np.stack([np.isin(np.arange(len(POINTS)), _seen(c)) for c in range(4)], axis=1)
    table = Trajectories(
        stage=np.arange(1, stages + 1, dtype=np.int32),
        time_s=np.arange(stages) / RATE_HZ,
        point_id=POINTS,
        position_mm=position,
        cov_mm2=4 * cov,
        cov_image_mm2=cov,
        cameras_used=np.tile(used, (stages, 1, 1)),
        rms_px=np.full(position.shape[:2], 0.02),
        camera_names=CAMERAS,
    )
    return Measurement(
        trajectories=table,
        motion=compute_motion(table),
        targets=tyre_targets(truth),
        image_name=tuple(tuple(f"{c}-{s}.tif" for s in range(stages)) for c in CAMERAS),
        frame_rate_hz=RATE_HZ,
    )


def tyre_pictures(stages: tuple[int, ...], seed: int = 2) -> dict[tuple[int, str], np.ndarray]:
    """Dark tyre, white dots with rings, 12 bit, a little noise."""
    rng = np.random.default_rng(seed)
    truth = true_positions(max(stages))
    y, x = np.mgrid[:SIZE, :SIZE]
    pictures = {}
    for stage in stages:
        for c, camera in enumerate(tyre_rig().cameras.values()):
            picture = np.full((SIZE, SIZE), 900.0)
            middle = projected(camera, truth[stage - 1].mean(axis=0)[None])[0]
            picture[np.hypot(x - middle[0], y - middle[1]) < 72] = 250.0
            for px, py in projected(camera, truth[stage - 1, _seen(c)]):
                r = np.hypot(x - px, y - py)
                picture += 2600 * np.clip(3.9 - r, 0, 1)
                arc = np.cos(3 * np.arctan2(y - py, x - px)) > 0
                picture += 2600 * np.clip(2.2 - np.abs(r - 9.0), 0, 1) * arc
            picture += rng.normal(0, 25, picture.shape)
            pictures[stage, CAMERAS[c]] = np.clip(picture, 0, 4095).astype(np.uint16)
    return pictures


def tyre_page(stages: int = 200, shown: tuple[int, ...] = (1, 60, 120)) -> ExperimentsPage:
    """A page with all parts."""
    rng = np.random.default_rng(3)
    measurement = falling_tyre_measurement(stages)
    time, motion = measurement.trajectories.time_s, measurement.motion
    true = true_positions(stages)
    columns = np.searchsorted(POINTS, motion.centroid_points)
    centroid = true[:, columns].mean(axis=1)
    free = slice(0, min(100, stages))
    fall = -motion.centroid_displacement_mm[free, 1]
    theory = -G_MM_S2 * time[free] ** 2 / 2
    slope, offset = np.polyfit(fall, theory, 1)
    away = measurement.trajectories.position_mm - motion.centroid_mm[:, None]
    distance = np.linalg.norm(away, axis=2)
    speed = np.linspace(0, 2500, 11)
    return ExperimentsPage(
        title="The paper's experiments, simulated and measured",
        summary="Four synchronised cameras measure a falling tyre: calibrated, recognised, "
        "matched and reconstructed by this program, from pictures that it rendered.",
        facts={
            "re-projection, px": "0.031",
            "slope of the free fall": f"{slope:.5f}",
            "scale bar RMS, mm": "0.097",
            "stages": str(stages),
            "points": str(len(POINTS)),
        },
        comparison=[
            ComparisonRow(
                quantity="Mean re-projection error",
                paper="< 0.05 px",
                run="0.031 px",
                truth="0.028 px",
                note="RMS a coordinate, all cameras.",
            ),
            ComparisonRow(
                quantity="Slope of the free fall",
                paper="1.0188",
                run=f"{slope:.5f}",
                truth="1",
                note="The paper's falls are 1.85 % short; ours has the right scale.",
            ),
            ComparisonRow(quantity="Largest scale bar error", paper="0.545 mm", run="0.18 mm"),
        ],
        calibration=CalibrationPart(
            facts={"RMS residual, px": "0.0312", "pictures": "64", "redundancy": "5 012"},
            text="The cross target was held at 16 places, all cameras adjusted together.",
            columns=("camera", "f px", "s.d. px"),
            rows=[(name, "2640.1", "0.22") for name in CAMERAS],
            report="calibration/rig-report.html",
        ),
        scale_bar=ScaleBarPart(
            error_mm=rng.normal(0, 0.1, 11),
            sigma_mm=np.full(11, 0.12),
            sigma_calibration_mm=np.full(11, 0.05),
            speed_mm_s=speed,
            limit_mm=0.5,
            text="An invar bar of 1100.057 mm at 11 places while it moves.",
        ),
        recognition=RecognitionPart(pictures=tyre_pictures(shown)),
        measurement=measurement,
        rig=tyre_rig(),
        scene=tyre_scene(),
        truth=CentroidTruth(
            position_mm=centroid, velocity_mm_s=np.gradient(centroid, 1 / RATE_HZ, axis=0)
        ),
        free_fall=FreeFallPart(
            measured_mm=fall,
            theoretical_mm=theory,
            slope=float(slope),
            offset_mm=float(offset),
            slope_sigma=4e-5,
            offset_sigma_mm=0.01,
            sigma_mm=np.sqrt(motion.centroid_displacement_cov_mm2[free, 3]),
            text="Stages 1 to 100, before the impact.",
        ),
        deformation=DeformationPart(
            radial_change_mm=distance - distance[0],
            point_id=POINTS.tolist(),
            text="Flattened at impact, it rings while it rises.",
        ),
        stages=shown,
        stage_notes={1: "release", 60: "free fall", 120: "impact"},
        markers=((IMPACT, "impact"),) if stages > IMPACT else (),
        files=[
            FileLink(path="tyre/project.toml", what="the project"),
            FileLink(path="tyre/measurement.h5", what="points, motion, targets"),
        ],
        commands=["videogrammetry demo experiments", "videogrammetry measure tyre/project.toml"],
        remarks=["The pictures are rendered; a real set-up has more sources of error."],
        provenance={"version": "0", "seed": 1},
    )
