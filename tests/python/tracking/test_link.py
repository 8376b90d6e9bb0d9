"""Numbers of un-coded points stay with their points over rigid and bending motion."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from videogrammetry.tracking import build_trajectories, link_stages
from videogrammetry.types import StagePoints

SIGMA_MM = 0.05


def stage_points(position, code, rng, *, keep=None):
    """A stage in random order; ``code`` (N,) has -1 for un-coded; returns it and the order."""
    order = rng.permutation(len(position) if keep is None else keep)
    n = len(order)
    cov = np.broadcast_to(SIGMA_MM**2 * np.eye(3), (n, 3, 3))
    points = StagePoints(
        id=code[order].astype(np.int32),
        target=np.zeros((n, 2), np.int32),
        position_mm=position[order] + rng.normal(0, SIGMA_MM, (n, 3)),
        cov_image_mm2=cov,
        cov_rig_mm2=0 * cov,
        rms_px=np.zeros(n),
        chi2=np.zeros(n),
        convergence_rad=np.ones(n),
        residual_px=np.zeros((n, 2, 2)),
    )
    return points, order


def panel(coded_every=4):
    x, y = np.meshgrid(np.arange(12) * 40.0, np.arange(9) * 40.0)
    position = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    code = np.where(np.arange(x.size) % coded_every == 0, np.arange(x.size) + 1, -1)
    return position, code


def check_identities(stages, orders, numbers, code, first_free):
    number_of = {}
    for points, order, ids in zip(stages, orders, numbers, strict=True):
        assert len(set(ids.tolist())) == len(ids)
        np.testing.assert_array_equal(ids[points.id >= 0], points.id[points.id >= 0])
        for truth, number in zip(order, ids, strict=True):
            assert number_of.setdefault(int(truth), int(number)) == number
    loose = [n for truth, n in number_of.items() if code[truth] < 0]
    assert min(loose) == first_free
    assert len(set(number_of.values())) == len(number_of)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_rigid_panel_thrown_about(seed):
    # Motions of many times the spacing: only the coded neighbours can tell.
    rng = np.random.default_rng(seed)
    position, code = panel()
    stages, orders = [], []
    for _ in range(6):
        rotation = Rotation.random(random_state=rng).as_matrix()
        points, order = stage_points(
            position @ rotation.T + rng.uniform(-500, 500, 3), code, rng, keep=rng.permutation(108)
        )
        stages.append(points)
        orders.append(order)
    check_identities(stages, orders, link_stages(stages, 517), code, 517)


@pytest.mark.parametrize("seed", [1, 2])
def test_bending_panel_and_points_that_come_back(seed):
    rng = np.random.default_rng(seed)
    position, code = panel()
    stages, orders = [], []
    for s in range(10):
        bent = position.copy()
        bent[:, 2] = 40 * np.sin(0.5 * s) * np.sin(position[:, 0] / 150)
        bent[:, 0] += 25.0 * s
        seen = np.flatnonzero((code >= 0) | (rng.uniform(size=len(code)) > 0.2))
        points, order = stage_points(bent, code, rng, keep=seen)
        stages.append(points)
        orders.append(order)
    check_identities(stages, orders, link_stages(stages, 517), code, 517)


def test_without_codes_small_steps_are_followed():
    rng = np.random.default_rng(4)
    position, _ = panel()
    code = np.full(len(position), -1)
    made = [stage_points(position + 5.0 * s, code, rng) for s in range(5)]
    stages, orders = zip(*made, strict=True)
    check_identities(stages, orders, link_stages(stages, 517), code, 517)


def test_without_codes_a_fall_is_followed_beyond_the_spacing():
    # 0.4 of the spacing is 16 mm; the last steps are 60 mm, each 5 mm more than the one before.
    rng = np.random.default_rng(4)
    position, _ = panel()
    code = np.full(len(position), -1)
    stages, orders = [], []
    for k in range(13):
        keep = np.flatnonzero(rng.uniform(size=len(position)) > 0.05)
        points, order = stage_points(position + np.array([0, 2.5 * k**2, 0]), code, rng, keep=keep)
        stages.append(points)
        orders.append(order)
    numbers = link_stages(stages, 517)
    check_identities(stages, orders, numbers, code, 517)


def test_trajectories_hold_nan_where_a_point_is_missing():
    rng = np.random.default_rng(5)
    position, code = panel()
    made = [stage_points(position, code, rng, keep=np.arange(k)) for k in (108, 50)]
    stages = [m[0] for m in made]
    numbers = link_stages(stages, 517)
    table = build_trajectories(stages, numbers, np.array([1, 2]), np.array([0.0, 0.1]), ["a", "b"])
    assert table.position_mm.shape == (2, 108, 3)
    assert np.isfinite(table.position_mm[0]).all()
    assert np.isfinite(table.position_mm[1, :, 0]).sum() == 50
    row = {int(n): i for i, n in enumerate(numbers[1])}
    for column, number in enumerate(table.point_id):
        if int(number) in row:
            expected = stages[1].position_mm[row[int(number)]]
            np.testing.assert_array_equal(table.position_mm[1, column], expected)
            assert table.cov_mm2[1, column, 0] == SIGMA_MM**2


def test_no_stage_and_empty_stage():
    assert link_stages([], 517) == []
    rng = np.random.default_rng(6)
    position, code = panel()
    empty, _ = stage_points(position, code, rng, keep=np.arange(0))
    full, _ = stage_points(position, code, rng)
    numbers = link_stages([full, empty, full], 517)
    assert len(numbers[1]) == 0
    np.testing.assert_array_equal(numbers[0], numbers[2])


@pytest.mark.parametrize("unread", [[2], [0], [0, 1], [3, 4]])
def test_a_code_that_some_stages_cannot_read_keeps_its_number(unread):
    rng = np.random.default_rng(7)
    position, code = panel()
    lost = np.flatnonzero(code > 0)[5]
    stages, orders = [], []
    for s in range(6):
        rotation = Rotation.from_rotvec(rng.uniform(-0.5, 0.5, 3)).as_matrix()
        seen = code.copy()
        if s in unread:
            seen[lost] = -1
        points, order = stage_points(position @ rotation.T + rng.uniform(-300, 300, 3), seen, rng)
        stages.append(points)
        orders.append(order)
    numbers = link_stages(stages, 517)
    for order, ids in zip(orders, numbers, strict=True):
        assert ids[np.flatnonzero(order == lost)[0]] == code[lost]
    uncoded = {int(i) for ids in numbers for i in ids if i >= 517}
    assert len(uncoded) == (code < 0).sum()
