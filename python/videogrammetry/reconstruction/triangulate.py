"""Triangulation of n views with the covariance of image noise and calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from videogrammetry._core import reconstruction as _reconstruction
from videogrammetry.geometry import full_covariance, rig_model
from videogrammetry.types import StagePoints

if TYPE_CHECKING:
    from videogrammetry.types import FloatArray, IntArray, Matches, RigData

#: Why a point could not be triangulated, by its status.
TRIANGULATION_STATUS = (
    "ok",
    "fewer than two rays",
    "parallel rays",
    "behind a camera",
    "not converged",
)


def triangulate(
    rig: RigData,
    offsets: npt.ArrayLike,
    camera: npt.ArrayLike,
    xy_px: npt.ArrayLike,
    cov_px2: npt.ArrayLike,
    num_threads: int = 1,
) -> Mapping[str, FloatArray]:
    """Triangulate points from flat arrays of sightings, the cameras' orientation held.

    Least squares of the residuals in the measured pictures, weighted with
    ``cov_px2``; point i has the sightings ``offsets[i]:offsets[i + 1]``.

    Parameters
    ----------
    rig : the cameras.
    offsets : (P + 1,) ascending from 0 to M.
    camera : (M,) index of the camera in the rig.
    xy_px : (M, 2) measured image points.
    cov_px2 : (M, 3) covariance xx, xy, yy.
    num_threads : 0 = one a core.

    Returns
    -------
    dict of arrays
        ``position_mm (P, 3)``, ``cov_image_mm2`` and ``cov_rig_mm2 (P, 3, 3)``,
        ``chi2 (P,)``, ``convergence_rad (P,)``, ``residual_px (M, 2)``,
        ``status (P,)`` by ``TRIANGULATION_STATUS``; NaN where it failed.

    Examples
    --------
    >>> from videogrammetry.types import RigCamera, RigData
    >>> lens = dict(image_size_px=(101, 101), interior=np.r_[1000.0, np.zeros(9)], r0_px=40.0,
    ...             rotation=np.eye(3))
    >>> rig = RigData(cameras={"a": RigCamera(translation_mm=np.zeros(3), **lens),
    ...                        "b": RigCamera(translation_mm=np.array([-20.0, 0, 0]), **lens)})
    >>> points = triangulate(rig, [0, 2], [0, 1], [[60.0, 50.0], [40.0, 50.0]],
    ...                      [[0.01, 0, 0.01]] * 2)
    >>> points["position_mm"].round(6).tolist()
    [[10.0, 0.0, 1000.0]]
    """
    result: Mapping[str, FloatArray] = _reconstruction.triangulate(
        rig_model(rig),
        np.ascontiguousarray(offsets, dtype=np.int64),
        np.ascontiguousarray(camera, dtype=np.int32),
        np.ascontiguousarray(xy_px, dtype=np.float64),
        np.ascontiguousarray(cov_px2, dtype=np.float64),
        full_covariance(rig),
        num_threads,
    )
    return result


def reconstruct_stage(
    rig: RigData,
    matches: Matches,
    xy_px: Sequence[FloatArray],
    cov_px2: Sequence[FloatArray],
    num_threads: int = 1,
) -> StagePoints:
    """The points of a stage's matches; one array (N, 2) and (N, 3) a camera.

    Matches that cannot be triangulated are left out.
    """
    target: IntArray = matches.target
    point, camera = np.nonzero(target >= 0)
    index = target[point, camera]
    offsets = np.concatenate([[0], np.cumsum((target >= 0).sum(axis=1))])
    xy = np.empty((len(point), 2))
    cov = np.empty((len(point), 3))
    for c in range(target.shape[1]):
        here = camera == c
        xy[here] = xy_px[c][index[here]]
        cov[here] = cov_px2[c][index[here]]
    result = triangulate(rig, offsets, camera, xy, cov, num_threads)
    residual = np.full((*target.shape, 2), np.nan)
    residual[point, camera] = result["residual_px"]
    ok = result["status"] == 0
    return StagePoints(
        id=matches.id[ok],
        target=target[ok],
        position_mm=result["position_mm"][ok],
        cov_image_mm2=result["cov_image_mm2"][ok],
        cov_rig_mm2=result["cov_rig_mm2"][ok],
        rms_px=np.sqrt(np.nanmean(residual[ok] ** 2, axis=(1, 2))) if ok.any() else np.empty(0),
        chi2=result["chi2"][ok],
        convergence_rad=result["convergence_rad"][ok],
        residual_px=residual[ok],
    )
