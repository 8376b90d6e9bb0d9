"""A plan: the calibration's design, what it leaves uncertain, and what a rig will measure."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np

from videogrammetry.accuracy import (
    SOURCES,
    DistancesPrediction,
    NeededPositions,
    PlacesPrediction,
    needed_positions,
    pair_geometries,
    predict_distances,
    predict_places,
    prediction_statistics,
)
from videogrammetry.calibration import DesignOptions, design_calibration
from videogrammetry.errors import CalibrationError, MeasurementError
from videogrammetry.geometry import MeasuringVolume, point_nearest_to_axes
from videogrammetry.pipeline.frames import Progress, silent
from videogrammetry.pipeline.plan_types import CountRow, Plan, PlanOptions, Section
from videogrammetry.reconstruction import Rig
from videogrammetry.types import INTERIOR_NAMES, FloatArray, PointSet, RigData

#: Which coordinates a section shows, across and up, and the one that it holds.
SECTION_AXES = ((0, 1, 2), (0, 2, 1), (1, 2, 0))
_USUAL_FREE = ("f", "x0", "y0", "A1", "B1", "B2")
_USUAL_SIGMA_PX = 0.05
_USUAL_POSITIONS = 16
_USUAL_LENGTH_MM = 1000.0
_PART_OF_FIELD = 0.9
# A target kept near the middle: the comparison that shows what coverage is worth.
_NEAR_PART, _NEAR_TILT_RAD = 0.5, math.radians(20.0)


def plan_rig(
    rig: RigData,
    target: PointSet,
    *,
    volume: MeasuringVolume | None = None,
    options: PlanOptions | None = None,
    progress: Progress = silent,
) -> Plan:
    """Predict what a rig will measure how well: image noise, calibration and both together.

    The calibration's covariance comes from the design of a calibration with the
    target at ``options.positions`` places of the volume
    (:func:`~videogrammetry.calibration.design_calibration`); a calibrated rig's own is
    taken unless positions are asked for.

    Parameters
    ----------
    rig : the cameras, planned or calibrated.
    target : the calibration target's points, with normals where they are seen from one side.
    volume : None: where the calibration's target stood, else a ball where the cameras look.

    Raises
    ------
    ValueError : fewer than two cameras, a wrong option.
    MeasurementError : two cameras see no place of the volume.
    CalibrationError : the target at these positions does not calibrate the rig.
    """
    options = options or PlanOptions()
    if len(rig.cameras) < 2:
        raise ValueError(
            f"rig: a plan needs two cameras or more, got {len(rig.cameras)}; one camera gives "
            "directions and no positions"
        )
    volume = volume or _usual_volume(rig)
    options = _completed(options, rig, volume)
    assert options.sigma_px is not None
    assert options.length_mm is not None
    warnings: list[str] = []
    grid = volume.grid(options.places)
    part_seen = _check_sight(rig, volume, grid, options, warnings)
    own = rig.cov is not None and options.positions is None
    design = None if own else design_calibration(rig, target, volume, _design(options, None))
    base = Rig.from_data(rig if design is None else design.rig)
    places = _places(base, grid, options)
    distances = predict_distances(
        base, volume, options.length_mm, options.sigma_px, groups=options.groups
    )
    if not len(distances.sigma_image_mm):
        warnings.append(
            f"no distance of {options.length_mm:g} mm in the volume is seen at both ends; give a "
            "shorter length_mm"
        )
    sections = tuple(_section(base, volume, axes, options) for axes in SECTION_AXES)
    counts = _counts(rig, target, volume, options, progress, warnings)
    needed = None
    if options.wanted_mm is not None:
        needed = _needed(rig, target, volume, options, places, distances, progress)
    return Plan(
        rig=base,
        calibrated=own,
        volume=volume,
        options=options,
        target_points=len(target),
        design=design,
        places=places,
        distances=distances,
        sections=sections,
        statistics=prediction_statistics(places, distances),
        pairs=tuple(
            pair_geometries(base, volume.centre_mm, options.sigma_px, groups=options.groups)
        ),
        counts=counts,
        needed=needed,
        part_seen=part_seen,
        warnings=tuple(warnings),
    )


def plan_document(plan: Plan) -> dict[str, Any]:
    """What plan.json holds: options, tables and the covariance's parameters, without the maps."""
    return {
        "options": dataclasses.asdict(plan.options),
        "volume": dataclasses.asdict(plan.volume),
        "part_seen_by_two": plan.part_seen,
        "calibration": "the rig's own covariance" if plan.calibrated else "simulated design",
        "statistics_mm": {
            q: {s: dataclasses.asdict(v) for s, v in by.items()}
            for q, by in plan.statistics.items()
        },
        "pairs": [dataclasses.asdict(pair) for pair in plan.pairs],
        "positions": [dataclasses.asdict(row) for row in plan.counts],
        "target_positions": None
        if plan.design is None
        else [{"rotation": r, "translation_mm": t} for r, t in plan.design.world_from_target],
        "needed": None if plan.needed is None else dataclasses.asdict(plan.needed),
        "cameras": {
            name: {"centre_mm": camera.centre_mm, "sigma": dict(camera.sigma)}
            for name, camera in plan.rig.cameras.items()
        },
        "warnings": list(plan.warnings),
    }


