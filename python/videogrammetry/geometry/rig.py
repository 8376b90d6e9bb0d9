"""The rig as the C++ rooms take it, and projection with covariance."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from videogrammetry.geometry.refraction import oriented_model
from videogrammetry.types import INTERIOR_NAMES

if TYPE_CHECKING:
    from videogrammetry.types import FloatArray, RigData

#: Order of a camera's sixteen parameters in the C++ rooms.
CAMERA_PARAMETERS = (*INTERIOR_NAMES, "rx", "ry", "rz", "tx", "ty", "tz")


def rig_model(rig: RigData) -> list[Any]:
    """The C++ oriented cameras of a rig, in its order."""
    return [oriented_model(camera) for camera in rig.cameras.values()]


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


def select_cameras(rig: RigData, names: Sequence[str]) -> RigData:
    """The rig of some of its cameras, in the order of ``names``, with their covariance.

    Examples
    --------
    >>> from videogrammetry.types import RigCamera, RigData
    >>> lens = RigCamera(image_size_px=(101, 101), interior=np.r_[1000.0, np.zeros(9)],
    ...                  r0_px=40.0, rotation=np.eye(3), translation_mm=np.zeros(3))
    >>> rig = RigData(cameras={"a": lens, "b": lens}, cov=np.diag([1.0, 2.0]),
    ...               cov_names=("a/f", "b/f"))
    >>> select_cameras(rig, ["b"]).cov.tolist()
    [[2.0]]
    """
    missing = [name for name in names if name not in rig.cameras]
    if missing:
        raise ValueError(
            f"camera {missing[0]!r} is not in the rig, which has {', '.join(rig.cameras)}"
        )
    columns = [list(rig.cameras).index(name) for name in names]
    seen = None if rig.volume_seen is None else rig.volume_seen[:, columns]
    keep = [i for i, n in enumerate(rig.cov_names) if n.rsplit("/", 1)[0] in names]
    return dataclasses.replace(
        rig,
        cameras={name: rig.cameras[name] for name in names},
        cov=None if rig.cov is None else rig.cov[np.ix_(keep, keep)],
        cov_names=tuple(rig.cov_names[i] for i in keep),
        volume_seen=seen,
    )
