"""From the results of a calibration or an adjustment to what tells how good they are."""

from __future__ import annotations

import numpy as np

from videogrammetry.calibration.network_result import (
    AdjustedBars,
    AdjustedCamera,
    NetworkAdjustment,
)
from videogrammetry.calibration.picture_angles import (
    largest_angle_rad,
    rolls_against,
    span_rad,
    tilts_and_rolls,
    upright,
)
from videogrammetry.calibration.picture_coverage import picture_coverage
from videogrammetry.calibration.quality import (
    CameraQuality,
    NetworkQuality,
    PictureFacts,
    VarianceComponent,
    correlations,
    reliability,
    variance_component,
)
from videogrammetry.calibration.result import CAMERA_PARAMETERS
from videogrammetry.calibration.run import CalibrationRun
from videogrammetry.types import INTERIOR_NAMES, FloatArray, IntArray

#: Normal quantile of a power of 80 %.
_POWER_80 = 0.8416212335729143
_DEFAULT_CRITICAL_VALUE = 4.0


def quality_of_network(result: NetworkAdjustment) -> NetworkQuality:
    """Of an adjusted network: an object, cameras that moved."""
    seen, images = result.observations, result.images
    up = upright(images.rotation)
    components = []
    camera_of = images.camera[seen.image]
    for index, camera in enumerate(result.cameras):
        used = seen.used & (camera_of == index)
        components.append(
            variance_component(
                f"image points of {camera.name}",
                seen.residual_px[used],
                seen.sigma_px[used],
                seen.redundancy[used],
            )  # fmt: skip
        )
    bars = result.scale_bars
    if len(bars):
        components.append(_bars_component(bars))
    if result.known_factor is not None:
        components.append(
            VarianceComponent(
                group="known points",
                factor=result.known_factor,
                redundancy=result.known_redundancy,
            )
        )
    kept = seen.used
    return NetworkQuality(
        target=False,
        up=up,
        sigma0=result.summary.sigma0,
        cameras=tuple(
            _camera_of_network(result, camera, index, up)
            for index, camera in enumerate(result.cameras)
        ),
        rays=result.points.images.astype(np.int64),
        shared={},
        scale_free=result.summary.datum == "free",
        bars=bars if len(bars) else None,
        components=tuple(components),
        reliability=reliability(seen.redundancy[kept], seen.detectable_px[kept]),
    )


def _bars_component(bars: AdjustedBars) -> VarianceComponent:
    kept = bars.used
    return variance_component(
        "scale bars", bars.residual_mm[kept], bars.sigma_mm[kept], bars.redundancy[kept]
    )


def _camera_of_network(
    result: NetworkAdjustment, camera: AdjustedCamera, index: int, up: FloatArray
) -> CameraQuality:
    seen, images = result.observations, result.images
    mine = images.camera[seen.image] == index
    used = mine & seen.used
    rows = np.unique(seen.image[used])
    rotation, translation = images.rotation[seen.image], images.translation_mm[seen.image]
    position = result.points.position_mm[seen.point]
    depth = (rotation[:, 2] * position).sum(axis=1) + translation[:, 2]
    counts, depths = _by_group(seen.image[used], depth[used], rows)
    roll = rolls_against(images.rotation[rows], up) if len(rows) else np.empty(0)
    return CameraQuality(
        name=camera.name,
        image_size_px=camera.image_size_px,
        coverage=picture_coverage(camera.image_size_px, seen.xy_px[used]),
        pictures=PictureFacts(
            name=tuple(images.name[i] for i in rows), points=counts, depth_mm=depths,
            tilt_rad=np.full(len(rows), np.nan), roll_rad=roll,
        ),
        points=int(used.sum()),
        rejected=int((mine & ~seen.used).sum()),
        depth_mm=_range(depth[used]),
        roll_span_rad=span_rad(roll),
        tilt_rad=largest_angle_rad(images.rotation[rows][:, 2]),
        free=camera.free,
        undetermined=tuple(d.name for d in camera.dropped if d.undetermined),
        correlations=correlations(camera.free, camera.cov),
        reliability=reliability(seen.redundancy[used], seen.detectable_px[used]),
    )  # fmt: skip


def quality_of_run(run: CalibrationRun) -> NetworkQuality:
    """Of a calibration: fixed cameras, a target that moved."""
    seen = run.observations
    components = [
        variance_component(
            f"image points of {name}",
            seen.residual_px[used], seen.sigma_px[used], seen.redundancy[used],
        )
        for index, name in enumerate(run.camera_names)
        for used in (seen.used & (seen.camera == index),)
    ]  # fmt: skip
    if run.target_factor is not None:
        components.append(
            VarianceComponent(
                group="the target's points",
                factor=run.target_factor,
                redundancy=run.target_redundancy,
            )
        )
    if run.bars is not None:
        components.append(_bars_component(run.bars))
    used = seen.used
    return NetworkQuality(
        target=True,
        up=np.array([0.0, -1.0, 0.0]),
        sigma0=run.sigma0,
        cameras=tuple(
            _camera_of_run(run, name, index) for index, name in enumerate(run.camera_names)
        ),
        rays=np.empty(0, np.int64),
        shared=_shared(run),
        scale_free=single_points(run),
        bars=run.bars,
        components=tuple(components),
        reliability=reliability(seen.redundancy[used], _detectable_px(run)[used]),
    )


