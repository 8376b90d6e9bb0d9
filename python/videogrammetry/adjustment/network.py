"""Bundle adjustment of a network of pictures: arrays in, arrays out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from videogrammetry._core import TaskError as _TaskError
from videogrammetry._core import adjustment as _adjustment
from videogrammetry.adjustment.start import rows
from videogrammetry.errors import CalibrationError
from videogrammetry.geometry import camera_model
from videogrammetry.types import INTERIOR_NAMES, FloatArray, IntArray, RigCamera

POINT_KINDS = ("fixed", "weighted", "free")


@dataclass(frozen=True, kw_only=True)
class AdjustOptions:
    """What an adjustment does beside minimising (fields as in the C++ struct).

    Attributes
    ----------
    critical_value : of Baarda's w-test; 0 = no data snooping.
    estimate_floor : estimate an additive variance of the image points per camera
        (or, where the stated covariances are too large, a factor below 1).
    robust_start : begin with Cauchy's loss (needed unless the start is the solution).
    significance : drop offered distortion parameters below this many standard
        deviations; 0 = keep all.
    max_rounds : adjustments between changes of weights and observations, at most.
    num_threads : 0 = one a core.
    """

    critical_value: float = 3.29
    estimate_floor: bool = True
    robust_start: bool = True
    significance: float = 0.0
    max_rounds: int = 30
    num_threads: int = 0


@dataclass(frozen=True, kw_only=True)
class DroppedParameter:
    """An interior parameter not estimated: not significant, or ``undetermined``."""

    camera: int
    name: str
    value: float
    sigma: float
    undetermined: bool


@dataclass(frozen=True, kw_only=True)
class CameraVariance:
    """A camera's variance factor, redundancy, RMS residual per coordinate, image points."""

    factor: float
    redundancy: float
    rms_px: float
    count: int


@dataclass(frozen=True, kw_only=True)
class Adjustment:
    """Summary of an adjustment; (M, 2) arrays per observation, used or not.

    ``residual_px`` measured - adjusted; ``normalised`` Baarda's w;
    ``redundancy_numbers`` diagonal of Qvv P; ``used`` False where rejected.
    """

    converged: bool
    message: str
    sigma0: float
    num_observations: int
    num_prior: int
    num_unknowns: int
    redundancy: int
    point_factor: float
    point_redundancy: float
    cameras: tuple[CameraVariance, ...]
    dropped: tuple[DroppedParameter, ...]
    residual_px: FloatArray
    normalised: FloatArray
    redundancy_numbers: FloatArray
    used: npt.NDArray[np.bool_]
    rounds: int


