"""The rig as the C++ rooms take it, and projection with covariance."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from videogrammetry._core import geometry as _geometry
from videogrammetry.geometry.camera import camera_model
from videogrammetry.types import INTERIOR_NAMES

if TYPE_CHECKING:
    from videogrammetry.types import FloatArray, RigData

#: Order of a camera's sixteen parameters in the C++ rooms.
CAMERA_PARAMETERS = (*INTERIOR_NAMES, "rx", "ry", "rz", "tx", "ty", "tz")


def rig_model(rig: RigData) -> list[Any]:
    """The C++ oriented cameras of a rig, in its order."""
    return [
        _geometry.OrientedCamera(camera_model(camera), camera.rotation, camera.translation_mm)
        for camera in rig.cameras.values()
    ]


def full_covariance(rig: RigData) -> FloatArray:
    """Covariance (16 K, 16 K) of all cameras' parameters, 0 for those held.

    A rig without covariance gives an empty array: "nothing known", not "exact".
    """
    if rig.cov is None:
        return np.empty((0, 0))
    place = {
        f"{name}/{parameter}": 16 * k + i
        for k, name in enumerate(rig.cameras)
        for i, parameter in enumerate(CAMERA_PARAMETERS)
    }
    rows = np.array([place[name] for name in rig.cov_names], dtype=int)
    full = np.zeros((16 * len(rig.cameras),) * 2)
    full[np.ix_(rows, rows)] = rig.cov
    return full
