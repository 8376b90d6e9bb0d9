"""Relative orientation against truth and against OpenCV."""

from __future__ import annotations

import numpy as np
import pytest

from videogrammetry.adjustment import relative_orientation
from videogrammetry.geometry import (
    camera_model,
    project,
    rays_through_pixels,
    rotation_from_vector,
)
from videogrammetry.types import RigCamera

SEEDS = range(1, 9)
NOISE_PX = 0.1


def camera(f_px=1800.0, distorted=True):
    interior = np.r_[f_px, np.zeros(9)]
    if distorted:
        interior[1:5] = 12.0, -7.0, -3e-8, 2e-15
    return RigCamera(
        image_size_px=(1920, 1200), interior=interior, r0_px=700.0,
        rotation=np.eye(3), translation_mm=np.zeros(3),
    )  # fmt: skip


def scene(seed, count=60, plane=False, baseline=1.0, noise_px=NOISE_PX, wrong=0.0, cams=None):
    """Two pictures of points at 5 units; b_from_a of unit baseline times ``baseline``."""
    rng = np.random.default_rng(seed)
    a, b = cams or (camera(), camera(2100.0))
    points = rng.uniform(-1, 1, (count, 3)) * [1.6, 1.0, 0.0 if plane else 0.8]
    points = points @ rotation_from_vector(rng.normal(0, 0.3, 3)).T + [0, 0, 5]
    turn = rotation_from_vector([0.05, 0.2 * baseline, 0.3])
    shift = rng.normal(0, 0.3, 3) + np.array([-1.0, 0, 0.1])
    shift *= baseline / max(np.linalg.norm(shift), 1e-12)
    pixels = []
    for cam, in_cam in ((a, points), (b, points @ turn.T + shift)):
        pixels.append(project(cam, in_cam) + rng.normal(0, noise_px, (count, 2)))
    bad = rng.random(count) < wrong
    pixels[1][bad] = rng.uniform(0, 1200, (int(bad.sum()), 2))
    return (a, b), pixels, turn, shift, bad


def oriented(cams, pixels, **kwargs):
    return relative_orientation(
        camera_model(cams[0]), pixels[0], camera_model(cams[1]), pixels[1], **kwargs
    )


def errors_rad(candidate, turn, shift):
    """Angles of the rotation's and the baseline's error."""
    cosine = (np.trace(candidate.rotation @ turn.T) - 1) / 2
    along = candidate.translation @ shift / np.linalg.norm(shift)
    return np.arccos(np.clip(cosine, -1, 1)), np.arccos(np.clip(along, -1, 1))


def predicted_rad(cams, points_ab, turn, shift):
    """Standard deviations of rotation and direction: NOISE^2 (J'J)^-1, J by differences.

    J is of the epipolar distances (written here anew) by a small turn of b and by
    moves of the unit baseline, at the true motion and the exact rays.
    """
    a, b = points_ab

    def distances(x):
        rotation = rotation_from_vector(x[:3]) @ turn
        t = shift / np.linalg.norm(shift)
        u = np.cross(t, [0.3, 0.5, 0.7])
        u /= np.linalg.norm(u)
        t = t + x[3] * u + x[4] * np.cross(t, u)
        lines = np.cross(t, a @ rotation.T)
        back = np.cross(b, t) @ rotation
        f = [cam.interior[0] for cam in cams]
        size = np.hypot(
            np.linalg.norm(lines[:, :2], axis=1) / f[1], np.linalg.norm(back[:, :2], axis=1) / f[0]
        )
        return np.sum(b * lines, axis=1) / size

    step = 1e-6
    j = np.stack([(distances(step * e) - distances(-step * e)) / (2 * step) for e in np.eye(5)], 1)
    cov = NOISE_PX**2 * np.linalg.inv(j.T @ j)
    return np.sqrt(np.trace(cov[:3, :3])), np.sqrt(np.trace(cov[3:, 3:]))


def bounds_rad(cams, pixels, turn, shift, good):
    """Five standard deviations of each (the norm of three errors exceeds its root mean
    square five times with less than 1e-5); rays of the noisy pictures move the
    derivatives by a part in a thousand only."""
    rays = [np.c_[rays_through_pixels(c, p[good])] for c, p in zip(cams, pixels, strict=True)]
    return 5 * np.array(predicted_rad(cams, rays, turn, shift))


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("wrong", [0.0, 0.3])
def test_finds_the_truth(seed, wrong):
    cams, pixels, turn, shift, bad = scene(seed, wrong=wrong)
    found = oriented(cams, pixels)
    assert found.has_baseline
    best = found.candidates[0]
    rotation, direction = errors_rad(best, turn, shift)
    bounds = bounds_rad(cams, pixels, turn, shift, ~bad)
    # A wrong pair that chance puts within the gate of four sigmas of its line pulls by
    # up to four times what a right one may, in the direction that few pairs hold.
    bounds *= 3 if wrong else 1
    assert rotation < bounds[0], seed
    assert direction < bounds[1], seed
    assert best.inlier[~bad].all(), seed
    # A wrong pair lies within 2 px of an epipolar line by chance only: 4 px of 1200.
    assert best.inlier[bad].sum() <= 3, seed
    # Baseline 1 at a distance of 5, more or less across: 0.2 rad at most.
    assert 0.1 < best.convergence_rad < 0.22


