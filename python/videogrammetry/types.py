"""The nouns that flow between the rooms: frozen dataclasses of arrays.

Frames and units as everywhere in this package: pixel (0, 0) is the centre of
the top-left pixel, x right, y down; camera axes z forward, x right, y down;
lengths in mm, times in s, angles in rad. ``a_from_b`` names a transform.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int32]

#: Order of the ten interior parameters in every vector, matrix and file.
INTERIOR_NAMES = ("f", "x0", "y0", "A1", "A2", "A3", "B1", "B2", "E1", "E2")

#: Order of a symmetric 3x3 covariance stored as six numbers.
COV6_ORDER = ("xx", "xy", "xz", "yy", "yz", "zz")
_COV6_ROWS = np.array([0, 0, 0, 1, 1, 2])
_COV6_COLS = np.array([0, 1, 2, 1, 2, 2])
_COV6_PLACES = 3 * _COV6_ROWS + _COV6_COLS


def cov6_from_matrix(matrix: FloatArray) -> FloatArray:
    """Six numbers (xx, xy, xz, yy, yz, zz) of symmetric matrices (..., 3, 3).

    Examples
    --------
    >>> cov6_from_matrix(np.diag([1.0, 2.0, 3.0])).tolist()
    [1.0, 0.0, 0.0, 2.0, 0.0, 3.0]
    """
    matrix = np.asarray(matrix)
    flat = matrix.reshape(*matrix.shape[:-2], 9)
    return np.ascontiguousarray(flat.take(_COV6_PLACES, axis=-1))


def matrix_from_cov6(cov6: FloatArray) -> FloatArray:
    """Symmetric matrices (..., 3, 3) of the six numbers (..., 6).

    Examples
    --------
    >>> matrix_from_cov6(np.array([1.0, 0.5, 0.0, 2.0, 0.0, 3.0]))[0].tolist()
    [1.0, 0.5, 0.0]
    """
    cov6 = np.asarray(cov6, dtype=float)
    matrix = np.empty((*cov6.shape[:-1], 3, 3))
    matrix[..., _COV6_ROWS, _COV6_COLS] = cov6
    matrix[..., _COV6_COLS, _COV6_ROWS] = cov6
    return matrix


#: What is said of a point at a stage, the bits of ``Trajectories.flags`` from the lowest.
POINT_FLAGS = (
    "two_rays",  # 1: no third ray that could contradict
    "large_residual",  # 2: the rays miss each other by more than noise and calibration explain
    "outside_volume",  # 4: beyond where the calibration was
    "ambiguous",  # 8: another match or another identity is not much less likely
    "filled",  # 16: not measured, estimated from other stages or neighbours
    "unstable_camera",  # 32: seen by a camera that has moved since the calibration
)


@runtime_checkable
class FrameSource(Protocol):
    """A sequence of frames of one camera: what a reader of a format provides.

    ``read`` may be called from several threads at once. Frames are numbered
    from 0 here (stages count from 1 in files and results). A source may also
    have ``packed(index)``: the frame as :class:`PackedSamples` where it stands,
    or None if it is to be read. What else one may have, and an example:
    docs/how-to/own-format.md.
    """

    @property
    def image_size_px(self) -> tuple[int, int]:
        """(width, height)."""
        ...

    @property
    def frame_rate_hz(self) -> float | None:
        """Frames a second as the file says, or None."""
        ...

    def __len__(self) -> int:
        """Number of frames."""
        ...

    def name(self, index: int) -> str:
        """Name of a frame for tables and messages (a file's name, no folder)."""
        ...

    def read(self, index: int) -> npt.NDArray[Any]:
        """The frame: (height, width), uint8 or uint16, C-contiguous."""
        ...


class PackedSamples(Protocol):
    """A picture of 12-bit samples in memory, two in three bytes, without gaps.

    What a source's ``packed(index)`` gives and recognition reads in place: any
    object with these attributes.
    """

    @property
    def data(self) -> npt.NDArray[np.uint8]:
        """(3 H W / 2,) bytes."""
        ...

    @property
    def shape(self) -> tuple[int, int]:
        """(H, W), W even."""
        ...

    @property
    def order(self) -> str:
        """``high-first`` (Photron) or ``low-first`` (Mono12p)."""
        ...


#: Stand for flags and confidences that were not given.
_NO_FLAGS = np.empty(0, np.uint8)
_UNKNOWN = np.empty(0)


@dataclass(frozen=True, kw_only=True)
class Targets:
    """The targets recognised in one picture.

    Attributes
    ----------
    centre_px : (N, 2) ellipse centres x, y, not corrected for eccentricity.
    semi_axes_px : (N, 2) semi-major and semi-minor axis.
    angle_rad : (N,) direction of the major axis from x towards y, in [0, pi).
    id : (N,) code number, -1 = un-coded or not read.
    cov : (N, 5, 5) covariance of (x, y, semi-major, semi-minor, angle), in px
        and rad, from the residuals of the edge points.
    edge_rms_px : (N,) RMS distance of the edge points from the ellipse.
    contrast : (N,) grey-value difference across the edge, in grey levels.
    ring_status : (N,) index into ``RING_STATUS``: why a target has no ID.
    id_confidence : (N,) probability that the ID is right, NaN where there is none
        (or where nothing is known of it); what it means: docs/method.md, section 1.
    """

    centre_px: FloatArray
    semi_axes_px: FloatArray
    angle_rad: FloatArray
    id: IntArray
    cov: FloatArray
    edge_rms_px: FloatArray
    contrast: FloatArray
    ring_status: npt.NDArray[np.uint8]
    id_confidence: FloatArray = field(default_factory=lambda: _UNKNOWN)

    def __post_init__(self) -> None:
        if self.id_confidence is _UNKNOWN:
            object.__setattr__(self, "id_confidence", np.full(len(self.id), np.nan))

    def __len__(self) -> int:
        return len(self.id)

    @property
    def sigma_px(self) -> FloatArray:
        """(N, 2) standard deviations of the centre."""
        return np.sqrt(np.stack([self.cov[:, 0, 0], self.cov[:, 1, 1]], axis=1))

    @property
    def unique_id(self) -> IntArray:
        """(N,) ``id``, -1 also where the same number stands at several places."""
        _, inverse, count = np.unique(self.id, return_inverse=True, return_counts=True)
        return np.where(count[inverse] > 1, np.int32(-1), self.id).astype(np.int32)

    def select(self, index: Any) -> Targets:
        """The targets of an index array or mask, in its order."""
        return Targets(**{name: getattr(self, name)[index] for name in _TARGET_FIELDS})


_TARGET_FIELDS = tuple(Targets.__dataclass_fields__)


@dataclass(frozen=True, kw_only=True)
class PointSet:
    """Known or measured points of an object: a points CSV.

    Attributes
    ----------
    id : (N,) numbers, unique.
    position_mm : (N, 3).
    cov_mm2 : (N, 6) in the order of ``COV6_ORDER``, or None where unknown.
    normal : (N, 3) unit normals or None; diameter_mm : (N,) or None.
    full_cov_mm2 : (3N, 3N) with the correlations between points, where they are known.
    """

    id: IntArray
    position_mm: FloatArray
    cov_mm2: FloatArray | None = None
    normal: FloatArray | None = None
    diameter_mm: FloatArray | None = None
    full_cov_mm2: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.id)


