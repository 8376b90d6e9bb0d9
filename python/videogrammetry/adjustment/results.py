"""What an adjustment is asked for and what it says: options, statistics, covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from videogrammetry._core import adjustment as _adjustment
from videogrammetry.types import INTERIOR_NAMES, FloatArray, IntArray

#: What can be estimated of a camera: the ten interior parameters, the pixels'
#: height over width less 1, and the moment of exposure as a part of the interval
#: between pictures.
CAMERA_UNKNOWNS = (*INTERIOR_NAMES, "aspect", "time_offset")

#: What can be estimated of a window: tangents of the angles by which its normal turns
#: along two directions of the window (``Network.interface_tangents``), and its distance, mm.
INTERFACE_UNKNOWNS = ("tilt_1", "tilt_2", "distance")


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
    baarda : True: the standard deviations are those stated; False: sigma0 is
        estimated from the network itself and the test is Pope's tau.
    max_rounds : adjustments between changes of weights and observations, at most.
    num_threads : 0 = one a core.
    """

    critical_value: float = 3.29
    estimate_floor: bool = True
    robust_start: bool = True
    significance: float = 0.0
    baarda: bool = True
    max_rounds: int = 30
    num_threads: int = 0


@dataclass(frozen=True, kw_only=True)
class DroppedParameter:
    """A camera's parameter not estimated: not significant, or ``undetermined``."""

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
class ScaleBarStatistics:
    """What an adjustment says about the scale bars, (B,) each.

    ``residual_mm`` given - adjusted length; ``normalised`` Baarda's w;
    ``redundancy`` the share of an error that shows in the residual; ``used``
    False where rejected.
    """

    residual_mm: FloatArray
    normalised: FloatArray
    redundancy: FloatArray
    used: npt.NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class PointPriorStatistics:
    """The same about the points' a-priori positions; zeros where there is none.

    Attributes
    ----------
    residual_mm : (N, 3), a priori - adjusted.
    normalised : (N, 3), per coordinate.
    test : (N,) the three together, chi-square, as the |w| of the same probability.
    redundancy : (N,) of the three together.
    used : (N,) whether the a-priori position takes part.
    starved : (N,) True: too few pictures for a position; its covariance is NaN.
    """

    residual_mm: FloatArray
    normalised: FloatArray
    test: FloatArray
    redundancy: FloatArray
    used: npt.NDArray[np.bool_]
    starved: npt.NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class Adjustment:
    """Summary of an adjustment; (M, 2) arrays per observation, used or not.

    ``residual_px`` measured - adjusted; ``normalised`` Baarda's w;
    ``redundancy_numbers`` diagonal of Qvv P; ``used`` False where rejected.
    ``point_factor`` and ``bar_factor`` are the variance components of the
    a-priori positions and the scale bars, 1 where their covariances are true.
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
    bar_factor: float
    bar_redundancy: float
    cameras: tuple[CameraVariance, ...]
    dropped: tuple[DroppedParameter, ...]
    residual_px: FloatArray
    normalised: FloatArray
    redundancy_numbers: FloatArray
    used: npt.NDArray[np.bool_]
    scale_bars: ScaleBarStatistics
    points: PointPriorStatistics
    rounds: int


@dataclass(frozen=True, kw_only=True)
class Dispersion:
    """Covariance of the unknowns, a priori (times sigma0^2: a posteriori).

    The unknowns are the cameras', the poses', the windows' and the points', in this order.

    Attributes
    ----------
    camera_index : per camera, twelve places (``CAMERA_UNKNOWNS``) or -1.
    pose_index : per pose, its first place (rx, ry, rz, tx, ty, tz) or -1.
    interface_index : per window, three places (``INTERFACE_UNKNOWNS``) or -1.
    point_index : per point, its first place (x, y, z) or -1.
    unknown_names : "left A1", "stage 3 rx", "point 7 x", ...
    redundancy : observations and a-priori values, less unknowns, and ``datum_size``.
    datum_size : datum parameters that inner constraints determine (free network).
    """

    camera_index: IntArray
    pose_index: IntArray
    interface_index: IntArray
    point_index: IntArray
    unknown_names: tuple[str, ...]
    redundancy: int
    datum_size: int
    handle: Any = field(repr=False)

    @property
    def interior_index(self) -> IntArray:
        """Per camera, the ten places of its interior parameters or -1."""
        return self.camera_index[:, : len(INTERIOR_NAMES)]

    @cached_property
    def cov(self) -> FloatArray:
        """(U, U) of the cameras', poses' and windows' unknowns, which come first."""
        return np.asarray(self.handle.cov_orientation())

    @cached_property
    def point_cov_mm2(self) -> FloatArray:
        """(N, 3, 3); zero of fixed points, NaN of points that nothing determines."""
        return np.reshape(_adjustment.point_covariances(self.handle), (-1, 3, 3))

    def covariance(self, a: Sequence[int], b: Sequence[int] | None = None) -> FloatArray:
        """Covariance between two sets of unknowns (places); ``b`` None: of ``a`` alone."""
        rows_a = [int(u) for u in a]
        columns = rows_a if b is None else [int(u) for u in b]
        for place in (*rows_a, *columns):
            if not 0 <= place < len(self.unknown_names):
                raise ValueError(
                    f"unknown: expected 0 to {len(self.unknown_names) - 1}, got {place}"
                )
        return np.asarray(self.handle.covariance(rows_a, columns))

    def point_covariance(self, rows: npt.ArrayLike) -> FloatArray:
        """(3K, 3K) of some points, correlations included."""
        points = np.asarray(rows, dtype=int)
        if ((points < 0) | (points >= len(self.point_index))).any():
            raise ValueError(f"rows: expected 0 to {len(self.point_index) - 1}, got {points}")
        return np.asarray(self.handle.point_covariance(points.tolist()))

    def predict(self, image: npt.ArrayLike, point: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Pictures (N, 2) of points in images and their covariances (N, 3); NaN where none."""
        xy, cov = self.handle.predict(np.asarray(image, np.int32), np.asarray(point, np.int32))
        return xy, cov

    def full_covariance(self, *, num_threads: int = 0) -> FloatArray:
        """Covariance of all unknowns, in the order of ``unknown_names``."""
        return np.asarray(self.handle.full_covariance(num_threads))