@dataclass(frozen=True, kw_only=True)
class Dispersion:
    """Covariance of the unknowns, a priori (times sigma0^2: a posteriori).

    Attributes
    ----------
    cov : (U, U) of the cameras' and poses' unknowns.
    interior_index : per camera, ten places in ``cov`` or -1.
    pose_index : per pose, its first place (rx, ry, rz, tx, ty, tz) or -1.
    point_cov_mm2 : (N, 3, 3).
    """

    cov: FloatArray
    interior_index: IntArray
    pose_index: IntArray
    point_cov_mm2: FloatArray
    handle: Any = field(repr=False)

    def predict(self, image: npt.ArrayLike, point: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Pictures (N, 2) of points in images and their covariances (N, 3); NaN where none."""
        xy, cov = self.handle.predict(np.asarray(image, np.int32), np.asarray(point, np.int32))
        return xy, cov

    def full_covariance(self) -> FloatArray:
        """Covariance of all unknowns, the points' three each at the end."""
        result: FloatArray = self.handle.full_covariance()
        return result


class Network:
    """Cameras, poses, images, points and observations; see ``Network`` in C++.

    A picture's pose is cam_from_object = poses[outer] * poses[inner]: of a rig,
    outer = cam_from_rig of its camera and inner = rig_from_target of its stage;
    a picture with a pose of its own has outer = -1.

    Examples
    --------
    A resection: one picture of four fixed points.

    >>> camera = RigCamera(image_size_px=(101, 101), interior=np.r_[1000.0, np.zeros(9)],
    ...                    r0_px=40.0, rotation=np.eye(3), translation_mm=np.zeros(3))
    >>> points = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.5]])
    >>> in_cam = points + [0.0, 0.0, 100.0]
    >>> pixels = 50.0 + 1000.0 * in_cam[:, :2] / in_cam[:, 2:]
    >>> network = Network()
    >>> cam = network.add_camera("left", camera, free=())
    >>> pose = network.add_pose("stage 1", np.eye(3), [0.1, 0.0, 99.0])
    >>> image = network.add_image("left_1", cam, inner=pose)
    >>> network.set_points(np.arange(4), points)
    >>> cov = np.tile([1e-4, 0, 1e-4], (4, 1))
    >>> network.set_observations(np.zeros(4), np.arange(4), pixels, cov)
    >>> result = network.adjust(AdjustOptions(critical_value=0))
    >>> network.pose(pose)[1].round(6).tolist(), result.redundancy
    ([0.0, 0.0, 100.0], 2)
    """

    def __init__(self) -> None:
        self._network = _adjustment.Network()
        self._names: list[str] = []

    def add_camera(
        self,
        name: str,
        camera: RigCamera,
        *,
        free: Sequence[str],
        prior_sigma: Mapping[str, float] | None = None,
        start: npt.ArrayLike | None = None,
        floor_px: float = 0.0,
    ) -> int:
        """Add a camera; ``start``: values of held or observed parameters (its interior)."""
        prior = np.zeros(len(INTERIOR_NAMES))
        for key, sigma in (prior_sigma or {}).items():
            prior[INTERIOR_NAMES.index(key)] = sigma
        held = camera.interior if start is None else np.asarray(start, dtype=float)
        mask = [parameter in free for parameter in INTERIOR_NAMES]
        self._names.append(name)
        index: int = self._network.add_camera(
            name, camera_model(camera), mask, held, prior, floor_px
        )
        return index

    def add_pose(
        self,
        name: str,
        rotation: npt.ArrayLike,
        translation_mm: npt.ArrayLike,
        *,
        free: bool = True,
    ) -> int:
        """Add a rigid motion, estimated or held."""
        index: int = self._network.add_pose(
            name, np.asarray(rotation, float), np.asarray(translation_mm, float), free
        )
        return index

    def add_image(self, name: str, camera: int, *, inner: int, outer: int = -1) -> int:
        """Add a picture."""
        index: int = self._network.add_image(name, camera, outer, inner)
        return index

    def set_points(
        self,
        point_id: npt.ArrayLike,
        position_mm: npt.ArrayLike,
        cov_mm2: FloatArray | None = None,
        *,
        kind: str | None = None,
    ) -> None:
        """Set the object points (N, 3); with ``cov_mm2`` (N, 3, 3) weighted, else fixed."""
        kind = kind or ("fixed" if cov_mm2 is None else "weighted")
        if kind not in POINT_KINDS:
            raise ValueError(f"kind: expected one of {', '.join(POINT_KINDS)}, got {kind!r}")
        cov = np.zeros((0, 9)) if cov_mm2 is None else np.reshape(cov_mm2, (-1, 9))
        self._network.set_points(
            np.asarray(point_id, np.int32),
            rows(position_mm, 3, "position_mm"),
            np.ascontiguousarray(cov, dtype=float),
            getattr(_adjustment.PointKind, kind.upper()),
        )

    def set_circles(self, normal: npt.ArrayLike, diameter_mm: npt.ArrayLike) -> None:
        """Say that points are centres of circles, whose ellipses' centres are observed.

        Parameters
        ----------
        normal : (N, 3) unit normals in the object's frame, one a point of ``set_points``.
        diameter_mm : (N,); a row that is not finite in either: the point is no circle.

        Raises
        ------
        ValueError : a diameter that is not positive or a normal not of unit length.
        """
        normals, diameters = rows(normal, 3, "normal"), np.asarray(diameter_mm, dtype=float)
        if diameters.shape != (len(normals),):
            raise ValueError(f"diameter_mm: expected ({len(normals)},), got {diameters.shape}")
        known = np.isfinite(normals).all(axis=1) & np.isfinite(diameters)
        if (diameters[known] <= 0).any():
            raise ValueError(
                f"diameter_mm: expected > 0, got {diameters[known][diameters[known] <= 0][0]:g}"
            )
        self._network.set_circles(
            np.where(known[:, None], normals, [0.0, 0.0, 1.0]),
            np.where(known, 0.5 * diameters, 0.0),
        )

    def set_observations(
        self,
        image: npt.ArrayLike,
        point: npt.ArrayLike,
        xy_px: npt.ArrayLike,
        cov_px2: npt.ArrayLike,
        used: npt.ArrayLike | None = None,
    ) -> None:
        """Set the image points: indices (M,), positions (M, 2), covariances (M, 3) xx, xy, yy."""
        image = np.asarray(image, np.int32)
        mask = np.ones(len(image), bool) if used is None else np.asarray(used, bool)
        self._network.set_observations(
            image,
            np.asarray(point, np.int32),
            rows(xy_px, 2, "xy_px"),
            rows(cov_px2, 3, "cov_px2"),
            mask.tolist(),
        )

    def set_free(self, camera: int, free: Sequence[str]) -> None:
        """Choose which interior parameters of a camera are estimated."""
        self._network.set_free(camera, [name in free for name in INTERIOR_NAMES])

    def set_pose(self, pose: int, rotation: npt.ArrayLike, translation_mm: npt.ArrayLike) -> None:
        """Replace a pose's values."""
        self._network.set_pose(pose, np.asarray(rotation, float), np.asarray(translation_mm, float))

    def interior(self, camera: int) -> FloatArray:
        """The ten interior parameters of a camera as they stand."""
        return np.array(self._network.camera(camera).interior)

    def model(self, camera: int) -> Any:
        """The C++ camera as it stands, for :func:`~videogrammetry.adjustment.start.resect`."""
        return self._network.camera(camera)

    def free(self, camera: int) -> tuple[str, ...]:
        """Names of the interior parameters that are estimated."""
        mask = self._network.free(camera)
        return tuple(name for name, is_free in zip(INTERIOR_NAMES, mask, strict=True) if is_free)

    def floor_px(self, camera: int) -> float:
        """The camera's estimated floor of the image points' standard deviation."""
        return float(self._network.floor_px(camera))

    def cov_scale(self, camera: int) -> float:
        """Factor on the camera's stated covariances; below 1 where they were too large."""
        return float(self._network.cov_scale(camera))

    def pose(self, pose: int) -> tuple[FloatArray, FloatArray]:
        """Rotation (3, 3) and translation (3,) of a pose as they stand."""
        rotation, translation = self._network.pose(pose)
        return rotation, translation

    @property
    def positions_mm(self) -> FloatArray:
        """(N, 3) positions of the points as they stand."""
        return np.array(self._network.positions_mm)

    @property
    def used(self) -> npt.NDArray[np.bool_]:
        """(M,) whether an observation takes part."""
        return np.array(self._network.used, dtype=bool)

    def adjust(
        self,
        options: AdjustOptions | None = None,
        offered: Sequence[Sequence[str]] | None = None,
    ) -> Adjustment:
        """Adjust; ``offered`` names per camera the parameters that may be dropped.

        Raises
        ------
        CalibrationError : rank defect (names the unknowns) or no redundancy.
        """
        options = options or AdjustOptions()
        native = _adjustment.AdjustOptions()
        for name in AdjustOptions.__dataclass_fields__:
            setattr(native, name, getattr(options, name))
        if offered is not None:
            native.offered = [[name in names for name in INTERIOR_NAMES] for names in offered]
        try:
            result = _adjustment.adjust(self._network, native)
        except _TaskError as error:
            raise CalibrationError(str(error)) from error
        statistics = result.statistics
        return Adjustment(
            **{name: getattr(result, name) for name in _COPIED},
            cameras=tuple(
                CameraVariance(
                    factor=c.factor, redundancy=c.redundancy, rms_px=c.rms_px, count=c.count
                )
                for c in result.cameras
            ),
            dropped=tuple(
                DroppedParameter(
                    camera=d.camera,
                    name=INTERIOR_NAMES[d.parameter],
                    value=d.value,
                    sigma=d.sigma,
                    undetermined=d.undetermined,
                )
                for d in result.dropped
            ),
            residual_px=statistics["residual_px"],
            normalised=statistics["normalised"],
            redundancy_numbers=statistics["redundancy"],
            used=self.used,
        )

    def dispersion(self) -> Dispersion:
        """Covariance of the unknowns at the present values.

        Raises
        ------
        CalibrationError : rank defect.
        """
        try:
            handle = _adjustment.Dispersion(self._network)
        except _TaskError as error:
            raise CalibrationError(str(error)) from error
        cov = _adjustment.point_covariances(self._network, handle)
        return Dispersion(
            cov=handle.cov_reduced,
            interior_index=np.array(handle.interior_index, np.int32).reshape(-1, 10),
            pose_index=np.array(handle.pose_index, np.int32),
            point_cov_mm2=np.reshape(cov, (-1, 3, 3)),
            handle=handle,
        )


_COPIED = (
    "converged",
    "message",
    "sigma0",
    "num_observations",
    "num_prior",
    "num_unknowns",
    "redundancy",
    "point_factor",
    "point_redundancy",
    "rounds",
)