def _usual_volume(rig: RigData) -> MeasuringVolume:
    """The box of the calibrated volume, or a ball in all pictures where the cameras look."""
    if rig.volume_mm is not None and len(rig.volume_mm):
        low, high = rig.volume_mm.min(axis=0), rig.volume_mm.max(axis=0)
        return MeasuringVolume(centre_mm=(low + high) / 2, size_mm=np.maximum(high - low, 1e-3))
    centre = point_nearest_to_axes(rig)
    radii = []
    for camera in rig.cameras.values():
        depth = float(camera.rotation[2] @ (centre - camera.centre_mm))
        radii.append(depth * 0.5 * min(camera.image_size_px) / camera.interior[0])
    if min(radii) <= 0:
        raise ValueError(
            "volume: the cameras do not look at one place, so that the volume must be said: "
            "[volume] centre_mm and size_mm in the plan, or --centre and --size"
        )
    return MeasuringVolume(
        centre_mm=centre, size_mm=np.full(3, 2 * _PART_OF_FIELD * min(radii)), shape="sphere"
    )


def _completed(options: PlanOptions, rig: RigData, volume: MeasuringVolume) -> PlanOptions:
    """The options with everything decided."""
    length = options.length_mm
    largest = float(volume.size_mm.max())
    if length is None:
        length = _USUAL_LENGTH_MM if largest >= _USUAL_LENGTH_MM else 0.5 * largest
    known = {name.rsplit("/", 1)[1] for name, s in _sigmas(rig).items() if s > 0}
    usual = tuple(n for n in INTERIOR_NAMES if n in known) or _USUAL_FREE
    return dataclasses.replace(
        options,
        sigma_px=options.sigma_px or max(rig.sigma_floor_px.values(), default=0) or _USUAL_SIGMA_PX,
        free=usual if options.free is None else options.free,
        length_mm=length,
    )


def _sigmas(rig: RigData) -> dict[str, float]:
    if rig.cov is None:
        return {}
    return dict(zip(rig.cov_names, np.sqrt(np.maximum(np.diag(rig.cov), 0.0)), strict=True))


def _design(options: PlanOptions, count: int | None) -> DesignOptions:
    assert options.sigma_px is not None
    assert options.free is not None
    return DesignOptions(
        count=count or options.positions or _USUAL_POSITIONS,
        sigma_px=options.sigma_px,
        target_sigma_mm=options.target_sigma_mm,
        free=options.free,
        part=options.target_part,
        largest_tilt_rad=options.target_tilt_rad,
        whole=options.target_whole,
    )


def _places(rig: Rig, where: FloatArray, options: PlanOptions) -> PlacesPrediction:
    assert options.sigma_px is not None
    return predict_places(rig, where, options.sigma_px, groups=options.groups, frame=options.frame)


def _check_sight(
    rig: RigData,
    volume: MeasuringVolume,
    grid: FloatArray,
    options: PlanOptions,
    warnings: list[str],
) -> float:
    """The part of the volume that two cameras see; MeasurementError if there is none."""
    for group in options.groups:
        for name in group:
            if name not in rig.cameras:
                raise ValueError(
                    f"groups: camera {name!r} is not in the rig, which has {', '.join(rig.cameras)}"
                )
    bare = Rig(cameras=rig.cameras)
    sight = _places(bare, grid, options)
    part = float((sight.cameras >= 2).mean())
    if part == 0:
        seen = ", ".join(
            f"{name} {100 * share:.0f} %"
            for name, share in zip(rig.cameras, sight.seen.mean(axis=0), strict=True)
        )
        raise MeasurementError(
            f"the volume around ({', '.join(f'{v:.0f}' for v in volume.centre_mm)}) mm, "
            f"{' x '.join(f'{v:.0f}' for v in volume.size_mm)} mm, is nowhere seen by two cameras "
            f"(seen of it: {seen}); check the volume's place and where the cameras stand and look"
        )
    if part < 1:
        warnings.append(
            f"{100 * (1 - part):.0f} % of the volume are seen by fewer than two cameras; the "
            "figures hold for the rest"
        )
    return part


