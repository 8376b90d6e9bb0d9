"""Known true points, their exact pictures, and the frame that the calibration has given them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from videogrammetry.accuracy.scale_bar import KnownLength
from videogrammetry.geometry import fit_rigid, project_from_world
from videogrammetry.reconstruction import Triangulator
from videogrammetry.types import FloatArray, IntArray, RigData, Trajectories

BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class TruePoints:
    """True positions in the true rig's frame.

    Attributes
    ----------
    stage : (S,) from 1, ascending. point_id : (P,) numbers.
    position_mm : (S, P, 3), NaN where there is no point.
    cameras_seen : (S, P, C) which cameras see it, or None where unknown.
    """

    stage: IntArray
    point_id: IntArray
    position_mm: FloatArray
    cameras_seen: BoolArray | None = None


@dataclass(frozen=True, kw_only=True)
class FrameFit:
    """measured_from_true: x_measured = R x_true + t.

    ``rms_mm`` 3-D that it leaves; ``scale_error`` of a seventh parameter, which
    is not applied.
    """

    rotation: FloatArray
    translation_mm: FloatArray
    rms_mm: float
    scale_error: float


def exact_pictures(rig: RigData, points_mm: FloatArray) -> FloatArray:
    """(N, C, 2) px of points (N, 3) in all cameras; NaN where there is no picture."""
    finite = np.asarray(np.isfinite(points_mm).all(axis=1))
    filled = np.where(finite[:, None], points_mm, 0.0)
    pixels = np.stack(
        [project_from_world(c, filled) for c in rig.cameras.values()],
        axis=1,
    )
    pixels[~finite] = np.nan
    return pixels


def triangulate_pictures(
    rig: RigData,
    pixels: FloatArray,
    used: BoolArray,
    sigma_px: FloatArray | None = None,
) -> FloatArray:
    """(N, 3) points of pictures (N, C, 2) in the cameras ``used`` (N, C); NaN where it fails."""
    bare = RigData(cameras=rig.cameras)  # covariances are not asked for
    point, camera = np.nonzero(used)
    sigma = np.ones(used.shape) if sigma_px is None else sigma_px
    variance = sigma[point, camera] ** 2
    result = Triangulator(bare)(
        np.concatenate([[0], np.cumsum(used.sum(axis=1))]),
        camera,
        pixels[point, camera],
        np.stack([variance, 0 * variance, variance], axis=1),
    )
    return result["position_mm"]


def measured_from_true(rig: RigData, truth_rig: RigData) -> FrameFit:
    """The rigid motion that the calibration's error shares over the calibrated volume.

    Raises
    ------
    ValueError
        If the rigs have different cameras, or the rig knows no volume.
    """
    if list(rig.cameras) != list(truth_rig.cameras):
        raise ValueError(
            f"truth rig: its cameras are {', '.join(truth_rig.cameras)}, the calibrated rig's "
            f"{', '.join(rig.cameras)}"
        )
    if rig.volume_mm is None or rig.volume_seen is None:
        raise ValueError(
            "rig: it does not say which volume was calibrated, so that its frame cannot be "
            "compared with the truth's; calibrate again with this version"
        )
    pixels = exact_pictures(rig, rig.volume_mm)
    true = triangulate_pictures(
        truth_rig, pixels, rig.volume_seen & np.isfinite(pixels).all(axis=2)
    )
    good = np.isfinite(true).all(axis=1)
    if good.sum() < 3:
        raise ValueError(
            f"rig: {int(good.sum())} places of its calibrated volume can be compared with the "
            "truth, three or more are needed"
        )
    return rigid_frame(rig.volume_mm[good], true[good])


def rigid_frame(measured_mm: FloatArray, true_mm: FloatArray) -> FrameFit:
    """Best rotation and translation of points (N, 3), least squares, no scale.

    Examples
    --------
    >>> x = np.array([[0.0, 0, 0], [100, 0, 0], [0, 100, 0], [0, 0, 100]])
    >>> fit = rigid_frame(x * 1.001 + [1, 2, 3], x)
    >>> (fit.rotation.round(9) + 0.0).tolist(), round(fit.scale_error, 9)
    ([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], 0.001)
    """
    rotation, translation, _ = fit_rigid(measured_mm, true_mm)
    residual = measured_mm - (true_mm @ rotation.T + translation)
    turned = (true_mm - true_mm.mean(axis=0)) @ rotation.T
    centred = measured_mm - measured_mm.mean(axis=0)
    return FrameFit(
        rotation=rotation,
        translation_mm=translation,
        rms_mm=float(np.sqrt((residual**2).sum(axis=1).mean())),
        scale_error=float((centred * turned).sum() / (turned**2).sum() - 1),
    )


def on_measured_axes(truth: TruePoints, stage: IntArray) -> TruePoints:
    """The truth at the measured stages, NaN at those it lacks."""
    row = np.searchsorted(truth.stage, stage)
    row = np.minimum(row, len(truth.stage) - 1)
    there = truth.stage[row] == stage
    position = np.where(there[:, None, None], truth.position_mm[row], np.nan)
    seen = None if truth.cameras_seen is None else truth.cameras_seen[row] & there[:, None, None]
    return TruePoints(stage=stage, point_id=truth.point_id, position_mm=position, cameras_seen=seen)


def identify(
    table: Trajectories, true_id: IntArray, moved_mm: FloatArray, first_free_id: int | None
) -> IntArray:
    """(P,) column of the true point that each measured one is, -1 = none.

    A coded point is the true one of its number. An un-coded one is that from
    which it lies least far over its stages (median), if that is nearer than
    half way to the next.
    """
    column = {int(n): i for i, n in enumerate(true_id)}
    found = np.full(len(table.point_id), -1, dtype=np.int32)
    for k, number in enumerate(table.point_id.tolist()):
        if first_free_id is None or number < first_free_id:
            found[k] = column.get(number, -1)
            continue
        there = np.isfinite(table.position_mm[:, k, 0])
        away = np.linalg.norm(moved_mm[there] - table.position_mm[there, None, k], axis=2)
        comparable = np.isfinite(away).any(axis=0)
        if not comparable.any():
            continue
        distance = np.full(len(true_id), np.inf)
        distance[comparable] = np.nanmedian(away[:, comparable], axis=0)
        order = np.argsort(distance)
        second = distance[order[1]] if len(order) > 1 else np.inf
        if distance[order[0]] < 0.5 * second:
            found[k] = order[0]
    return found


def lengths_from_calibration(
    rig: RigData,
    truth_rig: RigData,
    truth: TruePoints,
    bars: Sequence[KnownLength],
    cameras_used: BoolArray | None = None,
) -> FloatArray:
    """(S, B) mm: the bars' errors that the calibration alone makes, where the truth is known.

    The true ends are projected with the true rig (exact pictures), triangulated
    with the calibrated one, and the length is compared with the true one.

    Parameters
    ----------
    truth : with the numbers of the bars' ends.
    cameras_used : (S, P, C) as ``truth.point_id``; None: ``truth.cameras_seen``,
        or all that have a picture.
    """
    used = truth.cameras_seen if cameras_used is None else cameras_used
    pixels = exact_pictures(truth_rig, truth.position_mm.reshape(-1, 3))
    mask = np.asarray(np.isfinite(pixels).all(axis=2))
    if used is not None:
        mask &= used.reshape(-1, pixels.shape[1])
    found = triangulate_pictures(rig, pixels, mask).reshape(truth.position_mm.shape)
    column = {int(n): i for i, n in enumerate(truth.point_id)}
    errors = np.full((len(truth.stage), len(bars)), np.nan)
    for k, bar in enumerate(bars):
        if bar.point_a in column and bar.point_b in column:
            a, b = column[bar.point_a], column[bar.point_b]
            lengths = [
                np.linalg.norm(x[:, b] - x[:, a], axis=1) for x in (found, truth.position_mm)
            ]
            errors[:, k] = lengths[0] - lengths[1]
    return errors
