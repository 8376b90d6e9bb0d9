"""A measurement written part by part is what was given, however the parts meet the blocks."""

from __future__ import annotations

import os

import h5py
import numpy as np
import pytest

from videogrammetry.motion import compute_motion, motion_rows, trajectory_rows
from videogrammetry.project import MeasurementLayout, open_measurement_writer, read_measurement
from videogrammetry.project.atomic import atomic_path
from videogrammetry.types import TargetRecords, Trajectories

CAMERAS = ("a", "b", "c", "d", "e")


def table_of(stages: int, points: int, rng: np.random.Generator) -> Trajectories:
    position = rng.normal(size=(stages, points, 3))
    position[rng.uniform(size=(stages, points)) < 0.1] = np.nan
    cov = np.abs(rng.normal(size=(stages, points, 6)))
    return Trajectories(
        stage=np.arange(11, 11 + stages, dtype=np.int32),
        time_s=np.arange(stages) / 50.0,
        point_id=np.arange(points, dtype=np.int32) * 2 + 1,
        position_mm=position,
        cov_mm2=cov,
        cov_image_mm2=cov / 2,
        cameras_used=rng.uniform(size=(stages, points, len(CAMERAS))) > 0.3,
        rms_px=rng.uniform(size=(stages, points)),
        camera_names=CAMERAS,
        flags=rng.integers(0, 63, (stages, points)).astype(np.uint8),
    )


def targets_of(count: int, rng: np.random.Generator) -> TargetRecords:
    pairs = ("centre_px", "semi_axes_px", "sigma_px", "residual_px")
    whole = ("stage", "camera", "code_id", "point_id")
    return TargetRecords(
        angle_rad=rng.normal(size=count),
        match_status=rng.integers(0, 5, count).astype(np.uint8),
        ring_status=rng.integers(0, 5, count).astype(np.uint8),
        **{name: rng.normal(size=(count, 2)) for name in pairs},
        **{name: rng.integers(-1, 70000, count).astype(np.int32) for name in whole},
    )


@pytest.mark.parametrize(
    ("stages", "points", "targets", "slab"),
    [
        (250, 150, 9001, 100),
        (200, 64, 8192, 100),
        (230, 7, 4095, 100),
        (90, 3, 50, 100),
        (5000, 5, 4096, 100),
        (330, 70, 12, 33),
        (120, 1, 0, 100),
    ],
)
def test_parts(tmp_path, stages, points, targets, slab) -> None:
    rng = np.random.default_rng(stages + points)
    table, records = table_of(stages, points, rng), targets_of(targets, rng)
    motion = compute_motion(table)
    path = tmp_path / "measurement.h5"
    layout = MeasurementLayout(
        stage=table.stage,
        point_id=table.point_id,
        camera_names=CAMERAS,
        num_targets=targets,
        reference_stage=motion.reference_stage,
        centroid_points=motion.centroid_points,
        image_name=[["x"] * stages] * len(CAMERAS),
        frame_rate_hz=50.0,
        provenance={},
        warnings=(),
        flag_meanings={},
    )
    gone = np.zeros((stages, points), bool)
    with open_measurement_writer(path, layout) as writer:
        for first in range(0, stages, slab):
            rows = slice(first, min(first + slab, stages))
            columns = np.flatnonzero(rng.uniform(size=points) < (1.0 if first % 200 else 0.7))
            gone[rows] = ~np.isin(np.arange(points), columns)
            part, moved = trajectory_rows(table, rows), motion_rows(motion, rows)
            writer.points(first, columns, columns_of(part, columns), columns_of(moved, columns))
            share = slice(first * targets // stages, rows.stop * targets // stages)
            own = {n: getattr(records, n)[share] for n in TargetRecords.__dataclass_fields__}
            writer.targets(share.start, TargetRecords(**own))
    back = read_measurement(path)
    for found, given in ((back.trajectories, table), (back.motion, motion)):
        for name in found.__dataclass_fields__:
            values = getattr(given, name)
            if np.shape(values)[:2] == (stages, points):
                values = values.copy()
                values[gone] = np.nan if values.dtype.kind == "f" else 0
            np.testing.assert_array_equal(getattr(found, name), values, err_msg=name)
    for name in TargetRecords.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(back.targets, name), getattr(records, name), name)
    with h5py.File(path) as file:
        assert file["position_mm"].dtype == np.float64
        assert file["flags"].dtype == np.uint8


def columns_of(values, columns):
    """The arrays of some points of trajectories or motion."""
    own = {}
    for name, array in vars(values).items():
        per_point = np.ndim(array) >= 2 and not name.startswith("centroid_")
        own[name] = array[:, columns] if per_point else array
    own |= {"point_id": values.point_id[columns]} if isinstance(values, Trajectories) else {}
    return type(values)(**own)


def test_without_flush_nobody_waits(tmp_path, monkeypatch) -> None:
    waited = []
    monkeypatch.setattr(os, "fsync", lambda file: waited.append(file))
    for flush in (False, True):
        with atomic_path(tmp_path / f"{flush}.txt", flush=flush) as beside:
            beside.write_text("whole")
        assert (tmp_path / f"{flush}.txt").read_text() == "whole"
        assert (len(waited) > 0) == flush
