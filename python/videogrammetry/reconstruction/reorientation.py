"""A camera that has moved: its new pose from points that the other cameras see as well."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from videogrammetry.errors import CalibrationError
from videogrammetry.geometry import (
    CAMERA_PARAMETERS,
    full_covariance,
    rotation_from_vector,
    vector_from_rotation,
)
from videogrammetry.reconstruction.camera_scores import (
    CameraScores,
    PointResiduals,
    calibration_factor,
    camera_scores,
    pose_of_motion,
)
from videogrammetry.reconstruction.triangulate import Triangulator
from videogrammetry.types import FloatArray, RigCamera, RigData

_POSE = CAMERA_PARAMETERS[-6:]
#: Three points fix a pose by what they are known to be; more tell a wrong one.
MIN_POINTS = 5
_MOST_STEPS = 30
#: Of the picture: a step below it changes nothing.
_DONE_PX = 1e-6
#: Points of residuals so many times their median, or standard deviations, are left out.
_GROSS = 5.0


@dataclass(frozen=True, kw_only=True)
class RayReorientation:
    """A camera's new pose by the rays of the others.

    Attributes
    ----------
    rig : with the new pose, its covariance and that with all other parameters.
    turn_rad, shift_mm : (3,) from the old pose: about the projection centre (rotation
        vector on the left of cam_from_world), and that centre's way in the rig's frame.
    cov : (6, 6) of turn and shift, from the pictures' noise and the other parameters.
    significance : of the move, in its standard deviations, sqrt(d' cov^-1 d).
    sigma0, rms_px : of the points' residuals. used : (N,) points that took part.
    """

    rig: RigData
    turn_rad: FloatArray
    shift_mm: FloatArray
    cov: FloatArray
    significance: float
    sigma0: float
    rms_px: float
    used: npt.NDArray[np.bool_]


def reorient_by_rays(
    rig: RigData,
    name: str,
    xy_px: npt.ArrayLike,
    variance_px2: npt.ArrayLike,
    systematic: npt.ArrayLike | None = None,
    repeats: float = 1.0,
) -> RayReorientation:
    """The six pose parameters of a camera and the points together, all else held.

    Gauss-Newton on the pose with the points eliminated, N d = g of
    :func:`~videogrammetry.reconstruction.camera_scores.camera_scores`, the points
    intersected anew at every step. With L = B'W P A F of the other cameras and the own
    interior, the estimate errs by N^-1 L z where these err by -F z, so that
    cov = sigma0^2 N^-1 + N^-1 L L' N^-1, and its covariance with them is -N^-1 L F'.

    Parameters
    ----------
    rig : the calibration. name : the camera that has moved.
    xy_px : (N, C, 2) pictures of points in the rig's cameras, NaN where not seen.
    variance_px2 : (N, C, 2). systematic : (N, C) share of it that is the same in
        ``repeats`` pictures of one target, so that these do not average it.

    Raises
    ------
    ValueError : the camera is not in the rig.
    CalibrationError : too few points that two other cameras see, or no pose fits them.
    """
    if name not in rig.cameras:
        raise ValueError(f"camera {name!r} is not in the rig, which has {', '.join(rig.cameras)}")
    index = list(rig.cameras).index(name)
    xy, variance = np.array(xy_px, float), np.array(variance_px2, float)
    share = np.zeros(xy.shape[:2]) if systematic is None else np.asarray(systematic, float)
    seen = np.isfinite(xy).all(axis=2)
    used = seen[:, index] & (np.delete(seen, index, axis=1).sum(axis=1) >= 2)
    old = rig.cameras[name]
    for _ in range(3):
        if used.sum() < MIN_POINTS:
            raise CalibrationError(
                f"camera {name}: {int(used.sum())} points that it and two other cameras see; its "
                f"pose by their rays needs {MIN_POINTS} coded points that are not on one line, or "
                "give static points of known place in [stability] points"
            )
        turned, scores, points = _solve(rig, index, xy[used], variance[used], share[used])
        size = np.sqrt(np.nanmean(points.residual_px**2 / points.variance_px2, axis=(1, 2)))
        gross = size > _GROSS * max(1.0, float(np.median(size)))
        if not gross.any():
            break
        used[np.flatnonzero(used)[gross]] = False
    mine = slice(6 * index, 6 * index + 6)
    normal = scores.normal[0, mine, mine]
    left = float(scores.chi2[0, 0]) / max(float(scores.redundancy[0, 0]) - 6, 1.0)
    factor = max(1.0, left) * (1 + float(scores.systematic[0, index]) * (repeats - 1))
    inverse = np.linalg.inv(normal)
    by_others = inverse @ scores.by_calibration[0, mine]
    cov = factor * inverse + by_others @ by_others.T
    new = turned.cameras[name]
    change = np.concatenate(
        [vector_from_rotation(new.rotation @ old.rotation.T), new.centre_mm - old.centre_mm]
    )
    scale = np.sqrt(np.diag(cov))
    standard = change / scale
    return RayReorientation(
        rig=_with_covariance(rig, name, new, cov, by_others),
        turn_rad=change[:3],
        shift_mm=change[3:],
        cov=cov,
        significance=float(
            np.sqrt(standard @ np.linalg.solve(cov / np.outer(scale, scale), standard))
        ),
        sigma0=float(np.sqrt(left)),
        rms_px=float(np.sqrt(np.nanmean(points.residual_px**2))),
        used=used,
    )


def _solve(
    rig: RigData, index: int, xy: FloatArray, variance: FloatArray, share: FloatArray
) -> tuple[RigData, CameraScores, PointResiduals]:
    """The rig with the new pose, and the scores and residuals there."""
    name = list(rig.cameras)[index]
    others = calibration_factor(_held(rig, name))
    mine = slice(6 * index, 6 * index + 6)
    focal = abs(float(rig.cameras[name].interior[0]))
    for _ in range(_MOST_STEPS):
        points = _residuals(rig, xy, variance, share)
        scores = camera_scores(rig, points, 1, others)
        scale = 1 / np.sqrt(np.diag(scores.normal[0, mine, mine]))
        correlation = scores.normal[0, mine, mine] * np.outer(scale, scale)
        value = np.linalg.eigvalsh(correlation)
        if value[0] < 1e-12 * value[-1]:
            raise CalibrationError(
                f"camera {name}: the points that it shares with two others do not determine its "
                "pose (all on one line?): put more coded targets in view"
            )
        step = scale * np.linalg.solve(correlation, scale * scores.score[0, mine])
        camera = rig.cameras[name]
        rotation = rotation_from_vector(step[:3]) @ camera.rotation
        centre = camera.centre_mm + step[3:]
        moved = replace(camera, rotation=rotation, translation_mm=-rotation @ centre)
        distance = float(np.linalg.norm(np.nanmedian(points.position_mm, axis=0) - centre))
        rig = replace(rig, cameras={**rig.cameras, name: moved})
        size = np.abs(step) * focal / np.repeat([1.0, distance], 3)
        if size.max() < _DONE_PX * max(1.0, float(scores.redundancy[0, 0]) ** 0.5):
            break
    else:
        raise CalibrationError(
            f"camera {name}: no pose brings its rays to those of the other cameras: have several "
            "cameras moved, or are the numbers of the targets wrong?"
        )
    points = _residuals(rig, xy, variance, share)
    return rig, camera_scores(rig, points, 1, others), points


def _residuals(
    rig: RigData, xy: FloatArray, variance: FloatArray, share: FloatArray
) -> PointResiduals:
    seen = np.isfinite(xy[..., 0])
    point, camera = np.nonzero(seen)
    own = variance[point, camera]
    found = Triangulator(rig)(
        np.concatenate([[0], np.cumsum(seen.sum(axis=1))]),
        camera,
        xy[point, camera],
        np.stack([own[:, 0], np.zeros(len(own)), own[:, 1]], axis=1),
    )
    residual = np.full(xy.shape, np.nan)
    residual[point, camera] = found["residual_px"]
    good = np.asarray(found["status"]) == 0
    residual[~good] = np.nan
    return PointResiduals(
        look=np.zeros(len(xy), np.int32),
        position_mm=np.where(good[:, None], found["position_mm"], 0.0),
        residual_px=residual,
        variance_px2=variance,
        systematic=share,
    )


def _held(rig: RigData, name: str) -> RigData:
    """The rig with the covariance of all parameters but the pose of one camera."""
    if rig.cov is None:
        return rig
    pose = [k for k, n in enumerate(rig.cov_names) if n in {f"{name}/{p}" for p in _POSE}]
    cov = rig.cov.copy()
    cov[pose] = 0.0
    cov[:, pose] = 0.0
    return replace(rig, cov=cov)


def _with_covariance(
    rig: RigData, name: str, new: RigCamera, cov: FloatArray, by_others: FloatArray
) -> RigData:
    """The rig with a camera's new pose and its covariance, also with all other parameters."""
    by_motion = pose_of_motion(new)
    of_pose = by_motion @ cov @ by_motion.T
    own = dict(zip(_POSE, np.sqrt(np.diag(of_pose)).tolist(), strict=True))
    cameras = {**rig.cameras, name: replace(new, sigma={**new.sigma, **own})}
    if rig.cov is None:
        return replace(rig, cameras=cameras)
    total = full_covariance(_held(rig, name))
    begin = len(CAMERA_PARAMETERS) * list(rig.cameras).index(name) + len(CAMERA_PARAMETERS) - 6
    pose = slice(begin, begin + 6)
    cross = -by_motion @ by_others @ calibration_factor(_held(rig, name)).T
    total[pose], total[:, pose] = cross, cross.T
    total[pose, pose] = of_pose
    names = tuple(f"{camera}/{p}" for camera in rig.cameras for p in CAMERA_PARAMETERS)
    return replace(rig, cameras=cameras, cov=total, cov_names=names)
