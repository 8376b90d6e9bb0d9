"""The network of a calibration: cameras, poses, pictures, observations, and its book-keeping."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from videogrammetry.adjustment import CAMERA_UNKNOWNS, Adjustment, Network
from videogrammetry.calibration.interfaces import add_interfaces, in_target_frame
from videogrammetry.calibration.late_cameras import image_motion, less_bend
from videogrammetry.calibration.linking import Rigid, compose
from videogrammetry.calibration.pictures import MIN_POINTS, Picture
from videogrammetry.calibration.run import CalibrationOptions, CameraFrames, Rejection
from videogrammetry.calibration.start import CameraStart
from videogrammetry.errors import CalibrationError
from videogrammetry.types import INTERIOR_NAMES, FloatArray, IntArray, PointSet

#: What may be dropped when a camera's free parameters are not chosen.
DISTORTION_NAMES = INTERIOR_NAMES[3:]
#: Delays that change by less, in stages, move no picture by a thousandth of a pixel.
_SAME_DELAY = 1e-4
POSE_NAMES = ("rx", "ry", "rz", "tx", "ty", "tz")


def offered_names(camera: CameraFrames) -> tuple[str, ...]:
    """Interior parameters that are estimated at first."""
    return INTERIOR_NAMES if camera.free is None else tuple(camera.free)


@dataclass
class Bundle:
    """A network with the pictures behind it.

    ``camera_of``: the project's camera of each of the network's; ``outer``: the
    network pose of each camera in the rig (none where every picture has a pose
    of its own); ``pictures``: one a network image; ``stage_pose``: the network pose of
    a stage; ``circle_normal`` (N, 3), ``circle_diameter_mm`` (N,): the circles that the
    network knows, NaN for points that are none; ``windows``: name -> the network's
    window; ``camera_windows``: the one of each camera, None: none; ``inner``: the inner pose
    of pictures of additional points, by picture; ``time_offset``: whether
    cameras may be late, ``delay`` (C,) by which part of a stage they are.
    """

    network: Network
    camera_of: list[int]
    outer: list[int]
    pictures: list[Picture] = field(default_factory=list)
    stage_pose: dict[int, int] = field(default_factory=dict)
    circle_normal: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    circle_diameter_mm: FloatArray = field(default_factory=lambda: np.empty(0))
    windows: dict[str, int] = field(default_factory=dict)
    camera_windows: list[int | None] = field(default_factory=list)
    inner: dict[int, int] = field(default_factory=dict)
    time_offset: bool = False
    delay: FloatArray = field(default_factory=lambda: np.empty(0))

    def set_circles(self, normal: FloatArray, diameter_mm: FloatArray) -> None:
        """Have the network model the ellipses of these circles."""
        self.circle_normal, self.circle_diameter_mm = normal, diameter_mm
        self.network.set_circles(normal, diameter_mm)

    def set_known_circles(self, target: PointSet, wanted: bool) -> None:
        """The circles of the target's table, where it states both normal and diameter."""
        n = len(target)
        normal = np.full((n, 3), np.nan)
        diameter = np.full(n, np.nan)
        if wanted and target.normal is not None:
            length = np.linalg.norm(target.normal, axis=1)
            usable = np.isfinite(length) & (length > 0)
            normal[usable] = target.normal[usable] / length[usable, None]
        if wanted and target.diameter_mm is not None:
            usable = np.isfinite(normal).all(axis=1)
            diameter[usable] = target.diameter_mm[usable]
        self.set_circles(normal, diameter)

    def window_of(self, camera: int) -> int | None:
        """The network's window that a camera looks through; None: none."""
        return self.camera_windows[camera] if self.camera_windows else None

    def network_camera(self, image: int) -> int:
        """The network's camera of a picture."""
        return self.camera_of.index(self.pictures[image].camera)

    def cam_from_target(self, image: int) -> Rigid:
        """A picture's pose as it stands."""
        picture = self.pictures[image]
        own = self.inner.get(image)
        inner = self.network.pose(self.stage_pose[picture.stage] if own is None else own)
        if not self.outer:
            return inner
        return compose(self.network.pose(self.outer[picture.camera]), inner)

    def set_observations(self, used: npt.NDArray[np.bool_] | None = None) -> None:
        """Hand the pictures' points to the network (again)."""
        image = self.image_of
        xy_px = np.concatenate([p.xy_px for p in self.pictures])
        velocity_px = None
        if self.time_offset:
            motion = image_motion(self.pictures)
            camera = np.array([p.camera for p in self.pictures])[image]
            delay = self.delay if len(self.delay) else np.zeros(camera.max() + 1)
            xy_px, velocity_px = less_bend(xy_px, motion, delay[camera]), motion.velocity_px
            # A late camera's point without neighbours cannot be brought to the stage.
            here = motion.known | (camera == 0)
            used = here if used is None else used & here
        self.network.set_observations(
            image,
            np.concatenate([p.point for p in self.pictures]),
            xy_px,
            np.concatenate([p.cov_px2 for p in self.pictures]),
            used,
            velocity_px=velocity_px,
        )

    def update_delay(self) -> bool:
        """Take the estimated delays over; whether that changes the observations."""
        place = CAMERA_UNKNOWNS.index("time_offset")
        found = np.array(
            [self.network.camera_unknowns(i)[place] for i in range(len(self.camera_of))]
        )
        before = self.delay if len(self.delay) else np.zeros(len(found))
        self.delay = found
        return bool(np.abs(found - before).max() > _SAME_DELAY)

    @property
    def image_of(self) -> IntArray:
        """(M,) picture of every observation."""
        return np.concatenate([np.full(len(p), i, np.int32) for i, p in enumerate(self.pictures)])

    @property
    def point_of(self) -> IntArray:
        """(M,) row of the target of every observation."""
        return np.concatenate([p.point for p in self.pictures])


