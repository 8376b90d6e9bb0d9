"""Gaps are filled chunk by chunk, and at a chunk's border as anywhere else."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
from measured_data import datasets
from small_project import PERIOD, SIZE_PX, frames_of, positions, small_rig, write_small_project

from videogrammetry.export import leave_out_flagged
from videogrammetry.motion import MotionOptions, compute_motion
from videogrammetry.pipeline import measure_frames, measure_project, measure_to_file
from videogrammetry.pipeline.assemble import TrajectoryBuilder, assemble, plan_of_chunks
from videogrammetry.pipeline.chunk_record import ChunkRecord
from videogrammetry.pipeline.chunk_store import FolderStore, MemoryStore
from videogrammetry.pipeline.filling import fill_chunks
from videogrammetry.pipeline.linking import link_chunks
from videogrammetry.pipeline.sinks import ArraySink
from videogrammetry.project import read_measurement, read_project
from videogrammetry.sequence import create_sequence
from videogrammetry.tracking import FillOptions, fill_gaps
from videogrammetry.types import POINT_FLAGS, Motion, Trajectories

FILLED = 1 << POINT_FLAGS.index("filled")
NAMES = ("a", "b")
SIGMA_MM = 0.01
POINTS, STAGES = 12, 300
CHUNKS = [(1, 100), (101, 200), (201, 300)]
#: First and last stage of the gaps of single points: within a chunk, over its border,
#: up to it and from it on, at the ends, and longer than ten stages.
GAPS = [(2, 40, 43), (3, 98, 104), (4, 97, 100), (5, 101, 103), (6, 195, 201), (7, 1, 5)]
GAPS += [(8, 290, 300), (9, 60, 70), (10, 60, 69)]


def truth(stage: np.ndarray) -> np.ndarray:
    """(S, P, 3): points that swing, each in its own phase and way."""
    phase = 2 * np.pi * stage[:, None] / 60 + np.arange(POINTS)
    rest = np.stack([90.0 * np.arange(POINTS) % 400, 70.0 * (np.arange(POINTS) // 4)], axis=1)
    x = np.stack([8 * np.cos(phase), 5 * np.sin(phase), 3 * np.sin(2 * phase)], axis=2)
    x[..., :2] += rest
    return x


def table(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Measured positions (S, P, 3) and where there are any (S, P)."""
    seen = np.ones((STAGES, POINTS), dtype=bool)
    for point, first, last in GAPS:
        seen[first - 1 : last, point] = False
    x = truth(np.arange(1, STAGES + 1))
    return x + SIGMA_MM * np.random.default_rng(seed).normal(size=x.shape), seen


def record(first: int, last: int, x: np.ndarray, seen: np.ndarray) -> ChunkRecord:
    """The codes 0 to 11 at their places."""
    rows, code = np.nonzero(seen[first - 1 : last])
    n, stages, nothing = len(rows), last - first + 1, np.empty(0)
    cov = np.tile(SIGMA_MM**2 * np.array([1.0, 0, 0, 1, 0, 1]), (n, 1))
    return ChunkRecord(
        stage=np.arange(first, last + 1, dtype=np.int32),
        target_count=np.zeros((stages, 2), np.int32),
        point_count=np.bincount(rows, minlength=stages).astype(np.int32),
        **{k: np.empty((0, 2)) for k in ("centre_px", "semi_axes_px", "sigma_px", "residual_px")},
        angle_rad=nothing,
        code_id=np.empty(0, np.int32),
        match_status=np.empty(0, np.uint8),
        ring_status=np.empty(0, np.uint8),
        target_point=np.empty(0, np.int32),
        point_code=code.astype(np.int32),
        position_mm=x[rows + first - 1, code],
        cov_mm2=1.5 * cov,
        cov_image_mm2=cov,
        cameras_used=np.ones((n, 2), bool),
        rms_px=np.full(n, 0.02),
        flags=np.zeros(n, np.uint8),
        eccentricity_px=nothing,
        coded_ends=np.zeros((stages, 2, 2), np.int32),
        size_mm=nothing,
        size_checked=0,
        without_normal=0,
        searched_whole=np.ones((stages, 2), bool),
    )


