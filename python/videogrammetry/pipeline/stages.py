"""One stage: matching and reconstruction, and what can be said of many stages together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from videogrammetry.errors import MeasurementError
from videogrammetry.matching import TARGET_STATUS, MatchingOptions, image_covariance, match_stage
from videogrammetry.pipeline.circle_size import SizeCheck, check_size, size_remark
from videogrammetry.pipeline.eccentricity import circle_remarks, possible_eccentricity
from videogrammetry.pipeline.facing import check_facing
from videogrammetry.reconstruction import CalibrationField, Triangulator, reconstruct_stage
from videogrammetry.types import IntArray, Matches, StagePoints, TargetRecords, Targets


@dataclass(frozen=True)
class StageResult:
    """One stage: what was seen, matched and reconstructed.

    ``size`` where it was looked at; ``without_normal``: matches left out because a
    thickness was to be taken off and no ellipse said a normal.
    """

    targets: tuple[Targets, ...]
    matches: Matches
    points: StagePoints
    size: SizeCheck | None = None
    without_normal: int = 0


def measure_stage(
    triangulator: Triangulator,
    targets: Sequence[Targets],
    options: MatchingOptions | None = None,
    field: CalibrationField | None = None,
    diameter_mm: float | None = None,
    thickness_mm: float = 0.0,
) -> StageResult:
    """Match and reconstruct the targets of one stage, one ``Targets`` a camera.

    With ``diameter_mm``, sightings of another size than circles of that
    diameter have at their place are left out: sectors of a ring whose dot is
    hidden, dots hidden in part; and points are the circles' centres, which are not
    where the ellipses' centres say. With ``thickness_mm`` they move by that much
    from the stickers' surface into the object.
    """
    rig = triangulator.rig
    field = field or CalibrationField(triangulator)
    uncertain = [field.covariance(i, t.centre_px) for i, t in enumerate(targets)]
    if diameter_mm is not None:
        uncertain = [
            extra + possible_eccentricity(camera, t)
            for extra, camera, t in zip(uncertain, rig.cameras.values(), targets, strict=True)
        ]
    matches = check_facing(rig, targets, match_stage(rig, targets, options, uncertain))
    cov = [
        image_covariance(t, rig.sigma_floor_px.get(name, 0.0))
        for name, t in zip(rig.cameras, targets, strict=True)
    ]
    centres = [t.centre_px for t in targets]
    size = None
    if diameter_mm is not None:
        points = reconstruct_stage(triangulator, matches, centres, cov)
        size = check_size(rig, targets, matches, points, diameter_mm)
        matches = size.matches
    points = reconstruct_stage(
        triangulator, matches, centres, cov, targets, diameter_mm, thickness_mm
    )
    lost = 0
    if thickness_mm != 0:
        plain = reconstruct_stage(triangulator, matches, centres, cov)
        lost = max(len(plain) - len(points), 0)
    return StageResult(tuple(targets), matches, points, size, lost)


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


def _coded_ends(result: StageResult) -> IntArray:
    """(C, 2): how many coded targets of each camera met the rays of their ID in another
    camera, and how many did not.
    """
    matched = TARGET_STATUS.index("matched")
    inconsistent = TARGET_STATUS.index("inconsistent ID")
    ends = [
        [((t.unique_id >= 0) & (status == matched)).sum(), (status == inconsistent).sum()]
        for t, status in zip(result.targets, result.matches.status, strict=True)
    ]
    return np.array(ends, dtype=np.int32)


def refuse_senseless(results: Sequence[StageResult]) -> None:
    """MeasurementError if the rays of equal IDs do not meet: rig and pictures do not fit."""
    met, missed = np.sum([_coded_ends(r) for r in results], axis=(0, 1)).tolist()
    if missed >= _MIN_CODED and missed > met:
        raise MeasurementError(
            f"of {met + missed} coded targets seen by several cameras, the rays of {missed} do not "
            "meet those of the same ID: the rig is not that of these sequences, the cameras are "
            "not synchronous (a frame missing at the start?) or stand in another order"
        )


def stage_warnings(
    results: Sequence[StageResult],
    stage: IntArray,
    cameras: Sequence[str],
    diameter_mm: float | None = None,
) -> list[str]:
    """Stages, cameras whose coded targets do not meet, though those of the others do; empty
    pictures; many targets of another size than ``diameter_mm``.
    """
    warnings = _empty_pictures(results, stage, cameras) + _strangers(results, cameras)
    remark = _of_size(results, diameter_mm)
    if remark is not None:
        warnings.append(remark)
    warnings += circle_remarks(
        [r.points for r in results], diameter_mm, sum(r.without_normal for r in results)
    )
    for number, result in zip(stage.tolist(), results, strict=True):
        met, missed = _coded_ends(result).sum(axis=0).tolist()
        if missed >= _MIN_CODED and missed > met:
            warnings.append(
                f"stage {number}: the rays of {missed} coded targets do not meet those of the same "
                f"ID, {met} do: is a frame of a camera missing or late here?"
            )
    return warnings


def _strangers(results: Sequence[StageResult], cameras: Sequence[str]) -> list[str]:
    """Cameras most of whose coded targets do not meet the others', though the rest do."""
    ends = np.sum([_coded_ends(r) for r in results], axis=0)
    strange = [
        (name, met, missed)
        for name, (met, missed) in zip(cameras, ends.tolist(), strict=True)
        if missed >= _MIN_CODED and missed > met
    ]
    if not strange:
        return []
    said = ", ".join(f"{name!r} ({missed} of {met + missed})" for name, met, missed in strange)
    return [
        f"the rays of most coded targets of the cameras {said} do not meet those of the same ID in "
        "other cameras: do these cameras stand in another order than in the rig, were they moved, "
        "or are they not synchronous?"
    ]


def _empty_pictures(
    results: Sequence[StageResult], stage: IntArray, cameras: Sequence[str]
) -> list[str]:
    """Cameras that see nothing at single stages, or at all."""
    count = np.array([[len(t) for t in r.targets] for r in results])
    warnings = []
    for c, name in enumerate(cameras):
        empty = stage[count[:, c] == 0].tolist()
        if len(empty) == len(stage):
            warnings.append(
                f"camera {name!r}: no target at all at any of the {len(stage)} stages: look at its "
                "pictures with `videogrammetry recognize --overlay DIR`"
            )
        elif empty:
            some = ", ".join(map(str, empty[:10])) + (", ..." if len(empty) > 10 else "")
            warnings.append(
                f"camera {name!r}: no target at all at {len(empty)} of {len(stage)} stages "
                f"({some}): are its pictures empty there?"
            )
    return warnings


def _of_size(results: Sequence[StageResult], diameter_mm: float | None) -> str | None:
    checks = [r.size for r in results if r.size is not None]
    return size_remark(checks, diameter_mm) if diameter_mm is not None and checks else None


def nothing_measured(results: Sequence[StageResult], diameter_mm: float | None = None) -> str:
    """Why a measurement has no point, and what to do."""
    counts = status_counts(results)
    if not counts:
        return (
            f"no target was recognised in any of the {len(results)} stages: look at the pictures "
            "with `videogrammetry recognize --overlay DIR`, and check polarity and diameter_px in "
            "[targets]"
        )
    remark = _of_size(results, diameter_mm)
    if remark is not None:
        return f"no point is left: {remark}"
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
