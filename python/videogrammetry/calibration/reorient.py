"""A camera that has moved since the calibration: its new pose from points that stand still."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from videogrammetry.adjustment import Adjustment, AdjustOptions, Network, resect
from videogrammetry.calibration.pictures import MIN_POINTS
from videogrammetry.errors import CalibrationError
from videogrammetry.geometry import (
    CAMERA_PARAMETERS,
    camera_model,
    vector_from_rotation,
)
from videogrammetry.types import INTERIOR_NAMES, FloatArray, RigCamera, RigData

_LEFT_PX = 20.0
_POSE = len(CAMERA_PARAMETERS) - len(INTERIOR_NAMES)


@dataclass(frozen=True, kw_only=True)
class Reorientation:
    """A camera's new pose.

    Attributes
    ----------
    rig : the rig with the camera's new ``cam_from_world``, its covariance carried on.
    turn_rad, shift_mm : (3,) from the old pose to the new one: rotation vector on the left
        of cam_from_world, and the projection centre's way in the world.
    cov : (6, 6) of the new pose (rotation vector on the left, rad; translation, mm), from
        the image points, the points and the interior parameters together.
    significance : the move in its standard deviations, sqrt(d' cov^-1 d) of the six.
    sigma0, rms_px, used : of the resection; ``used`` (N,) False where rejected.
    """

    rig: RigData
    turn_rad: FloatArray
    shift_mm: FloatArray
    cov: FloatArray
    significance: float
    sigma0: float
    rms_px: float
    used: npt.NDArray[np.bool_]


def reorient_camera(
    rig: RigData,
    name: str,
    points_mm: npt.ArrayLike,
    point_cov_mm2: npt.ArrayLike,
    xy_px: npt.ArrayLike,
    cov_px2: npt.ArrayLike,
    *,
    critical_value: float = 4.0,
) -> Reorientation:
    """The six exterior parameters of a camera from points of known place.

    Resection of one picture (or of the mean of several) with the interior held:
    min v'Pv over pose and points, the points weighted by their covariance; Baarda's test
    removes points that have moved. What the interior's errors do to the pose,
    dp/di = -N^-1 A'PB, is found by differences and added through the rig's covariance.

    Parameters
    ----------
    rig : the calibration. name : the camera.
    points_mm : (N, 3) in the rig's frame, point_cov_mm2 : (N, 3, 3).
    xy_px : (N, 2) their pictures, NaN where not seen; cov_px2 : (N, 3) xx, xy, yy.

    Raises
    ------
    ValueError : the camera is not in the rig, or arrays differ in length.
    CalibrationError : fewer than four points, or none that fits.
    """
    if name not in rig.cameras:
        raise ValueError(f"camera {name!r} is not in the rig, which has {', '.join(rig.cameras)}")
    points = np.reshape(np.asarray(points_mm, float), (-1, 3))
    cov = np.reshape(np.asarray(point_cov_mm2, float), (-1, 3, 3))
    xy = np.reshape(np.asarray(xy_px, float), (-1, 2))
    xy_cov = np.reshape(np.asarray(cov_px2, float), (-1, 3))
    if not len(points) == len(cov) == len(xy) == len(xy_cov):
        raise ValueError(
            f"points: {len(points)} places, {len(cov)} covariances, {len(xy)} pictures and "
            f"{len(xy_cov)} of their covariances; expected as many of each"
        )
    seen = np.flatnonzero(np.isfinite(xy).all(axis=1) & np.isfinite(points).all(axis=1))
    if len(seen) < MIN_POINTS:
        raise CalibrationError(
            f"camera {name}: {len(seen)} points of known place in its picture; a pose needs "
            f"{MIN_POINTS} that are not on one line: put more static targets in view"
        )
    camera = rig.cameras[name]
    sight = _Sight(camera, points[seen], cov[seen], xy[seen], xy_cov[seen])
    start = _start(sight, name)
    adjustment, pose, inner = sight.adjust(camera.interior, start, critical_value)
    good = np.flatnonzero(adjustment.used)
    if len(good) < max(MIN_POINTS, 0.5 * len(seen)):
        raise CalibrationError(
            f"camera {name}: only {len(good)} of {len(seen)} points agree with one pose; have "
            "the static points moved too, or are their numbers wrong?"
        )
    factor = max(1.0, adjustment.sigma0**2)
    total, by_interior = _with_interior(rig, name, sight.of(good), pose, factor * inner)
    difference = np.concatenate(
        [vector_from_rotation(pose[0] @ camera.rotation.T), pose[1] - camera.translation_mm]
    )
    scale = np.sqrt(np.diag(total))
    standard = difference / scale
    correlation = total / np.outer(scale, scale)
    used = np.zeros(len(points), dtype=bool)
    used[seen[good]] = True
    moved = replace(camera, rotation=pose[0], translation_mm=pose[1])
    return Reorientation(
        rig=_moved_rig(rig, name, moved, total, by_interior),
        turn_rad=difference[:3],
        shift_mm=moved.centre_mm - camera.centre_mm,
        cov=total,
        significance=float(np.sqrt(standard @ np.linalg.solve(correlation, standard))),
        sigma0=adjustment.sigma0,
        rms_px=float(np.sqrt(np.mean(adjustment.residual_px[good] ** 2))),
        used=used,
    )


@dataclass(frozen=True)
class _Sight:
    """Points of known place and their pictures in one camera."""

    camera: RigCamera
    points_mm: FloatArray
    cov_mm2: FloatArray
    xy_px: FloatArray
    cov_px2: FloatArray

    def of(self, rows: npt.NDArray[np.intp]) -> _Sight:
        return _Sight(
            self.camera, self.points_mm[rows], self.cov_mm2[rows], self.xy_px[rows],
            self.cov_px2[rows],
        )  # fmt: skip

    def adjust(
        self, interior: FloatArray, start: tuple[FloatArray, FloatArray], critical_value: float
    ) -> tuple[Adjustment, tuple[FloatArray, FloatArray], FloatArray]:
        """Resection with a given interior: adjustment, pose and its covariance (6, 6)."""
        network = Network()
        lens = replace(
            self.camera, interior=interior, rotation=np.eye(3), translation_mm=np.zeros(3)
        )
        window = self.camera.interface
        number = network.add_camera(
            "camera", lens, free=(),
            interface=None if window is None else network.add_interface(window),
        )  # fmt: skip
        pose = network.add_pose("pose", *start)
        network.add_image("picture", number, inner=pose)
        n = len(self.points_mm)
        # A coordinate stated without error would make the weights infinite.
        size = float(np.linalg.norm(np.ptp(self.points_mm, axis=0)))
        network.set_points(
            np.arange(n), self.points_mm, self.cov_mm2 + np.eye(3) * (1e-7 * size) ** 2
        )
        network.set_observations(np.zeros(n), np.arange(n), self.xy_px, self.cov_px2)
        adjustment = network.adjust(
            AdjustOptions(critical_value=critical_value, num_threads=1)
            if critical_value > 0
            else AdjustOptions(
                critical_value=0.0, estimate_floor=False, robust_start=False, num_threads=1
            )
        )
        dispersion = network.dispersion()
        first = int(dispersion.pose_index[pose])
        block = slice(first, first + _POSE)
        return adjustment, network.pose(pose), dispersion.cov[block, block]


def _start(sight: _Sight, name: str) -> tuple[FloatArray, FloatArray]:
    """The old pose if it still fits roughly, else a resection anew."""
    found = resect(camera_model(sight.camera), sight.points_mm, sight.xy_px, threshold_px=_LEFT_PX)
    if not found:
        raise CalibrationError(
            f"camera {name}: no pose brings half of its {len(sight.points_mm)} known points within "
            f"{_LEFT_PX:.0f} px: wrong numbers, another lens, or points that have moved"
        )
    # Of a plane's two poses the one nearer to where the camera stood.
    best = [c for c in found if c.cost_px2 < 4.0 * found[0].cost_px2 + 0.01]
    near = min(
        best,
        key=lambda c: float(
            np.linalg.norm(vector_from_rotation(c.rotation @ sight.camera.rotation.T))
        ),
    )
    return near.rotation, near.translation_mm


def _with_interior(
    rig: RigData,
    name: str,
    sight: _Sight,
    pose: tuple[FloatArray, FloatArray],
    cov: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """The pose's covariance with the interior's part, and the pose's derivatives (6, 10) by it."""
    by_interior = np.zeros((_POSE, len(INTERIOR_NAMES)))
    if rig.cov is None:
        return cov, by_interior
    places = [rig.cov_names.index(f"{name}/{p}") for p in INTERIOR_NAMES]
    own = rig.cov[np.ix_(places, places)]
    camera = rig.cameras[name]
    for k, sigma in enumerate(np.sqrt(np.diag(own))):
        if sigma == 0:
            continue
        change = sigma * np.eye(len(INTERIOR_NAMES))[k]
        ends = [sight.adjust(camera.interior + sign * change, pose, 0.0)[1] for sign in (0.5, -0.5)]
        turn = vector_from_rotation(ends[0][0] @ ends[1][0].T)
        by_interior[:, k] = np.concatenate([turn, ends[0][1] - ends[1][1]]) / sigma
    return cov + by_interior @ own @ by_interior.T, by_interior


def _moved_rig(
    rig: RigData, name: str, moved: RigCamera, cov: FloatArray, by_interior: FloatArray
) -> RigData:
    """The rig with the new pose; its covariance with the others is the interior's share."""
    own = dict(zip(CAMERA_PARAMETERS[-_POSE:], np.sqrt(np.diag(cov)).tolist(), strict=True))
    sigma = {**moved.sigma, **own}
    cameras = {**rig.cameras, name: replace(moved, sigma=sigma)}
    if rig.cov is None:
        return replace(rig, cameras=cameras)
    pose = [rig.cov_names.index(f"{name}/{p}") for p in CAMERA_PARAMETERS[-_POSE:]]
    interior = [rig.cov_names.index(f"{name}/{p}") for p in INTERIOR_NAMES]
    total = rig.cov.copy()
    cross = by_interior @ rig.cov[interior]
    total[pose] = cross
    total[:, pose] = cross.T
    total[np.ix_(pose, pose)] = cov
    return replace(rig, cameras=cameras, cov=total)


__all__ = ["Reorientation", "reorient_camera"]