def _detectable_px(run: CalibrationRun) -> FloatArray:
    """(M, 2) smallest errors found with 80 % power: delta0 sigma / sqrt(r) (Baarda 1968)."""
    given = run.rig.how.get("options", {})
    critical = given.get("critical_value") if isinstance(given, dict) else None
    delta0 = (critical or _DEFAULT_CRITICAL_VALUE) + _POWER_80
    seen = run.observations
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(delta0 * seen.sigma_px / np.sqrt(np.clip(seen.redundancy, 0.0, 1.0)))


def _shared(run: CalibrationRun) -> dict[str, int]:
    """Camera -> positions of the target that it and another camera saw."""
    if len(run.camera_names) < 2:
        return {}
    seen = run.observations
    pairs = np.unique(np.stack([seen.stage, seen.camera], axis=1)[seen.used], axis=0)
    stages, row = np.unique(pairs[:, 0], return_inverse=True)
    several = np.bincount(row.reshape(-1), minlength=len(stages))[row.reshape(-1)] > 1
    return {
        name: int((several & (pairs[:, 1] == index)).sum())
        for index, name in enumerate(run.camera_names)
    }


def _camera_of_run(run: CalibrationRun, name: str, index: int) -> CameraQuality:
    seen, camera = run.observations, run.rig.cameras[name]
    mine = seen.camera == index
    used = mine & seen.used
    stages = np.array([s for s in np.unique(seen.stage[used]) if int(s) in run.rig_from_target])
    posed = used & np.isin(seen.stage, stages)
    in_cam = {
        int(s): (camera.rotation @ rotation, camera.rotation @ shift + camera.translation_mm)
        for s, (rotation, shift) in run.rig_from_target.items()
    }
    place = dict(zip(run.target.id.tolist(), run.target.position_mm, strict=True))
    depth = np.array(
        [
            in_cam[int(s)][0][2] @ place[int(p)] + in_cam[int(s)][1][2]
            for s, p in zip(seen.stage[posed], seen.point_id[posed], strict=True)
        ]
    )
    counts, depths = _by_group(seen.stage[posed], depth, stages)
    angles = np.full((len(stages), 2), np.nan)
    if len(stages) and not single_points(run):
        rotations = np.array([in_cam[int(s)][0] for s in stages])
        angles = tilts_and_rolls(rotations, run.target.position_mm)
    cov = run.rig.cov
    rows = np.flatnonzero([n.split("/")[0] == name for n in run.rig.cov_names])
    block = cov[np.ix_(rows, rows)] if cov is not None and len(rows) else np.zeros((16, 16))
    return CameraQuality(
        name=name,
        image_size_px=camera.image_size_px,
        coverage=picture_coverage(camera.image_size_px, seen.xy_px[used]),
        pictures=PictureFacts(
            name=tuple(run.image_names.get((name, int(s)), f"stage {s}") for s in stages),
            points=counts, depth_mm=depths, tilt_rad=angles[:, 0], roll_rad=angles[:, 1],
        ),
        points=int(used.sum()),
        rejected=int((mine & ~seen.used).sum()),
        depth_mm=_range(depth),
        roll_span_rad=np.nan if single_points(run) else span_rad(angles[:, 1]),
        tilt_rad=np.nan if single_points(run) else float(angles[:, 0].max(initial=0.0)),
        free=tuple(run.parameters_kept[name]),
        undetermined=_undetermined(run, name),
        correlations=correlations(CAMERA_PARAMETERS, block),
        reliability=reliability(seen.redundancy[used], _detectable_px(run)[used]),
    )  # fmt: skip


def single_points(run: CalibrationRun) -> bool:
    """Whether no target moved: the points of a waved bar are points of the rig, each its own."""
    poses = list(run.rig_from_target.values())
    return len(poses) > 1 and all(
        np.array_equal(rotation, poses[0][0]) and np.array_equal(shift, poses[0][1])
        for rotation, shift in poses
    )


def _undetermined(run: CalibrationRun, name: str) -> tuple[str, ...]:
    """Names of the parameters that the pictures do not determine (``dropped_rejections``)."""
    said = [
        item.reason.split(" is not determined")[0]
        for item in run.rejected
        if item.kind == "parameter" and item.camera == name and "is not determined" in item.reason
    ]
    return tuple(n for n in INTERIOR_NAMES if n in said)


def _range(values: FloatArray) -> tuple[float, float]:
    if not len(values):
        return (np.nan, np.nan)
    return float(values.min()), float(values.max())


def _by_group(group: IntArray, depth: FloatArray, rows: IntArray) -> tuple[np.ndarray, FloatArray]:
    """Counts (P,) and least, mean, largest depth (P, 3) of each group."""
    place = np.searchsorted(rows, group)
    count = np.bincount(place, minlength=len(rows)).astype(np.int64)
    depths = np.empty((len(rows), 3))
    depths[:, 0], depths[:, 2] = np.inf, -np.inf
    np.minimum.at(depths[:, 0], place, depth)
    np.maximum.at(depths[:, 2], place, depth)
    total = np.bincount(place, weights=depth, minlength=len(rows))
    depths[:, 1] = total / np.maximum(count, 1)
    return count, depths
