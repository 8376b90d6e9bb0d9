"""What goes into a calibration and what comes out of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields

import numpy as np
import numpy.typing as npt

from videogrammetry.calibration.network_result import AdjustedBars
from videogrammetry.types import (
    INTERIOR_NAMES,
    FlatInterface,
    FloatArray,
    IntArray,
    PointSet,
    RigData,
)


@dataclass(frozen=True, kw_only=True)
class FrameTargets:
    """The targets of one camera's picture of one stage.

    Attributes
    ----------
    stage : number of the stage, from 1; equal in two cameras = synchronous.
    image : the picture's name, for messages and tables.
    id : (N,) the target's number, -1 = un-coded or not read.
    xy_px : (N, 2) centres. cov_px2 : (N, 3) xx, xy, yy.
    ellipse : (N, 3) semi-major, semi-minor axis (px) and angle (rad), and
        ellipse_cov : (N, 3, 3) their covariance; None where only centres are known.
    """

    stage: int
    image: str
    id: IntArray
    xy_px: FloatArray
    cov_px2: FloatArray
    ellipse: FloatArray | None = None
    ellipse_cov: FloatArray | None = None


#: In which frame the windows of a calibration are stated.
INTERFACE_FRAMES = ("rig", "target")


@dataclass(frozen=True, kw_only=True)
class CalibrationInterface:
    """A flat window that cameras look through, as a calibration starts with it.

    Attributes
    ----------
    interface : start values (indices and glass are held); cameras name it.
    free : "normal" (or "tilt_1", "tilt_2") and "distance": what is estimated.
        Distance, f and the cameras' distance from the target are strongly
        correlated; hold what is known.
    prior_sigma : the same names -> standard deviation (rad, mm) of the start values.
    frame : "target": stated in the target's frame, which becomes the rig's; needs
        a single stage. "rig": in that of the first camera.
    """

    interface: FlatInterface
    free: tuple[str, ...] = ()
    prior_sigma: Mapping[str, float] = field(default_factory=dict)
    frame: str = "target"


@dataclass(frozen=True, kw_only=True)
class CameraFrames:
    """One camera's pictures of the calibration target.

    ``start`` gives start values (``f_px``, ``x0_px``, ``y0_px``, ``A1``...);
    ``free`` the interior parameters to estimate (None: all ten, each kept only
    if significant); ``prior_sigma`` standard deviations with which start values are
    observed; ``r0_px`` None = 2/3 of the half diagonal. ``interface`` names one of
    ``CalibrationOptions.interfaces``: the window that the camera looks through.
    """

    name: str
    image_size_px: tuple[int, int]
    frames: Sequence[FrameTargets]
    start: Mapping[str, float] = field(default_factory=dict)
    free: tuple[str, ...] | None = None
    r0_px: float | None = None
    interface: str | None = None
    prior_sigma: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class KnownLength:
    """The distance of two targets that holds at every stage: a bar, a wand."""

    point_a: int
    point_b: int
    length_mm: float
    sigma_mm: float


#: What additional points of unknown place may stand still relative to.
FREE_POINTS = ("none", "target", "room", "stage")


@dataclass(frozen=True, kw_only=True)
class CalibrationOptions:
    """How to calibrate.

    Attributes
    ----------
    method : "joint" (one pose a target position, constant relative poses of
        the cameras) or "mean" (the paper's Eqs. 7-8).
    sigma_mm : standard deviation of the target's coordinates, per axis; None:
        the target file's sigmas, else 0.1 mm per metre of its size.
    critical_value : an observation whose normalised residual is larger is
        rejected (Baarda's w-test). 4.0 is a level of 6e-5: of 3000 good
        observations 0.2 are lost. At the textbook's 3.29 three would be, and
        the parameters would move by that for nothing.
    max_image_rms_px : "mean" drops a picture whose residuals are larger (RMS
        per coordinate); None: three times the median picture's.
    significance : a parameter offered but smaller than this many of its
        standard deviations is dropped when ``free`` is None. Between two losses
        (bench/accuracy): at 2.0 a lens without A2, A3, E1, E2 keeps some by
        chance and lengths err up to three times as much; at 3.29 a lens that has
        all ten loses those that few pictures hardly show: up to half as much again.
    eccentricity : model the ellipses' centres of points whose circle is known:
        a diameter and a normal of the target's table, or a normal that the
        ellipses tell. False: take them for the pictures of the circles' centres.
    diameter_mm : of circles whose diameter the table does not state; None: unknown.
    interfaces : windows into a fluid that cameras look through (``CameraFrames.interface``);
        method "joint" only. With them ellipses' centres are taken for the circles'.
    time_offset : estimate by which part of the interval between two stages a camera is late
        (the first is the clock), from how targets move from stage to stage; joint only.
        Stages of neighbouring numbers must be neighbours in time.
    lengths : known distances between the target's points, observed; joint only.
    free_points : coded targets that the known target has not, as points of unknown place;
        joint, without windows and time offset. "none": left out. "target": they stand
        still relative to the target; "room": relative to the cameras; "stage": a point of
        its own at every stage, which holds whatever moves. Their ellipses' centres are
        taken for the circles'.
    num_threads : 0 = one a core.
    """

    method: str = "joint"
    sigma_mm: float | None = None
    critical_value: float = 4.0
    max_image_rms_px: float | None = None
    significance: float = 2.58
    eccentricity: bool = True
    diameter_mm: float | None = None
    interfaces: tuple[CalibrationInterface, ...] = ()
    time_offset: bool = False
    lengths: tuple[KnownLength, ...] = ()
    free_points: str = "none"
    num_threads: int = 0


@dataclass(frozen=True, kw_only=True)
class ObservationTable:
    """Every observation that had a known point, used or rejected; arrays of length M.

    ``residual_px`` = measured - adjusted. ``normalised`` = w of Baarda's test
    per coordinate. ``used`` False where rejected.
    """

    camera: IntArray
    stage: IntArray
    point_id: IntArray
    xy_px: FloatArray
    sigma_px: FloatArray
    residual_px: FloatArray
    normalised: FloatArray
    redundancy: FloatArray
    used: npt.NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.point_id)

    def rows(self, mask: npt.NDArray[np.bool_]) -> ObservationTable:
        """Some of the observations, (M,) True."""
        return ObservationTable(**{f.name: getattr(self, f.name)[mask] for f in fields(self)})


@dataclass(frozen=True, kw_only=True)
class Rejection:
    """One thing that was measured and not used, and why.

    ``kind``: "observation", "image", "target", "parameter" or "unknown-target";
    ``reason`` is a sentence for people; ``value`` the number that decided.
    """

    kind: str
    camera: str
    image: str
    point_id: int | None
    value: float
    reason: str


@dataclass(frozen=True, kw_only=True)
class AdditionalPoints:
    """Points of unknown place that a calibration with a known target took along.

    Attributes
    ----------
    mode : "target", "room" or "stage", as ``CalibrationOptions.free_points``.
    number, stage : (P,) of each; stage 0: one point at all stages.
    position_mm : (P, 3) and cov_mm2 (P, 3, 3), in the target's frame ("target") or the
        rig's; NaN covariance: its observations were all rejected.
    observations : as the run's, of these points.
    """

    mode: str
    number: IntArray
    stage: IntArray
    position_mm: FloatArray
    cov_mm2: FloatArray
    observations: ObservationTable

    def __len__(self) -> int:
        return len(self.number)


@dataclass(frozen=True, kw_only=True)
class CalibrationRun:
    """Result of a calibration.

    Attributes
    ----------
    rig : the cameras with their covariance; frame: the first camera's (the target's
        where windows are stated in that).
    method : "joint" or "mean".
    camera_names, image_names : names of ``observations.camera`` and of
        (camera, stage) pictures.
    rig_from_target : stage -> (rotation (3, 3), translation_mm (3,)).
    target : adjusted target coordinates with covariance.
    sigma0 : a-posteriori standard deviation of unit weight.
    rms_px : RMS re-projection residual per coordinate of the used observations.
    redundancy, num_unknowns, num_observations : counts (coordinates).
    camera_rms_px, camera_count : per camera.
    parameters_kept : camera -> names of the interior parameters estimated.
    rejected, warnings : for the report and the terminal.
    seconds : time the calculation took.
    target_factor, target_redundancy : variance factor of the target's coordinates
        and its redundancy; None where it was not estimated.
    bars : known lengths, their ends as rows of ``target``; None where there were none.
    additional : points beside the target, whose observations are counted in
        ``num_observations`` but are not in ``observations``; None where there were none.
    """

    rig: RigData
    method: str
    camera_names: tuple[str, ...]
    image_names: Mapping[tuple[str, int], str]
    rig_from_target: Mapping[int, tuple[FloatArray, FloatArray]]
    target: PointSet
    observations: ObservationTable
    sigma0: float
    rms_px: float
    redundancy: int
    num_unknowns: int
    num_observations: int
    camera_rms_px: Mapping[str, float]
    camera_count: Mapping[str, int]
    parameters_kept: Mapping[str, tuple[str, ...]]
    rejected: tuple[Rejection, ...] = ()
    warnings: tuple[str, ...] = ()
    seconds: float = 0.0
    target_factor: float | None = None
    target_redundancy: float = 0.0
    bars: AdjustedBars | None = None
    additional: AdditionalPoints | None = None


def check_free(names: Sequence[str], where: str) -> tuple[str, ...]:
    """The names as a tuple; ValueError names an unknown interior parameter.

    Examples
    --------
    >>> check_free(["f", "x0"], "[calibration] free")
    ('f', 'x0')
    """
    for name in names:
        if name not in INTERIOR_NAMES:
            raise ValueError(
                f"{where}: unknown interior parameter {name!r}; known: {', '.join(INTERIOR_NAMES)}"
            )
    return tuple(names)