@dataclass(frozen=True, kw_only=True)
class Observations:
    """Image points of known identity: an observations CSV, one row a point.

    Attributes
    ----------
    image : names of the pictures, indexed by ``image_index`` (M,).
    point_id : (M,) numbers of the points; -1 = not yet identified.
    xy_px : (M, 2). cov_px2 : (M, 3) xx, xy, yy.
    """

    image: tuple[str, ...]
    image_index: IntArray
    point_id: IntArray
    xy_px: FloatArray
    cov_px2: FloatArray

    def __len__(self) -> int:
        return len(self.point_id)


@dataclass(frozen=True, kw_only=True)
class FlatInterface:
    """A flat window between the cameras' air and a fluid: plane normal . X = distance_mm.

    Attributes
    ----------
    name : cameras that look through the same window name the same.
    normal : (3,) unit, pointing to the cameras, in the frame of the rig.
    distance_mm : of the window's face on the cameras' side from the frame's origin,
        along the normal.
    fluid_index, glass_index : refractive indices over that of air.
    glass_thickness_mm : 0 = no glass (or as thin as not to matter).
    sigma : "tilt_1", "tilt_2" (rad), "distance" (mm) -> standard deviation, where estimated.
    """

    name: str = "window"
    normal: FloatArray
    distance_mm: float
    fluid_index: float = 1.333
    glass_index: float = 1.0
    glass_thickness_mm: float = 0.0
    sigma: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class RigCamera:
    """One camera of a rig: interior parameters and exterior orientation.

    ``interior`` holds f, x0, y0, A1, A2, A3, B1, B2, E1, E2 (``INTERIOR_NAMES``;
    pixels) for the polynomial of the measured point (``measured`` True: the
    paper's direction) or of the ideal point. ``sigma`` maps a parameter's name
    (also ``rx, ry, rz`` in rad, ``tx, ty, tz`` in mm) to its standard deviation;
    a rotation's is of the rotation vector applied on the left of cam_from_world.
    ``interface`` is the window through which the camera looks into a fluid, if any.
    """

    image_size_px: tuple[int, int]
    interior: FloatArray
    r0_px: float
    rotation: FloatArray
    translation_mm: FloatArray
    measured: bool = True
    sigma: Mapping[str, float] = field(default_factory=dict)
    interface: FlatInterface | None = None

    @property
    def centre_mm(self) -> FloatArray:
        """(3,) projection centre in the rig's frame: -R' t.

        Examples
        --------
        >>> turned = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
        >>> camera = RigCamera(
        ...     image_size_px=(640, 480), interior=np.zeros(10), r0_px=200.0,
        ...     rotation=turned, translation_mm=np.array([-2.0, 1, -3]),
        ... )
        >>> camera.centre_mm.tolist()
        [1.0, 2.0, 3.0]
        """
        return np.asarray(-self.rotation.T @ self.translation_mm)


