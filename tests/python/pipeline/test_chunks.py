"""Stages measured in chunks are the stages measured at once."""

from __future__ import annotations

import dataclasses

import h5py
import numpy as np
import pytest
from small_project import frames_of, positions, small_rig, write_small_project

from videogrammetry.calibration.calibrated_volume import CalibratedVolume
from videogrammetry.motion import MotionOptions, compute_motion
from videogrammetry.pipeline import measure_frames, measure_project, measure_to_file
from videogrammetry.pipeline.assemble import (
    TrajectoryBuilder,
    assemble,
    plan_of_chunks,
)
from videogrammetry.pipeline.chunk import CameraTargets
from videogrammetry.pipeline.chunk_record import ChunkRecord, read_record, write_record
from videogrammetry.pipeline.chunk_store import MemoryStore
from videogrammetry.pipeline.linking import link_chunks
from videogrammetry.pipeline.numbering import Numbering
from videogrammetry.pipeline.sinks import ArraySink
from videogrammetry.project import read_measurement, read_project
from videogrammetry.tracking import link_stages
from videogrammetry.types import POINT_FLAGS, Motion, RigData, StagePoints, Targets, Trajectories

NAMES = ("a", "b")
CHUNKS = [(5, 14), (15, 24), (25, 34), (35, 37)]


def same(a, b, names) -> None:
    for name in names:
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


def record(stages: range, rng: np.random.Generator) -> ChunkRecord:
    """Points on straight ways: two codes, one of them with gaps, and dots that come and go."""
    rows, code, place = [], [], []
    for row, stage in enumerate(stages):
        for k, (first, last, number) in enumerate(
            [(1, 99, 3), (1, 99, 7), (1, 20, -1), (12, 99, -1), (26, 33, -1)]
        ):
            if not first <= stage <= last or (number == 7 and stage % 9 == 4):
                continue
            rows.append(row)
            code.append(number)
            place.append([100.0 * k + 0.7 * stage, -0.3 * stage, 5.0 * k])
    n = len(rows)
    cov = np.tile(1e-4 * np.array([1.0, 0.1, 0, 1, 0, 2]), (n, 1))
    empty = np.empty(0)
    return ChunkRecord(
        stage=np.array(stages, dtype=np.int32),
        target_count=np.zeros((len(stages), 2), np.int32),
        point_count=np.bincount(rows, minlength=len(stages)).astype(np.int32),
        centre_px=np.empty((0, 2)),
        semi_axes_px=np.empty((0, 2)),
        angle_rad=empty,
        sigma_px=np.empty((0, 2)),
        residual_px=np.empty((0, 2)),
        code_id=np.empty(0, np.int32),
        match_status=np.empty(0, np.uint8),
        ring_status=np.empty(0, np.uint8),
        target_point=np.empty(0, np.int32),
        point_code=np.array(code, np.int32),
        position_mm=np.array(place) + 0.01 * rng.normal(size=(n, 3)),
        cov_mm2=1.5 * cov,
        cov_image_mm2=cov,
        cameras_used=np.ones((n, 2), bool),
        rms_px=rng.uniform(size=n),
        flags=rng.integers(0, 4, n).astype(np.uint8),
        eccentricity_px=empty,
        coded_ends=np.zeros((len(stages), 2, 2), np.int32),
        size_mm=empty,
        size_checked=0,
        without_normal=0,
        searched_whole=np.ones((len(stages), 2), bool),
    )


def measured(chunks, records, options):
    store = MemoryStore()
    for chunk, part in zip(chunks, records, strict=True):
        store.put(chunk, part)
    linked = link_chunks(store, chunks, 100)
    plan = plan_of_chunks(store, chunks, linked, NAMES, options)
    sink = ArraySink(linked, plan, NAMES)
    assemble(store, chunks, linked, plan, TrajectoryBuilder(linked, 200.0, NAMES), sink)
    return sink


def joined(records) -> ChunkRecord:
    names = [f.name for f in dataclasses.fields(ChunkRecord)]
    counts = ("size_checked", "without_normal")
    return ChunkRecord(
        **{n: 0 if n in counts else np.concatenate([getattr(r, n) for r in records]) for n in names}
    )


@pytest.mark.parametrize("reference", [5, 17, 37])
def test_motion_by_parts_is_the_motion_of_the_whole(reference) -> None:
    rng = np.random.default_rng(4)
    records = [record(range(a, b + 1), rng) for a, b in CHUNKS]
    options = MotionOptions(reference_stage=reference)
    parts = measured(CHUNKS, records, options)
    whole = measured([(5, 37)], [joined(records)], options)
    same(parts.trajectories, whole.trajectories, Trajectories.__dataclass_fields__)
    same(parts.motion, whole.motion, Motion.__dataclass_fields__)
    assert parts.trajectories.point_id.tolist() == [3, 7, 100, 101, 102]
    seen = np.isfinite(parts.trajectories.position_mm[..., 0]).sum(axis=0)
    assert seen.tolist() == [33, 30, 16, 26, 8]
    again = compute_motion(parts.trajectories, options)
    same(parts.motion, again, Motion.__dataclass_fields__)


def test_records_are_files_and_back(tmp_path) -> None:
    part = record(range(5, 15), np.random.default_rng(1))
    write_record(tmp_path / "part.npz", part)
    back = read_record(tmp_path / "part.npz")
    same(part, back, [f.name for f in dataclasses.fields(ChunkRecord)])


