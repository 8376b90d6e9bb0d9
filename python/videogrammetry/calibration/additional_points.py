"""Targets beside the known ones: free points of a calibration with a known target."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from videogrammetry.calibration.bundle import Bundle, set_target_points
from videogrammetry.calibration.linking import Rigid, compose
from videogrammetry.calibration.network_rays import agreeing, intersect_rays
from videogrammetry.calibration.pictures import MIN_POINTS, Picture, unread_picture
from videogrammetry.calibration.run import (
    FREE_POINTS,
    CalibrationOptions,
    CameraFrames,
    FrameTargets,
    Rejection,
)
from videogrammetry.geometry import rays_through_pixels
from videogrammetry.types import FloatArray, IntArray, PointSet, RigCamera

BoolArray = npt.NDArray[np.bool_]
#: Rays that pass each other by more belong to no one point.
MEET_PX = 10.0
#: Rays under a smaller angle place no point.
LEAST_RAD = 0.02


@dataclass(frozen=True, kw_only=True)
class Sightings:
    """Coded targets that the known target has not, in the pictures of a calibration.

    ``number`` and ``stage`` (P,) of each point (stage 0: one point at all stages), ``pictures``
    of them with ``point`` a row of these, ``target`` with rows for them at its end (no
    coordinates yet), ``rejected``: what cannot join.
    """

    number: IntArray
    stage: IntArray
    pictures: tuple[Picture, ...]
    rejected: tuple[Rejection, ...] = ()


def check_free_points(options: CalibrationOptions) -> None:
    """ValueError if additional points are wanted of a calibration that cannot take them."""
    mode = options.free_points
    if mode not in FREE_POINTS:
        raise ValueError(f"free_points: expected one of {', '.join(FREE_POINTS)}, got {mode!r}")
    if mode == "none":
        return
    for wanted, what in (
        (options.method == "joint", f"method {options.method!r}"),
        (not options.interfaces, "interfaces"),
        (not options.time_offset, "time_offset"),
    ):
        if not wanted:
            raise ValueError(
                f"free_points: {mode!r} does not go with {what}; leave one of them out"
            )


def additional_sightings(
    cameras: Sequence[CameraFrames], bundle: Bundle, target: PointSet, mode: str
) -> Sightings:
    """The sightings of numbers that are not the target's, in pictures that can be placed.

    mode : "target": still relative to the target; "room": still relative to the cameras;
        "stage": a point of its own at every stage. Points seen from one place only are listed.
    """
    known = set(target.id.tolist())
    seen: dict[tuple[int, int], list[tuple[int, FrameTargets, int]]] = {}
    for index, frame in _frames(cameras, bundle, known, mode):
        values, counts = np.unique(frame.id[frame.id >= 0], return_counts=True)
        for number in values[counts == 1].tolist():
            if number not in known:
                row = int(np.flatnonzero(frame.id == number)[0])
                key = (number, frame.stage if mode == "stage" else 0)
                seen.setdefault(key, []).append((index, frame, row))
    # Of a point that stays in the room one camera has but one ray.
    rays = {
        key: len(own) if mode == "target" else len({index for index, _, _ in own})
        for key, own in seen.items()
    }
    kept = sorted(key for key, count in rays.items() if count >= 2)
    rows: dict[tuple[int, int], list[tuple[int, int]]] = {}
    frames: dict[tuple[int, int], FrameTargets] = {}
    for point, key in enumerate(kept):
        for index, frame, row in seen[key]:
            rows.setdefault((index, frame.stage), []).append((point, row))
            frames[index, frame.stage] = frame
    pictures = [
        unread_picture(index, frames[index, stage], *zip(*pairs, strict=True))
        for (index, stage), pairs in sorted(rows.items())
    ]
    alone = [(key, own[0]) for key, own in sorted(seen.items()) if rays[key] == 1]
    table = np.array(kept, np.int32).reshape(-1, 2)
    return Sightings(
        number=table[:, 0],
        stage=table[:, 1],
        pictures=tuple(pictures),
        rejected=tuple(
            Rejection(
                kind="unknown-target", camera=cameras[index].name, image=frame.image,
                point_id=number, value=1.0,
                reason=f"number {number} is not in the target's point list, and no sighting "
                "from elsewhere places it as a free point",
            )
            for (number, _), (index, frame, _) in alone
        ),
    )  # fmt: skip


def _frames(
    cameras: Sequence[CameraFrames], bundle: Bundle, known: set[int], mode: str
) -> Iterator[tuple[int, FrameTargets]]:
    """Frames whose pose is known, less those that the calibration itself has refused."""
    used = bundle.network.used
    images = bundle.image_of
    good = {
        (p.camera, p.stage)
        for image, p in enumerate(bundle.pictures)
        if 2 * used[images == image].sum() >= len(p)
    }
    for index, camera in enumerate(cameras):
        for frame in sorted(camera.frames, key=lambda f: f.stage):
            if mode == "target" and frame.stage not in bundle.stage_pose:
                continue
            of_target = sum(number in known for number in frame.id.tolist())
            # A picture with few known points could not be refused.
            if (index, frame.stage) in good or of_target < MIN_POINTS:
                yield index, frame


@dataclass(frozen=True, kw_only=True)
class Placed:
    """Sightings with places: ``position_mm`` (P, 3) in the target's or the rig's frame."""

    sightings: Sightings
    position_mm: FloatArray
    warnings: tuple[str, ...]


def place_sightings(
    bundle: Bundle, cameras: Sequence[CameraFrames], found: Sightings, mode: str
) -> Placed:
    """Points where most of their rays meet, sightings that pass by left out.

    A number whose rays do not meet in one place (it moved) is left out and named.
    """
    if not found.pictures:
        return Placed(sightings=found, position_mm=np.empty((0, 3)), warnings=())
    rays = [_rays(bundle, cameras, picture, mode) for picture in found.pictures]
    point = np.concatenate([p.point for p in found.pictures])
    centre, way = (np.concatenate([ray[k] for ray in rays]) for k in (0, 1))
    f_px = np.concatenate(
        [np.full(len(p), ray[2]) for p, ray in zip(found.pictures, rays, strict=True)]
    )
    keep = np.zeros(len(point), bool)
    position = np.full((len(found.number), 3), np.nan)
    moved = set()
    for row in range(len(found.number)):
        mine = np.flatnonzero(point == row)
        place = intersect_rays(
            centre[mine][None], way[mine][None], f_px[mine][None], MEET_PX, LEAST_RAD
        )[0]
        if not np.isfinite(place).all():
            moved.add(int(found.number[row]))
            continue
        near = agreeing(place, centre[mine], way[mine], f_px[mine], MEET_PX)
        if 2 * near.sum() < len(mine):
            moved.add(int(found.number[row]))
            continue
        position[row] = place
        keep[mine[near]] = True
    warnings = []
    if moved:
        still = {"target": "relative to the target", "room": "in the room"}.get(mode)
        cause = f"they did not stand still {still}" if still else "they were misread"
        warnings.append(
            f"the rays of {len(moved)} numbers beside the target meet in no one point, or under "
            f"too small an angle ({', '.join(map(str, sorted(moved)[:12]))}): {cause}, or all "
            "rays are nearly parallel; they are left out"
            + ('; free_points = "stage" takes moving ones' if still else "")
        )
    return Placed(
        sightings=_subset(found, np.isfinite(position).all(axis=1), keep),
        position_mm=position[np.isfinite(position).all(axis=1)],
        warnings=tuple(warnings),
    )


def _subset(found: Sightings, placed: BoolArray, keep: BoolArray) -> Sightings:
    """The placed points, with the observations of ``keep`` (all pictures one after the other)."""
    number = np.cumsum(placed) - 1
    pictures, first = [], 0
    for picture in found.pictures:
        mine = keep[first : first + len(picture)]
        first += len(picture)
        if mine.any():
            pictures.append(
                replace(
                    picture, point=number[picture.point[mine]].astype(np.int32),
                    xy_px=picture.xy_px[mine], cov_px2=picture.cov_px2[mine],
                    ellipse=picture.ellipse[mine], ellipse_cov=picture.ellipse_cov[mine],
                )
            )  # fmt: skip
    return replace(
        found, number=found.number[placed], stage=found.stage[placed], pictures=tuple(pictures)
    )


def _rays(
    bundle: Bundle, cameras: Sequence[CameraFrames], picture: Picture, mode: str
) -> tuple[FloatArray, FloatArray, float]:
    """Centres and unit directions (n, 3) of a picture's rays in the frame of its points, and f."""
    pose: Rigid = bundle.network.pose(bundle.outer[picture.camera])
    if mode == "target":
        pose = compose(pose, bundle.network.pose(bundle.stage_pose[picture.stage]))
    model = bundle.network.model(picture.camera)
    lens = RigCamera(
        image_size_px=cameras[picture.camera].image_size_px, interior=np.array(model.interior),
        r0_px=model.r0_px, rotation=pose[0], translation_mm=pose[1],
    )  # fmt: skip
    way = rays_through_pixels(lens, picture.xy_px) @ pose[0]
    way /= np.linalg.norm(way, axis=1)[:, None]
    return np.tile(lens.centre_mm, (len(picture), 1)), way, float(model.interior[0])


