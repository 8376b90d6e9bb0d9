"""Particles in a tank: rays through a window have no epipolar lines, and yet find each other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from tanks import pictures, tank_cameras, without_window

from videogrammetry.matching import match_stage
from videogrammetry.types import FloatArray, IntArray, RigCamera, RigData, Targets

SIGMA_PX = 0.05


def targets(xy_px: FloatArray) -> Targets:
    n = len(xy_px)
    cov = np.zeros((n, 5, 5))
    cov[:, [0, 1], [0, 1]] = SIGMA_PX**2
    cov[:, [2, 3, 4], [2, 3, 4]] = 1e-4
    return Targets(
        centre_px=xy_px, semi_axes_px=np.full((n, 2), 4.0), angle_rad=np.zeros(n), cov=cov,
        id=np.full(n, -1, np.int32), contrast=np.full(n, 100.0),
        edge_rms_px=np.full(n, 0.1), ring_status=np.zeros(n, np.uint8),
    )  # fmt: skip


def matched(cameras: dict[str, RigCamera], seed: int = 1) -> tuple[IntArray, IntArray]:
    """Matches (P, 4) as particles' numbers, of 60 particles that the tank's cameras see."""
    rng = np.random.default_rng(seed)
    points = rng.uniform([-50, -40, -60], [50, 40, 0], (60, 3))
    order = [rng.permutation(len(points)) for _ in cameras]
    seen = pictures(tank_cameras(), points)
    found = match_stage(
        RigData(cameras=cameras),
        [
            targets((xy + rng.normal(0, SIGMA_PX, xy.shape))[o])
            for xy, o in zip(seen.values(), order, strict=True)
        ],
    )
    number = np.stack(
        [np.where(t >= 0, o[t], -1) for t, o in zip(found.target.T, order, strict=True)], axis=1
    )
    return number, found.target


def test_particles_are_matched_through_the_window() -> None:
    number, _ = matched(tank_cameras())
    whole = (number >= 0).all(axis=1)
    right = (number == number[:, :1]).all(axis=1)
    # A ray's miss is 5 px at random among 60 in a picture of 600 px: with four rays
    # nearly none passes by chance at 0.05 px.
    assert (whole & right).sum() >= 58
    assert not (whole & ~right).any()


def test_without_the_window_they_are_not() -> None:
    number, _ = matched(without_window(tank_cameras()))
    assert ((number >= 0).all(axis=1) & (number == number[:, :1]).all(axis=1)).sum() < 10


def test_a_camera_in_the_fluid_is_matched_too() -> None:
    """The gate of a pair holds where only one of its two rays is refracted."""
    cameras = tank_cameras()
    air = {n: replace(c, interface=None) if n == "c0" else c for n, c in cameras.items()}
    rng = np.random.default_rng(2)
    points = rng.uniform([-50, -40, -60], [50, 40, 0], (20, 3))
    seen = pictures(air, points)
    found = match_stage(RigData(cameras=air), [targets(xy) for xy in seen.values()])
    assert len(found) == 20
    assert (found.target == found.target[:, :1]).all()
