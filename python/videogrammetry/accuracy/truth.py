"""A measurement of a simulated sequence against the known truth.

The truth is stated in the truth rig's frame, the measurement in the calibrated
one, and its covariances in the frame of the calibrated volume (inner
constraints, ``Triangulator``). The truth is therefore carried over by the
rigid motion that the calibration's actual error shares over that volume:
the calibrated places, projected with the calibrated rig into the cameras that
saw them and triangulated with the true one, give pairs; their best rigid fit
(six parameters, no scale) is ``measured_from_true``. What is left are errors
of shape, scale and distance, as the covariances state them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from videogrammetry.accuracy.calibration_part import CalibrationPart
from videogrammetry.accuracy.scale_bar import camera_group
from videogrammetry.accuracy.true_points import (
    TruePoints,
    exact_pictures,
    identify,
    measured_from_true,
    on_measured_axes,
    triangulate_pictures,
)
from videogrammetry.motion.motion import velocity
from videogrammetry.types import (
    FloatArray,
    IntArray,
    Motion,
    RigData,
    Trajectories,
    matrix_from_cov6,
)

#: A point is wrong if it is off by more than this many sigmas and this length.
WRONG_SIGMAS = 6.0
WRONG_MM = 0.5


@dataclass(frozen=True, kw_only=True)
class ErrorStatistics:
    """Errors measured - true of a group of points and stages.

    Attributes
    ----------
    name, count : the cameras that saw them, and how many positions.
    rms_mm : 3-D, sqrt(mean |e|^2). axis_rms_mm, bias_mm : (3,) along x, y, z.
    largest_mm : of |e|.
    predicted_mm : sqrt(mean trace C). ratio : rms_mm / predicted_mm.
    normalised_rms : sqrt(mean(e^T C^-1 e) / 3); 1 if the covariances are right.
    image_rms_mm, image_predicted_mm, image_normalised_rms : the same of the
        pictures' part alone, e less ``CalibrationSplit``'s exact part: noise
        and whatever recognition does wrong. It averages over the stages.
    rig_rms_mm, rig_predicted_mm, rig_normalised_rms : of the calibration's part:
        one draw of a few numbers, its ratio scatters accordingly.
    """

    name: str
    count: int
    rms_mm: float
    axis_rms_mm: FloatArray
    bias_mm: FloatArray
    largest_mm: float
    predicted_mm: float
    ratio: float
    normalised_rms: float
    image_rms_mm: float
    image_predicted_mm: float
    image_normalised_rms: float
    rig_rms_mm: float
    rig_predicted_mm: float
    rig_normalised_rms: float


@dataclass(frozen=True, kw_only=True)
class WrongPoint:
    """A measured position that no noise explains."""

    stage: int
    point_id: int
    error_mm: float
    sigma_mm: float
    cameras: str


@dataclass(frozen=True, kw_only=True)
class CentroidErrors:
    """Centroid against the mean of the same true points, over the stages.

    RMS 3-D errors of position (mm) and of central-difference velocity (mm/s),
    the largest, and the predicted RMS; NaN where nothing is defined. The
    position's prediction has the correlation of the points by the calibration;
    ``Motion.centroid_cov_mm2`` is larger: it takes that error as common to all.
    """

    position_rms_mm: float
    position_largest_mm: float
    position_predicted_mm: float
    velocity_rms_mm_s: float
    velocity_largest_mm_s: float
    velocity_predicted_mm_s: float


@dataclass(frozen=True, kw_only=True)
class TruthComparison:
    """A measurement against the truth.

    Attributes
    ----------
    rotation, translation_mm : measured_from_true, x_measured = R x_true + t.
    frame_rms_mm : 3-D RMS that the fit has left: what the calibration has bent.
    scale_error : of the volume, least squares, (calibrated / true) - 1.
    stage, point_id : of the measurement. true_id : (P,) number of the true point
        that each measured one is, -1 = none.
    error_mm : (S, P, 3) measured - true, NaN where either is missing;
    error_rig_mm : (S, P, 3) the calibration's exact part: the true point's exact
        pictures in the cameras used, triangulated with the calibrated rig, - true.
    total, groups : statistics of all, and by cameras used.
    centroid : None where there is none.
    visible, measured : positions visible in two cameras or more, and measured of them.
    missing : (M, 2) stage and true number of those visible but not measured.
    wrong : beyond ``WRONG_SIGMAS`` sigmas + ``WRONG_MM``; they count in the statistics.
    renumbered : (measured, true) numbers of un-coded points, where they differ.
    unknown : measured numbers that are no true point.
    """

    rotation: FloatArray
    translation_mm: FloatArray
    frame_rms_mm: float
    scale_error: float
    stage: IntArray
    point_id: IntArray
    true_id: IntArray
    error_mm: FloatArray
    error_rig_mm: FloatArray
    total: ErrorStatistics
    groups: tuple[ErrorStatistics, ...]
    centroid: CentroidErrors | None
    visible: int
    measured: int
    missing: IntArray
    wrong: tuple[WrongPoint, ...]
    renumbered: tuple[tuple[int, int], ...]
    unknown: tuple[int, ...]


def compare_with_truth(
    trajectories: Trajectories,
    rig: RigData,
    truth_rig: RigData,
    truth: TruePoints,
    *,
    motion: Motion | None = None,
    first_free_id: int | None = None,
    sigma_px: FloatArray | None = None,
) -> TruthComparison:
    """Errors of measured trajectories, in the frame in which their covariances hold.

    Parameters
    ----------
    trajectories : the measurement.
    rig : as calibrated; truth_rig : as simulated; both with the cameras of
        ``trajectories`` in its order.
    truth : true points in the truth rig's frame.
    motion : for the centroid; None: left out.
    first_free_id : measured numbers from here on are un-coded and their own:
        they stand for the true point they lie at. None: all numbers are the truth's.
    sigma_px : (S, P, C) weights of the sightings; None: all alike.

    Raises
    ------
    ValueError
        If cameras differ, or no measured point is one of the truth.
    """
    frame = measured_from_true(rig, truth_rig)
    expected = on_measured_axes(truth, trajectories.stage)
    moved = expected.position_mm @ frame.rotation.T + frame.translation_mm
    columns = identify(trajectories, expected.point_id, moved, first_free_id)
    known = np.flatnonzero(columns >= 0)
    if not len(known):
        raise ValueError(
            "truth: no measured point is one of the truth's; are stages and numbers those of "
            "this measurement?"
        )
    shape = trajectories.position_mm.shape
    error, error_rig = np.full(shape, np.nan), np.full(shape, np.nan)
    error[:, known] = trajectories.position_mm[:, known] - moved[:, columns[known]]
    ideal = _ideal(trajectories, rig, truth_rig, expected, columns, sigma_px)
    error_rig[:, known] = (ideal - _true_in_measured(moved, columns, shape))[:, known]
    groups = _groups(trajectories)
    there = np.isfinite(error).all(axis=2)
    true_id = np.where(columns >= 0, expected.point_id[columns], -1).astype(np.int32)
    pairs = list(zip(trajectories.point_id.tolist(), true_id.tolist(), strict=True))
    visible, missing = _missing(expected, true_id, there)
    return TruthComparison(
        rotation=frame.rotation,
        translation_mm=frame.translation_mm,
        frame_rms_mm=frame.rms_mm,
        scale_error=frame.scale_error,
        stage=trajectories.stage,
        point_id=trajectories.point_id,
        true_id=true_id,
        error_mm=error,
        error_rig_mm=error_rig,
        total=_statistics("all", trajectories, error, error_rig, there),
        groups=tuple(
            _statistics(name, trajectories, error, error_rig, there & (groups == name))
            for name in sorted(set(groups[there].tolist()))
        ),
        centroid=None
        if motion is None
        else _centroid(trajectories, motion, moved, columns, CalibrationPart(rig), sigma_px),
        visible=visible,
        measured=visible - len(missing),
        missing=missing,
        wrong=_wrong(trajectories, error, there, groups),
        renumbered=tuple((m, t) for m, t in pairs if t >= 0 and m != t),
        unknown=tuple(m for m, t in pairs if t < 0),
    )


def _ideal(
    table: Trajectories,
    rig: RigData,
    truth_rig: RigData,
    truth: TruePoints,
    columns: IntArray,
    sigma_px: FloatArray | None,
) -> FloatArray:
    """(S, P, 3): the true points' exact pictures in the cameras used, by the calibrated rig."""
    ideal = np.full(table.position_mm.shape, np.nan)
    known = np.flatnonzero(columns >= 0)
    pixels = exact_pictures(truth_rig, truth.position_mm[:, columns[known]].reshape(-1, 3))
    used = table.cameras_used[:, known].reshape(-1, pixels.shape[1])
    sigma = None if sigma_px is None else sigma_px[:, known].reshape(-1, pixels.shape[1])
    mask = used & np.asarray(np.isfinite(pixels).all(axis=2))
    found = triangulate_pictures(rig, pixels, mask, sigma)
    ideal[:, known] = found.reshape(len(table.stage), len(known), 3)
    return ideal