def measured(seed: int, threads: int = 1, options: MotionOptions | None = None) -> ArraySink:
    x, seen = table(seed)
    store = MemoryStore()
    for chunk in CHUNKS:
        store.put(chunk, record(*chunk, x, seen))
    linked = link_chunks(store, CHUNKS, 100)
    builder = TrajectoryBuilder(linked, 200.0, NAMES)
    linked.filled = fill_chunks(store, CHUNKS, linked, builder, 10, num_threads=threads)
    plan = plan_of_chunks(store, CHUNKS, linked, NAMES, options or MotionOptions(reference_stage=9))
    sink = ArraySink(linked, plan, NAMES)
    assemble(store, CHUNKS, linked, plan, builder, sink)
    return sink


def same(a, b, names) -> None:
    for name in names:
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


def test_gaps_are_filled_wherever_they_lie() -> None:
    found = measured(1)
    t = found.trajectories
    wanted = np.zeros((STAGES, POINTS), bool)
    for point, first, last in GAPS:
        # Nothing is filled before the first or after the last time, nor more than ten stages.
        if first > 1 and last < STAGES and last - first < 10:
            wanted[first - 1 : last, point] = True
    np.testing.assert_array_equal(t.flags & FILLED != 0, wanted)
    np.testing.assert_array_equal(t.flags[~wanted], 0)
    _, seen = table(1)
    np.testing.assert_array_equal(np.isfinite(t.position_mm[..., 0]), seen | wanted)
    assert not t.cameras_used[wanted].any()
    assert np.isnan(t.rms_px[wanted]).all()
    # The calibration's part is that of the gap's ends, half the noise's of a position here.
    added = (t.cov_mm2 - t.cov_image_mm2)[wanted][:, [0, 3, 5]]
    np.testing.assert_allclose(added, 0.5 * SIGMA_MM**2, rtol=1e-9)
    # A step over a border goes from a filled place to a filled place of one and the same gap.
    np.testing.assert_array_equal(
        found.motion.step_mm[99, 3], np.diff(t.position_mm[99:101, 3], axis=0)[0]
    )
    same(
        compute_motion(t, MotionOptions(reference_stage=9)),
        found.motion,
        Motion.__dataclass_fields__,
    )


def test_threads_do_not_matter() -> None:
    one, three = measured(2), measured(2, threads=3)
    same(one.trajectories, three.trajectories, Trajectories.__dataclass_fields__)
    same(one.motion, three.motion, Motion.__dataclass_fields__)


def test_a_border_is_as_good_as_the_middle() -> None:
    """What is filled over a border is what all stages at once give, but for the motion learnt."""
    x, seen = table(3)
    parts = measured(3).trajectories
    gone = np.where(seen[..., None], x, np.nan)
    cov = np.where(seen[..., None], SIGMA_MM**2 * np.array([1.0, 0, 0, 1, 0, 1]), np.nan)
    stage = np.arange(1, STAGES + 1)
    at_once, mask = fill_gaps(
        Trajectories(
            stage=stage,
            time_s=stage / 200,
            point_id=np.arange(POINTS),
            position_mm=gone,
            cov_mm2=cov,
            cov_image_mm2=cov,
            cameras_used=np.repeat(seen[..., None], 2, axis=2),
            rms_px=np.where(seen, 0.02, np.nan),
            camera_names=NAMES,
        ),
        FillOptions(largest_gap=10),
    )
    np.testing.assert_array_equal(parts.flags & FILLED != 0, mask)
    off = (parts.position_mm - at_once.position_mm)[mask]
    sigma = np.sqrt(at_once.cov_image_mm2[mask][:, [0, 3, 5]])
    # Both take the same 24 stages around a gap; only the accelerations' size is learnt from a
    # third of the stages, known to some percent: a fraction of the sigma.
    assert np.abs(off / sigma).max() < 0.5