def set_target_points(
    network: Network,
    target: PointSet,
    target_cov: FloatArray,
    options: CalibrationOptions,
    additional_mm: FloatArray | None = None,
) -> None:
    """The target's points as observed, then free ones at ``additional_mm`` (P, 3)."""
    n, size = len(target), float(np.linalg.norm(np.ptp(target.position_mm, axis=0)))
    extra = np.empty((0, 3)) if additional_mm is None else additional_mm
    network.set_points(
        np.concatenate([target.id, np.arange(len(extra))]),
        np.concatenate([target.position_mm, extra]),
        np.concatenate([target_cov, np.zeros((len(extra), 3, 3))]),
        kind=["weighted"] * n + ["free"] * len(extra),
    )
    if options.sigma_mm is None and target.full_cov_mm2 is not None:
        # A coordinate stated without error would make the weights infinite.
        joint = target.full_cov_mm2 + np.eye(3 * n) * (1e-7 * size) ** 2
        network.set_point_prior(np.arange(n), target.position_mm, joint)


def joint_bundle(
    cameras: Sequence[CameraFrames],
    starts: Sequence[CameraStart],
    pictures: Sequence[Picture],
    cam_from_rig: Sequence[Rigid],
    rig_from_target: Mapping[int, Rigid],
    target: PointSet,
    target_cov: FloatArray,
    options: CalibrationOptions,
) -> Bundle:
    """One pose a stage, one constant relative pose a camera, target coordinates observed.

    The rig's frame is the first camera's; the target's where windows are stated in that.
    """
    network = Network()
    bundle = Bundle(
        network=network, camera_of=list(range(len(cameras))), outer=[],
        time_offset=options.time_offset,
    )  # fmt: skip
    bundle.windows = add_interfaces(network, options.interfaces)
    of_target = in_target_frame(options)
    for index, (camera, start) in enumerate(zip(cameras, starts, strict=True)):
        window = None if camera.interface is None else bundle.windows[camera.interface]
        bundle.camera_windows.append(window)
        # The first camera is the clock.
        late = ("time_offset",) if options.time_offset and index > 0 else ()
        network.add_camera(
            camera.name,
            start.model,
            free=(*offered_names(camera), *late),
            start=start.held,
            prior_sigma=camera.prior_sigma,
            interface=window,
        )
        # The reference's pose is the frame itself.
        bundle.outer.append(
            network.add_pose(camera.name, *cam_from_rig[index], free=index > 0 or of_target)
        )
    for stage, pose in sorted(rig_from_target.items()):
        bundle.stage_pose[stage] = network.add_pose(f"stage {stage}", *pose, free=not of_target)
    for picture in pictures:
        if picture.stage not in starts[picture.camera].poses:
            continue
        # A window stands in the frame that outer poses lead from: none may be missing.
        outer = bundle.outer[picture.camera] if picture.camera > 0 or options.interfaces else -1
        network.add_image(
            picture.image, picture.camera, outer=outer, inner=bundle.stage_pose[picture.stage]
        )
        bundle.pictures.append(picture)
    set_target_points(network, target, target_cov, options)
    _set_lengths(network, target, options)
    bundle.set_known_circles(target, options.eccentricity and not options.interfaces)
    bundle.set_observations()
    return bundle


