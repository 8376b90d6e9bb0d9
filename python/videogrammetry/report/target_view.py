"""Where a calibration's target was, and pieces of its pictures."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from videogrammetry.calibration.quality_of import single_points
from videogrammetry.calibration.run import CalibrationRun
from videogrammetry.report.cutouts import MOST_CUTOUTS, Cutout, cutouts
from videogrammetry.report.space import Scene
from videogrammetry.report.station_view import Stations, station_view
from videogrammetry.types import FloatArray

#: A camera's picture of a stage: grey values (height, width), or None.
StagePictures = Callable[[str, int], npt.NDArray[Any] | None]


def target_positions(run: CalibrationRun) -> str:
    """Cameras and the points that they used, the target at all its positions."""
    seen = run.observations
    used = seen.used & np.isin(seen.stage, list(run.rig_from_target))
    if not used.any():
        return ""
    key = np.stack([seen.stage[used], seen.point_id[used]], axis=1)
    places, times = np.unique(key, axis=0, return_counts=True)
    position_of = dict(zip(run.target.id.tolist(), run.target.position_mm, strict=True))
    points = np.empty((len(places), 3))
    for row, (stage, point) in enumerate(places.tolist()):
        rotation, shift = run.rig_from_target[stage]
        points[row] = rotation @ position_of[point] + shift
    return station_view(
        Stations(
            rig=run.rig,
            scene=Scene(),
            position_mm=points,
            name=[
                f"position {stage}, point {point}: {n} camera{'s' * (n > 1)}"
                for (stage, point), n in zip(places.tolist(), times.tolist(), strict=True)
            ],
            value=places[:, 0].astype(np.int64),
            legend="number of the target's position",
            lines_mm=_lines(run, np.unique(places[:, 0]).tolist()),
        )
    )


def _lines(run: CalibrationRun, stages: list[int]) -> list[FloatArray]:
    """How the target lay: its longest extents along its own axes; of a waved bar its sightings."""
    known = run.target.position_mm
    if single_points(run):
        bars = run.bars
        if bars is None:
            return []
        return [known[[a, b]] for a, b in zip(bars.point_a, bars.point_b, strict=True)]
    lines = []
    for axis in np.argsort(-np.ptp(known, axis=0))[:2]:
        ends = known[[int(known[:, axis].argmin()), int(known[:, axis].argmax())]]
        for stage in stages:
            rotation, shift = run.rig_from_target[stage]
            lines.append(ends @ rotation.T + shift)
    return lines


def target_cutouts(run: CalibrationRun, pictures: StagePictures | None) -> str:
    """Pieces of the pictures around the worst rejected observations."""
    if pictures is None:
        return ""
    seen = run.observations
    w = np.nan_to_num(np.abs(seen.normalised).max(axis=1, initial=0.0), nan=np.inf, posinf=np.inf)
    out = np.flatnonzero(~seen.used)
    items = []
    for i in out[np.argsort(-w[out], kind="stable")][:MOST_CUTOUTS]:
        camera, stage = run.camera_names[seen.camera[i]], int(seen.stage[i])
        picture = pictures(camera, stage)
        if picture is None:
            continue
        x, y = map(float, seen.xy_px[i])
        dx, dy = map(float, seen.residual_px[i])
        name = run.image_names.get((camera, stage), f"stage {stage}")
        items.append(
            Cutout(
                picture=picture, measured_px=(x, y), expected_px=(x - dx, y - dy),
                title=f"{camera}, point {seen.point_id[i]}",
                text=f"{name}: {np.hypot(dx, dy):.2f} px, w {w[i]:.1f}",
            )
        )  # fmt: skip
    return cutouts(items)
