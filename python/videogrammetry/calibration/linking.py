"""Relative poses of the cameras and poses of the stages: the rig's start values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from videogrammetry.adjustment import PoseCandidate
from videogrammetry.calibration.pictures import Picture
from videogrammetry.calibration.run import Rejection
from videogrammetry.calibration.start import CameraStart
from videogrammetry.errors import CalibrationError
from videogrammetry.geometry import nearest_rotation, project
from videogrammetry.types import FloatArray, PointSet

#: Relative poses of one pair of cameras that differ by more belong to a wrong
#: candidate of a stage; a resection in a narrow field scatters by less.
SAME_RAD = 0.1
#: A picture further from its stage's pose (median, in gates of the start) does not belong to it.
MISFIT_GATES = 6.0

Rigid = tuple[FloatArray, FloatArray]


def compose(a: Rigid, b: Rigid) -> Rigid:
    """a_from_c of a_from_b and b_from_c."""
    return a[0] @ b[0], a[0] @ b[1] + a[1]


def invert(a: Rigid) -> Rigid:
    """b_from_a of a_from_b."""
    return a[0].T, -a[0].T @ a[1]


@dataclass(frozen=True, kw_only=True)
class RigStart:
    """Start values of the rig.

    ``cam_from_rig`` per camera (the reference's is the identity),
    ``rig_from_target`` per stage; ``doubtful``: stages whose mirrored pose fits
    nearly as well, with that pose; ``rejected``: pictures (camera, stage) that
    do not fit their stage.
    """

    cam_from_rig: list[Rigid]
    rig_from_target: dict[int, Rigid]
    doubtful: dict[int, Rigid]
    rejected: tuple[Rejection, ...]
    dropped: frozenset[tuple[int, int]]


def link_cameras(
    names: Sequence[str],
    starts: Sequence[CameraStart],
    pictures: Sequence[Picture],
    seen_target: Sequence[PointSet],
) -> RigStart:
    """Tie all cameras to the first one through the stages they share.

    ``seen_target``: the target as it seems to lie to each camera (through a window
    into a fluid nearer than it is).

    The pair with the most shared stages goes first (a maximum spanning tree).
    Of each picture's one or two pose candidates those are taken that make the
    relative pose constant; the stage's pose is the one that fits all cameras.

    Raises
    ------
    CalibrationError : a camera that no chain of shared stages ties to the first.
    """
    cam_from_rig: list[Rigid | None] = [None] * len(starts)
    cam_from_rig[0] = (np.eye(3), np.zeros(3))
    stages = [set(start.poses) for start in starts]
    while any(pose is None for pose in cam_from_rig):
        shared, placed, loose = max(
            (len(stages[p] & stages[c]), -p, -c)
            for p, c in product(range(len(starts)), repeat=2)
            if cam_from_rig[p] is not None and cam_from_rig[c] is None
        )
        if shared == 0:
            _raise_unlinked(names, starts, [pose is not None for pose in cam_from_rig])
        p, c = -placed, -loose
        base = cam_from_rig[p]
        assert base is not None
        cam_from_rig[c] = compose(_relative_pose((names[c], names[p]), starts[c], starts[p]), base)
    cams = [pose for pose in cam_from_rig if pose is not None]
    rig_from_target: dict[int, Rigid] = {}
    doubtful: dict[int, Rigid] = {}
    rejected = []
    dropped = set()
    for stage in sorted(set().union(*stages)):
        seen = [p for p in pictures if p.stage == stage and stage in starts[p.camera].poses]
        best, twin = _stage_pose(seen, starts, cams, seen_target)
        rig_from_target[stage] = best
        if twin is not None:
            doubtful[stage] = twin
        for picture in seen:
            start = starts[picture.camera]
            pose = compose(cams[picture.camera], best)
            misfit = _misfit_px(start, pose, picture, seen_target[picture.camera])
            if misfit > MISFIT_GATES * start.gate_px:
                dropped.add((picture.camera, stage))
                rejected.append(
                    Rejection(
                        kind="image",
                        camera=names[picture.camera],
                        image=picture.image,
                        point_id=None,
                        value=misfit,
                        reason=f"disagrees with the other cameras' pictures of stage {stage} by "
                        f"about {misfit:.0f} px: not synchronous, or the camera moved",
                    )  # fmt: skip
                )
    return RigStart(
        cam_from_rig=cams, rig_from_target=rig_from_target, doubtful=doubtful,
        rejected=tuple(rejected), dropped=frozenset(dropped),
    )  # fmt: skip


def _raise_unlinked(
    names: Sequence[str], starts: Sequence[CameraStart], placed: Sequence[bool]
) -> None:
    inside = [n for n, is_in in zip(names, placed, strict=True) if is_in]
    outside = [n for n, is_in in zip(names, placed, strict=True) if not is_in]
    camera = names.index(outside[0])
    own = sorted(starts[camera].poses)
    theirs = sorted(set().union(*(starts[i].poses for i, is_in in enumerate(placed) if is_in)))
    nearest = min(((abs(a - b), a, b) for a in own for b in theirs), default=None)
    hint = f" (its stage {nearest[1]}, theirs {nearest[2]} is the nearest)" if nearest else ""
    raise CalibrationError(
        f"camera {', '.join(outside)} cannot be tied to {', '.join(inside)}: there is no stage at "
        f"which both see at least four points of the target{hint}. Camera {outside[0]} has usable "
        f"pictures of stages {_ranges(own)}, the others of {_ranges(theirs)}. Take at least one "
        "more synchronous position of the target in which both sides see it, or check that equal "
        "stages of the sequences are synchronous"
    )


def _ranges(numbers: Sequence[int]) -> str:
    """1, 2, 3, 7 as "1-3, 7"."""
    parts: list[list[int]] = []
    for n in numbers:
        if parts and n == parts[-1][-1] + 1:
            parts[-1][-1:] = [parts[-1][-1], n] if len(parts[-1]) == 1 else [n]
        else:
            parts.append([n])
    return ", ".join("-".join(map(str, p)) for p in parts) or "none"


def _angle(a: FloatArray, b: FloatArray) -> FloatArray:
    """Angles between rotations (..., 3, 3), broadcast."""
    # |A - B|_F = 2 sqrt(2) sin(angle / 2)
    norm = np.sqrt(np.sum((a - b) ** 2, axis=(-2, -1)))
    result: FloatArray = 2.0 * np.arcsin(np.clip(norm / np.sqrt(8.0), 0.0, 1.0))
    return result


def _relative_pose(names: tuple[str, str], camera: CameraStart, other: CameraStart) -> Rigid:
    """camera_from_other: consensus over the shared stages and their candidates.

    Raises
    ------
    CalibrationError : no relative pose holds for most of the shared stages.
    """
    rotations, shifts, stage_of, excess = [], [], [], []
    for stage in sorted(set(camera.poses) & set(other.poses)):
        for a, b in product(camera.poses[stage], other.poses[stage]):
            rotation, shift = compose(
                (a.rotation, a.translation_mm), invert((b.rotation, b.translation_mm))
            )
            rotations.append(rotation)
            shifts.append(shift)
            stage_of.append(stage)
            excess.append(_excess(a, camera.poses[stage]) + _excess(b, other.poses[stage]))
    rotation_array, shift_array = np.array(rotations), np.array(shifts)
    stage_array, excess_array = np.array(stage_of), np.array(excess)
    distance_mm = np.median(
        [np.linalg.norm(c.translation_mm) for s in (camera, other) for p in s.poses.values()
         for c in p]
    )  # fmt: skip
    angle = _angle(rotation_array[:, None], rotation_array[None])
    offset = np.linalg.norm(shift_array[:, None] - shift_array[None], axis=2) / distance_mm
    apart = np.maximum(angle, offset) / SAME_RAD
    score = np.minimum(apart, 1.0) + excess_array[None]
    stages = np.unique(stage_array)
    total = sum(score[:, stage_array == s].min(axis=1) for s in stages)
    best = int(np.argmin(np.asarray(total) + excess_array))
    near = apart[best] < 1.0
    agreeing = len(np.unique(stage_array[near]))
    if len(stages) > 1 and 2 * agreeing <= len(stages):
        raise CalibrationError(
            f"the pose of camera {names[0]} relative to {names[1]} is not constant: only "
            f"{agreeing} of {len(stages)} shared stages ({_ranges([int(s) for s in stages])}) "
            "agree. Equal stages of the two are not synchronous (a picture missing at the start?), "
            "or a camera moved between the pictures"
        )
    rotation = nearest_rotation(rotation_array[near].sum(axis=0))
    return rotation, np.median(shift_array[near], axis=0)


def _excess(candidate: PoseCandidate, all_of_picture: Sequence[PoseCandidate]) -> float:
    """0 for a picture's best candidate, towards 1 the worse another one fits."""
    best = min(c.cost_px2 for c in all_of_picture)
    return float(1.0 - (best + 0.01) / (candidate.cost_px2 + 0.01))


def _stage_pose(
    seen: Sequence[Picture],
    starts: Sequence[CameraStart],
    cams: Sequence[Rigid],
    seen_target: Sequence[PointSet],
) -> tuple[Rigid, Rigid | None]:
    """The stage's pose that fits its pictures best, and its twin if that fits nearly as well."""
    seen = sorted(seen, key=len, reverse=True)[:8]
    poses = [
        compose(invert(cams[picture.camera]), (candidate.rotation, candidate.translation_mm))
        for picture in seen[:4]
        for candidate in starts[picture.camera].poses[picture.stage]
    ]
    all_costs = [
        _costs(starts[q.camera], cams[q.camera], poses, q, seen_target[q.camera]) for q in seen
    ]
    costs = np.mean(all_costs, axis=0)
    trials = [(float(cost), pose) for cost, pose in zip(costs, poses, strict=True)]
    trials.sort(key=lambda trial: trial[0])
    best_cost, best = trials[0]
    for cost, pose in trials[1:]:
        if float(_angle(pose[0], best[0])) > SAME_RAD / 3 and cost < 4.0 * best_cost:
            return best, pose
    return best, None


def _distances(start: CameraStart, pose: Rigid, picture: Picture, target: PointSet) -> FloatArray:
    in_cam = target.position_mm[picture.point] @ pose[0].T + pose[1]
    difference = project(start.model, in_cam) - picture.xy_px
    result: FloatArray = np.sqrt(np.sum(difference**2, axis=1))
    return result


def _misfit_px(start: CameraStart, pose: Rigid, picture: Picture, target: PointSet) -> float:
    """Median distance of a picture's points from where the pose puts them."""
    return float(np.median(np.nan_to_num(_distances(start, pose, picture, target), nan=np.inf)))


def _costs(
    start: CameraStart, cam: Rigid, poses: Sequence[Rigid], picture: Picture, target: PointSet
) -> FloatArray:
    """Mean squared distance of a picture's points, limited, for each pose of its stage."""
    # Relative poses are still rough: a limit ten times a resection's gate.
    limit = 10.0 * start.gate_px
    rotation = cam[0] @ np.array([pose[0] for pose in poses])
    shift = np.array([pose[1] for pose in poses]) @ cam[0].T + cam[1]
    points = target.position_mm[picture.point]
    in_cam = np.einsum("tij,nj->tni", rotation, points) + shift[:, None]
    pixels = project(start.model, in_cam.reshape(-1, 3)).reshape(len(poses), -1, 2)
    square = np.sum((pixels - picture.xy_px) ** 2, axis=2)
    result: FloatArray = np.fmin(square, limit**2).mean(axis=1)
    return result
