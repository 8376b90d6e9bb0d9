"""The calibration's effects on points: the covariance of triangulate, factored."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from two_pairs import PAIRS, falling, measure, measurement_of, two_pair_rig

from videogrammetry.accuracy import CalibrationPart, sighting_sigma_px
from videogrammetry.accuracy.calibration_part import covariance_factor
from videogrammetry.types import matrix_from_cov6


def correlated(rig, rng):
    """As calibrations leave it: nearly dependent radial terms, some parameters held."""
    sigma = {"A1": 2e-11, "A2": 5e-17, "A3": 2e-23, "tx": 0.01, "f": 0.03, "ry": 2e-6}
    names = rig.cov_names
    scale = np.array([sigma.get(n.split("/")[1], 0.0) for n in names])
    scale[[n.startswith("cam1/t") or n in ("cam2/A3", "cam4/A3") for n in names]] = 0
    mixed = np.eye(len(names)) + 0.3 * rng.normal(size=(len(names),) * 2)
    for camera in range(4):
        mixed[16 * camera + 4] = -mixed[16 * camera + 3] + 1e-3 * mixed[16 * camera + 4]
    factor = scale[:, None] * mixed
    return dataclasses.replace(rig, cov=factor @ factor.T)


# Parameters of sigma 0 have derivatives as well, of 1e20 for A3: rounding must not meet them.
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_it_is_the_covariance_of_triangulate(seed):
    rng = np.random.default_rng(seed)
    rig = correlated(two_pair_rig(rng), rng)
    position, used = rng.uniform(-1500, 1500, (1, 8, 3)), np.repeat(PAIRS, 4, axis=0)
    table = measure(rig, rig, position, used, None)
    effects = CalibrationPart(rig).effects(position[0], used)
    expected = matrix_from_cov6(table.cov_mm2 - table.cov_image_mm2)[0]
    # 1e-12 of rank is left out of correlations, 1e-6 of sigmas.
    found = effects @ np.swapaxes(effects, 1, 2)
    np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())


def test_a_factor_of_nothing_is_nothing():
    assert covariance_factor(np.zeros((4, 4))).shape == (4, 0)
    rig = dataclasses.replace(two_pair_rig(np.random.default_rng(1)), cov=None, cov_names=())
    part = CalibrationPart(rig)
    assert not part.known
    assert part.effects(np.zeros((5, 3)), np.ones((5, 4), bool)).shape == (5, 3, 0)


def test_weights_are_those_of_the_measurement():
    scene = falling(1, stages=5)
    measurement = measurement_of(scene.table, np.random.default_rng(1), sigma_px=0.03)
    rig = dataclasses.replace(scene.rig, sigma_floor_px={"cam2": 0.04})
    sigma = sighting_sigma_px(measurement, rig)
    used = scene.table.cameras_used
    assert sigma.shape == used.shape
    np.testing.assert_allclose(sigma[..., 0][used[..., 0]], 0.03)
    np.testing.assert_allclose(sigma[..., 1][used[..., 1]], 0.05)
