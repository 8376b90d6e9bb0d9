"""Calibration without a known target: points of unknown place, a waved bar of known length."""

from __future__ import annotations

import time
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from videogrammetry.adjustment import AdjustOptions, Network
from videogrammetry.calibration.bundle import (
    Bundle,
    dropped_rejections,
    observation_rejections,
    offered,
    offered_names,
)
from videogrammetry.calibration.joint import camera_covariance
from videogrammetry.calibration.network_input import (
    NetworkCamera,
    NetworkImage,
    NetworkInput,
    NetworkObservations,
    NetworkPoints,
    ScaleBars,
)
from videogrammetry.calibration.network_rays import intersect_rays
from videogrammetry.calibration.network_start import start_network
from videogrammetry.calibration.pictures import Picture, Pictures
from videogrammetry.calibration.result import Outcome, adjusted_bars, calibration_run
from videogrammetry.calibration.run import (
    CalibrationOptions,
    CalibrationRun,
    CameraFrames,
    FrameTargets,
    KnownLength,
    Rejection,
)
from videogrammetry.calibration.solving import Solution
from videogrammetry.calibration.start import START_GATE, CameraStart, start_interior
from videogrammetry.calibration.suspicions import check_frames, doubts_of_result
from videogrammetry.calibration.volume import with_volume
from videogrammetry.errors import CalibrationError
from videogrammetry.geometry import default_r0_px, rays_through_pixels
from videogrammetry.types import FloatArray, IntArray, PointSet, RigCamera

#: Rays that pass each other by more belong to no one point; a start's distortion is rough.
_MEET_PX = 10.0
#: Rays under a smaller angle place no point.
_LEAST_RAD = 0.02


@dataclass(frozen=True)
class _Places:
    """One row a free point: its target's number and the stage where it was (0: it stands still)."""

    number: IntArray
    stage: IntArray

    def __len__(self) -> int:
        return len(self.number)


def calibrate_free_points(
    cameras: Sequence[CameraFrames],
    lengths: Sequence[KnownLength],
    options: CalibrationOptions | None = None,
    still: Collection[int] = (),
) -> CalibrationRun:
    """Calibrate from coded targets of unknown place: a waved bar, and points that stand still.

    Every target is a point of its own at every stage (those in ``still`` one for all), seen
    from at least two cameras; the known lengths hold at every stage where both ends are
    seen. A free network with the lengths as observations: min v'Pv over interior parameters,
    relative poses and all points (Hu et al. 2012, Eq. 4, without a known target). Needs no
    start values: relative orientation of the cameras by five points, f searched.

    Parameters
    ----------
    cameras : their pictures in the project's order; equal ``stage`` is synchronous.
    lengths : one at least: nothing else gives the scale.
    options : ``method`` is "joint"; the target's options do not apply.

    Raises
    ------
    CalibrationError : cameras that share too few points, no length that two cameras see,
        what the pictures do not determine.
    ValueError : malformed input.
    """
    began = time.perf_counter()
    options = options or CalibrationOptions()
    if len(cameras) < 2:
        raise ValueError(f"cameras: unknown points need two or more, got {len(cameras)}")
    refracted = [camera.name for camera in cameras if camera.interface is not None]
    if refracted:
        raise ValueError(
            f"camera {refracted[0]}: it looks through an interface; points of unknown place have "
            "no refraction: calibrate with a target of known points"
        )
    check_frames(cameras)
    places, pictures, rejected = _collect(cameras, frozenset(still))
    bars = _bars(places, lengths)
    network = _start(cameras, places, pictures, bars)
    bundle, starts, bars = _bundle(cameras, network, places, pictures, bars)
    solution = _solve(bundle, cameras, places, options)
    outcome = _outcome(bundle, solution, places, bars)
    target = PointSet(
        id=np.arange(1, len(places) + 1, dtype=np.int32), position_mm=bundle.network.positions_mm
    )
    listed = Pictures(
        pictures=tuple(pictures), rejected=tuple(rejected), warnings=tuple(_remarks(bars, lengths))
    )
    run = calibration_run(
        cameras, starts, listed, target, options, outcome, time.perf_counter() - began
    )
    return with_volume(run)


