"""Positions where a stage lacks a point: from before and after, or from the points around."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

from videogrammetry._core import tracking as _tracking
from videogrammetry.types import Trajectories, cov6_from_matrix, matrix_from_cov6


@dataclass(frozen=True, kw_only=True)
class FillOptions:
    """How gaps are filled; fields and defaults equal the C++ struct's.

    Attributes
    ----------
    largest_gap : in stages; longer gaps stay. neighbours : as in ``LinkOptions``.
    """

    largest_gap: int = 10
    neighbours: int = 6


def fill_gaps(
    trajectories: Trajectories, options: FillOptions | None = None
) -> tuple[Trajectories, npt.NDArray[np.bool_]]:
    """Fill gaps between two stages that saw a point, with covariance.

    By Kalman's filter and the Rauch-Tung-Striebel smoother, its motion model
    learnt from all points and its covariance from gaps of the same length that
    are cut into what was seen; or by the rigid (or, where the object bends, the
    local) motion of the points around it, from both ends of the gap; whichever
    has the smaller covariance. Measured positions stay as they are.

    Parameters
    ----------
    trajectories : ``cov_image_mm2`` weighs the positions.
    options : None: the defaults.

    Returns
    -------
    (Trajectories, (S, P) bool)
        With positions and covariances where they were missing, and the mask of
        those: nothing was measured there, ``cameras_used`` and ``rms_px`` stay
        empty. ``cov_mm2`` there is that of the filling plus the calibration's
        part of the gap's ends, the larger of both.

    Raises
    ------
    ValueError
        If an option is out of range.

    Examples
    --------
    >>> from videogrammetry.tracking import build_trajectories
    >>> stage = np.arange(1, 6)
    >>> x = np.zeros((5, 1, 3))
    >>> x[:, 0, 0] = 2.0 * stage
    >>> x[2] = np.nan
    >>> cov = np.where(np.isnan(x[..., :1]), np.nan, [1e-4, 0, 0, 1e-4, 0, 1e-4])
    >>> t = Trajectories(
    ...     stage=stage, time_s=stage / 100, point_id=np.array([7]), position_mm=x, cov_mm2=cov,
    ...     cov_image_mm2=cov, cameras_used=np.ones((5, 1, 2), bool), rms_px=np.zeros((5, 1)),
    ...     camera_names=("a", "b"),
    ... )
    >>> filled, mask = fill_gaps(t)
    >>> filled.position_mm[2, 0].round(2).tolist(), mask[:, 0].tolist()
    ([6.0, 0.0, 0.0], [False, False, True, False, False])
    """
    options = options or FillOptions()
    core_options = _tracking.FillOptions()
    for field in fields(options):
        setattr(core_options, field.name, getattr(options, field.name))
    position, cov, filled = _tracking.fill_gaps(
        np.ascontiguousarray(trajectories.position_mm),
        np.ascontiguousarray(matrix_from_cov6(trajectories.cov_image_mm2)),
        core_options,
    )
    cov_image = np.where(filled[..., None], cov6_from_matrix(cov), trajectories.cov_image_mm2)
    rig = trajectories.cov_mm2 - trajectories.cov_image_mm2
    cov_all = np.where(filled[..., None], cov_image, trajectories.cov_mm2)
    for s, p in np.argwhere(filled):
        seen = np.flatnonzero(~np.isnan(rig[:, p, 0]))
        after = np.searchsorted(seen, s)
        ends = rig[seen[[after - 1, after]], p]
        cov_all[s, p] += ends[np.argmax(ends[:, [0, 3, 5]].sum(axis=1))]
    table = dataclasses.replace(
        trajectories, position_mm=position, cov_mm2=cov_all, cov_image_mm2=cov_image
    )
    return table, filled
