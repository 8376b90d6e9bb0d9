"""A project's measurement against what is known of it: lengths, gravity, simulated truth."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from videogrammetry.accuracy import (
    STANDARD_GRAVITY_M_S2,
    CalibrationPart,
    FreeFallOptions,
    FreeFallTest,
    KnownLength,
    ReprojectionStatistics,
    ScaleBarTest,
    TruePoints,
    TruthComparison,
    check_free_fall,
    check_scale_bars,
    compare_with_truth,
    lengths_from_calibration,
    measurement_reprojection,
    sighting_sigma_px,
)
from videogrammetry.errors import MeasurementError, ProjectFileError
from videogrammetry.geometry import select_cameras
from videogrammetry.motion import without_flagged
from videogrammetry.pipeline.frames import recognition_options
from videogrammetry.pipeline.measure_job import first_free_id, read_project_rig
from videogrammetry.project import (
    Project,
    ScaleBar,
    TrajectoryTable,
    VerifySection,
    provenance,
    read_measurement,
    read_rig,
    read_scale_bars,
    read_trajectories,
)
from videogrammetry.types import FloatArray, Measurement, RigData

#: What to give where there is nothing to verify against.
NOTHING_TO_VERIFY = (
    "nothing to verify against: give lengths to check (--scale-bars FILE), the stages of a free "
    "fall (--free-fall FIRST LAST) or the truth of a simulated sequence (--truth DIR), or the same "
    "in the project's [verify]"
)

_TRUTH_FILES = ("rig.json", "trajectories.csv")


@dataclass(frozen=True, kw_only=True)
class Verification:
    """What could be checked; None where nothing was given for it.

    Attributes
    ----------
    scale_bars, free_fall, truth : the tests.
    scale_bar_rig_error_mm : (N,) with ``scale_bars`` and a truth: the error of each
        length that the calibration alone has made, from exact pictures.
    reprojection : of the measurement, by camera and of all.
    options : as asked for. warnings : what could not be done, and why.
    provenance : version, options, hashes of the inputs, time.
    """

    scale_bars: ScaleBarTest | None
    scale_bar_rig_error_mm: FloatArray | None
    free_fall: FreeFallTest | None
    reprojection: tuple[ReprojectionStatistics, ...]
    truth: TruthComparison | None
    options: VerifySection
    warnings: tuple[str, ...]
    provenance: Mapping[str, Any]


def verify_project(
    project: Project,
    *,
    options: VerifySection | None = None,
    measurement: Measurement | None = None,
    rig: RigData | None = None,
) -> Verification:
    """Check a project's measurement.

    Parameters
    ----------
    project : as ``read_project`` gives it.
    options : what to check against; None: the project's ``[verify]``.
    measurement, rig : None: measurement.h5 and rig.json beside the project.

    Raises
    ------
    ProjectFileError, TableError, MeasurementError
        A file is missing or wrong, nothing is there to verify against, or the
        measurement does not hold what is asked for.
    """
    options = project.verify if options is None else options
    if not options.anything:
        raise ProjectFileError(f"{project.path}: {NOTHING_TO_VERIFY}")
    if rig is None:
        rig = read_project_rig(project)
    if measurement is None:
        measurement = read_measurement(project.measurement_path)
    # What is estimated from other stages proves nothing.
    measured = without_flagged(measurement.trajectories, ["filled"])
    measurement = dataclasses.replace(measurement, trajectories=measured)
    try:
        rig = select_cameras(rig, measurement.trajectories.camera_names)
    except ValueError as error:
        raise MeasurementError(
            f"{error}: rig and measurement are not of one project; measure again"
        ) from error
    part = CalibrationPart(rig)
    sigma_px = sighting_sigma_px(measurement, rig)
    warnings: list[str] = []
    if not part.known:
        warnings.append("the rig has no covariance: predicted sigmas are those of the noise alone")
    try:
        bars = _check_bars(options, measurement, part, sigma_px, warnings)
        fall = _check_fall(options, measurement, part, sigma_px)
        truth, bar_errors = _check_truth(project, options, measurement, rig, sigma_px, bars)
    except ValueError as error:
        raise MeasurementError(str(error)) from error
    return Verification(
        scale_bars=bars,
        scale_bar_rig_error_mm=bar_errors,
        free_fall=fall,
        reprojection=measurement_reprojection(measurement),
        truth=truth,
        options=options,
        warnings=tuple(warnings),
        provenance=provenance(options, _inputs(project, options), project.folder),
    )


def known_lengths(bars: Sequence[ScaleBar]) -> tuple[KnownLength, ...]:
    """Lengths at the temperature of the measurement."""
    return tuple(
        KnownLength(
            point_a=bar.point_a,
            point_b=bar.point_b,
            length_mm=bar.used_length_mm(),
            sigma_mm=bar.sigma_mm,
        )
        for bar in bars
    )


def _check_bars(
    options: VerifySection,
    measurement: Measurement,
    part: CalibrationPart,
    sigma_px: FloatArray,
    warnings: list[str],
) -> ScaleBarTest | None:
    if options.scale_bars is None:
        return None
    bars = known_lengths(read_scale_bars(options.scale_bars))
    test = check_scale_bars(measurement.trajectories, bars, part, sigma_px=sigma_px)
    if test is None:
        known = ", ".join(map(str, measurement.trajectories.point_id[:30].tolist()))
        raise MeasurementError(
            f"{options.scale_bars}: no bar has both ends measured at one stage; measured points "
            f"are {known}"
        )
    for index in test.not_measured:
        bar = bars[index]
        warnings.append(
            f"scale bar {bar.point_a}-{bar.point_b}: its ends were measured together at no stage"
        )
    return test


def _check_fall(
    options: VerifySection,
    measurement: Measurement,
    part: CalibrationPart,
    sigma_px: FloatArray,
) -> FreeFallTest | None:
    if options.free_fall is None:
        return None
    gravity = options.gravity_m_s2
    fall = FreeFallOptions(
        gravity_m_s2=STANDARD_GRAVITY_M_S2 if gravity is None else gravity,
        drag_per_m=options.drag_per_m,
        estimate_drag=options.estimate_drag,
        up=options.vertical,
    )
    return check_free_fall(
        measurement.trajectories,
        *options.free_fall,
        part,
        fall,
        points=options.points,
        sigma_px=sigma_px,
    )


def _check_truth(
    project: Project,
    options: VerifySection,
    measurement: Measurement,
    rig: RigData,
    sigma_px: FloatArray,
    bars: ScaleBarTest | None,
) -> tuple[TruthComparison | None, FloatArray | None]:
    """The comparison, and what the calibration alone has made of the bars' lengths."""
    if options.truth is None:
        return None, None
    table = measurement.trajectories
    for name in _TRUTH_FILES:
        if not (options.truth / name).is_file():
            raise ProjectFileError(
                f"{options.truth / name}: there is no such file; give the folder `truth` that "
                "simulate has written beside the project"
            )
    truth_rig = read_rig(options.truth / "rig.json")
    missing = [name for name in table.camera_names if name not in truth_rig.cameras]
    if missing:
        raise MeasurementError(
            f"{options.truth / 'rig.json'}: has no camera {missing[0]!r}, which was measured with"
        )
    truth_rig = select_cameras(truth_rig, table.camera_names)
    points = true_points(read_trajectories(options.truth / "trajectories.csv"), table.camera_names)
    comparison = compare_with_truth(
        table,
        rig,
        truth_rig,
        points,
        motion=measurement.motion,
        first_free_id=first_free_id(recognition_options(project.targets)),
        sigma_px=sigma_px,
    )
    if bars is None:
        return comparison, None
    return comparison, _bar_errors(bars, measurement, rig, truth_rig, points)


