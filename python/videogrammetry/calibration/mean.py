"""The paper's way: every picture a pose of its own, then the mean relative pose (Eqs. 5-8)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from videogrammetry.calibration.bundle import Bundle, rms_px, single_bundle
from videogrammetry.calibration.linking import Rigid, RigStart, compose, invert
from videogrammetry.calibration.pictures import Picture, Pictures
from videogrammetry.calibration.result import Outcome
from videogrammetry.calibration.run import CalibrationOptions, CameraFrames, Rejection
from videogrammetry.calibration.solving import Solution, solve
from videogrammetry.calibration.start import CameraStart
from videogrammetry.errors import CalibrationError
from videogrammetry.geometry import nearest_rotation, vector_from_rotation
from videogrammetry.types import FloatArray, PointSet

#: A picture whose residuals exceed the median picture's so many times is dropped.
IMAGE_RMS_FACTOR = 3.0


def calibrate_mean(
    cameras: Sequence[CameraFrames],
    starts: Sequence[CameraStart],
    rig: RigStart,
    pictures: Pictures,
    target: PointSet,
    options: CalibrationOptions,
) -> Outcome:
    """Each camera alone with fixed target points, then Eqs. (7) and (8).

    The rotations' mean is put back into SO(3). The covariance of a pose is the
    stages' scatter over n (the paper's, in ``how["pose_scatter"]``) plus what
    the uncertainty of the interior parameters does to all stages alike: the
    scatter alone understates the error many times.
    """
    solutions, rejected, poses = [], [], []
    for index in range(len(cameras)):
        own = [p for p in pictures.of_camera(index) if p.stage in starts[index].poses]
        start_poses = {
            p.stage: compose(rig.cam_from_rig[index], rig.rig_from_target[p.stage]) for p in own
        }
        solution, dropped = _solve_camera(
            cameras, index, starts[index], own, start_poses, target, options
        )
        solutions.append(solution)
        rejected += dropped
        network = solution.bundle.network
        poses.append({s: network.pose(k) for s, k in solution.bundle.stage_pose.items()})
    mean = mean_relative_poses(
        [c.name for c in cameras], poses, [_by_interior(s) for s in solutions]
    )
    return Outcome(
        solutions=tuple(solutions),
        interior=[s.bundle.network.interior(0) for s in solutions],
        cam_from_rig=mean.cam_from_rig,
        rig_from_target=_stage_poses(mean.cam_from_rig, poses),
        cov=_camera_covariance(solutions, mean),
        position_mm=target.position_mm,
        point_cov_mm2=None,
        rejected=(*rig.rejected, *rejected),
        warnings=mean.warnings,
        statistics={"pose_scatter": mean.scatter},
    )


def _solve_camera(
    cameras: Sequence[CameraFrames],
    index: int,
    start: CameraStart,
    pictures: Sequence[Picture],
    poses: Mapping[int, Rigid],
    target: PointSet,
    options: CalibrationOptions,
) -> tuple[Solution, list[Rejection]]:
    """One camera's bundle; pictures with large residuals dropped, largest first, and named."""
    rejected: list[Rejection] = []
    kept = list(pictures)
    f_given = [start.f_given] * len(cameras)
    while True:
        bundle = single_bundle(
            cameras[index], index, start, kept, poses, target, options.eccentricity
        )
        solution = solve(bundle, cameras, f_given, target, options)
        rms = _image_rms(bundle, solution)
        limit = options.max_image_rms_px or IMAGE_RMS_FACTOR * float(np.median(rms))
        worst = int(np.argmax(rms))
        if rms[worst] <= limit or len(kept) <= 1:
            return solution, rejected
        rejected.append(
            Rejection(
                kind="image",
                camera=cameras[index].name,
                image=kept[worst].image,
                point_id=None,
                value=float(rms[worst]),
                reason=f"RMS residual {rms[worst]:.3f} px exceeds {limit:.3f} px",
            )  # fmt: skip
        )
        del kept[worst]


def _image_rms(bundle: Bundle, solution: Solution) -> FloatArray:
    images = bundle.image_of
    # Rejected points count: a picture is judged by all that was read in it.
    return np.array(
        [rms_px(solution.adjustment.residual_px[images == i]) for i in range(len(bundle.pictures))]
    )


