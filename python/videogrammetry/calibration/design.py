"""What a calibration will be worth before a picture is taken: its design alone gives that.

The covariance of an adjustment, (A^T P A)^-1, holds the geometry and the
observations' weights and no measurement. So the target is put at simulated
positions in the measuring volume, the points that each camera would see there
are projected, and the network's dispersion is the calibration's covariance.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from videogrammetry.adjustment import Network
from videogrammetry.calibration.bundle import POSE_NAMES
from videogrammetry.calibration.linking import Rigid
from videogrammetry.calibration.volume import evenly
from videogrammetry.errors import CalibrationError
from videogrammetry.geometry import CAMERA_PARAMETERS, MeasuringVolume, project
from videogrammetry.types import INTERIOR_NAMES, FloatArray, PointSet, RigData

#: Candidates tried for every position that is wanted.
_TRIES = 40
# Cameras within this angle of each other, seen from the target, are turned to together.
_TOGETHER_RAD = np.radians(60.0)
_BOARD_MARGIN = 0.95


@dataclass(frozen=True, kw_only=True)
class DesignOptions:
    """How a calibration will be made.

    Attributes
    ----------
    count : positions of the target.
    sigma_px : of a measured image coordinate.
    target_sigma_mm : of a coordinate of the target's points (weighted observations).
    free : interior parameters estimated: of all cameras, or camera -> names.
    largest_tilt_rad : of the target against the direction to the cameras.
    largest_incidence_rad : circles are measured while their normal is within
        this angle of the line of sight.
    min_points : a picture with fewer is not used.
    part : of the volume's extent over which the target's middle is moved; 1: all of it.
    whole : a picture counts only if all points that face the camera are in it;
        else what is in the picture is used.
    """

    count: int = 16
    sigma_px: float = 0.02
    target_sigma_mm: float = 0.1
    free: Sequence[str] | Mapping[str, Sequence[str]] = ("f", "x0", "y0", "A1", "B1", "B2")
    largest_tilt_rad: float = float(np.radians(45.0))
    largest_incidence_rad: float = float(np.radians(65.0))
    min_points: int = 6
    part: float = 1.0
    whole: bool = False

    def __post_init__(self) -> None:
        if self.count < 1:
            raise ValueError(f"count: expected a position of the target or more, got {self.count}")
        for name in ("sigma_px", "target_sigma_mm", "part"):
            if not 0 < getattr(self, name) < np.inf:
                raise ValueError(f"{name}: expected more than 0, got {getattr(self, name)}")
        names = (
            [n for some in self.free.values() for n in some]
            if isinstance(self.free, Mapping)
            else list(self.free)
        )
        unknown = [n for n in names if n not in INTERIOR_NAMES]
        if unknown:
            raise ValueError(
                f"free: {unknown[0]!r} is no interior parameter: {', '.join(INTERIOR_NAMES)}"
            )

    def free_of(self, camera: str) -> Sequence[str]:
        """The parameters of one camera that are estimated."""
        return self.free.get(camera, ()) if isinstance(self.free, Mapping) else self.free


@dataclass(frozen=True, kw_only=True)
class CalibrationDesign:
    """A simulated calibration.

    Attributes
    ----------
    rig : the rig with the calibration's covariance, and where the target stood
        (``volume_mm``), as a calibration's own rig has them.
    world_from_target : n transforms. points_seen : (n, C) points in each picture,
        0 where it is not used.
    """

    rig: RigData
    world_from_target: tuple[Rigid, ...]
    points_seen: npt.NDArray[np.int64]


def flat_board(size_mm: tuple[float, float], points: tuple[int, int] = (7, 5)) -> PointSet:
    """A flat target, one side, its circles on a grid; normals towards -z of its frame.

    Examples
    --------
    >>> board = flat_board((1000.0, 800.0), (3, 2))
    >>> board.position_mm[-1].tolist(), board.normal[0].tolist()
    ([475.0, 380.0, 0.0], [0.0, 0.0, -1.0])
    """
    if min(size_mm) <= 0 or min(points) < 2:
        raise ValueError(
            f"board: expected lengths above 0 and 2 x 2 points, got {size_mm} {points}"
        )
    half = 0.5 * _BOARD_MARGIN * np.asarray(size_mm, dtype=float)
    x, y = np.meshgrid(np.linspace(-1, 1, points[0]), np.linspace(-1, 1, points[1]))
    position = np.column_stack([x.ravel() * half[0], y.ravel() * half[1], np.zeros(x.size)])
    return PointSet(
        id=np.arange(1, x.size + 1, dtype=np.int32),
        position_mm=position,
        normal=np.tile([0.0, 0.0, -1.0], (x.size, 1)),
    )


def design_calibration(
    rig: RigData, target: PointSet, volume: MeasuringVolume, options: DesignOptions
) -> CalibrationDesign:
    """The covariance that a calibration with ``options.count`` positions would have.

    The positions fill the volume evenly and are the same whenever they are asked
    for; those of a smaller count are the first ones of a larger.

    Parameters
    ----------
    rig : the cameras as planned; their values are taken for true.
    target : with normals each point is seen from its side alone; without, from everywhere.

    Raises
    ------
    CalibrationError
        The target is hardly in a picture in that volume, a camera sees none of
        its positions, no chain of positions ties all cameras together, or the
        unknowns are not determined.
    """
    _check_in_air(rig)
    poses = _positions(rig, target, volume, options)
    return design_at_positions(rig, target, poses, options)


def design_at_positions(
    rig: RigData, target: PointSet, world_from_target: Sequence[Rigid], options: DesignOptions
) -> CalibrationDesign:
    """The same for given positions of the target (``count``, tilt and spread play no part).

    Parameters
    ----------
    world_from_target : rotation (3, 3) and translation (3,) mm of each position.

    Raises
    ------
    CalibrationError : as :func:`design_calibration`.
    """
    _check_in_air(rig)
    poses = tuple(world_from_target)
    seen = [_visible(rig, target, pose, options) for pose in poses]
    counts = np.array([[s.sum() for s in one] for one in seen])
    _check_linked(list(rig.cameras), counts > 0)
    cov = _covariance(rig, target, poses, seen, options)
    sigma = np.sqrt(np.maximum(np.diag(cov), 0.0)).reshape(len(rig.cameras), -1)
    cameras = {
        name: dataclasses.replace(
            camera, sigma=dict(zip(CAMERA_PARAMETERS, map(float, sigma[k]), strict=True))
        )
        for k, (name, camera) in enumerate(rig.cameras.items())
    }
    where = np.concatenate([target.position_mm @ r.T + t for r, t in poses])
    by = np.concatenate([np.stack(one, axis=1) for one in seen])
    keep = evenly(np.flatnonzero(by.sum(axis=1) >= 2))
    return CalibrationDesign(
        rig=dataclasses.replace(
            rig,
            cameras=cameras,
            cov=cov,
            cov_names=tuple(f"{n}/{p}" for n in rig.cameras for p in CAMERA_PARAMETERS),
            volume_mm=where[keep],
            volume_seen=by[keep],
        ),
        world_from_target=poses,
        points_seen=counts,
    )


def _check_in_air(rig: RigData) -> None:
    for name, camera in rig.cameras.items():
        if camera.interface is not None:
            raise CalibrationError(
                f"camera {name}: it looks through the interface {camera.interface.name!r}; "
                "planning knows no refraction: plan in air, with the volume at its apparent depth"
            )


Seen = list[npt.NDArray[np.bool_]]


def _positions(
    rig: RigData, target: PointSet, volume: MeasuringVolume, options: DesignOptions
) -> list[Rigid]:
    """Poses of the target at which two cameras see it."""
    numbers = even_sequence(_TRIES * options.count, 6)
    middle = dataclasses.replace(volume, size_mm=options.part * volume.size_mm)
    places = middle.fill(numbers[:, :3])
    axis, two_sided = _facing_axis(target)
    wanted = min(2, len(rig.cameras))
    poses: list[Rigid] = []
    for i, (place, number) in enumerate(zip(places, numbers[:, 3:], strict=True)):
        # The cameras take turns, so that all are looked at, whatever side they are on; the
        # sides of the target do, so that every camera meets both.
        turn = len(poses)
        towards = _direction(rig, place, turn, i // len(rig.cameras))
        sign = -1.0 if two_sided and (turn // 2) % 2 else 1.0
        rotation = _turned(sign * axis, towards, number, options.largest_tilt_rad)
        shift = place - rotation @ target.position_mm.mean(axis=0)
        visible = _visible(rig, target, (rotation, shift), options)
        if sum(bool(v.any()) for v in visible) >= wanted:
            poses.append((rotation, shift))
        if len(poses) == options.count:
            return poses
    raise CalibrationError(
        f"calibration design: of {len(numbers)} positions of the target in the volume only "
        f"{len(poses)} are seen by two cameras with {options.min_points} points or more, "
        f"{options.count} are wanted; take a smaller target, or another volume or direction of "
        "the cameras"
    )


def even_sequence(count: int, dimensions: int) -> FloatArray:
    """(count, dimensions) numbers in [0, 1) that fill the cube evenly from the first one on.

    The additive recurrence x_i = (1/2 + i / g^k) mod 1, k = 1 ... d, with g the positive root of
    g^(d + 1) = g + 1 [1].

    [1] M. Roberts, The unreasonable effectiveness of quasirandom sequences, 2018.

    Examples
    --------
    >>> even_sequence(2, 1).round(4).tolist()
    [[0.118], [0.7361]]
    """
    root = 2.0
    for _ in range(60):
        root = (1 + root) ** (1 / (dimensions + 1))
    steps = root ** -np.arange(1.0, dimensions + 1)
    return np.asarray((0.5 + np.arange(1, count + 1)[:, None] * steps) % 1.0)


def _facing_axis(target: PointSet) -> tuple[FloatArray, bool]:
    """Unit vector that the target turns to the cameras, and whether its back does as well."""
    if target.normal is None:
        spread = target.position_mm - target.position_mm.mean(axis=0)
        return np.asarray(np.linalg.svd(spread)[2][2]), True
    normals = target.normal[np.isfinite(target.normal).all(axis=1)]
    mean = normals.mean(axis=0)
    if np.linalg.norm(mean) > 0.1:
        return np.asarray(mean / np.linalg.norm(mean)), False
    return np.asarray(np.linalg.eigh(normals.T @ normals)[1][:, 2]), True


def _direction(rig: RigData, place: FloatArray, turn: int, skip: int) -> FloatArray:
    """Mean direction from a place to the cameras around the one whose turn it is."""
    views = np.stack([camera.centre_mm - place for camera in rig.cameras.values()])
    views /= np.linalg.norm(views, axis=1, keepdims=True)
    main = views[(turn + skip) % len(views)]
    mean = views[views @ main > np.cos(_TOGETHER_RAD)].mean(axis=0)
    return np.asarray(mean / np.linalg.norm(mean))


def _turned(
    axis: FloatArray, towards: FloatArray, number: FloatArray, largest_rad: float
) -> FloatArray:
    """Rotation that brings ``axis`` to a direction tilted from ``towards``, with any roll."""
    tilt, azimuth, roll = largest_rad * number[0], *(2 * np.pi * number[1:])
    u, v = _perpendicular(towards)
    direction = np.cos(tilt) * towards + np.sin(tilt) * (np.cos(azimuth) * u + np.sin(azimuth) * v)
    u, v = _perpendicular(direction)
    first = np.cos(roll) * u + np.sin(roll) * v
    world = np.stack([first, np.cross(direction, first), direction], axis=1)
    a, b = _perpendicular(axis)
    return np.asarray(world @ np.stack([a, b, axis], axis=1).T)


def _perpendicular(axis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors that make a right-handed frame (u, v, axis)."""
    other = np.eye(3)[np.argmin(np.abs(axis))]
    u = np.cross(other, axis)
    u /= np.linalg.norm(u)
    return np.asarray(u), np.cross(axis, u)


