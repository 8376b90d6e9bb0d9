"""What the calibration's error does to many points at once."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from videogrammetry.geometry import full_covariance
from videogrammetry.reconstruction import Triangulator
from videogrammetry.types import FloatArray, Measurement, RigData

# Eigenvalues of the correlation matrix below this are rounding.
_RANK_TOLERANCE = 1e-12


class CalibrationPart:
    """The calibration's effect on points, with all correlations between them.

    With C = L L^T the covariance of the cameras' parameters and G_i the
    derivatives of point i by them (``Triangulator.derivatives``),
    B_i = G_i L gives cov(i, j) = B_i B_j^T for any two points and stages, and
    for any linear function sum K_i x_i of them the covariance
    (sum K_i B_i)(sum K_i B_i)^T: no matrix between all points is ever formed.

    Parameters
    ----------
    rig : the cameras; without a covariance every effect is zero wide, "nothing known".
    frame : as for ``Triangulator``.
    """

    def __init__(self, rig: RigData, *, frame: str = "volume") -> None:
        self.rig = rig
        self._triangulator = Triangulator(rig, frame=frame)
        self._factor = covariance_factor(full_covariance(rig))

    @property
    def known(self) -> bool:
        """Whether the rig has a covariance."""
        return self.rig.cov is not None

    def effects(
        self,
        position_mm: FloatArray,
        cameras_used: npt.NDArray[np.bool_],
        sigma_px: FloatArray | None = None,
    ) -> FloatArray:
        """(P, 3, R) mm: B of points (P, 3) seen by ``cameras_used`` (P, C).

        R is the number of independent errors of the calibration, 0 where the
        rig has no covariance. NaN where a point is not determined.
        """
        if not self.known:
            return np.zeros((len(position_mm), 3, 0))
        by_parameters = self._triangulator.derivatives(position_mm, cameras_used, sigma_px)
        effects: FloatArray = by_parameters @ self._factor
        return effects


def covariance_factor(cov: FloatArray) -> FloatArray:
    """L (N, R) with L L^T = C, also of a singular C; parameters of any scale.

    Examples
    --------
    >>> c = np.array([[4.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1e-30]])
    >>> factor = covariance_factor(c)
    >>> factor.shape, bool(np.allclose(factor @ factor.T, c, rtol=1e-9, atol=0))
    ((3, 2), True)
    """
    sigma = np.sqrt(np.diag(cov))
    scale = np.where(sigma > 0, sigma, 1.0)
    values, vectors = np.linalg.eigh(cov / np.outer(scale, scale))
    keep = values > _RANK_TOLERANCE * max(float(values.max(initial=0.0)), 1.0)
    # A held parameter's row must be zero, not rounding: a point moves by 1e19 mm per unit of A3.
    factor: FloatArray = sigma[:, None] * vectors[:, keep] * np.sqrt(values[keep])
    return factor


def sighting_sigma_px(measurement: Measurement, rig: RigData) -> FloatArray:
    """(S, P, C) standard deviation of every sighting's image coordinates, as it was weighted.

    The target's own (mean of both coordinates) and the camera's floor, in
    squares; 1 where the measurement keeps no target.
    """
    table, targets = measurement.trajectories, measurement.targets
    sigma = np.ones(table.cameras_used.shape)
    mine = (targets.point_id >= 0) & np.isfinite(targets.sigma_px).all(axis=1)
    mine &= np.isin(targets.point_id, table.point_id)
    row = np.searchsorted(table.stage, targets.stage[mine])
    column = np.searchsorted(table.point_id, targets.point_id[mine])
    floor = np.array([rig.sigma_floor_px.get(name, 0.0) for name in table.camera_names])
    camera = targets.camera[mine]
    variance = (targets.sigma_px[mine] ** 2).mean(axis=1) + floor[camera] ** 2
    sigma[row, column, camera] = np.sqrt(np.where(variance > 0, variance, 1.0))
    return sigma