def _collect(
    cameras: Sequence[CameraFrames], still: frozenset[int]
) -> tuple[_Places, list[Picture], list[Rejection]]:
    """Points that two cameras see, pictures of them, and what only one camera sees."""
    seen: dict[tuple[int, int], set[int]] = {}
    for index, camera in enumerate(cameras):
        for frame in camera.frames:
            for number in _numbers(frame):
                stage = 0 if number in still else frame.stage
                seen.setdefault((number, stage), set()).add(index)
    kept = sorted(key for key, by in seen.items() if len(by) >= 2)
    if not kept:
        raise CalibrationError(
            "no coded target was read by two cameras at the same stage: the cameras must see the "
            "moving targets together, and equal stages must be synchronous"
        )
    row = {key: i for i, key in enumerate(kept)}
    pictures = [
        _picture(index, frame, row, still)
        for index, camera in enumerate(cameras)
        for frame in sorted(camera.frames, key=lambda f: f.stage)
    ]
    alone: dict[int, int] = {}
    for key, by in seen.items():
        if key not in row:
            only = next(iter(by))
            alone[only] = alone.get(only, 0) + 1
    rejected = [
        Rejection(
            kind="target",
            camera=cameras[index].name,
            image="",
            point_id=None,
            value=float(count),
            reason=f"{count} targets are seen by no other camera at their stage",
        )
        for index, count in sorted(alone.items())
    ]
    table = np.array(kept, np.int32)
    return _Places(table[:, 0], table[:, 1]), [p for p in pictures if len(p)], rejected


def _numbers(frame: FrameTargets) -> list[int]:
    """Numbers that were read once in a picture."""
    values, counts = np.unique(frame.id[frame.id >= 0], return_counts=True)
    return [int(v) for v in values[counts == 1]]


def _picture(
    camera: int, frame: FrameTargets, row: dict[tuple[int, int], int], still: frozenset[int]
) -> Picture:
    once = set(_numbers(frame))
    rows, keep = [], []
    for i, number in enumerate(frame.id.tolist()):
        place = row.get((number, 0 if number in still else frame.stage))
        if number in once and place is not None:
            rows.append(place)
            keep.append(i)
    n = len(keep)
    none = np.empty((0, 2))
    return Picture(
        camera=camera, stage=frame.stage, image=frame.image, point=np.array(rows, np.int32),
        xy_px=np.asarray(frame.xy_px, float)[keep], cov_px2=np.asarray(frame.cov_px2, float)[keep],
        open_xy_px=none, open_cov_px2=np.empty((0, 3)),
        ellipse=np.full((n, 3), np.nan), ellipse_cov=np.full((n, 3, 3), np.nan),
        open_ellipse=np.empty((0, 3)), open_ellipse_cov=np.empty((0, 3, 3)),
    )  # fmt: skip


def _bars(places: _Places, lengths: Sequence[KnownLength]) -> ScaleBars:
    row = {
        (int(n), int(s)): i
        for i, (n, s) in enumerate(zip(places.number, places.stage, strict=True))
    }
    found = [
        (row[bar.point_a, stage], row[bar.point_b, stage], bar.length_mm, bar.sigma_mm)
        for bar in lengths
        for stage in np.unique(places.stage).tolist()
        if (bar.point_a, stage) in row and (bar.point_b, stage) in row
    ]
    if not found:
        stated = ", ".join(f"{bar.point_a}-{bar.point_b}" for bar in lengths) or "none is stated"
        raise CalibrationError(
            f"no known length has both ends seen by two cameras at a stage ({stated}): the scale "
            'is unknown; give scale_bars = "bars.csv" with the targets\' numbers'
        )
    a, b, length, sigma = np.array(found).T
    return ScaleBars(
        point_a=a.astype(np.int32), point_b=b.astype(np.int32), length_mm=length, sigma_mm=sigma
    )


def _remarks(bars: ScaleBars, lengths: Sequence[KnownLength]) -> list[str]:
    if len(bars) >= 3 or len(lengths) > 1:
        return []
    return [f"the scale rests on {len(bars)} sightings of one length: nothing checks it"]