@dataclass(frozen=True, kw_only=True)
class MeanPoses:
    """Mean relative poses and what is known of their errors.

    Attributes
    ----------
    cam_from_rig : per camera.
    cov : (6 C, 6 C) from the stages' scatter over n: what averages out.
    by_interior : (6 C, 10 C) how the poses answer to errors of the interior
        parameters, which all stages have in common and no scatter shows.
    scatter : camera -> its six scatter / sqrt(n) (rx...tz), as the paper has it.
    """

    cam_from_rig: list[Rigid]
    cov: FloatArray
    by_interior: FloatArray
    scatter: dict[str, list[float]]
    warnings: list[str]


def mean_relative_poses(
    names: Sequence[str],
    poses: Sequence[Mapping[int, Rigid]],
    by_interior: Sequence[Mapping[int, FloatArray]],
) -> MeanPoses:
    """cam_from_rig of every camera by Eqs. (7)-(8).

    A camera that shares no stage with the first is tied to the camera with
    which it shares the most; the covariances are propagated along the chain.

    Parameters
    ----------
    names : the cameras.
    poses : per camera, stage -> cam_from_target.
    by_interior : per camera, stage -> (6, 10) derivative of that pose by the
        camera's interior parameters, everything re-adjusted.
    """
    count = len(names)
    placed: dict[int, Rigid] = {0: (np.eye(3), np.zeros(3))}
    cov = np.zeros((6 * count, 6 * count))
    response = np.zeros((6 * count, 10 * count))
    scatter: dict[str, list[float]] = {}
    warnings = [
        "mean: the target's coordinates are taken for exact, so that their errors, common to all "
        "pictures, are in no standard deviation; the method joint has them"
    ]
    while len(placed) < count:
        # The first camera is preferred wherever it shares a stage.
        _, shared, p, c = max(
            (p == 0 and bool(set(poses[0]) & set(poses[c])), len(set(poses[p]) & set(poses[c])),
             -p, -c)
            for p in placed
            for c in range(count)
            if c not in placed
        )  # fmt: skip
        p, c = -p, -c
        if shared == 0:
            raise CalibrationError(
                f"camera {names[c]} shares no stage with the others after bad pictures were "
                "dropped; take more positions of the target that both see"
            )
        stages = sorted(set(poses[p]) & set(poses[c]))
        relative = [compose(poses[c][s], invert(poses[p][s])) for s in stages]  # Eq. (7)
        mean, own_cov = _mean_pose(relative)  # Eq. (8)
        scatter[names[c]] = [float(x) for x in np.sqrt(np.diag(own_cov))]
        if len(stages) < 2:
            warnings.append(
                f"camera {names[c]} shares one stage only with {names[p]}: the scatter of its "
                "relative pose, and so its standard deviation, is unknown"
            )
        own = np.zeros((6, 10 * count))
        for s, (rotation, _) in zip(stages, relative, strict=True):
            by_c, by_p = _relative_jacobians(rotation, poses[p][s][1])
            own[:, 10 * c : 10 * c + 10] += by_c @ by_interior[c][s] / len(stages)
            own[:, 10 * p : 10 * p + 10] += by_p @ by_interior[p][s] / len(stages)
        by_own, by_parent = _chain_jacobians(mean, placed[p])
        placed[c] = compose(mean, placed[p])
        here, there = slice(6 * c, 6 * c + 6), slice(6 * p, 6 * p + 6)
        cov[here, :] = by_parent @ cov[there, :]
        cov[:, here] = cov[here, :].T
        cov[here, here] = by_own @ own_cov @ by_own.T + by_parent @ cov[there, there] @ by_parent.T
        response[here] = by_own @ own + by_parent @ response[there]
    return MeanPoses(
        cam_from_rig=[placed[i] for i in range(count)], cov=cov, by_interior=response,
        scatter=scatter, warnings=warnings,
    )  # fmt: skip