def _bar_errors(
    bars: ScaleBarTest,
    measurement: Measurement,
    rig: RigData,
    truth_rig: RigData,
    points: TruePoints,
) -> FloatArray:
    table = measurement.trajectories
    used = np.zeros((len(points.stage), len(points.point_id), len(table.camera_names)), dtype=bool)
    _, s_true, s = np.intersect1d(points.stage, table.stage, return_indices=True)
    _, p_true, p = np.intersect1d(points.point_id, table.point_id, return_indices=True)
    used[np.ix_(s_true, p_true)] = table.cameras_used[np.ix_(s, p)]
    errors = lengths_from_calibration(rig, truth_rig, points, bars.bars, used)
    row = np.searchsorted(points.stage, bars.stage)
    row = np.minimum(row, len(points.stage) - 1)
    known: FloatArray = np.where(points.stage[row] == bars.stage, errors[row, bars.bar], np.nan)
    return known


def true_points(table: TrajectoryTable, camera_names: Sequence[str]) -> TruePoints:
    """The truth of a simulated sequence from its trajectories CSV.

    Raises
    ------
    ValueError
        If a point's name is no number.
    """
    try:
        number = np.array([int(name) for name in table.point], dtype=np.int32)
    except ValueError as error:
        raise ValueError(f"truth: a point's name is no number ({error}); correct it") from error
    stage, row = np.unique(table.stage, return_inverse=True)
    point_id, column = np.unique(number, return_inverse=True)
    position = np.full((len(stage), len(point_id), 3), np.nan)
    seen = np.zeros((len(stage), len(point_id), len(camera_names)), dtype=bool)
    position[row, column] = table.position_mm
    for c, name in enumerate(camera_names):
        seen[row, column, c] = [name in cameras for cameras in table.cameras]
    return TruePoints(
        stage=stage,
        point_id=point_id,
        position_mm=position,
        cameras_seen=seen if any(table.cameras) else None,
    )


def _inputs(project: Project, options: VerifySection) -> list[Path]:
    files = [project.path, project.rig_path, project.rig_path.with_suffix(".npz")]
    files.append(project.measurement_path)
    if options.scale_bars is not None:
        files.append(options.scale_bars)
    if options.truth is not None:
        files += [options.truth / name for name in _TRUTH_FILES]
    return [path for path in files if path.is_file()]


def verification_document(verification: Verification) -> dict[str, Any]:
    """The verification as it goes to JSON (``project.plain``), provenance included."""
    return {
        "schema": 1,
        **{f.name: getattr(verification, f.name) for f in dataclasses.fields(verification)},
    }