def _set_lengths(network: Network, target: PointSet, options: CalibrationOptions) -> None:
    row = {int(number): i for i, number in enumerate(target.id)}
    for bar in options.lengths:
        for end in (bar.point_a, bar.point_b):
            if end not in row:
                raise CalibrationError(
                    f"the scale bar {bar.point_a}-{bar.point_b} ends in point {end}, which is not "
                    "one of the target's: name the bars between points of the target here; bars "
                    "beside it belong into its measurement (measure-target)"
                )
    if options.lengths:
        network.set_scale_bars(
            [row[bar.point_a] for bar in options.lengths],
            [row[bar.point_b] for bar in options.lengths],
            [bar.length_mm for bar in options.lengths],
            [bar.sigma_mm for bar in options.lengths],
        )


def single_bundle(
    camera: CameraFrames,
    index: int,
    start: CameraStart,
    pictures: Sequence[Picture],
    cam_from_target: Mapping[int, Rigid],
    target: PointSet,
    eccentricity: bool = True,
) -> Bundle:
    """One camera alone: a pose of its own for every picture, target points fixed (Eq. 5)."""
    network = Network()
    bundle = Bundle(network=network, camera_of=[index], outer=[])
    network.add_camera(camera.name, start.model, free=offered_names(camera), start=start.held)
    for picture in pictures:
        pose = network.add_pose(picture.image, *cam_from_target[picture.stage])
        network.add_image(picture.image, 0, inner=pose)
        bundle.stage_pose[picture.stage] = pose
        bundle.pictures.append(picture)
    network.set_points(target.id, target.position_mm)
    bundle.set_known_circles(target, eccentricity)
    bundle.set_observations()
    return bundle


def offered(cameras: Sequence[CameraFrames]) -> list[Sequence[str]]:
    """Per camera, what the significance test may drop."""
    return [DISTORTION_NAMES if camera.free is None else () for camera in cameras]


def observation_rejections(
    bundle: Bundle, adjustment: Adjustment, names: Sequence[str], target: PointSet
) -> list[Rejection]:
    """A line for every observation that the data snooping left out."""
    rejected = []
    images, points = bundle.image_of, bundle.point_of
    for image, picture in enumerate(bundle.pictures):
        out = ~adjustment.used[images == image]
        if len(picture) >= MIN_POINTS and 2 * out.sum() > len(picture):
            residual = rms_px(adjustment.residual_px[images == image])
            rejected.append(
                Rejection(
                    kind="image",
                    camera=names[picture.camera],
                    image=picture.image,
                    point_id=None,
                    value=residual,
                    reason=f"{out.sum()} of its {len(picture)} points do not fit the other "
                    f"pictures (RMS {residual:.2f} px): not synchronous, moved, or badly read",
                )  # fmt: skip
            )
    for i in np.flatnonzero(~adjustment.used):
        picture = bundle.pictures[images[i]]
        residual = float(np.hypot(*adjustment.residual_px[i]))
        w = float(np.abs(adjustment.normalised[i]).max())
        rejected.append(
            Rejection(
                kind="observation",
                camera=names[picture.camera],
                image=picture.image,
                point_id=int(target.id[points[i]]),
                value=w,
                reason=f"normalised residual {w:.1f} ({residual:.2f} px)",
            )  # fmt: skip
        )
    return sorted(rejected, key=lambda r: (r.kind, -r.value))


def rms_px(residual_px: FloatArray) -> float:
    """RMS per coordinate; 0 of nothing."""
    return float(np.sqrt(np.mean(residual_px**2))) if residual_px.size else 0.0


def dropped_rejections(
    adjustment: Adjustment, camera_of: Sequence[int], names: Sequence[str]
) -> list[Rejection]:
    """A line for every interior parameter that is not estimated."""
    rejected = []
    for d in adjustment.dropped:
        ratio = abs(d.value) / d.sigma if d.sigma > 0 else np.inf
        reason = (
            f"{d.name} is not determined by the pictures (sigma {d.sigma:.3g}); held at its start"
            if d.undetermined
            else f"{d.name} = {d.value:.3g} is {ratio:.1f} times its standard deviation: "
            "not significant"
        )
        rejected.append(
            Rejection(
                kind="parameter",
                camera=names[camera_of[d.camera]],
                image="",
                point_id=None,
                value=float(ratio),
                reason=reason,
            )
        )
    return rejected