def test_a_code_twice_counts_within_its_picture_alone() -> None:
    def of(*ids: int) -> Targets:
        n = len(ids)
        return Targets(
            centre_px=np.zeros((n, 2)),
            semi_axes_px=np.ones((n, 2)),
            angle_rad=np.zeros(n),
            id=np.array(ids, np.int32),
            cov=np.zeros((n, 5, 5)),
            edge_rms_px=np.zeros(n),
            contrast=np.ones(n),
            ring_status=np.zeros(n, np.uint8),
        )

    stages = [of(4, 5, 4), of(4, -1, -1), of(), of(5)]
    camera = CameraTargets.of_stages(stages)
    assert camera.unique_id.tolist() == [-1, 5, -1, 4, -1, -1, 5]
    assert camera.unique_id.tolist() == [i for t in stages for i in t.unique_id.tolist()]
    assert camera.stage.tolist() == [0, 0, 0, 1, 1, 1, 3]
    assert len(camera[2]) == 0


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    return read_project(write_small_project(tmp_path_factory.mktemp("chunks") / "small", 230))


def test_file_and_memory_hold_the_same(project) -> None:
    measurement = measure_project(project, num_threads=1)
    table = measure_to_file(project, num_threads=3)
    stored = read_measurement(project.measurement_path)
    same(measurement.trajectories, stored.trajectories, Trajectories.__dataclass_fields__)
    same(measurement.motion, stored.motion, Motion.__dataclass_fields__)
    same(measurement.targets, stored.targets, measurement.targets.__dataclass_fields__)
    assert (table.points, table.everywhere) == (8, 8)
    assert table.num_points.tolist() == [8] * 230
    with h5py.File(project.measurement_path) as file:
        assert file["flags"].attrs["flag_meanings"].split() == list(POINT_FLAGS)
        assert file["position_mm"].chunks == (100, 8, 3)


def test_positions_are_right_within_their_sigmas(project) -> None:
    found = measure_project(project).trajectories
    truth = np.stack([positions(int(s)) for s in found.stage])
    off = (found.position_mm - truth) / np.sqrt(found.cov_image_mm2[..., [0, 3, 5]])
    # One period of twenty noises, 8 points, 3 axes; the RMS of 480 normal numbers is
    # within 1 +- 4 / sqrt(960) = 0.13, and the sigmas within 20 %.
    assert 0.7 < np.sqrt(np.mean(off[:20] ** 2)) < 1.33
    assert (found.flags & (1 << POINT_FLAGS.index("large_residual")) == 0).mean() > 0.99


def test_frames_that_are_followed_give_what_whole_ones_give() -> None:
    rig = small_rig(2)
    frames = {name: frames_of(rig, name, 30) for name in rig.cameras}
    followed = measure_frames(rig, frames, full_every=25)
    whole = measure_frames(rig, frames, full_every=1)
    a, b = followed.trajectories, whole.trajectories
    assert a.point_id.tolist() == b.point_id.tolist()
    off = (a.position_mm - b.position_mm) / np.sqrt(b.cov_image_mm2[..., [0, 3, 5]])
    assert np.nanmax(np.abs(off)) < 0.5  # the fits start elsewhere and end within 0.25 sigma


def test_outside_the_volume() -> None:
    flat = RigData(cameras={}, volume_mm=np.column_stack([np.eye(3), np.ones(3)])[:, :3] * 0)
    assert CalibratedVolume(flat).contains(np.array([[1e6, 0, 0]])).tolist() == [True]
    with pytest.raises(ValueError, match="full_every"):
        measure_frames(small_rig(2), {"c1": [], "c2": []}, full_every=0)


def test_numbers_of_chunks_are_those_of_the_stages() -> None:
    """Crossing dots, some of them codes that are read late: revised and renamed alike."""
    rng = np.random.default_rng(3)
    stages, count = 60, 30
    way = rng.normal(size=(count, 2, 3)) * [[[60.0], [1.5]]]
    code = np.where(np.arange(count) < 6, np.arange(count), -1)
    points, records = [], []
    for begin in range(0, stages, 20):
        parts = []
        for s in range(begin, begin + 20):
            seen = np.flatnonzero(rng.uniform(size=count) > 0.1)
            ids = np.where(s > 8 + 5 * np.arange(count), code, -1)[seen].astype(np.int32)
            place = way[seen, 0] + s * way[seen, 1] + 0.02 * rng.normal(size=(len(seen), 3))
            parts.append((ids, place))
            cov = np.tile(4e-4 * np.eye(3), (len(seen), 1, 1))
            points.append(stage_points(ids, place, cov))
        records.append(
            dataclasses.replace(
                record(range(begin + 1, begin + 21), rng),
                point_count=np.array([len(ids) for ids, _ in parts], np.int32),
                point_code=np.concatenate([ids for ids, _ in parts]),
                position_mm=np.concatenate([place for _, place in parts]),
                cov_image_mm2=np.tile(
                    4e-4 * np.array([1.0, 0, 0, 1, 0, 1]), (sum(len(i) for i, _ in parts), 1)
                ),
            )
        )
    numbering = Numbering(100)
    for part in records:
        numbering.add(part)
    np.testing.assert_array_equal(
        np.concatenate(numbering.numbers), np.concatenate(link_stages(points, 100))
    )
    assert {0, 1, 2, 3, 4, 5} <= set(numbering.numbers[0].tolist())  # read only later


def stage_points(ids, place, cov) -> StagePoints:
    none = np.empty(0)
    return StagePoints(
        id=ids,
        target=np.empty((len(ids), 0), np.int32),
        position_mm=place,
        cov_image_mm2=cov,
        cov_rig_mm2=none,
        rms_px=none,
        chi2=none,
        convergence_rad=none,
        residual_px=none,
    )