@dataclass(frozen=True, kw_only=True)
class RigData:
    """The cameras of a rig with their covariance: what rig.json and rig.npz hold.

    Attributes
    ----------
    cameras : name -> RigCamera, in the project's order.
    reference : the frame's origin, in words ("camera left").
    cov : (P, P) covariance of the parameters in ``cov_names`` or None.
    cov_names : "camera/parameter" for each row of ``cov``.
    sigma_floor_px : camera -> standard deviation of an image coordinate that
        adds to what the edges of a target say (lens, flatness, synchronism),
        estimated by the calibration.
    volume_mm, volume_seen : (D, 3) points of the calibrated volume, in the
        rig's frame, and (D, C) which cameras saw each during the calibration;
        None where unknown. They tell where the calibration holds, and in which
        frame the covariance of a point is stated.
    how : method, options, input hashes, version, time, statistics.
    """

    cameras: Mapping[str, RigCamera]
    reference: str = ""
    cov: FloatArray | None = None
    cov_names: tuple[str, ...] = ()
    sigma_floor_px: Mapping[str, float] = field(default_factory=dict)
    volume_mm: FloatArray | None = None
    volume_seen: npt.NDArray[np.bool_] | None = None
    how: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Matches:
    """Targets of all cameras of one stage that show the same points.

    Attributes
    ----------
    target : (P, C) index of the target in each camera's Targets, -1 = not seen.
    id : (P,) code number or -1. chi2 : (P,) of the rays, 2n - 3 degrees of freedom.
    log_odds : (P,) that all the match's targets show one point, against all else.
    status : a camera: (N,) index into ``matching.TARGET_STATUS``.
    false_probability : (P,) that a target of the match shows another point or none;
        0 of what the user has put together, None where it was not estimated.
    """

    target: IntArray
    id: IntArray
    chi2: FloatArray
    log_odds: FloatArray
    status: tuple[npt.NDArray[np.uint8], ...]
    false_probability: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.id)

    def with_targets(
        self, target: IntArray, id: IntArray, status: tuple[npt.NDArray[np.uint8], ...]
    ) -> Matches:
        """The same matches with other targets; those without any are left out."""
        keep = (target >= 0).any(axis=1)
        false = self.false_probability
        return Matches(
            target=target[keep],
            id=id[keep],
            chi2=self.chi2[keep],
            log_odds=self.log_odds[keep],
            status=status,
            false_probability=None if false is None else false[keep],
        )


