"""A coded target seen from both sides is none."""

from __future__ import annotations

import numpy as np
import pytest
from two_pairs import two_pair_rig

from videogrammetry.geometry import project
from videogrammetry.matching import TARGET_STATUS
from videogrammetry.pipeline.facing import check_facing
from videogrammetry.types import Matches, Targets


def one_target(camera, point, code, ratio):
    """The picture of a circle at ``point`` with the given ratio of its axes."""
    xy = project(camera, (point @ camera.rotation.T + camera.translation_mm)[None])
    return Targets(
        centre_px=xy,
        semi_axes_px=np.array([[5.0, 5.0 * ratio]]),
        angle_rad=np.zeros(1),
        id=np.array([code], dtype=np.int32),
        cov=np.tile(1e-4 * np.eye(5), (1, 1, 1)),
        edge_rms_px=np.full(1, 0.01),
        contrast=np.full(1, 1000.0),
        ring_status=np.zeros(1, dtype=np.uint8),
    )


def stage(codes, ratio=0.95):
    rig = two_pair_rig(np.random.default_rng(1))
    # The point in the middle of what the cameras see.
    point = np.mean([c.centre_mm for c in rig.cameras.values()], axis=0)
    targets = [
        one_target(camera, point, code, ratio)
        for camera, code in zip(rig.cameras.values(), codes, strict=True)
    ]
    return rig, targets


def match(used, code):
    target = np.where(np.array([used]), 0, -1).astype(np.int32)
    return Matches(
        target=target,
        id=np.array([code], dtype=np.int32),
        chi2=np.ones(1),
        log_odds=np.full(1, 9.0),
        status=tuple(np.zeros(1, dtype=np.uint8) for _ in used),
    )


@pytest.mark.parametrize("used", [[1, 1, 0, 0], [0, 0, 1, 1]])
def test_a_pair_on_one_side_stays(used):
    rig, targets = stage([7, 7, 7, 7])
    matches = match(used, 7)
    assert check_facing(rig, targets, [t.unique_id for t in targets], matches) is matches


def test_the_other_side_is_taken_away_and_its_code_with_it():
    rig, targets = stage([-1, -1, -1, 7])
    left = check_facing(rig, targets, [t.unique_id for t in targets], match([1, 1, 0, 1], 7))
    assert left.target.tolist() == [[0, 0, -1, -1]]
    assert left.id.tolist() == [-1]
    assert TARGET_STATUS[left.status[3][0]] == "no partner"


def test_two_opposite_cameras_have_no_point():
    rig, targets = stage([7, -1, 7, -1])
    left = check_facing(rig, targets, [t.unique_id for t in targets], match([1, 0, 1, 0], 7))
    assert len(left) == 0


def test_what_has_no_code_may_be_a_ball():
    rig, targets = stage([-1, -1, -1, -1], ratio=1.0)
    matches = match([1, 1, 1, 1], -1)
    assert check_facing(rig, targets, [t.unique_id for t in targets], matches) is matches