def with_points(target: PointSet, placed: Placed) -> PointSet:
    """The target with rows for the additional points at its end, which are no circles."""
    extra = len(placed.position_mm)
    return PointSet(
        id=np.concatenate([target.id, placed.sightings.number]).astype(np.int32),
        position_mm=np.concatenate([target.position_mm, placed.position_mm]),
        normal=None
        if target.normal is None
        else np.concatenate([target.normal, np.full((extra, 3), np.nan)]),
        diameter_mm=None
        if target.diameter_mm is None
        else np.concatenate([target.diameter_mm, np.full(extra, np.nan)]),
    )


def add_to_bundle(
    bundle: Bundle,
    placed: Placed,
    target: PointSet,
    target_cov: FloatArray,
    options: CalibrationOptions,
    used: BoolArray,
) -> None:
    """Pictures, points and observations of the additional points, the rest as adjusted.

    ``used``: which of the observations that are there already take part.
    """
    network, mode = bundle.network, options.free_points
    set_target_points(network, target, target_cov, options, placed.position_mm)
    extra = len(placed.position_mm)
    bundle.set_circles(
        np.concatenate([bundle.circle_normal, np.full((extra, 3), np.nan)]),
        np.concatenate([bundle.circle_diameter_mm, np.full(extra, np.nan)]),
    )
    room = -1
    if mode != "target":
        room = network.add_pose("rig", np.eye(3), np.zeros(3), free=False)
    count = 0
    for picture in placed.sightings.pictures:
        inner = bundle.stage_pose[picture.stage] if mode == "target" else room
        outer = bundle.outer[picture.camera] if picture.camera > 0 else -1
        image = network.add_image(picture.image, picture.camera, outer=outer, inner=inner)
        bundle.inner[image] = inner
        bundle.pictures.append(
            replace(picture, point=(picture.point + len(target)).astype(np.int32))
        )
        count += len(picture)
    bundle.set_observations(np.concatenate([used, np.ones(count, bool)]))


__all__ = [
    "Placed",
    "Sightings",
    "add_to_bundle",
    "additional_sightings",
    "check_free_points",
    "place_sightings",
    "with_points",
]
