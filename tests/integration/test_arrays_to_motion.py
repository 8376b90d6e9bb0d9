"""From arrays to trajectories without a file: rendered pictures with known truth."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.synthetic import arc_rig, render

import videogrammetry as vg
from videogrammetry.geometry import fit_rigid
from videogrammetry.recognition import code_family
from videogrammetry.types import PointSet, matrix_from_cov6

CODED, LOOSE = 12, 12


def board(rng):
    """Points of a slightly uneven board, mm, in its own frame: 12 coded, 12 un-coded."""
    x, y = np.meshgrid(np.arange(6) * 75.0 - 187.5, np.arange(4) * 75.0 - 112.5)
    z = rng.uniform(-25, 25, 24)
    position = np.column_stack([x.ravel(), y.ravel(), z])
    position[:, :2] += rng.uniform(-6, 6, (24, 2))
    ids = np.concatenate([np.arange(1, CODED + 1) * 7, 2000 + np.arange(LOOSE)])
    order = rng.permutation(24)
    return ids[np.argsort(order)], position


def picture_targets(ids, position, world_from_board):
    rotation, translation = world_from_board
    codes = code_family("schneider-14").codes
    return [
        (
            rotation @ p + translation,
            rotation[:, 0],
            rotation[:, 1],
            codes[i - 1] if i < 517 else None,
        )
        for i, p in zip(ids, position, strict=True)
    ]


def poses(rng, count, spread_rad=0.45):
    made = []
    for _ in range(count):
        turn = Rotation.from_rotvec(rng.uniform(-spread_rad, spread_rad, 3)).as_matrix()
        made.append((turn, np.array([0, 0, 2000.0]) + rng.uniform(-90, 90, 3)))
    return made


def film(rig, ids, position, motion, rng):
    to_world = rig_world(rig)
    return {
        name: np.stack(
            [
                render(c, picture_targets(ids, position, compose(to_world, pose)), rng)
                for pose in motion
            ]
        )
        for name, c in rig.cameras.items()
    }


def rig_world(rig):
    """The arc's own frame seen from the first camera: there the board is in view of all."""
    centres = np.array([-c.rotation.T @ c.translation_mm for c in rig.cameras.values()])
    axes = np.array([c.rotation[2] for c in rig.cameras.values()])
    normal = sum(np.eye(3) - np.outer(a, a) for a in axes)
    meet = np.linalg.solve(
        normal, sum((np.eye(3) - np.outer(a, a)) @ p for a, p in zip(axes, centres, strict=True))
    )
    z = axes.mean(axis=0) / np.linalg.norm(axes.mean(axis=0))
    x = np.cross([0, 1.0, 0], z)
    x /= np.linalg.norm(x)
    rotation = np.column_stack([x, np.cross(z, x), z])
    return rotation, meet - rotation @ np.array([0, 0, 2000.0])


def compose(a, b):
    return a[0] @ b[0], a[0] @ b[1] + a[1]


@pytest.mark.slow
@pytest.mark.parametrize(("cameras", "seed"), [(2, 1), (3, 2)])
def test_calibrate_and_measure_rendered_arrays(cameras, seed):
    rng = np.random.default_rng(seed)
    truth = arc_rig(cameras)
    ids, position = board(rng)
    target = PointSet(id=ids.astype(np.int32), position_mm=position)
    run = vg.calibrate_frames(
        film(truth, ids, position, poses(rng, 8), rng),
        target,
        vg.CalibrationOptions(sigma_mm=0.01),
    )
    assert run.rms_px < 0.05  # dots of 8 px, contrast 175, noise 1: some 0.01 px each
    first, second = list(run.rig.cameras.values())[:2]
    true_baseline = np.linalg.norm(list(truth.cameras.values())[1].translation_mm)
    baseline = np.linalg.norm(second.translation_mm)
    sigma = np.linalg.norm([second.sigma[k] for k in ("tx", "ty", "tz")])
    assert abs(baseline - true_baseline) < 5 * sigma + 0.05

    # A short flight: 6 stages, small turns; the un-coded are numbered by us.
    step = Rotation.from_rotvec([0.02, -0.03, 0.05]).as_matrix()
    pose = (Rotation.from_rotvec([0.1, 0.2, 0]).as_matrix(), np.array([-40.0, -30, 1980]))
    motion = [pose]
    for _ in range(5):
        pose = (step @ pose[0], pose[1] + [12.0, 10, -6])
        motion.append(pose)
    frames = film(truth, ids, position, motion, rng)
    result = vg.measure_frames(vg.Rig.from_data(run.rig), frames, frame_rate_hz=100.0)

    table = result.trajectories
    measured = np.isfinite(table.position_mm[..., 0])
    # The uneven board is no surface: two cameras may leave a target between two
    # partners, which is named and never guessed.
    assert measured.mean() > (0.9 if cameras == 2 else 0.999)
    assert set(ids[ids < 517].tolist()) <= set(table.point_id.tolist())
    assert sorted(i for i in table.point_id.tolist() if i > 516) == list(range(517, 517 + LOOSE))

    identity = {}
    errors, predicted = [], []
    to_world = rig_world(truth)
    for s, pose in enumerate(motion):
        here = measured[s]
        number, found = table.point_id[here], table.position_mm[s, here]
        rotation, translation = compose(to_world, pose)
        true_points = position @ rotation.T + translation
        nearest = np.linalg.norm(found[:, None] - true_points[None], axis=2).argmin(axis=1)
        coded = number < 517
        np.testing.assert_array_equal(ids[nearest][coded], number[coded])
        for n, k in zip(number.tolist(), nearest.tolist(), strict=True):
            assert identity.setdefault(n, k) == k  # nobody changes places
        turn, shift, _ = fit_rigid(true_points[nearest], found)
        errors.append(found @ turn.T + shift - true_points[nearest])
        predicted.append(np.diagonal(matrix_from_cov6(table.cov_mm2[s, here]), axis1=1, axis2=2))
    normalised = np.concatenate(errors) / np.sqrt(np.concatenate(predicted))
    assert 0.5 < np.sqrt((normalised**2).mean()) < 1.6

    # Eq. (11) on the true centroid of the same points; speeds know no frame.
    columns = [identity[n] for n in result.motion.centroid_points.tolist()]
    centre = np.array([(position[columns] @ r.T + t).mean(axis=0) for r, t in motion])
    expected = np.linalg.norm(centre[2:] - centre[:-2], axis=1) * 100 / 2
    speed = np.linalg.norm(result.motion.centroid_velocity_mm_s[1:-1], axis=1)
    sigma = np.sqrt(result.motion.centroid_velocity_cov_mm2_s2[1:-1][:, [0, 3, 5]].sum(axis=1))
    # Five sigmas of the noise, and 1e-3 for the scale that the calibration leaves.
    np.testing.assert_array_less(np.abs(speed - expected), 5 * sigma + 1e-3 * expected)
