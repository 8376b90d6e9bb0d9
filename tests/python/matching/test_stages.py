"""Chunks of stages and the user's edits through the Python interface."""

from __future__ import annotations

import numpy as np
import pytest

from videogrammetry.geometry import project_from_world, rotation_looking_at
from videogrammetry.matching import MatchEdits, MatchingOptions, match_stage, match_stages
from videogrammetry.types import FlatTargets, FloatArray, IntArray, RigCamera, RigData, Targets

SIGMA_PX = 0.03
STAGES = 8


def rig(cameras: int) -> RigData:
    made = {}
    for k in range(cameras):
        across, up = 0.3 * k - 0.15 * (cameras - 1), 0.15 * (k % 2)
        centre = 1000 * np.array([np.sin(across), np.sin(up), -np.cos(across)])
        rotation = rotation_looking_at(centre, np.zeros(3), (0.0, -1.0, 0.0))
        made[f"c{k}"] = RigCamera(
            image_size_px=(1280, 1024), interior=np.r_[2500.0, np.zeros(9)], r0_px=500.0,
            rotation=rotation, translation_mm=-rotation @ centre,
        )  # fmt: skip
    return RigData(cameras=made)


def filmed(data: RigData, points: int, seed: int) -> tuple[list[FlatTargets], list[IntArray]]:
    """Points in flight, targets in any order; the point of each target."""
    rng = np.random.default_rng(seed)
    place = rng.uniform(-100, 100, (points, 3))
    speed = rng.normal(0, 2, (points, 3))
    flat, truth = [], []
    for camera in data.cameras.values():
        centres, own = [], []
        for s in range(STAGES):
            order = rng.permutation(points)
            xy = project_from_world(camera, (place + s * speed)[order])
            centres.append(xy + rng.normal(0, SIGMA_PX, xy.shape))
            own.append(order)
        n = STAGES * points
        flat.append(
            FlatTargets(
                offsets=points * np.arange(STAGES + 1), centre_px=np.concatenate(centres),
                cov_px2=np.tile([SIGMA_PX**2, 0, SIGMA_PX**2], (n, 1)),
                id=np.full(n, -1, np.int32), semi_major_px=np.full(n, 3.0),
            )
        )  # fmt: skip
        truth.append(np.concatenate(own).astype(np.int32))
    return flat, truth


def targets(xy: FloatArray) -> Targets:
    n = len(xy)
    cov = np.zeros((n, 5, 5))
    cov[:, range(5), range(5)] = SIGMA_PX**2
    return Targets(
        centre_px=xy, semi_axes_px=np.full((n, 2), 3.0), angle_rad=np.zeros(n), cov=cov,
        id=np.full(n, -1, np.int32), contrast=np.full(n, 100.0),
        edge_rms_px=np.full(n, 0.1), ring_status=np.zeros(n, np.uint8),
    )  # fmt: skip


@pytest.mark.parametrize("cameras", [2, 3, 5])
@pytest.mark.parametrize("seed", [1, 2])
def test_points_in_flight(cameras: int, seed: int) -> None:
    data = rig(cameras)
    flat, truth = filmed(data, 40, seed)
    found = match_stages(data, flat)
    assert found.offsets[-1] == len(found)
    stage = np.repeat(np.arange(STAGES), np.diff(found.offsets))
    own = np.stack(
        [
            np.where(t >= 0, p[f.offsets[stage] + t], -1)
            for t, f, p in zip(found.target.T, flat, truth, strict=True)
        ],
        axis=1,
    )
    point = own.max(axis=1)
    assert ((own == point[:, None]) | (own < 0)).all(), f"a wrong match, seed {seed}"
    # A point may lie on another's epipolar line in two cameras, at every stage.
    assert len(found) >= (0.9 if cameras == 2 else 0.99) * 40 * STAGES
    np.testing.assert_allclose(found.false_probability, 1 / (1 + np.exp(found.log_odds)))
    for c, f in enumerate(flat):
        rows = f.offsets[stage] + found.target[:, c]
        rows = rows[found.target[:, c] >= 0]
        assert len(np.unique(rows)) == len(rows)
        assert (found.status[c][rows] == 0).all()


def test_more_uncertainty_is_added() -> None:
    """Targets that the calibration places 0.5 px wrong meet if it says so, and else do not."""
    data = rig(3)
    flat, _ = filmed(data, 20, 3)
    off = FlatTargets(
        offsets=flat[1].offsets, centre_px=flat[1].centre_px + np.array([0.0, 0.5]),
        cov_px2=flat[1].cov_px2, id=flat[1].id, semi_major_px=flat[1].semi_major_px,
    )  # fmt: skip
    moved = [flat[0], off, flat[2]]
    extra = [np.tile([0.25, 0, 0.25], (len(f.id), 1)) for f in moved]
    whole = (match_stages(data, moved, None, extra).target >= 0).all(axis=1).sum()
    without = (match_stages(data, moved).target >= 0).all(axis=1).sum()
    assert whole > 0.9 * 20 * STAGES
    assert without < 0.2 * 20 * STAGES


def test_edits_of_a_stage() -> None:
    data = rig(3)
    flat, _ = filmed(data, 12, 4)
    pictures = [targets(f.centre_px[:12]) for f in flat]
    plain = match_stage(data, pictures)
    row = plain.target[0]
    pair = ((0, int(row[0])), (1, int(row[1])))
    apart = match_stage(data, pictures, edits=MatchEdits(apart=[pair]))
    assert not ((apart.target[:, 0] == row[0]) & (apart.target[:, 1] == row[1])).any()
    together = match_stage(data, pictures, edits=MatchEdits(together=[pair]))
    assert together.false_probability is not None
    assert together.false_probability[0] == 0
    assert together.target[0, :2].tolist() == row[:2].tolist()
    stages = match_stages(data, flat, edits={0: MatchEdits(apart=[pair])})
    first = stages.target[: stages.offsets[1]]
    assert not ((first[:, 0] == row[0]) & (first[:, 1] == row[1])).any()


def test_what_is_wrong_is_said() -> None:
    data = rig(2)
    flat, _ = filmed(data, 3, 5)
    with pytest.raises(ValueError, match="names target 7 of camera 1, which is not there"):
        match_stages(data, flat, edits={0: MatchEdits(together=[((0, 0), (1, 7))])})
    with pytest.raises(ValueError, match="stage 8 is not among the 8 stages"):
        match_stages(data, flat, edits={8: MatchEdits()})
    with pytest.raises(ValueError, match="stages count from 0"):
        match_stages(data, flat, edits={-1: MatchEdits()})
    with pytest.raises(ValueError, match=r"critical_value: expected \(0, 20\]"):
        match_stages(data, flat, MatchingOptions(critical_value=0))
    short = FlatTargets(
        offsets=flat[0].offsets[:-1], centre_px=flat[0].centre_px, cov_px2=flat[0].cov_px2,
        id=flat[0].id, semi_major_px=flat[0].semi_major_px,
    )  # fmt: skip
    with pytest.raises(ValueError, match="expected to rise from 0 to the number of targets, 24"):
        match_stages(data, [short, flat[1]])
