"""A small calibration target with points on both sides."""

from __future__ import annotations

import numpy as np

from videogrammetry.calibration import flat_board
from videogrammetry.types import PointSet


def two_sided() -> PointSet:
    """Two boards of 5 x 4 points back to back, 30 mm apart."""
    board = flat_board((500.0, 400.0), (5, 4))
    back = board.position_mm * [-1, 1, 1] + [0, 0, 30]
    return PointSet(
        id=np.arange(1, 41, dtype=np.int32),
        position_mm=np.concatenate([board.position_mm, back]),
        normal=np.concatenate([board.normal, -board.normal]),
    )
