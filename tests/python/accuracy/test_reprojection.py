"""Re-projection statistics: each number is what its definition says."""

from __future__ import annotations

import numpy as np
import pytest
from two_pairs import falling, measurement_of

from videogrammetry.accuracy import (
    DEFINITIONS,
    ReprojectionStatistics,
    camera_statistics,
    measurement_reprojection,
    reprojection_statistics,
)


@pytest.mark.parametrize("seed", [1, 2])
def test_of_normal_residuals(seed):
    n, sigma = 20_000, 0.1
    residual = np.random.default_rng(seed).normal(0, sigma, (n, 2))
    s = reprojection_statistics(residual, redundancy=2 * n)
    # A coordinate's RMS of 2n values scatters by 1/sqrt(4n); distances are Rayleigh: mean
    # sqrt(pi/2), median sqrt(ln 4), 95 % within sqrt(-2 ln 0.05) sigmas; none scatters by
    # more than 2/sqrt(n) of itself.
    bound = 4 * 2 / np.sqrt(n)
    assert s.rms_coordinate_px == pytest.approx(sigma, rel=bound)
    assert s.rms_distance_px == pytest.approx(np.sqrt(2) * s.rms_coordinate_px)
    assert s.mean_distance_px == pytest.approx(sigma * np.sqrt(np.pi / 2), rel=bound)
    assert s.median_distance_px == pytest.approx(sigma * np.sqrt(np.log(4)), rel=bound)
    assert s.p95_distance_px == pytest.approx(sigma * np.sqrt(-2 * np.log(0.05)), rel=bound)
    assert s.max_distance_px == np.linalg.norm(residual, axis=1).max()
    assert s.sigma0_px == pytest.approx(s.rms_coordinate_px)


def test_every_number_is_defined():
    names = {n for n in ReprojectionStatistics.__dataclass_fields__ if n.endswith("_px")}
    assert set(DEFINITIONS) == names


def test_nothing_gives_nothing():
    s = reprojection_statistics(np.full((3, 2), np.nan))
    assert s.count == 0
    assert np.isnan([s.rms_coordinate_px, s.max_distance_px, s.sigma0_px]).all()
    with pytest.raises(ValueError, match=r"residual_px: expected \(N, 2\), got \(4,\)"):
        reprojection_statistics(np.zeros(4))


def test_cameras_share_the_redundancy():
    residual = np.array([[0.3, 0.4], [0.0, 0.0], [0.6, 0.8]])
    rows = camera_statistics(residual, np.array([0, 0, 1]), np.array([0.5, 0.5, 0.5]), ("a", "b"))
    assert [r.name for r in rows] == ["a", "b", "all"]
    assert [r.redundancy for r in rows] == [1.0, 0.5, 1.5]
    assert rows[1].sigma0_px == pytest.approx(1 / np.sqrt(0.5))


def test_of_a_measurement_two_rays_keep_a_quarter():
    scene = falling(1, stages=8)
    measurement = measurement_of(scene.table, np.random.default_rng(1))
    *cameras, everything = measurement_reprojection(measurement)
    sightings = int(scene.table.cameras_used.sum())
    assert [s.name for s in cameras] == ["cam1", "cam2", "cam3", "cam4"]
    assert everything.count == sightings == sum(s.count for s in cameras)
    # Two rays: four coordinates less three unknowns.
    assert everything.redundancy == pytest.approx(sightings / 2)