def _start(
    cameras: Sequence[CameraFrames],
    places: _Places,
    pictures: Sequence[Picture],
    bars: ScaleBars,
) -> NetworkInput:
    """Poses and points: each camera is one picture of all its points."""
    models = []
    for camera in cameras:
        interior = start_interior(camera)
        interior[0] = interior[0] or np.nan
        models.append(
            NetworkCamera(
                name=camera.name,
                image_size_px=camera.image_size_px,
                interior=interior,
                r0_px=camera.r0_px or default_r0_px(camera.image_size_px),
                free=camera.free,
            )
        )
    observations = NetworkObservations(
        image=np.concatenate([np.full(len(p), p.camera, np.int32) for p in pictures]),
        point=np.concatenate([p.point for p in pictures]),
        xy_px=np.concatenate([p.xy_px for p in pictures]),
        cov_px2=np.concatenate([p.cov_px2 for p in pictures]),
    )
    # A point that stands still is seen once a stage: one sighting a camera starts it.
    _, first = np.unique(
        np.stack([observations.image, observations.point], axis=1), axis=0, return_index=True
    )
    observations = NetworkObservations(
        image=observations.image[first], point=observations.point[first],
        xy_px=observations.xy_px[first], cov_px2=observations.cov_px2[first],
    )  # fmt: skip
    names = tuple(
        f"{n}" if s == 0 else f"{n} at stage {s}"
        for n, s in zip(places.number, places.stage, strict=True)
    )
    network = NetworkInput(
        cameras=tuple(models),
        images=tuple(NetworkImage(name=c.name, camera=i) for i, c in enumerate(cameras)),
        points=NetworkPoints(
            name=names,
            position_mm=np.full((len(places), 3), np.nan),
            kind=np.full(len(places), "free"),
        ),
        observations=observations,
        scale_bars=bars,
    )
    return _place_rest(start_network(network).network)


def _place_rest(network: NetworkInput) -> NetworkInput:
    """Points that the start left without a place, where their rays meet after all."""
    positions = network.points.position_mm.copy()
    o = network.observations
    rays = {}
    for index, (camera, image) in enumerate(zip(network.cameras, network.images, strict=True)):
        if image.rotation is None or image.translation_mm is None:
            continue
        lens = RigCamera(
            image_size_px=camera.image_size_px, interior=camera.interior, r0_px=camera.r0_px,
            rotation=image.rotation, translation_mm=image.translation_mm,
        )  # fmt: skip
        rows = np.flatnonzero(o.image == index)
        direction = rays_through_pixels(lens, o.xy_px[rows]) @ image.rotation
        direction /= np.linalg.norm(direction, axis=1)[:, None]
        for row, way in zip(rows.tolist(), direction, strict=True):
            rays[row] = (lens.centre_mm, way, float(camera.interior[0]))
    for point in np.flatnonzero(np.isnan(positions).any(axis=1)):
        own = [rays[row] for row in np.flatnonzero(o.point == point).tolist() if row in rays]
        if len(own) < 2:
            continue
        centre, way, f_px = (np.array(part) for part in zip(*own, strict=True))
        positions[point] = intersect_rays(
            centre[None], way[None], f_px[None], _MEET_PX, _LEAST_RAD
        )[0]
    return replace(network, points=replace(network.points, position_mm=positions))


def _bundle(
    cameras: Sequence[CameraFrames],
    started: NetworkInput,
    places: _Places,
    pictures: Sequence[Picture],
    bars: ScaleBars,
) -> tuple[Bundle, list[CameraStart], ScaleBars]:
    """The rig's bundle in the first camera's frame: one pose a camera, all points free."""
    first = started.images[0]
    assert first.rotation is not None
    assert first.translation_mm is not None
    base_rotation, base_shift = first.rotation, first.translation_mm
    positions = started.points.position_mm @ base_rotation.T + base_shift
    network = Network()
    bundle = Bundle(network=network, camera_of=list(range(len(cameras))), outer=[])
    starts = []
    for index, (camera, model, image) in enumerate(
        zip(cameras, started.cameras, started.images, strict=True)
    ):
        assert image.rotation is not None
        assert image.translation_mm is not None
        rotation = image.rotation @ base_rotation.T
        shift = image.translation_mm - rotation @ base_shift
        lens = RigCamera(
            image_size_px=camera.image_size_px, interior=model.interior, r0_px=model.r0_px,
            rotation=np.eye(3), translation_mm=np.zeros(3),
        )  # fmt: skip
        held = start_interior(camera)
        f_given = bool(held[0] > 0)
        held[0] = held[0] or model.interior[0]
        network.add_camera(
            camera.name,
            lens,
            free=offered_names(camera),
            start=held,
            prior_sigma=camera.prior_sigma,
        )
        bundle.outer.append(network.add_pose(camera.name, rotation, shift, free=index > 0))
        gate = START_GATE * float(np.hypot(*camera.image_size_px))
        starts.append(
            CameraStart(model=lens, held=held, f_given=f_given, poses={}, gate_px=gate, rejected=())
        )
    placed = np.asarray(np.isfinite(positions).all(axis=1))
    rig = network.add_pose("rig", np.eye(3), np.zeros(3), free=False)
    for picture in pictures:
        keep = placed[picture.point]
        outer = bundle.outer[picture.camera] if picture.camera > 0 else -1
        network.add_image(picture.image, picture.camera, outer=outer, inner=rig)
        bundle.stage_pose[picture.stage] = rig
        bundle.pictures.append(
            replace(
                picture, point=picture.point[keep], xy_px=picture.xy_px[keep],
                cov_px2=picture.cov_px2[keep], ellipse=picture.ellipse[keep],
                ellipse_cov=picture.ellipse_cov[keep],
            )
        )  # fmt: skip
    unseen = ~placed
    network.set_points(
        np.arange(1, len(places) + 1),
        np.where(unseen[:, None], 0.0, positions),
        kind=["fixed" if out else "free" for out in unseen],
    )
    usable = placed[bars.point_a] & placed[bars.point_b]
    network.set_scale_bars(
        bars.point_a[usable], bars.point_b[usable], bars.length_mm[usable], bars.sigma_mm[usable]
    )
    bundle.set_observations()
    kept = ScaleBars(
        point_a=bars.point_a[usable],
        point_b=bars.point_b[usable],
        length_mm=bars.length_mm[usable],
        sigma_mm=bars.sigma_mm[usable],
    )
    return bundle, starts, kept


