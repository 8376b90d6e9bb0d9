"""Start values of one camera: principal distance, first distortion, a pose a picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from videogrammetry.adjustment import (
    AdjustOptions,
    Network,
    PoseCandidate,
    principal_extents,
    resect,
    search_focal,
)
from videogrammetry.calibration.pictures import MIN_POINTS, Picture
from videogrammetry.calibration.run import CameraFrames, Rejection, check_free
from videogrammetry.errors import CalibrationError
from videogrammetry.geometry import camera_model, default_r0_px, project
from videogrammetry.types import INTERIOR_NAMES, FloatArray, PointSet, RigCamera

#: Pictures that the search for f looks at: enough to vote down a bad one.
MAX_SEARCH_PICTURES = 4
#: Share of the picture's diagonal beyond which a point counts as a wrong number
#: while lens distortion is not yet modelled.
START_GATE = 0.01
#: A start that fits worse (RMS distance) is checked against the target's mirror image.
SUSPICIOUS_RMS_PX = 1.0


@dataclass(frozen=True, kw_only=True)
class CameraStart:
    """A camera's start values.

    ``model`` with pose identity; ``poses``: stage -> one or two candidates,
    the better first; ``held``: interior values of the parameters not estimated.
    """

    model: RigCamera
    held: FloatArray
    f_given: bool
    poses: dict[int, list[PoseCandidate]]
    gate_px: float
    rejected: tuple[Rejection, ...]


def start_interior(camera: CameraFrames) -> FloatArray:
    """The ten parameters that ``camera.start`` gives (``f_px``, ``x0_px``, ``A1``...), else 0."""
    interior = np.zeros(len(INTERIOR_NAMES))
    for key, value in camera.start.items():
        name = key.removesuffix("_px")
        if name in INTERIOR_NAMES:
            interior[INTERIOR_NAMES.index(name)] = float(value)
        elif name != "r0":
            raise ValueError(
                f"camera {camera.name}: unknown start value {key!r}; known: "
                f"f_px, x0_px, y0_px, {', '.join(INTERIOR_NAMES[3:])}, r0_px"
            )
    return interior


def start_camera(
    camera: CameraFrames, pictures: Sequence[Picture], target: PointSet
) -> CameraStart:
    """Start values of one camera from its pictures alone.

    Raises
    ------
    CalibrationError : no picture with enough points, or none that fits.
    """
    if camera.free is not None:
        check_free(camera.free, f"camera {camera.name}: free")
    rejected: list[Rejection] = []
    usable = [p for p in pictures if _enough(p, target, camera.name, rejected)]
    if not usable:
        raise CalibrationError(_no_picture(camera.name, pictures))
    width, height = camera.image_size_px
    gate_px = START_GATE * float(np.hypot(width, height))
    interior = start_interior(camera)
    r0_px = camera.r0_px or float(camera.start.get("r0_px", default_r0_px(camera.image_size_px)))
    model = RigCamera(
        image_size_px=camera.image_size_px, interior=interior, r0_px=r0_px,
        rotation=np.eye(3), translation_mm=np.zeros(3),
    )  # fmt: skip
    f_given = interior[0] > 0
    held, free = interior.copy(), INTERIOR_NAMES if camera.free is None else camera.free
    if not f_given and "f" not in free:
        raise CalibrationError(
            f"camera {camera.name}: f is held (it is not in free) but has no value: give f_px as "
            "start value, or free f"
        )
    try:
        model, poses = _start(camera.name, model, usable, target, gate_px, f_given, free)
    except CalibrationError:
        _check_handedness(camera.name, model, usable, {}, target, gate_px, f_given, free)
        raise
    _check_handedness(camera.name, model, usable, poses, target, gate_px, f_given, free)
    for picture in usable:
        if picture.stage not in poses:
            rejected.append(
                Rejection(
                    kind="image",
                    camera=camera.name,
                    image=picture.image,
                    point_id=None,
                    value=float(len(picture)),
                    reason=f"no pose fits half of its {len(picture)} points within "
                    f"{gate_px:.1f} px: wrong numbers or another target",
                )  # fmt: skip
            )
    if not f_given:
        held[0] = model.interior[0]
    if not poses:
        raise CalibrationError(
            f"camera {camera.name}: no picture's points fit the target within {gate_px:.1f} px; "
            "the target's coordinates, the code family or the start value of f is wrong"
        )
    return CameraStart(
        model=model, held=held, f_given=f_given, poses=poses, gate_px=gate_px,
        rejected=tuple(rejected),
    )  # fmt: skip


def _no_picture(name: str, pictures: Sequence[Picture]) -> str:
    most = max((len(p) for p in pictures), default=0)
    if most >= MIN_POINTS:
        return (
            f"camera {name}: in each of its {len(pictures)} pictures the known points (at most "
            f"{most}) lie along one line of the target, which fixes no pose; give the target more "
            "points, beside the line"
        )
    return (
        f"camera {name}: none of its {len(pictures)} pictures shows {MIN_POINTS} known points of "
        f"the target (the most: {most}); check that its pictures show the target and that the "
        "codes are read"
    )


def _enough(picture: Picture, target: PointSet, name: str, rejected: list[Rejection]) -> bool:
    reason = ""
    if len(picture) < MIN_POINTS:
        reason = f"only {len(picture)} known points; a pose needs {MIN_POINTS}"
    elif principal_extents(target.position_mm[picture.point])[1] < 0.01:
        reason = "its known points lie along one line; a pose needs an area"
    if reason:
        rejected.append(
            Rejection(
                kind="image",
                camera=name,
                image=picture.image,
                point_id=None,
                value=float(len(picture)),
                reason=reason,
            )
        )
    return not reason


def _with_interior(model: RigCamera, interior: FloatArray) -> RigCamera:
    return RigCamera(
        image_size_px=model.image_size_px, interior=interior, r0_px=model.r0_px,
        rotation=model.rotation, translation_mm=model.translation_mm,
    )  # fmt: skip


def _mean_cost(poses: dict[int, list[PoseCandidate]], count: int, gate_px: float) -> float:
    found = [candidates[0].cost_px2 for candidates in poses.values()]
    return (sum(found) + (count - len(found)) * gate_px**2) / count


def _start(
    name: str,
    model: RigCamera,
    pictures: Sequence[Picture],
    target: PointSet,
    gate_px: float,
    f_given: bool,
    free: Sequence[str],
) -> tuple[RigCamera, dict[int, list[PoseCandidate]]]:
    """Interior and poses: found, refined with the strongest distortion terms, found again."""
    model, poses = _first_poses(name, model, pictures, target, gate_px, f_given)
    # E1, E2 look like a tilt of the target unless several pictures contradict.
    wanted = ("f", "A1", "E1", "E2") if len(poses) >= 4 else ("f", "A1")
    refined = _refine(model, pictures, poses, target, [n for n in wanted if n in free])
    again = _resect_all(refined, pictures, target, gate_px)
    if _mean_cost(again, len(pictures), gate_px) < _mean_cost(poses, len(pictures), gate_px):
        return refined, again
    return model, poses


def _first_poses(
    name: str,
    model: RigCamera,
    pictures: Sequence[Picture],
    target: PointSet,
    gate_px: float,
    f_given: bool,
) -> tuple[RigCamera, dict[int, list[PoseCandidate]]]:
    poses: dict[int, list[PoseCandidate]] = {}
    cost = np.inf
    if f_given:
        poses = _resect_all(model, pictures, target, gate_px)
        cost = _mean_cost(poses, len(pictures), gate_px)
    # A given f that leaves a third of the gate is no start: look for a better one.
    if cost < (gate_px / 3) ** 2:
        return model, poses
    chosen = sorted(pictures, key=len, reverse=True)[:MAX_SEARCH_PICTURES]
    searched = model.interior.copy()
    searched[0] = searched[0] if f_given else float(max(model.image_size_px))
    try:
        searched[0], _, _ = search_focal(
            camera_model(_with_interior(model, searched)),
            [target.position_mm[p.point] for p in chosen],
            [p.xy_px for p in chosen],
            threshold_px=gate_px,
        )
    except CalibrationError as error:
        raise CalibrationError(
            f"camera {name}: {error}; the target's coordinates or the code family is wrong"
        ) from error
    found = _with_interior(model, searched)
    found_poses = _resect_all(found, pictures, target, gate_px)
    if _mean_cost(found_poses, len(pictures), gate_px) < 0.8 * cost:
        return found, found_poses
    return model, poses


def _resect_all(
    model: RigCamera, pictures: Sequence[Picture], target: PointSet, gate_px: float
) -> dict[int, list[PoseCandidate]]:
    native = camera_model(model)
    poses = {}
    for picture in pictures:
        found = resect(
            native, target.position_mm[picture.point], picture.xy_px, threshold_px=gate_px
        )
        found = [c for c in found if 2 * c.inliers >= len(picture)]
        if found:
            poses[picture.stage] = found
    return poses


def _check_handedness(
    name: str,
    model: RigCamera,
    pictures: Sequence[Picture],
    poses: dict[int, list[PoseCandidate]],
    target: PointSet,
    gate_px: float,
    f_given: bool,
    free: Sequence[str],
) -> None:
    """CalibrationError if the mirror image of the target fits and the target does not."""
    cost = _mean_cost(poses, len(pictures), gate_px)
    if cost < SUSPICIOUS_RMS_PX**2:
        return
    mirrored = replace(target, position_mm=target.position_mm * [1.0, 1.0, -1.0])
    try:
        _, others = _start(name, model, pictures, mirrored, gate_px, f_given, free)
    except CalibrationError:
        return
    other = _mean_cost(others, len(pictures), gate_px)
    if other < cost / 9.0:
        raise CalibrationError(
            f"camera {name}: the mirror image of the target fits its pictures "
            f"({np.sqrt(other):.2f} px), the target itself does not ({np.sqrt(cost):.2f} px): the "
            "target's coordinates are left-handed, or the pictures are mirrored; change the sign "
            "of one coordinate of the target, or mirror the pictures back"
        )


def _refine(
    model: RigCamera,
    pictures: Sequence[Picture],
    poses: dict[int, list[PoseCandidate]],
    target: PointSet,
    free: Sequence[str],
) -> RigCamera:
    """The interior after a bundle of this camera alone, target fixed, poses free.

    Points that a pose leaves far from where its others are take no part.
    """
    network = Network()
    camera = network.add_camera("camera", model, free=free)
    image, point, xy, cov = [], [], [], []
    for picture in pictures:
        if picture.stage not in poses:
            continue
        best = poses[picture.stage][0]
        near = _near(model, best, picture, target)
        if near.sum() < MIN_POINTS:
            continue
        pose = network.add_pose(picture.image, best.rotation, best.translation_mm)
        index = network.add_image(picture.image, camera, inner=pose)
        image.append(np.full(int(near.sum()), index))
        point.append(picture.point[near])
        xy.append(picture.xy_px[near])
        cov.append(picture.cov_px2[near])
    if not image or not free:
        return model
    network.set_points(target.id, target.position_mm)
    network.set_observations(*(np.concatenate(part) for part in (image, point, xy, cov)))
    try:
        network.adjust(
            AdjustOptions(
                critical_value=0.0, estimate_floor=False, robust_start=False, max_rounds=1
            )
        )
    except CalibrationError:
        return model  # what cannot be told here may be in the joint adjustment
    interior = network.interior(camera)
    plausible = 0.2 < interior[0] / model.interior[0] < 5.0
    return _with_interior(model, interior) if plausible else model


def _near(
    model: RigCamera, pose: PoseCandidate, picture: Picture, target: PointSet
) -> npt.NDArray[np.bool_]:
    """(n,) which of a picture's points lie within a few times the median distance."""
    in_cam = target.position_mm[picture.point] @ pose.rotation.T + pose.translation_mm
    away = np.linalg.norm(project(model, in_cam) - picture.xy_px, axis=1)
    away = np.nan_to_num(away, nan=np.inf)
    near: npt.NDArray[np.bool_] = away <= 5.0 * max(float(np.median(away)), 0.1)
    return near