def test_exact_pictures_give_exact_motion():
    cams, pixels, turn, shift, _ = scene(3, noise_px=0.0)
    rotation, direction = errors_rad(oriented(cams, pixels).candidates[0], turn, shift)
    # arccos near 1 turns rounding of 1e-16 into 1e-8; the distortion is inverted to 1e-10 px.
    assert rotation < 1e-7
    assert direction < 1e-7


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("wrong", [0.0, 0.3])
def test_a_plane_has_the_truth_among_its_candidates(seed, wrong):
    cams, pixels, turn, shift, bad = scene(seed, plane=True, wrong=wrong)
    found = oriented(cams, pixels)
    assert found.candidates, seed
    all_errors = [errors_rad(c, turn, shift) for c in found.candidates]
    rotation, direction = min(all_errors)
    bounds = bounds_rad(cams, pixels, turn, shift, ~bad)
    assert rotation < bounds[0], seed
    assert direction < bounds[1], seed


def test_planes_often_have_two_motions():
    """Both see the points in front for most planes; the other one is no copy of the first."""
    two = []
    for seed in range(1, 21):
        cams, pixels, _, _, _ = scene(seed, plane=True)
        candidates = oriented(cams, pixels).candidates
        if len(candidates) == 2:
            two.append(seed)
            first, second = candidates
            rotation, direction = errors_rad(second, first.rotation, first.translation)
            assert max(rotation, direction) > 0.01, seed
            assert second.cost_px2 < 4 * first.cost_px2 + 0.02, seed
    assert len(two) >= 5, two


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("wrong", [0.0, 0.3])
def test_a_pure_rotation_has_no_baseline(seed, wrong):
    cams, pixels, turn, _, _ = scene(seed, baseline=0.0, wrong=wrong)
    found = oriented(cams, pixels)
    assert not found.has_baseline, (seed, found.parallax)
    assert not found.candidates
    cosine = (np.trace(found.rotation @ turn.T) - 1) / 2
    # A turn is as sure as a direction, NOISE / f, over sqrt(N / 2), about the axis of
    # sight worse by the field's half width, 0.3 rad; of the best by medians only: five.
    assert np.arccos(np.clip(cosine, -1, 1)) < 5 * NOISE_PX / 1800 / 0.3 / np.sqrt(20), seed


def test_too_few_pairs_give_nothing():
    cams, pixels, _, _, _ = scene(1, count=5)
    assert not oriented(cams, pixels).candidates


def test_unequal_counts_are_refused():
    cams, pixels, _, _, _ = scene(1)
    with pytest.raises(ValueError, match="60 pixels of a but 59 of b"):
        oriented(cams, (pixels[0], pixels[1][:-1]))


def test_the_same_seed_gives_the_same_bits():
    cams, pixels, _, _, _ = scene(2, wrong=0.3)
    first, second = (oriented(cams, pixels).candidates[0] for _ in range(2))
    assert (first.rotation == second.rotation).all()


@pytest.mark.peer
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("plane", [False, True])
def test_as_sure_as_opencv(seed, plane):
    """findEssentialMat and recoverPose on the same pinhole pictures: both near the truth."""
    cv2 = pytest.importorskip("cv2")
    pinhole = camera(distorted=False)
    cams, pixels, turn, shift, bad = scene(
        seed, count=100, plane=plane, wrong=0.2, cams=(pinhole, pinhole)
    )
    matrix = np.array([[1800.0, 0, 959.5], [0, 1800, 599.5], [0, 0, 1]])
    essential, mask = cv2.findEssentialMat(*pixels, matrix, cv2.USAC_ACCURATE, 0.9999, 2.0)
    _, rotation, direction, _ = cv2.recoverPose(essential[:3], *pixels, matrix, mask=mask)
    cosine = (np.trace(rotation @ turn.T) - 1) / 2
    theirs = np.arccos(np.clip(cosine, -1, 1))
    ours = min(errors_rad(c, turn, shift)[0] for c in oriented(cams, pixels).candidates)
    bounds = bounds_rad(cams, pixels, turn, shift, ~bad)
    assert ours < bounds[0], (seed, ours, theirs)
    if not plane:  # of a plane OpenCV gives one motion, the true or the other one
        assert theirs < 3 * bounds[0], (seed, ours, theirs)
        # Theirs is of fewer points: ours is no worse than both errors' spread allows.
        assert ours < theirs + bounds[0], (seed, ours, theirs)