def _true_in_measured(moved: FloatArray, columns: IntArray, shape: tuple[int, ...]) -> FloatArray:
    true = np.full(shape, np.nan)
    known = columns >= 0
    true[:, known] = moved[:, columns[known]]
    return true


def _groups(table: Trajectories) -> npt.NDArray[np.object_]:
    """(S, P) names of the cameras that saw each position."""
    codes, inverse = np.unique(
        table.cameras_used.reshape(-1, len(table.camera_names)), axis=0, return_inverse=True
    )
    names = np.array([camera_group(table.camera_names, code) for code in codes], dtype=object)
    return np.asarray(names[inverse.reshape(table.cameras_used.shape[:2])])


def _statistics(
    name: str,
    table: Trajectories,
    error: FloatArray,
    error_rig: FloatArray,
    chosen: npt.NDArray[np.bool_],
) -> ErrorStatistics:
    e, e_rig = error[chosen], error_rig[chosen]
    cov, image = table.cov_mm2[chosen], table.cov_image_mm2[chosen]
    total = _normalised(e, cov)
    noise = _normalised(e - e_rig, image)
    of_rig = _normalised(e_rig, cov - image)
    nothing = np.full(3, np.nan)
    return ErrorStatistics(
        name=name,
        count=len(e),
        rms_mm=total[0],
        axis_rms_mm=np.sqrt((e**2).mean(axis=0)) if len(e) else nothing,
        bias_mm=e.mean(axis=0) if len(e) else nothing,
        largest_mm=float(np.linalg.norm(e, axis=1).max()) if len(e) else float("nan"),
        predicted_mm=total[1],
        ratio=total[0] / total[1] if total[1] > 0 else float("nan"),
        normalised_rms=total[2],
        image_rms_mm=noise[0],
        image_predicted_mm=noise[1],
        image_normalised_rms=noise[2],
        rig_rms_mm=of_rig[0],
        rig_predicted_mm=of_rig[1],
        rig_normalised_rms=of_rig[2],
    )