def _visible(rig: RigData, target: PointSet, pose: Rigid, options: DesignOptions) -> Seen:
    """Per camera (N,): in the picture and facing it; nothing where too few points are."""
    points = target.position_mm @ pose[0].T + pose[1]
    seen = []
    for camera in rig.cameras.values():
        xy = project(camera, points @ camera.rotation.T + camera.translation_mm)
        with np.errstate(invalid="ignore"):
            inside = ((xy >= 0) & (xy <= np.array(camera.image_size_px) - 1.0)).all(axis=1)
        faces = np.ones(len(points), dtype=bool)
        if target.normal is not None:
            view = camera.centre_mm - points
            cosine = ((target.normal @ pose[0].T) * view).sum(axis=1) / np.linalg.norm(view, axis=1)
            faces = ~(cosine <= np.cos(options.largest_incidence_rad))  # no normal: from all sides
        visible = inside & faces
        good = visible.sum() >= options.min_points and not (
            options.whole and (faces > inside).any()
        )
        seen.append(visible if good else np.zeros_like(visible))
    return seen


def _check_linked(names: Sequence[str], seen: npt.NDArray[np.bool_]) -> None:
    """CalibrationError unless shared positions tie all cameras to the first."""
    blind = [name for k, name in enumerate(names) if not seen[:, k].any()]
    if blind:
        raise CalibrationError(
            f"calibration design: camera {blind[0]} sees the target at none of {len(seen)} "
            "positions in the volume; check where it stands and looks, or take more positions"
        )
    tied = np.zeros(len(names), dtype=bool)
    tied[0] = True
    for _ in names:
        tied |= seen[seen[:, tied].any(axis=1)].any(axis=0)
    if not tied.all():
        rest = ", ".join(np.array(names)[~tied])
        raise CalibrationError(
            f"calibration design: no position of the target is seen by {names[0]} and its "
            f"neighbours as well as by {rest}, so that nothing ties them together; take a target "
            "with points on both sides, or more positions"
        )