def test_the_covariance_is_right() -> None:
    """Chi-square over many noises: gaps of a smooth motion, all lengths and places."""
    chi2, count = [], 0
    for seed in range(12):
        t = measured(seed).trajectories
        mask = t.flags & FILLED != 0
        off = t.position_mm[mask] - truth(t.stage)[mask]
        chi2.append((off**2 / t.cov_image_mm2[mask][:, [0, 3, 5]]).mean())
        count = len({p for p, a, b in GAPS if mask[a - 1, p]})
    # The stages of a gap err alike: 12 noises of 6 gaps in 3 axes are 216 draws at least, the
    # mean of whose squares is within 1 +- 4 sqrt(2 / 216) = 0.39.
    assert count == 6
    assert 0.61 < np.mean(chi2) < 1.39


def test_flagged_positions_can_be_left_out() -> None:
    with_them = measured(5)
    options = MotionOptions(reference_stage=9, leave_out=("filled",))
    without = measured(5, options=options)
    filled = with_them.trajectories.flags & FILLED != 0
    assert np.isfinite(with_them.motion.displacement_mm[filled]).all()
    assert np.isnan(without.motion.displacement_mm[filled]).all()
    again = compute_motion(with_them.trajectories, options)
    same(without.motion, again, Motion.__dataclass_fields__)


DARK = range(97, 103)  # from 0: stages 98 to 103, over the border of the first chunk


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """A project whose cameras all see nothing for six stages."""
    path = write_small_project(tmp_path_factory.mktemp("fill") / "small", 230)
    rig = small_rig()
    for name in rig.cameras:
        for file in path.parent.glob(f"{name}.*"):
            if file.suffix in (".mraw", ".cihx"):
                file.unlink()
        with create_sequence(
            path.parent / name,
            format="mraw",
            image_size_px=SIZE_PX,
            num_frames=230,
            bit_depth=8,
            frame_rate_hz=1000.0,
        ) as writer:
            for k, frame in enumerate(frames_of(rig, name, 230)):
                writer.append(np.zeros_like(frame) if k in DARK else frame)
    path.write_text(path.read_text(encoding="utf-8") + "[motion]\nfill_gaps = 8\n", "utf-8")
    return read_project(path)


def test_a_project_is_filled_and_resumes(project, monkeypatch) -> None:
    measure_to_file(project, num_threads=2)
    expected = datasets(project.measurement_path)
    t = read_measurement(project.measurement_path).trajectories
    filled = t.flags & FILLED != 0
    assert np.flatnonzero(filled.all(axis=1)).tolist() == list(DARK)
    assert filled.sum() == len(DARK) * 8
    off = t.position_mm - np.stack([positions(int(s)) for s in t.stage])
    sigma = np.sqrt(t.cov_image_mm2[..., [0, 3, 5]])
    # 144 numbers in 8 gaps of 3 axes: none beyond 4.5 sigmas, with sigmas right within a third.
    assert np.abs(off[filled] / sigma[filled]).max() < 6
    assert np.abs(off[filled]).max() < 0.5 * 2 * np.pi / PERIOD * 5  # half of a stage's way
    project.measurement_path.unlink()

    def stop(self, chunk, record):
        put(self, chunk, record)
        if next(counter) == 1:
            raise KeyboardInterrupt

    put, counter = FolderStore.put, itertools.count()
    with monkeypatch.context() as context:
        context.setattr(FolderStore, "put", stop)
        with pytest.raises(KeyboardInterrupt):
            measure_to_file(project, num_threads=1)
    table = measure_to_file(project, num_threads=1)
    assert datasets(project.measurement_path) == expected
    assert (table.everywhere, table.num_points[list(DARK)].sum()) == (0, 0)


def test_without_filling_the_rest_is_the_same(project) -> None:
    filled = measure_project(project)
    section = dataclasses.replace(project.motion, fill_gaps=0)
    plain = measure_project(dataclasses.replace(project, motion=section))
    assert not (plain.trajectories.flags & FILLED).any()
    left = leave_out_flagged(filled, ["filled"])
    np.testing.assert_array_equal(left.trajectories.position_mm, plain.trajectories.position_mm)
    np.testing.assert_array_equal(left.motion.velocity_mm_s, plain.motion.velocity_mm_s)
    assert filled.provenance["options"]["fill_gaps"] == 8


def test_out_of_range() -> None:
    with pytest.raises(ValueError, match="fill_gaps: expected 0 to 100 stages, got 101"):
        measure_frames(small_rig(2), {"c1": [], "c2": []}, fill_gaps=101)