@dataclass(frozen=True, kw_only=True)
class FlatTargets:
    """Targets of one camera over S stages, one after another.

    Attributes
    ----------
    offsets : (S + 1,) those of stage s are ``offsets[s]:offsets[s + 1]``.
    centre_px : (M, 2). cov_px2 : (M, 3) xx, xy, yy. id : (M,) code number or -1.
    semi_major_px : (M,) 0 where unknown.
    """

    offsets: npt.NDArray[np.int64]
    centre_px: FloatArray
    cov_px2: FloatArray
    id: IntArray
    semi_major_px: FloatArray


@dataclass(frozen=True, kw_only=True)
class StageMatches:
    """Matches over S stages, one after another.

    Attributes
    ----------
    offsets : (S + 1,) those of stage s are ``offsets[s]:offsets[s + 1]``.
    target : (P, C) index within the stage's and camera's targets, -1 = not seen.
    id, chi2, log_odds, false_probability : (P,) as in :class:`Matches`.
    status : a camera: (M,) index into ``matching.TARGET_STATUS`` of all its targets.
    """

    offsets: npt.NDArray[np.int64]
    target: IntArray
    id: IntArray
    chi2: FloatArray
    log_odds: FloatArray
    false_probability: FloatArray
    status: tuple[npt.NDArray[np.uint8], ...]

    def __len__(self) -> int:
        return len(self.id)


@dataclass(frozen=True, kw_only=True)
class StagePoints:
    """The points of one stage.

    Attributes
    ----------
    id : (P,) code number or -1. target : (P, C) as in :class:`Matches`.
    position_mm : (P, 3) in the rig's frame.
    cov_image_mm2, cov_rig_mm2 : (P, 3, 3) from the image noise and from the
        calibration; their sum is the point's covariance. The calibration's is
        stated in the frame of the calibrated volume (``Triangulator``).
    rms_px : (P,) RMS residual per coordinate. chi2 : (P,).
    convergence_rad : (P,) largest angle between two rays.
    residual_px : (P, C, 2) measured - adjusted, NaN where not seen.
    normal, cov_normal : (P, 3), (P, 3, 3) of the targets' circles, towards the
        cameras; None where nothing was asked of the circles.
    eccentricity_px : (P,) the largest distance, over the cameras, from the
        picture of the circle's centre to the ellipse's; NaN where the point is
        not corrected for it, None where nothing was asked.
    """

    id: IntArray
    target: IntArray
    position_mm: FloatArray
    cov_image_mm2: FloatArray
    cov_rig_mm2: FloatArray
    rms_px: FloatArray
    chi2: FloatArray
    convergence_rad: FloatArray
    residual_px: FloatArray
    normal: FloatArray | None = None
    cov_normal: FloatArray | None = None
    eccentricity_px: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.id)


@dataclass(frozen=True, kw_only=True)
class Trajectories:
    """Points over stages; NaN where a point was not measured.

    Attributes
    ----------
    stage : (S,) numbers from 1. time_s : (S,), NaN without a frame rate.
    point_id : (P,). position_mm : (S, P, 3).
    cov_mm2 : (S, P, 6) image noise and calibration, order ``COV6_ORDER``.
    cov_image_mm2 : (S, P, 6) the image noise's part alone.
    cameras_used : (S, P, C) bool. rms_px : (S, P).
    camera_names : (C,).
    flags : (S, P) uint8, bits by ``POINT_FLAGS``; 0 where nothing is said.
    """

    stage: IntArray
    time_s: FloatArray
    point_id: IntArray
    position_mm: FloatArray
    cov_mm2: FloatArray
    cov_image_mm2: FloatArray
    cameras_used: npt.NDArray[np.bool_]
    rms_px: FloatArray
    camera_names: tuple[str, ...]
    flags: npt.NDArray[np.uint8] = field(default_factory=lambda: _NO_FLAGS)

    def __post_init__(self) -> None:
        if self.flags is _NO_FLAGS:
            object.__setattr__(self, "flags", np.zeros(self.rms_px.shape, np.uint8))