def _normalised(error: FloatArray, cov6: FloatArray) -> tuple[float, float, float]:
    """3-D RMS, predicted RMS, and sqrt(mean(e^T C^-1 e) / 3)."""
    good = np.isfinite(error).all(axis=1) & np.isfinite(cov6).all(axis=1)
    error, cov = error[good], matrix_from_cov6(cov6[good])
    if not len(error):
        return float("nan"), float("nan"), float("nan")
    rms = float(np.sqrt((error**2).sum(axis=1).mean()))
    trace = np.einsum("nii->n", cov)
    predicted = float(np.sqrt(trace.mean()))
    # A part without covariance (a rig without one) has nothing to be compared with.
    if not (trace > 0).all() or (np.linalg.eigvalsh(cov)[:, 0] <= 0).any():
        return rms, predicted, float("nan")
    chi2 = np.einsum("ni,ni->n", error, np.linalg.solve(cov, error[..., None])[..., 0])
    return rms, predicted, float(np.sqrt(chi2.mean() / 3))


def _missing(
    truth: TruePoints, true_id: IntArray, there: npt.NDArray[np.bool_]
) -> tuple[int, IntArray]:
    """How many positions two cameras could see, and those that were not measured."""
    visible = np.isfinite(truth.position_mm).all(axis=2)
    if truth.cameras_seen is not None:
        visible &= truth.cameras_seen.sum(axis=2) >= 2
    found = np.zeros_like(visible)
    for column, number in enumerate(true_id.tolist()):
        if number >= 0:
            found[:, truth.point_id == number] |= there[:, column, None]
    s, p = np.nonzero(visible & ~found)
    return int(visible.sum()), np.stack([truth.stage[s], truth.point_id[p]], axis=1)


