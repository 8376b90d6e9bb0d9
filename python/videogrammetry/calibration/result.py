"""From adjusted networks to a :class:`CalibrationRun`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from videogrammetry.adjustment import Adjustment
from videogrammetry.calibration.additional_points import Placed, with_points
from videogrammetry.calibration.bundle import POSE_NAMES, rms_px
from videogrammetry.calibration.interfaces import in_target_frame
from videogrammetry.calibration.linking import Rigid
from videogrammetry.calibration.network_result import AdjustedBars
from videogrammetry.calibration.pictures import Pictures
from videogrammetry.calibration.run import (
    AdditionalPoints,
    CalibrationOptions,
    CalibrationRun,
    CameraFrames,
    ObservationTable,
    Rejection,
)
from videogrammetry.calibration.solving import Solution
from videogrammetry.calibration.start import CameraStart
from videogrammetry.types import (
    INTERIOR_NAMES,
    FlatInterface,
    FloatArray,
    IntArray,
    PointSet,
    RigCamera,
    RigData,
    cov6_from_matrix,
)

#: Order of a camera's sixteen parameters in the covariance of a rig.
CAMERA_PARAMETERS = (*INTERIOR_NAMES, *POSE_NAMES)


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What a method of calibration hands over.

    ``additional``: points beside the target, whose rows follow the target's;
    ``solutions``: one of all cameras (joint) or one a camera (mean); ``cov``
    (16 C, 16 C) in the order of ``CAMERA_PARAMETERS`` camera by camera.
    """

    solutions: tuple[Solution, ...]
    interior: Sequence[FloatArray]
    cam_from_rig: Sequence[Rigid]
    rig_from_target: Mapping[int, Rigid]
    cov: FloatArray
    position_mm: FloatArray
    point_cov_mm2: FloatArray | None
    interfaces: Mapping[str, FlatInterface] = field(default_factory=dict)
    rejected: Sequence[Rejection] = ()
    warnings: Sequence[str] = ()
    statistics: Mapping[str, Any] = field(default_factory=dict)
    bars: AdjustedBars | None = None
    additional: Placed | None = None


def calibration_run(
    cameras: Sequence[CameraFrames],
    starts: Sequence[CameraStart],
    pictures: Pictures,
    target: PointSet,
    options: CalibrationOptions,
    outcome: Outcome,
    seconds: float,
) -> CalibrationRun:
    """Everything in the shape that files, reports and the command use."""
    names = tuple(camera.name for camera in cameras)
    additional = outcome.additional
    every = target if additional is None else with_points(target, additional)
    table = observation_table(outcome.solutions, every)
    extra = None
    if additional is not None and len(every) > len(target):
        of_target = _of_target(outcome.solutions, len(target))
        extra = _additional(outcome, options.free_points, additional, table.rows(~of_target))
        table = table.rows(of_target)
    used = table.used
    of = {name: used & (table.camera == index) for index, name in enumerate(names)}
    adjustments = [s.adjustment for s in outcome.solutions]
    target_redundancy = sum(a.point_redundancy for a in adjustments)
    of_points = sum(a.point_factor * a.point_redundancy for a in adjustments)
    how = _how(options, outcome, rms_px(table.residual_px[used]), extra)
    kept = {
        names[camera]: s.bundle.network.free(index)
        for s in outcome.solutions
        for index, camera in enumerate(s.bundle.camera_of)
    }
    return CalibrationRun(
        rig=rig_data(cameras, starts, outcome, how, in_target_frame(options)),
        method=options.method,
        camera_names=names,
        image_names={(names[p.camera], p.stage): p.image for p in pictures.pictures},
        rig_from_target=outcome.rig_from_target,
        target=PointSet(
            id=target.id, position_mm=outcome.position_mm,
            cov_mm2=target.cov_mm2 if outcome.point_cov_mm2 is None
            else cov6_from_matrix(outcome.point_cov_mm2),
            normal=target.normal, diameter_mm=target.diameter_mm,
        ),
        observations=table,
        sigma0=how["sigma0"],
        rms_px=how["rms_px"],
        redundancy=how["redundancy"],
        num_unknowns=how["unknowns"],
        num_observations=how["image_coordinates"],
        camera_rms_px={name: rms_px(table.residual_px[mask]) for name, mask in of.items()},
        camera_count={name: int(mask.sum()) for name, mask in of.items()},
        parameters_kept=kept,
        rejected=(
            *pictures.rejected,
            *(r for start in starts for r in start.rejected),
            *outcome.rejected,
            *(r for s in outcome.solutions for r in s.rejected),
        ),
        warnings=(
            *pictures.warnings,
            *(w for s in outcome.solutions for w in s.warnings),
            *outcome.warnings,
        ),
        seconds=seconds,
        target_factor=of_points / target_redundancy if target_redundancy > 0 else None,
        target_redundancy=target_redundancy,
        bars=outcome.bars,
        additional=extra,
    )  # fmt: skip