@dataclass(frozen=True, kw_only=True)
class Motion:
    """Motion of points and of their centroid; NaN where it is not defined.

    Shapes: (S, P, 3) for points, (S, 3) for the centroid, covariances
    (S, P, 6) or (S, 6) in the order ``COV6_ORDER``. ``step_mm`` is Eq. (10),
    X(i+1) - X(i) stored at stage i; ``displacement_mm`` is against
    ``reference_stage``; ``velocity_mm_s`` is Eq. (11). Covariances are of the
    image noise: the calibration's error is common to both ends of a
    difference and cancels but for what it does to a length of that size.

    ``centroid_mm`` is Eq. (12) over ``centroid_points``, the same points at
    every stage; ``centroid_cov_mm2`` contains the calibration, taken as common
    to all points.
    """

    reference_stage: int
    step_mm: FloatArray
    step_cov_mm2: FloatArray
    displacement_mm: FloatArray
    displacement_cov_mm2: FloatArray
    velocity_mm_s: FloatArray
    velocity_cov_mm2_s2: FloatArray
    centroid_points: IntArray
    centroid_mm: FloatArray
    centroid_cov_mm2: FloatArray
    centroid_displacement_mm: FloatArray
    centroid_displacement_cov_mm2: FloatArray
    centroid_velocity_mm_s: FloatArray
    centroid_velocity_cov_mm2_s2: FloatArray


@dataclass(frozen=True, kw_only=True)
class TargetRecords:
    """Every target seen in a measurement, one row each.

    ``point_id`` is the trajectory that the target went into, -1 = none;
    ``match_status`` by ``matching.TARGET_STATUS``; ``ring_status`` by
    ``recognition.RING_STATUS``.
    """

    stage: IntArray
    camera: IntArray
    centre_px: FloatArray
    semi_axes_px: FloatArray
    angle_rad: FloatArray
    sigma_px: FloatArray
    code_id: IntArray
    point_id: IntArray
    residual_px: FloatArray
    match_status: npt.NDArray[np.uint8]
    ring_status: npt.NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.stage)


@dataclass(frozen=True, kw_only=True)
class CameraSeries:
    """How far every camera seems to have moved since the first stages.

    Every camera by itself, as if it alone had; over the last eight looks (of the first the
    later half, against the earlier), against the first sixteen; NaN at the first look.

    Attributes
    ----------
    stage : (K,) of the looks.
    turn_rad, shift_mm : (K, C, 3) turn about the projection centre, as a rotation vector
        on the left of cam_from_world, and the centre's shift in the rig's frame;
        sigma_turn_rad, sigma_shift_mm : their standard deviations.
    chi2 : (K, C) of the six. critical_chi2 : above it a camera has moved.
    """

    stage: IntArray
    turn_rad: FloatArray
    shift_mm: FloatArray
    sigma_turn_rad: FloatArray
    sigma_shift_mm: FloatArray
    chi2: FloatArray
    critical_chi2: float


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """Everything that ``measure`` found: what measurement.h5 holds.

    ``image_name[c][s]`` is the picture of camera c at the s-th stage;
    ``provenance`` has version, options, hashes of the inputs and time;
    ``flag_meanings`` names the values of ``targets.match_status`` and
    ``targets.ring_status``; ``stability`` is of the cameras, None where it was not looked at.
    """

    trajectories: Trajectories
    motion: Motion
    targets: TargetRecords
    image_name: tuple[tuple[str, ...], ...]
    frame_rate_hz: float | None = None
    provenance: Mapping[str, Any] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    flag_meanings: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    stability: CameraSeries | None = None
