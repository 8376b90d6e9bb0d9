"""Where a calibration holds: the volume that its target has filled."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull, QhullError

from videogrammetry.geometry import inside_half_spaces
from videogrammetry.types import FloatArray, RigData

#: How far beyond the hull a point is outside, as a share of the volume's diameter.
_BORDER = 0.05


class CalibratedVolume:
    """The convex hull of where the target stood during the calibration, and a border around.

    Examples
    --------
    >>> corners = np.array(np.meshgrid([0, 1.0], [0, 1.0], [0, 1.0])).reshape(3, -1).T
    >>> volume = CalibratedVolume(RigData(cameras={}, volume_mm=corners))
    >>> volume.contains(np.array([[0.5, 0.5, 1.05], [0.5, 0.5, 1.2]])).tolist()
    [True, False]
    """

    def __init__(self, rig: RigData) -> None:
        self._planes: FloatArray | None = None
        if rig.volume_mm is None or len(rig.volume_mm) < 4:
            return
        try:
            self._planes = ConvexHull(rig.volume_mm).equations
        except QhullError:
            return  # a plane has no inside
        self._border = _BORDER * float(np.linalg.norm(np.ptp(rig.volume_mm, axis=0)))

    def contains(self, position_mm: FloatArray) -> npt.NDArray[np.bool_]:
        """(N,) whether points lie in it; all do where the rig knows of no volume."""
        if self._planes is None or not len(position_mm):
            return np.ones(len(position_mm), dtype=bool)
        return inside_half_spaces(position_mm, self._planes, self._border)