def _how(
    options: CalibrationOptions, outcome: Outcome, rms: float, extra: AdditionalPoints | None
) -> dict[str, Any]:
    """Method, options and statistics, as the rig's file keeps them."""
    adjustments = [s.adjustment for s in outcome.solutions]
    redundancy = sum(a.redundancy for a in adjustments)
    squares = sum(a.sigma0**2 * a.redundancy for a in adjustments)
    how = {
        "method": options.method, "options": asdict(options),
        "sigma0": float(np.sqrt(squares / redundancy)),
        "redundancy": redundancy, "unknowns": sum(a.num_unknowns for a in adjustments),
        "image_coordinates": sum(a.num_observations for a in adjustments),
        "rms_px": rms, **outcome.statistics,
    }  # fmt: skip
    if extra is not None:
        how["additional_points"] = {
            "fixed_to": extra.mode,
            "points": len(extra),
            "observations": len(extra.observations),
        }
    return how


def _of_target(solutions: Sequence[Solution], count: int) -> npt.NDArray[np.bool_]:
    """(M,) which observations are of the target's ``count`` points."""
    return np.concatenate([s.bundle.point_of for s in solutions]) < count


def _additional(
    outcome: Outcome, mode: str, placed: Placed, observations: ObservationTable
) -> AdditionalPoints:
    [solution] = outcome.solutions
    first = len(outcome.position_mm)
    cov = solution.adjustment.sigma0**2 * solution.dispersion.point_cov_mm2[first:]
    return AdditionalPoints(
        mode=mode,
        number=placed.sightings.number,
        stage=placed.sightings.stage,
        position_mm=solution.bundle.network.positions_mm[first:],
        cov_mm2=cov,
        observations=observations,
    )


def adjusted_bars(
    adjustment: Adjustment,
    ends: tuple[IntArray, IntArray],
    length_mm: FloatArray,
    sigma_mm: FloatArray,
    remarks: Sequence[str] = (),
) -> AdjustedBars:
    """Known lengths with what the adjustment says of them; ``remarks``: a few words on each."""
    found = adjustment.scale_bars
    return AdjustedBars(
        point_a=ends[0], point_b=ends[1], length_mm=length_mm, sigma_mm=sigma_mm,
        residual_mm=found.residual_mm, normalised=found.normalised,
        redundancy=found.redundancy, used=found.used,
        certificate=tuple(remarks) or ("",) * len(length_mm),
    )  # fmt: skip


def rig_data(
    cameras: Sequence[CameraFrames],
    starts: Sequence[CameraStart],
    outcome: Outcome,
    how: Mapping[str, Any],
    of_target: bool = False,
) -> RigData:
    """The rig with its covariance; ``of_target``: in the target's frame."""
    sigma = np.sqrt(np.maximum(np.diag(outcome.cov), 0.0)).reshape(len(cameras), -1)
    floors = {
        cameras[camera].name: s.bundle.network.floor_px(index)
        for s in outcome.solutions
        for index, camera in enumerate(s.bundle.camera_of)
    }
    return RigData(
        cameras={
            camera.name: RigCamera(
                image_size_px=camera.image_size_px, interior=outcome.interior[i],
                r0_px=starts[i].model.r0_px, rotation=outcome.cam_from_rig[i][0],
                translation_mm=outcome.cam_from_rig[i][1],
                sigma=dict(zip(CAMERA_PARAMETERS, map(float, sigma[i]), strict=True)),
                interface=outcome.interfaces.get(camera.interface or ""),
            )
            for i, camera in enumerate(cameras)
        },
        reference="target" if of_target else f"camera {cameras[0].name}",
        cov=outcome.cov,
        cov_names=tuple(f"{c.name}/{p}" for c in cameras for p in CAMERA_PARAMETERS),
        sigma_floor_px={camera.name: floors[camera.name] for camera in cameras},
        how=dict(how),
    )  # fmt: skip


def observation_table(solutions: Sequence[Solution], target: PointSet) -> ObservationTable:
    """Every observation that had a known point, used or rejected, (M, 2) per coordinate."""
    pictures = [p for s in solutions for p in s.bundle.pictures]
    counts = [len(p) for p in pictures]
    floor = np.concatenate(
        [
            np.full(len(p), s.bundle.network.floor_px(s.bundle.network_camera(i)))
            for s in solutions
            for i, p in enumerate(s.bundle.pictures)
        ]
    )
    cov = np.concatenate(
        [
            s.bundle.network.cov_scale(s.bundle.network_camera(i)) * p.cov_px2
            for s in solutions
            for i, p in enumerate(s.bundle.pictures)
        ]
    )
    adjustments = [s.adjustment for s in solutions]
    return ObservationTable(
        camera=np.repeat([p.camera for p in pictures], counts).astype(np.int32),
        stage=np.repeat([p.stage for p in pictures], counts).astype(np.int32),
        point_id=target.id[np.concatenate([p.point for p in pictures])].astype(np.int32),
        xy_px=np.concatenate([p.xy_px for p in pictures]),
        sigma_px=np.sqrt(cov[:, [0, 2]] + floor[:, None] ** 2),
        residual_px=np.concatenate([a.residual_px for a in adjustments]),
        normalised=np.concatenate([a.normalised for a in adjustments]),
        redundancy=np.concatenate([a.redundancy_numbers for a in adjustments]),
        used=np.concatenate([a.used for a in adjustments]),
    )
