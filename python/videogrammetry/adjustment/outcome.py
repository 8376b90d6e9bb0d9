"""The extension's results as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from videogrammetry._core import TaskError as _TaskError
from videogrammetry._core import adjustment as _adjustment
from videogrammetry.adjustment.arguments import mask
from videogrammetry.adjustment.results import (
    CAMERA_UNKNOWNS,
    INTERFACE_UNKNOWNS,
    Adjustment,
    AdjustOptions,
    CameraVariance,
    Dispersion,
    DroppedParameter,
    PointPriorStatistics,
    ScaleBarStatistics,
)
from videogrammetry.errors import CalibrationError

_COPIED = (
    "converged",
    "message",
    "sigma0",
    "num_observations",
    "num_prior",
    "num_unknowns",
    "redundancy",
    "point_factor",
    "point_redundancy",
    "bar_factor",
    "bar_redundancy",
    "rounds",
)


def run_adjustment(
    network: Any, options: AdjustOptions, offered: Sequence[Sequence[str]] | None
) -> Adjustment:
    """Adjusts the extension's network; see ``Network.adjust``."""
    native = _adjustment.AdjustOptions()
    for name in AdjustOptions.__dataclass_fields__:
        setattr(native, name, getattr(options, name))
    if offered is not None:
        native.offered = [mask(names) for names in offered]
    try:
        result = _adjustment.adjust(network, native)
    except _TaskError as error:
        raise CalibrationError(str(error)) from error
    statistics = result.statistics
    return Adjustment(
        **{name: getattr(result, name) for name in _COPIED},
        cameras=tuple(
            CameraVariance(factor=c.factor, redundancy=c.redundancy, rms_px=c.rms_px, count=c.count)
            for c in result.cameras
        ),
        dropped=tuple(
            DroppedParameter(
                camera=d.camera,
                name=CAMERA_UNKNOWNS[d.parameter],
                value=d.value,
                sigma=d.sigma,
                undetermined=d.undetermined,
            )
            for d in result.dropped
        ),
        residual_px=statistics["residual_px"],
        normalised=statistics["normalised"],
        redundancy_numbers=statistics["redundancy"],
        used=np.array(network.used, dtype=bool),
        scale_bars=ScaleBarStatistics(**result.bars, used=np.array(network.bars_used, dtype=bool)),
        points=PointPriorStatistics(
            **result.points,
            used=np.array(network.priors_used, dtype=bool),
            starved=np.array(network.starved, dtype=bool),
        ),
    )


def find_dispersion(network: Any, num_threads: int) -> Dispersion:
    """See ``Network.dispersion``."""
    try:
        handle = _adjustment.Dispersion(network, num_threads)
    except _TaskError as error:
        raise CalibrationError(str(error)) from error
    return Dispersion(
        camera_index=np.array(handle.camera_index, np.int32).reshape(-1, len(CAMERA_UNKNOWNS)),
        pose_index=np.array(handle.pose_index, np.int32),
        interface_index=np.array(handle.interface_index, np.int32).reshape(
            -1, len(INTERFACE_UNKNOWNS)
        ),
        point_index=np.array(handle.point_index, np.int32),
        unknown_names=tuple(handle.names(network)),
        redundancy=handle.redundancy,
        datum_size=handle.datum_size,
        handle=handle,
    )