def _wrong(
    table: Trajectories,
    error: FloatArray,
    there: npt.NDArray[np.bool_],
    groups: npt.NDArray[np.object_],
) -> tuple[WrongPoint, ...]:
    size = np.linalg.norm(error, axis=2)
    sigma = np.sqrt(table.cov_mm2[..., [0, 3, 5]].sum(axis=2))
    s, p = np.nonzero(there & (size > WRONG_SIGMAS * sigma + WRONG_MM))
    return tuple(
        WrongPoint(
            stage=int(table.stage[i]),
            point_id=int(table.point_id[j]),
            error_mm=float(size[i, j]),
            sigma_mm=float(sigma[i, j]),
            cameras=str(groups[i, j]),
        )
        for i, j in zip(s.tolist(), p.tolist(), strict=True)
    )


def _centroid(
    table: Trajectories,
    motion: Motion,
    moved: FloatArray,
    columns: IntArray,
    part: CalibrationPart,
    sigma_px: FloatArray | None,
) -> CentroidErrors | None:
    place = np.searchsorted(table.point_id, motion.centroid_points)
    if not len(place) or (columns[place] < 0).any():
        return None
    true = moved[:, columns[place]].mean(axis=1)
    e = motion.centroid_mm - true
    speed, _ = velocity(true, np.zeros((len(true), 6)), table.time_s)
    ev = motion.centroid_velocity_mm_s - speed
    return CentroidErrors(
        position_rms_mm=_rms(e),
        position_largest_mm=_largest(e),
        position_predicted_mm=_centroid_sigma(table, place, part, sigma_px),
        velocity_rms_mm_s=_rms(ev),
        velocity_largest_mm_s=_largest(ev),
        velocity_predicted_mm_s=_predicted(motion.centroid_velocity_cov_mm2_s2),
    )


def _centroid_sigma(
    table: Trajectories,
    place: npt.NDArray[np.intp],
    part: CalibrationPart,
    sigma_px: FloatArray | None,
) -> float:
    """RMS over the stages of the mean's sigma: noise / n^2, and |mean B|^2."""
    whole = np.flatnonzero(np.isfinite(table.position_mm[:, place, 0]).all(axis=1))
    if not len(whole):
        return float("nan")
    effects = part.effects_at(table, whole, place, sigma_px)
    noise = table.cov_image_mm2[np.ix_(whole, place)][..., [0, 3, 5]].sum(axis=(1, 2))
    noise /= len(place) ** 2
    of_rig = (effects.mean(axis=1) ** 2).sum(axis=(1, 2))
    return float(np.sqrt((noise + of_rig).mean()))


def _rms(error: FloatArray) -> float:
    square = (error[np.isfinite(error).all(axis=1)] ** 2).sum(axis=1)
    return float(np.sqrt(square.mean())) if len(square) else float("nan")


def _largest(error: FloatArray) -> float:
    known = error[np.isfinite(error).all(axis=1)]
    return float(np.linalg.norm(known, axis=1).max()) if len(known) else float("nan")


def _predicted(cov6: FloatArray) -> float:
    trace = cov6[np.isfinite(cov6).all(axis=1)][:, [0, 3, 5]].sum(axis=1)
    return float(np.sqrt(trace.mean())) if len(trace) else float("nan")