def _covariance(
    rig: RigData,
    target: PointSet,
    poses: Sequence[Rigid],
    seen: Sequence[Seen],
    options: DesignOptions,
) -> FloatArray:
    """(16 C, 16 C) of the cameras; the first one's pose is the frame."""
    network = Network()
    outer = []
    for k, (name, camera) in enumerate(rig.cameras.items()):
        network.add_camera(name, camera, free=tuple(options.free_of(name)))
        outer.append(network.add_pose(name, camera.rotation, camera.translation_mm, free=k > 0))
    image, point, xy = [], [], []
    for i, (pose, visible) in enumerate(zip(poses, seen, strict=True)):
        if not any(v.any() for v in visible):
            continue  # nothing determines where the target stands there
        inner = network.add_pose(f"position {i + 1}", *pose)
        points = target.position_mm @ pose[0].T + pose[1]
        for k, (name, camera) in enumerate(rig.cameras.items()):
            if not visible[k].any():
                continue
            index = network.add_image(f"{name}, position {i + 1}", k, outer=outer[k], inner=inner)
            rows = np.flatnonzero(visible[k])
            image.append(np.full(len(rows), index))
            point.append(rows)
            in_cam = points[rows] @ camera.rotation.T + camera.translation_mm
            xy.append(project(camera, in_cam))
    variance = options.target_sigma_mm**2 * np.eye(3)
    network.set_points(target.id, target.position_mm, np.tile(variance, (len(target), 1, 1)))
    count = sum(len(rows) for rows in point)
    network.set_observations(
        np.concatenate(image),
        np.concatenate(point),
        np.concatenate(xy),
        np.tile([options.sigma_px**2, 0.0, options.sigma_px**2], (count, 1)),
    )
    try:
        dispersion = network.dispersion()
    except CalibrationError as error:
        raise CalibrationError(
            f"calibration design: {len(poses)} positions of the target do not determine the "
            f"cameras ({error}); take more positions, or fewer free parameters"
        ) from error
    place: list[int] = []
    for k, number in enumerate(outer):
        place += [int(p) for p in dispersion.interior_index[k][: len(INTERIOR_NAMES)]]
        first = int(dispersion.pose_index[number])
        place += [first + j if first >= 0 else -1 for j in range(len(POSE_NAMES))]
    where = np.array(place)
    free = np.flatnonzero(where >= 0)
    cov = np.zeros((len(where), len(where)))
    cov[np.ix_(free, free)] = dispersion.cov[np.ix_(where[free], where[free])]
    return cov
