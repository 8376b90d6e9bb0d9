"""One stage: matching and reconstruction, and what can be said of many stages together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from videogrammetry.errors import MeasurementError
from videogrammetry.matching import TARGET_STATUS, MatchingOptions, image_covariance, match_stage
from videogrammetry.reconstruction import CalibrationField, Triangulator, reconstruct_stage
from videogrammetry.types import IntArray, Matches, StagePoints, TargetRecords, Targets


@dataclass(frozen=True)
class StageResult:
    """One stage: what was seen, matched and reconstructed."""

    targets: tuple[Targets, ...]
    matches: Matches
    points: StagePoints


def measure_stage(
    triangulator: Triangulator,
    targets: Sequence[Targets],
    options: MatchingOptions | None = None,
    field: CalibrationField | None = None,
    diameter_mm: float | None = None,
) -> StageResult:
    """Match and reconstruct the targets of one stage, one ``Targets`` a camera.

    With ``diameter_mm``, sightings of another size than circles of that
    diameter have at their place are left out: sectors of a ring whose dot is
    hidden, dots hidden in part.
    """
    rig = triangulator.rig
    field = field or CalibrationField(triangulator)
    uncertain = [field.covariance(i, t.centre_px) for i, t in enumerate(targets)]
    matches = match_stage(rig, targets, options, uncertain)
    cov = [
        image_covariance(t, rig.sigma_floor_px.get(name, 0.0))
        for name, t in zip(rig.cameras, targets, strict=True)
    ]
    centres = [t.centre_px for t in targets]
    points = reconstruct_stage(triangulator, matches, centres, cov)
    if diameter_mm is not None:
        fitting = _of_size(triangulator, targets, matches, points, diameter_mm)
        if fitting is not matches:
            matches = fitting
            points = reconstruct_stage(triangulator, matches, centres, cov)
    return StageResult(tuple(targets), matches, points)


#: By how much a circle's measured diameter may differ from the stated one, and how many sigmas.
_SIZE_TOLERANCE, _SIZE_SIGMAS = 0.15, 4.0
_ANOTHER_SIZE = TARGET_STATUS.index("another size")


def _of_size(
    triangulator: Triangulator,
    targets: Sequence[Targets],
    matches: Matches,
    points: StagePoints,
    diameter_mm: float,
) -> Matches:
    """The matches without sightings of another size; ``matches`` itself where all fit.

    A circle's longest diameter in the picture is f d / z, whatever its tilt (to
    second order in the ratio of diameter and distance).
    """
    target = matches.target.copy()
    status = [s.copy() for s in matches.status]
    row_of = {tuple(row): i for i, row in enumerate(matches.target.tolist())}
    rows = np.array([row_of[tuple(row)] for row in points.target.tolist()], dtype=int)
    wrong = False
    for c, camera in enumerate(triangulator.rig.cameras.values()):
        seen = np.flatnonzero(points.target[:, c] >= 0)
        index = points.target[seen, c]
        depth = points.position_mm[seen] @ camera.rotation[2] + camera.translation_mm[2]
        expected = 0.5 * camera.interior[0] * diameter_mm / depth
        sigma = np.sqrt(targets[c].cov[index, 2, 2])
        off = np.abs(targets[c].semi_axes_px[index, 0] - expected)
        bad = off > _SIZE_TOLERANCE * expected + _SIZE_SIGMAS * sigma
        target[rows[seen[bad]], c] = -1
        status[c][index[bad]] = _ANOTHER_SIZE
        wrong = wrong or bool(bad.any())
    if not wrong:
        return matches
    # A target that has lost its partner has none.
    for row in np.flatnonzero((target >= 0).sum(axis=1) == 1):
        c = int(np.argmax(target[row] >= 0))
        status[c][target[row, c]] = TARGET_STATUS.index("no partner")
        target[row, c] = -1
    keep = (target >= 0).any(axis=1)
    return Matches(
        target=target[keep],
        id=matches.id[keep],
        chi2=matches.chi2[keep],
        log_odds=matches.log_odds[keep],
        status=tuple(status),
    )


def status_counts(results: Sequence[StageResult]) -> dict[str, int]:
    """How many targets of all stages came to which end."""
    status = np.concatenate([s for r in results for s in r.matches.status])
    return {
        name: int((status == code).sum())
        for code, name in enumerate(TARGET_STATUS)
        if (status == code).any()
    }


#: Fewer coded targets than this with a partner by ID say nothing of the rig.
_MIN_CODED = 8


def _coded_ends(result: StageResult) -> tuple[int, int]:
    """How many coded targets met the rays of their ID in another camera, and how many did not."""
    matched = TARGET_STATUS.index("matched")
    inconsistent = TARGET_STATUS.index("inconsistent ID")
    status = np.concatenate(result.matches.status)
    coded = np.concatenate([t.unique_id >= 0 for t in result.targets])
    return int((coded & (status == matched)).sum()), int((status == inconsistent).sum())


def refuse_senseless(results: Sequence[StageResult]) -> None:
    """MeasurementError if the rays of equal IDs do not meet: rig and pictures do not fit."""
    met, missed = np.array([_coded_ends(r) for r in results]).sum(axis=0).tolist()
    if missed >= _MIN_CODED and missed > met:
        raise MeasurementError(
            f"of {met + missed} coded targets seen by several cameras, the rays of {missed} do not "
            "meet those of the same ID: the rig is not that of these sequences, the cameras are "
            "not synchronous (a frame missing at the start?) or stand in another order"
        )


def stage_warnings(
    results: Sequence[StageResult], stage: IntArray, cameras: Sequence[str]
) -> list[str]:
    """Stages whose coded targets do not meet, though those of the others do; empty pictures."""
    warnings = _empty_pictures(results, stage, cameras)
    for number, result in zip(stage.tolist(), results, strict=True):
        met, missed = _coded_ends(result)
        if missed >= _MIN_CODED and missed > met:
            warnings.append(
                f"stage {number}: the rays of {missed} coded targets do not meet those of the same "
                f"ID, {met} do: is a frame of a camera missing or late here?"
            )
    return warnings


def _empty_pictures(
    results: Sequence[StageResult], stage: IntArray, cameras: Sequence[str]
) -> list[str]:
    """Cameras that see nothing at single stages and at others do."""
    count = np.array([[len(t) for t in r.targets] for r in results])
    warnings = []
    for c, name in enumerate(cameras):
        empty = stage[count[:, c] == 0].tolist()
        if empty and len(empty) < len(stage):
            some = ", ".join(map(str, empty[:10])) + (", ..." if len(empty) > 10 else "")
            warnings.append(
                f"camera {name!r}: no target at all at {len(empty)} of {len(stage)} stages "
                f"({some}): are its pictures empty there?"
            )
    return warnings


def nothing_measured(results: Sequence[StageResult]) -> str:
    """Why a measurement has no point, and what to do."""
    counts = status_counts(results)
    if not counts:
        return (
            f"no target was recognised in any of the {len(results)} stages: look at the pictures "
            "with `videogrammetry recognize --overlay DIR`, and check polarity and diameter_px in "
            "[targets]"
        )
    found = ", ".join(f"{count} {name}" for name, count in counts.items())
    return (
        f"targets were recognised but none could be matched between cameras ({found}): is the rig "
        "that of these sequences, are the cameras synchronous and in the right order?"
    )


def target_records(
    results: Sequence[StageResult], numbers: Sequence[IntArray], stage: IntArray
) -> TargetRecords:
    """Every target of every stage with the number of the point it went into."""
    rows = [
        _picture_rows(result, ids, int(s), camera)
        for result, ids, s in zip(results, numbers, stage, strict=True)
        for camera in range(len(result.targets))
    ]
    fields = TargetRecords.__dataclass_fields__
    return TargetRecords(**{name: np.concatenate([r[name] for r in rows]) for name in fields})


def _picture_rows(
    result: StageResult, numbers: IntArray, stage: int, camera: int
) -> dict[str, npt.NDArray[Any]]:
    targets = result.targets[camera]
    n = len(targets)
    point_id = np.full(n, -1, dtype=np.int32)
    residual = np.full((n, 2), np.nan)
    column = result.points.target[:, camera]
    seen = np.flatnonzero(column >= 0)
    point_id[column[seen]] = numbers[seen]
    residual[column[seen]] = result.points.residual_px[seen, camera]
    return {
        "stage": np.full(n, stage, dtype=np.int32),
        "camera": np.full(n, camera, dtype=np.int32),
        "centre_px": targets.centre_px,
        "semi_axes_px": targets.semi_axes_px,
        "angle_rad": targets.angle_rad,
        "sigma_px": targets.sigma_px,
        "code_id": targets.id,
        "point_id": point_id,
        "residual_px": residual,
        "match_status": result.matches.status[camera],
        "ring_status": targets.ring_status,
    }
