"""The paper's way: every picture a pose of its own, then the mean relative pose (Eqs. 5-8)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

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

    The rotations' mean is put back into SO(3); standard deviations come from
    the scatter of the stages' relative poses over sqrt(n). The interior
    parameters' covariance is each camera's own.
    """
    solutions, rejected, poses = [], [], []
    for index, camera in enumerate(cameras):
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
    cam_from_rig, exterior_cov, warnings = mean_relative_poses([c.name for c in cameras], poses)
    return Outcome(
        solutions=tuple(solutions),
        interior=[s.bundle.network.interior(0) for s in solutions],
        cam_from_rig=cam_from_rig,
        rig_from_target=_stage_poses(cam_from_rig, poses),
        cov=_camera_covariance(solutions, exterior_cov),
        position_mm=target.position_mm,
        point_cov_mm2=None,
        rejected=(*rig.rejected, *rejected),
        warnings=warnings,
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
        bundle = single_bundle(cameras[index], index, start, kept, poses, target)
        solution = solve(bundle, cameras, f_given, target, options)
        rms = _image_rms(bundle, solution)
        limit = options.max_image_rms_px or IMAGE_RMS_FACTOR * float(np.median(rms))
        worst = int(np.argmax(rms))
        if rms[worst] <= limit or len(kept) <= 1:
            return solution, rejected
        rejected.append(
            Rejection(
                kind="image", camera=cameras[index].name, image=kept[worst].image, point_id=None,
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


def mean_relative_poses(
    names: Sequence[str], poses: Sequence[Mapping[int, Rigid]]
) -> tuple[list[Rigid], FloatArray, list[str]]:
    """cam_from_rig of every camera by Eqs. (7)-(8), and its covariance (6 C, 6 C).

    A camera that shares no stage with the first is tied to the camera with
    which it shares the most; the covariances are propagated along the chain.
    """
    count = len(names)
    placed: dict[int, Rigid] = {0: (np.eye(3), np.zeros(3))}
    cov = np.zeros((6 * count, 6 * count))
    warnings: list[str] = []
    while len(placed) < count:
        # The first camera is preferred wherever it shares a stage.
        shared, _, p, c = max(
            (min(len(set(poses[p]) & set(poses[c])), 1 if p else 10**6), p == 0, p, c)
            for p in placed
            for c in range(count)
            if c not in placed
        )
        stages = sorted(set(poses[p]) & set(poses[c]))
        if shared == 0:
            raise CalibrationError(
                f"camera {names[c]} shares no stage with the others after bad pictures were "
                "dropped; take more positions of the target that both see"
            )
        relative = [compose(poses[c][s], invert(poses[p][s])) for s in stages]  # Eq. (7)
        mean, own_cov = _mean_pose(relative)  # Eq. (8)
        if len(stages) < 2:
            warnings.append(
                f"camera {names[c]} shares one stage only with {names[p]}: the scatter of its "
                "relative pose, and so its standard deviation, is unknown"
            )
        placed[c] = compose(mean, placed[p])
        _propagate(cov, c, p, mean, placed[p], own_cov)
    return [placed[i] for i in range(count)], cov, warnings


def _mean_pose(relative: Sequence[Rigid]) -> tuple[Rigid, FloatArray]:
    rotation = nearest_rotation(np.mean([r for r, _ in relative], axis=0))
    shift = np.mean([t for _, t in relative], axis=0)
    n = len(relative)
    if n < 2:
        return (rotation, shift), np.full((6, 6), np.nan)
    deviation = np.array(
        [np.r_[vector_from_rotation(r @ rotation.T), t - shift] for r, t in relative]
    )
    return (rotation, shift), deviation.T @ deviation / ((n - 1) * n)


def _propagate(
    cov: FloatArray, c: int, p: int, mean: Rigid, parent: Rigid, own: FloatArray
) -> None:
    """Covariance of cam_c_from_rig = mean * cam_p_from_rig into ``cov``.

    w_c = w + R w_p;  d_c = d + R d_p + w x (R t_p).
    """
    turned = mean[0] @ parent[1]
    by_own = np.eye(6)
    by_own[3:, :3] = -np.array(
        [[0, -turned[2], turned[1]], [turned[2], 0, -turned[0]], [-turned[1], turned[0], 0]]
    )
    by_parent = np.kron(np.eye(2), mean[0])
    here, there = slice(6 * c, 6 * c + 6), slice(6 * p, 6 * p + 6)
    cov[here, :] = by_parent @ cov[there, :]
    cov[:, here] = cov[here, :].T
    cov[here, here] = by_own @ own @ by_own.T + by_parent @ cov[there, there] @ by_parent.T


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


def _camera_covariance(solutions: Sequence[Solution], exterior: FloatArray) -> FloatArray:
    count = len(solutions)
    cov = np.zeros((16 * count, 16 * count))
    for c, solution in enumerate(solutions):
        place = solution.dispersion.interior_index[0]
        free = np.flatnonzero(place >= 0)
        cov[np.ix_(16 * c + free, 16 * c + free)] = (
            solution.adjustment.sigma0**2 * solution.dispersion.cov[np.ix_(place[free], place[free])]
        )
    rows = np.concatenate([16 * c + 10 + np.arange(6) for c in range(count)])
    cov[np.ix_(rows, rows)] = exterior
    return cov
