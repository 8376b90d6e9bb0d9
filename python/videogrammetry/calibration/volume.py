"""The calibrated volume: where the target stood, and which cameras saw it there."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt

from videogrammetry.calibration.run import CalibrationRun

#: Points that represent the volume; more would tell nothing new of a smooth field.
_MAX_POINTS = 600


def with_volume(run: CalibrationRun) -> CalibrationRun:
    """The run, its rig holding the target's points at every stage that two cameras saw."""
    table = run.observations
    used = table.used & np.isin(table.stage, list(run.rig_from_target))
    key = np.stack([table.stage[used], table.point_id[used]], axis=1)
    places, row = np.unique(key, axis=0, return_inverse=True)
    seen = np.zeros((len(places), len(run.camera_names)), dtype=bool)
    seen[row.reshape(-1), table.camera[used]] = True
    keep = evenly(np.flatnonzero(seen.sum(axis=1) >= 2))
    position_of = dict(zip(run.target.id.tolist(), run.target.position_mm, strict=True))
    volume = np.empty((len(keep), 3))
    for k, (stage, point) in enumerate(places[keep].tolist()):
        rotation, translation_mm = run.rig_from_target[stage]
        volume[k] = rotation @ position_of[point] + translation_mm
    rig = dataclasses.replace(run.rig, volume_mm=volume, volume_seen=seen[keep])
    return dataclasses.replace(run, rig=rig)


def evenly(rows: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """All rows, or evenly as many as represent the volume.

    Examples
    --------
    >>> len(evenly(np.arange(10))), len(evenly(np.arange(5000)))
    (10, 600)
    """
    if len(rows) <= _MAX_POINTS:
        return rows
    return np.asarray(rows[np.linspace(0, len(rows) - 1, _MAX_POINTS).round().astype(int)])