def _section(
    rig: Rig, volume: MeasuringVolume, axes: tuple[int, int, int], options: PlanOptions
) -> Section:
    across, up, held = axes
    size, centre = volume.size_mm, volume.centre_mm
    # Cells are square, their middles within the volume.
    longest = max(size[across], size[up])
    numbers = [max(2, round(options.section * size[k] / longest)) for k in (across, up)]
    ranges = [
        centre[k] + size[k] * ((np.arange(n) + 0.5) / n - 0.5)
        for k, n in zip((across, up), numbers, strict=True)
    ]
    first, second = np.meshgrid(*ranges)
    where = np.empty((first.size, 3))
    where[:, across], where[:, up], where[:, held] = first.ravel(), second.ravel(), centre[held]
    return Section(
        axes=axes,
        across_mm=ranges[0],
        up_mm=ranges[1],
        inside=volume.contains(where).reshape(first.shape),
        places=_places(rig, where, options),
    )


def _at_95(rig: Rig, volume: MeasuringVolume, count: int, options: PlanOptions) -> CountRow:
    assert options.sigma_px is not None
    assert options.length_mm is not None
    table = prediction_statistics(
        _places(rig, volume.grid(options.places), options),
        predict_distances(rig, volume, options.length_mm, options.sigma_px, groups=options.groups),
    )
    return CountRow(
        count=count,
        distance_calibration_mm=table["distance"]["calibration"].most_mm,
        distance_mm=table["distance"]["together"].most_mm,
        position_calibration_mm=table["position"]["calibration"].most_mm,
        position_mm=table["position"]["together"].most_mm,
    )


def _counted(
    rig: RigData, target: PointSet, volume: MeasuringVolume, options: PlanOptions, count: int
) -> CountRow:
    """The row of one number of positions; CalibrationError if they do not calibrate."""
    design = design_calibration(rig, target, volume, _design(options, count))
    return _at_95(Rig.from_data(design.rig), volume, count, options)


def _counts(
    rig: RigData,
    target: PointSet,
    volume: MeasuringVolume,
    options: PlanOptions,
    progress: Progress,
    warnings: list[str],
) -> tuple[CountRow, ...]:
    rows = []
    for done, count in enumerate(options.counts):
        progress(done, len(options.counts), "positions")
        try:
            row = _counted(rig, target, volume, options, count)
            near = _near_middle(rig, target, volume, options, count)
            rows.append(dataclasses.replace(row, distance_near_mm=near))
        except CalibrationError as error:
            warnings.append(f"{count} positions: {error}")
            rows.append(CountRow(count=count))
    progress(len(options.counts), len(options.counts), "positions")
    return tuple(rows)


def _near_middle(
    rig: RigData, target: PointSet, volume: MeasuringVolume, options: PlanOptions, count: int
) -> float:
    """A distance's sigma at 95 % from a calibration as careless people make it; NaN: from none."""
    near = dataclasses.replace(
        options, target_part=_NEAR_PART, target_tilt_rad=_NEAR_TILT_RAD, target_whole=True
    )
    try:
        return _counted(rig, target, volume, near, count).distance_calibration_mm
    except CalibrationError:
        return math.nan


def _needed(
    rig: RigData,
    target: PointSet,
    volume: MeasuringVolume,
    options: PlanOptions,
    places: PlacesPrediction,
    distances: DistancesPrediction,
    progress: Progress,
) -> NeededPositions:
    assert options.wanted_mm is not None
    tried = [0]

    def sigma_of(count: int) -> float:
        tried[0] += 1
        progress(tried[0], tried[0] + 1, "positions wanted")
        try:
            row = _counted(rig, target, volume, options, count)
        except CalibrationError:
            return math.inf
        value = row.distance_mm if options.wanted_of == "distance" else row.position_mm
        return value if math.isfinite(value) else math.inf

    image = prediction_statistics(places, distances)[options.wanted_of]["image"].most_mm
    if not math.isfinite(image):
        raise MeasurementError(
            f"no {options.wanted_of} in the volume is seen by two cameras, so that no number of "
            "positions can be told; give a shorter length_mm"
        )
    return needed_positions(sigma_of, options.wanted_mm, image_mm=image)


def plan_columns(plan: Plan) -> tuple[list[str], list[Any]]:
    """Header and columns of plan.csv: every place of the volume's grid with its sigmas."""
    places = plan.places
    header = ["x_mm", "y_mm", "z_mm", "cameras", "convergence_rad"]
    columns: list[Any] = [*places.position_mm.T]
    columns += [places.cameras, places.convergence_rad]
    for source in SOURCES:
        header += [f"sigma_{axis}_{source}_mm" for axis in "xyz"]
        columns += [*places.sigma_mm(source).T]
    return header, columns
