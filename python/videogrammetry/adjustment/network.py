"""Bundle adjustment of a network of pictures: arrays in, arrays out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from videogrammetry._core import adjustment as _adjustment
from videogrammetry.adjustment.arguments import (
    bar_arrays,
    check_names,
    circle_arrays,
    interface_names,
    mask,
    point_kinds,
)
from videogrammetry.adjustment.outcome import find_dispersion, run_adjustment
from videogrammetry.adjustment.results import (
    CAMERA_UNKNOWNS,
    INTERFACE_UNKNOWNS,
    Adjustment,
    AdjustOptions,
    Dispersion,
)
from videogrammetry.adjustment.start import rows
from videogrammetry.geometry import camera_model, interface_model
from videogrammetry.types import FlatInterface, FloatArray, RigCamera

DATUMS = ("fixed", "weighted", "free")
#: Whose residuals are minimised: the measured image point's, or the corrected one's.
RESIDUALS = ("measured", "corrected")


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
    >>> (network.pose(pose)[1].round(6) + 0.0).tolist(), result.redundancy
    ([0.0, 0.0, 100.0], 2)
    """

    def __init__(self) -> None:
        self._network = _adjustment.Network()
        self._names: list[str] = []
        self._interfaces: list[FlatInterface] = []

    def add_camera(
        self,
        name: str,
        camera: RigCamera,
        *,
        free: Sequence[str],
        prior_sigma: Mapping[str, float] | None = None,
        start: npt.ArrayLike | None = None,
        floor_px: float = 0.0,
        aspect: float = 0.0,
        time_offset: float = 0.0,
        interface: int | None = None,
        residuals: str = "measured",
    ) -> int:
        """Add a camera.

        Parameters
        ----------
        free, prior_sigma : names of ``CAMERA_UNKNOWNS``; what is estimated, and with
            which standard deviation its value in ``start`` is observed.
        start : (10,) or (12,) values of held or observed parameters (its interior).
        aspect : pixel height over width less 1: y from the principal point times
            (1 + aspect) enters the distortion.
        time_offset : part of the interval between pictures by which this camera is late:
            measured = predicted + time_offset * velocity_px of the observation.
        interface : the window that it looks through (:meth:`add_interface`); None: none.
        residuals : whose the stated covariances and the residuals are. "measured": the
            measured point's. "corrected", of cameras whose distortion corrects the
            measured point: r = (corrected(measured) - f (X, Y) / Z) / k with k, the
            corrected picture's scale at the principal point, which makes r independent
            of r0; as PhotoModeler and DBAT.

        Raises
        ------
        ValueError : a name that is none of ``CAMERA_UNKNOWNS``; corrected residuals of a
            camera whose distortion is a function of the ideal point.
        """
        if residuals not in RESIDUALS:
            raise ValueError(
                f"residuals: expected one of {', '.join(RESIDUALS)}, got {residuals!r}"
            )
        if residuals == "corrected" and not camera.measured:
            raise ValueError(
                f'residuals: camera {name}: "corrected" needs a distortion of the measured point '
                "(measured = True)"
            )
        check_names("free", free)
        check_names("prior_sigma", prior_sigma or ())
        prior = np.zeros(len(CAMERA_UNKNOWNS))
        for key, sigma in (prior_sigma or {}).items():
            prior[CAMERA_UNKNOWNS.index(key)] = sigma
        held = np.array([*camera.interior, aspect, time_offset], dtype=float)
        if start is not None:
            values = np.asarray(start, dtype=float)
            held[: len(values)] = values
        self._names.append(name)
        index: int = self._network.add_camera(
            name,
            camera_model(camera),
            mask(free),
            held,
            prior,
            floor_px,
            aspect,
            time_offset,
            residuals == "corrected",
        )
        if interface is not None:
            self._network.set_interface(index, interface)
        return index

    def add_interface(
        self,
        interface: FlatInterface,
        *,
        free: Sequence[str] = (),
        prior_sigma: Mapping[str, float] | None = None,
    ) -> int:
        """Add a window between air and a fluid; cameras name it by the index returned.

        It stands in the frame that outer poses lead from (the rig's); for images
        without one, in the object's. Its indices and glass are held. Circles behind a
        window count as points, and a free network (``set_datum("free")``) has none.

        Parameters
        ----------
        interface : start values.
        free, prior_sigma : names of ``INTERFACE_UNKNOWNS``, "normal" for both tilts; what is
            estimated, and with which standard deviation (rad, mm) its start value is observed.

        Raises
        ------
        ValueError : another name, or an interface that is none.
        """
        wanted = interface_names("free", free)
        prior = np.zeros(len(INTERFACE_UNKNOWNS))
        for key, sigma in (prior_sigma or {}).items():
            for name in interface_names("prior_sigma", (key,)):
                prior[INTERFACE_UNKNOWNS.index(name)] = sigma
        self._interfaces.append(interface)
        index: int = self._network.add_interface(
            interface.name,
            interface_model(interface),
            [name in wanted for name in INTERFACE_UNKNOWNS],
            prior,
        )
        return index

    def interface(self, interface: int) -> FlatInterface:
        """A window as it stands."""
        now = self._network.interface(interface)
        return replace(
            self._interfaces[interface],
            normal=np.array(now.normal),
            distance_mm=float(now.distance_mm),
        )

    def interface_unknowns(self, interface: int) -> FloatArray:
        """(3,) the values of ``INTERFACE_UNKNOWNS``: tilts from the start normal, distance."""
        return np.array(self._network.interface_values(interface))

    def interface_tangents(self, interface: int) -> FloatArray:
        """(2, 3) the directions along which tilt_1 and tilt_2 turn the start normal."""
        return np.array(self._network.interface_tangents(interface)).T

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
        kind: str | Sequence[str] | None = None,
    ) -> None:
        """Set the object points (N, 3); with ``cov_mm2`` (N, 3, 3) weighted, else fixed.

        Parameters
        ----------
        kind : "fixed", "weighted" or "free", of all points or one a point;
            ``cov_mm2`` is read where it is "weighted".
        """
        positions = rows(position_mm, 3, "position_mm")
        kind = kind if kind is not None else ("fixed" if cov_mm2 is None else "weighted")
        kinds = point_kinds(kind, len(positions))
        cov = np.zeros((0, 9)) if cov_mm2 is None else np.reshape(cov_mm2, (-1, 9))
        self._network.set_points(
            np.asarray(point_id, np.int32),
            positions,
            np.ascontiguousarray(cov, dtype=float),
            kinds,
        )

    def set_point_prior(
        self, rows: npt.ArrayLike, mean_mm: npt.ArrayLike, cov_mm2: npt.ArrayLike
    ) -> None:
        """Observe some weighted points together, with their full covariance.

        A covariance that is singular because it came from a free network gets a
        variance along the datum's directions (shift, rotation, then scale) of the
        size of its average variance: poses absorb such motions, so that what the
        network estimates does not change by it.

        Parameters
        ----------
        rows : (K,) rows of ``set_points``, of kind "weighted".
        mean_mm : (K, 3) a-priori positions; cov_mm2 : (3K, 3K).

        Raises
        ------
        ValueError : other shapes, a point that is not weighted or named twice, or a covariance
            that is singular in more than that.
        """
        self._network.set_point_prior(
            np.asarray(rows, int).tolist(),
            np.asarray(mean_mm, float).ravel(),
            np.asarray(cov_mm2, float),
        )

    def set_scale_bars(
        self,
        a: npt.ArrayLike,
        b: npt.ArrayLike,
        length_mm: npt.ArrayLike,
        sigma_mm: npt.ArrayLike,
    ) -> None:
        """Set known distances (B,) between points ``a`` and ``b`` (rows of the points)."""
        self._network.set_scale_bars(*bar_arrays(a, b, length_mm, sigma_mm))

    def set_datum(self, datum: str) -> None:
        """Say what the object's frame rests on.

        "fixed" and "weighted": on such points, or held poses. "free": inner
        constraints over all points (shift, rotation, and scale where no scale bar
        gives it); the points end where they fit their start values best.
        """
        if datum not in DATUMS:
            raise ValueError(f"datum: expected one of {', '.join(DATUMS)}, got {datum!r}")
        self._network.set_datum(getattr(_adjustment.Datum, datum.upper()))

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
        self._network.set_circles(*circle_arrays(normal, diameter_mm))

    def set_observations(
        self,
        image: npt.ArrayLike,
        point: npt.ArrayLike,
        xy_px: npt.ArrayLike,
        cov_px2: npt.ArrayLike,
        used: npt.ArrayLike | None = None,
        velocity_px: npt.ArrayLike | None = None,
    ) -> None:
        """Set the image points: indices (M,), positions (M, 2), covariances (M, 3) xx, xy, yy.

        ``velocity_px`` (M, 2): motion of the image point from picture to picture, which
        the cameras' ``time_offset`` is estimated from; None: at rest.
        """
        image = np.asarray(image, np.int32)
        velocity = np.zeros((len(image), 2)) if velocity_px is None else velocity_px
        mask = np.ones(len(image), bool) if used is None else np.asarray(used, bool)
        self._network.set_observations(
            image,
            np.asarray(point, np.int32),
            rows(xy_px, 2, "xy_px"),
            rows(cov_px2, 3, "cov_px2"),
            mask.tolist(),
            rows(velocity, 2, "velocity_px"),
        )

    def set_free(self, camera: int, free: Sequence[str]) -> None:
        """Choose which of ``CAMERA_UNKNOWNS`` of a camera are estimated."""
        check_names("free", free)
        self._network.set_free(camera, mask(free))

    def set_pose(self, pose: int, rotation: npt.ArrayLike, translation_mm: npt.ArrayLike) -> None:
        """Replace a pose's values."""
        self._network.set_pose(pose, np.asarray(rotation, float), np.asarray(translation_mm, float))

    def interior(self, camera: int) -> FloatArray:
        """The ten interior parameters of a camera as they stand."""
        return np.array(self._network.camera(camera).interior)

    def camera_unknowns(self, camera: int) -> FloatArray:
        """(12,) the values of ``CAMERA_UNKNOWNS`` of a camera as they stand."""
        return np.array(self._network.camera_values(camera))

    def model(self, camera: int) -> Any:
        """The C++ camera as it stands, for :func:`~videogrammetry.adjustment.start.resect`."""
        return self._network.camera(camera)

    def free(self, camera: int) -> tuple[str, ...]:
        """Names of a camera's parameters that are estimated."""
        mask = self._network.free(camera)
        return tuple(name for name, is_free in zip(CAMERA_UNKNOWNS, mask, strict=True) if is_free)

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
        return run_adjustment(self._network, options or AdjustOptions(), offered)

    def dispersion(self, *, num_threads: int = 0) -> Dispersion:
        """Covariance of the unknowns at the present values.

        Raises
        ------
        CalibrationError : rank defect.
        """
        return find_dispersion(self._network, num_threads)