def _solve(
    bundle: Bundle, cameras: Sequence[CameraFrames], places: _Places, options: CalibrationOptions
) -> Solution:
    adjustment = bundle.network.adjust(
        AdjustOptions(
            critical_value=options.critical_value,
            significance=options.significance,
            num_threads=options.num_threads,
        ),
        offered(cameras),
    )
    if not adjustment.converged:
        raise CalibrationError(
            f"the adjustment does not converge ({adjustment.message.strip()}); wave the bar "
            "through more of the volume, near and far and in all directions, or give start "
            "values of f_px"
        )
    names = [camera.name for camera in cameras]
    target = PointSet(id=places.number, position_mm=bundle.network.positions_mm)
    rejected = dropped_rejections(adjustment, bundle.camera_of, names)
    rejected += observation_rejections(bundle, adjustment, names, target)
    for row in np.flatnonzero(~adjustment.scale_bars.used):
        w = float(adjustment.scale_bars.normalised[row])
        rejected.append(
            Rejection(
                kind="target",
                camera="",
                image="",
                point_id=None,
                value=w,
                reason=f"sighting {row + 1} of a known length does not fit the others ({w:.1f} "
                f"sigma, {adjustment.scale_bars.residual_mm[row]:.3f} mm)",
            )
        )
    return Solution(
        bundle=bundle, adjustment=adjustment, dispersion=bundle.network.dispersion(),
        rejected=tuple(rejected),
        warnings=tuple(doubts_of_result(bundle, adjustment, cameras)),
    )  # fmt: skip


def _outcome(bundle: Bundle, solution: Solution, places: _Places, bars: ScaleBars) -> Outcome:
    network, adjustment = bundle.network, solution.adjustment
    cov: FloatArray = adjustment.sigma0**2 * solution.dispersion.point_cov_mm2
    still = (np.eye(3), np.zeros(3))
    return Outcome(
        solutions=(solution,),
        interior=[network.interior(i) for i in range(len(bundle.outer))],
        cam_from_rig=[network.pose(pose) for pose in bundle.outer],
        rig_from_target=dict.fromkeys(sorted(bundle.stage_pose), still),
        cov=camera_covariance(solution),
        position_mm=network.positions_mm,
        point_cov_mm2=cov,
        statistics={
            "scale_bars": len(adjustment.scale_bars.used),
            "scale_bar_rms_mm": float(np.sqrt(np.mean(adjustment.scale_bars.residual_mm**2))),
        },
        bars=adjusted_bars(
            adjustment,
            (bars.point_a, bars.point_b),
            bars.length_mm,
            bars.sigma_mm,
            [
                f"targets {places.number[a]} and {places.number[b]}, stage "
                f"{max(places.stage[a], places.stage[b])}"
                for a, b in zip(bars.point_a, bars.point_b, strict=True)
            ],
        ),
    )


__all__ = ["KnownLength", "calibrate_free_points"]