def _cross(v: FloatArray) -> FloatArray:
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def _relative_jacobians(rotation: FloatArray, shift_p: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Derivatives of Eq. (7)'s pose by both pictures' poses (w on the left, d).

    R' = Rc Rp^-1:  w' = wc - R' wp;   T' = Tc - R' Tp:  d' = dc - R' dp - w' x (R' Tp).
    """
    by_c, by_p = np.eye(6), np.zeros((6, 6))
    by_p[:3, :3] = by_p[3:, 3:] = -rotation
    lever = _cross(rotation @ shift_p)  # -w' x v = [v] w'
    by_c[3:, :3] = lever
    by_p[3:, :3] = -lever @ rotation
    return by_c, by_p


def _chain_jacobians(mean: Rigid, parent: Rigid) -> tuple[FloatArray, FloatArray]:
    """Derivatives of mean * parent: w = wm + R wp;  d = dm + R dp + wm x (R tp)."""
    by_own = np.eye(6)
    by_own[3:, :3] = -_cross(mean[0] @ parent[1])
    by_parent: FloatArray = np.asarray(np.kron(np.eye(2), mean[0]), dtype=np.float64)
    return by_own, by_parent


def _mean_pose(relative: Sequence[Rigid]) -> tuple[Rigid, FloatArray]:
    rotation = nearest_rotation(np.mean([r for r, _ in relative], axis=0))
    shift: FloatArray = np.asarray(np.mean([t for _, t in relative], axis=0))
    n = len(relative)
    if n < 2:
        return (rotation, shift), np.full((6, 6), np.nan)
    deviation = np.array(
        [np.r_[vector_from_rotation(r @ rotation.T), t - shift] for r, t in relative]
    )
    cov: FloatArray = np.asarray(deviation.T @ deviation / ((n - 1) * n))
    return (rotation, shift), cov


def _stage_poses(
    cam_from_rig: Sequence[Rigid], poses: Sequence[Mapping[int, Rigid]]
) -> dict[int, Rigid]:
    """rig_from_target of every stage: the mean of what its cameras say."""
    result = {}
    for stage in sorted(set().union(*poses)):
        seen = [
            compose(invert(cam_from_rig[c]), own[stage])
            for c, own in enumerate(poses)
            if stage in own
        ]
        result[stage] = _mean_pose(seen)[0]
    return result


def _interior_covariance(solution: Solution) -> FloatArray:
    place = solution.dispersion.interior_index[0]
    free = np.flatnonzero(place >= 0)
    cov = np.zeros((10, 10))
    cov[np.ix_(free, free)] = solution.dispersion.cov[np.ix_(place[free], place[free])]
    return solution.adjustment.sigma0**2 * cov


def _by_interior(solution: Solution) -> dict[int, FloatArray]:
    """Per stage, d pose / d interior = Q_pose,interior Q_interior^-1, (6, 10)."""
    dispersion = solution.dispersion
    place = dispersion.interior_index[0]
    free = np.flatnonzero(place >= 0)
    result = {}
    inner = dispersion.cov[np.ix_(place[free], place[free])]
    scale = 1.0 / np.sqrt(np.diag(inner)) if free.size else np.zeros(0)
    inverse = scale[:, None] * np.linalg.pinv(scale[:, None] * inner * scale) * scale
    for stage, pose in solution.bundle.stage_pose.items():
        result[stage] = np.zeros((6, 10))
        first = int(dispersion.pose_index[pose])
        if first >= 0 and free.size:
            across = dispersion.cov[first : first + 6][:, place[free]]
            result[stage][:, free] = across @ inverse
    return result


def _camera_covariance(solutions: Sequence[Solution], mean: MeanPoses) -> FloatArray:
    """Interior: each camera's own; exterior: scatter plus what the interior's errors do to all."""
    count = len(solutions)
    interior = np.zeros((10 * count, 10 * count))
    for c, solution in enumerate(solutions):
        block = slice(10 * c, 10 * c + 10)
        interior[block, block] = _interior_covariance(solution)
    inner = np.concatenate([16 * c + np.arange(10) for c in range(count)])
    outer = np.concatenate([16 * c + 10 + np.arange(6) for c in range(count)])
    across = mean.by_interior @ interior
    cov = np.zeros((16 * count, 16 * count))
    cov[np.ix_(inner, inner)] = interior
    cov[np.ix_(outer, inner)] = across
    cov[np.ix_(inner, outer)] = across.T
    cov[np.ix_(outer, outer)] = mean.cov + across @ mean.by_interior.T
    return cov
