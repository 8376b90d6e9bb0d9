"""What a measurement is made of: trajectories, their motion, the targets, the cameras."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from videogrammetry.types.arrays import FloatArray, IntArray

#: What is said of a point at a stage, the bits of ``Trajectories.flags`` from the lowest.
POINT_FLAGS = (
    "two_rays",  # 1: no third ray that could contradict
    "large_residual",  # 2: the rays miss each other by more than noise and calibration explain
    "outside_volume",  # 4: beyond where the calibration was
    "ambiguous",  # 8: another match or another identity is not much less likely
    "filled",  # 16: not measured, estimated from other stages or neighbours
    "unstable_camera",  # 32: seen by a camera that has moved since the calibration
)

#: Stands for flags that were not given.
_NO_FLAGS = np.empty(0, np.uint8)


@dataclass(frozen=True, kw_only=True)
class Trajectories:
    """Points over stages; NaN where a point was not measured.

    Attributes
    ----------
    stage : (S,) numbers from 1. time_s : (S,), NaN without a frame rate.
    point_id : (P,). position_mm : (S, P, 3).
    cov_mm2 : (S, P, 6) image noise and calibration, order ``COV6_ORDER``.
    cov_image_mm2 : (S, P, 6) the image noise's part alone.
    cameras_used : (S, P, C) bool. rms_px : (S, P).
    camera_names : (C,).
    flags : (S, P) uint8, bits by ``POINT_FLAGS``; 0 where nothing is said.
    """

    stage: IntArray
    time_s: FloatArray
    point_id: IntArray
    position_mm: FloatArray
    cov_mm2: FloatArray
    cov_image_mm2: FloatArray
    cameras_used: npt.NDArray[np.bool_]
    rms_px: FloatArray
    camera_names: tuple[str, ...]
    flags: npt.NDArray[np.uint8] = field(default_factory=lambda: _NO_FLAGS)

    def __post_init__(self) -> None:
        if self.flags is _NO_FLAGS:
            object.__setattr__(self, "flags", np.zeros(self.rms_px.shape, np.uint8))


@dataclass(frozen=True, kw_only=True)
class Motion:
    """Motion of points and of their centroid; NaN where it is not defined.

    Shapes: (S, P, 3) for points, (S, 3) for the centroid, covariances
    (S, P, 6) or (S, 6) in the order ``COV6_ORDER``. ``step_mm`` is Eq. (10),
    X(i+1) - X(i) stored at stage i; ``displacement_mm`` is against
    ``reference_stage``; ``velocity_mm_s`` is Eq. (11). Covariances are of the
    image noise: the calibration's error is common to both ends of a
    difference and cancels but for what it does to a length of that size.

    ``centroid_mm`` is Eq. (12) over ``centroid_points``, the same points at
    every stage; ``centroid_cov_mm2`` contains the calibration, taken as common
    to all points.
    """

    reference_stage: int
    step_mm: FloatArray
    step_cov_mm2: FloatArray
    displacement_mm: FloatArray
    displacement_cov_mm2: FloatArray
    velocity_mm_s: FloatArray
    velocity_cov_mm2_s2: FloatArray
    centroid_points: IntArray
    centroid_mm: FloatArray
    centroid_cov_mm2: FloatArray
    centroid_displacement_mm: FloatArray
    centroid_displacement_cov_mm2: FloatArray
    centroid_velocity_mm_s: FloatArray
    centroid_velocity_cov_mm2_s2: FloatArray


@dataclass(frozen=True, kw_only=True)
class TargetRecords:
    """Every target seen in a measurement, one row each.

    ``point_id`` is the trajectory that the target went into, -1 = none;
    ``match_status`` by ``matching.TARGET_STATUS``; ``ring_status`` by
    ``recognition.RING_STATUS``.
    """

    stage: IntArray
    camera: IntArray
    centre_px: FloatArray
    semi_axes_px: FloatArray
    angle_rad: FloatArray
    sigma_px: FloatArray
    code_id: IntArray
    point_id: IntArray
    residual_px: FloatArray
    match_status: npt.NDArray[np.uint8]
    ring_status: npt.NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.stage)


@dataclass(frozen=True, kw_only=True)
class CameraSeries:
    """How far every camera seems to have moved since the first stages.

    Every camera by itself, as if it alone had; over the last 16 looks (of the first the
    later half, against the earlier), against the first 40; NaN at the first look.

    Attributes
    ----------
    stage : (K,) of every fourth look.
    turn_rad, shift_mm : (K, C, 3) turn about the projection centre, as a rotation vector
        on the left of cam_from_world, and the centre's shift in the rig's frame;
        sigma_turn_rad, sigma_shift_mm : their standard deviations.
    chi2 : (K, C) of the six. critical_chi2 : above it a camera has moved.
    """

    stage: IntArray
    turn_rad: FloatArray
    shift_mm: FloatArray
    sigma_turn_rad: FloatArray
    sigma_shift_mm: FloatArray
    chi2: FloatArray
    critical_chi2: float


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """Everything that ``measure`` found: what measurement.h5 holds.

    ``image_name[c][s]`` is the picture of camera c at the s-th stage;
    ``provenance`` has version, options, hashes of the inputs and time;
    ``flag_meanings`` names the values of ``targets.match_status`` and
    ``targets.ring_status``; ``stability`` is of the cameras, None where it was not looked at.
    """

    trajectories: Trajectories
    motion: Motion
    targets: TargetRecords
    image_name: tuple[tuple[str, ...], ...]
    frame_rate_hz: float | None = None
    provenance: Mapping[str, Any] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    flag_meanings: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    stability: CameraSeries | None = None
