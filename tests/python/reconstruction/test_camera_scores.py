"""Scores of the cameras' poses against the same written out with whole matrices."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from moving_camera import body, intersected, pictures, residuals_of, ring_rig

from videogrammetry.geometry import project_from_world_with_jacobians
from videogrammetry.reconstruction import Triangulator
from videogrammetry.reconstruction.camera_scores import (
    calibration_factor,
    camera_scores,
    pose_of_motion,
)


def scene(known):
    """Two looks of nine points, some not seen by all of three cameras."""
    rng = np.random.default_rng(4)
    rig = ring_rig(3, rng)
    xy = pictures(rig, body(rng, 9, 2).reshape(-1, 3), rng)
    xy[[2, 11], [0, 2]] = np.nan
    place, residual = intersected(Triangulator(rig), xy)
    residuals = dataclasses.replace(
        residuals_of(place, residual, 2),
        variance_px2=rng.uniform(1e-4, 9e-4, residual.shape),
        systematic=rng.uniform(0, 1, residual.shape[:2]),
    )
    if known:
        root = 0.05 * rng.normal(size=(len(place), 3, 3))
        residuals = dataclasses.replace(residuals, cov_mm2=root @ np.swapaxes(root, 1, 2))
    return rig, residuals


def whole(rig, residuals, look):
    """N, g, B'W P A F and r'W P r with P and W of all pictures of a look."""
    cameras = list(rig.cameras.values())
    rows = np.flatnonzero(residuals.look == look)
    size = len(rows) * len(cameras) * 2
    j, a = np.zeros((size, 3 * len(rows))), np.zeros((size, 16 * len(cameras)))
    cov, r = np.eye(size), np.zeros(size)
    seen = np.zeros(size, bool)
    for i, p in enumerate(rows):
        for c, camera in enumerate(cameras):
            at = slice(2 * (i * len(cameras) + c), 2 * (i * len(cameras) + c) + 2)
            if np.isnan(residuals.residual_px[p, c, 0]):
                continue
            _, by_point, by_camera = project_from_world_with_jacobians(
                camera, residuals.position_mm[p : p + 1]
            )
            j[at, 3 * i : 3 * i + 3], a[at, 16 * c : 16 * c + 16] = by_point[0], by_camera[0]
            cov[at, at] = np.diag(residuals.variance_px2[p, c])
            if residuals.cov_mm2 is not None:
                cov[at, at] += by_point[0] @ residuals.cov_mm2[p] @ by_point[0].T
            r[at], seen[at] = residuals.residual_px[p, c], True
    b = np.zeros((size, 6 * len(cameras)))
    for c, camera in enumerate(cameras):
        b[:, 6 * c : 6 * c + 6] = a[:, 16 * c + 10 : 16 * c + 16] @ pose_of_motion(camera)
    w = np.linalg.inv(cov) * seen
    wp = w
    if residuals.cov_mm2 is None:
        wp = w - w @ j @ np.linalg.solve(j.T @ w @ j, j.T @ w)
    return b.T @ wp @ b, b.T @ wp @ r, b.T @ wp @ a @ calibration_factor(rig), r @ wp @ r


@pytest.mark.parametrize("known", [False, True])
def test_sums_point_by_point_are_those_of_whole_matrices(known) -> None:
    rig, residuals = scene(known)
    scores = camera_scores(rig, residuals, 2, calibration_factor(rig))
    for look in range(2):
        for found, expected in zip(
            (scores.normal, scores.score, scores.by_calibration), whole(rig, residuals, look)[:3],
            strict=True,
        ):  # fmt: skip
            # Numbers of one row differ by 1e3 in their units; rounding by 1e-16 times 1e4 or so.
            scale = np.abs(expected).max()
            np.testing.assert_allclose(found[look], expected, rtol=1e-9, atol=1e-11 * scale)
        chi2 = whole(rig, residuals, look)[3]
        total = scores.chi2[look].sum() if known else scores.chi2[look, 0]
        assert total == pytest.approx(chi2, rel=1e-9)
    seen = np.isfinite(residuals.residual_px[..., 0]).reshape(2, 9, 3)
    np.testing.assert_array_equal(scores.points, seen.sum(axis=1))
    share = np.where(seen, residuals.systematic.reshape(2, 9, 3), 0).sum(axis=1)
    np.testing.assert_allclose(scores.systematic, share / scores.points)


def test_looks_in_any_order_and_looks_without_points() -> None:
    rig, residuals = scene(known=False)
    factor = calibration_factor(rig)
    expected = camera_scores(rig, residuals, 2, factor)
    mixed = residuals.select(np.random.default_rng(0).permutation(len(residuals)))
    mixed = dataclasses.replace(mixed, look=2 * mixed.look + 1)
    found = camera_scores(rig, mixed, 5, factor)
    for name in ("score", "normal", "by_calibration", "chi2", "redundancy", "points"):
        values, of = getattr(found, name), getattr(expected, name)
        np.testing.assert_allclose(values[[1, 3]], of, rtol=1e-9, atol=1e-11 * np.abs(of).max())
        assert not values[[0, 2, 4]].any()
