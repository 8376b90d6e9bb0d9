"""The calibration's effect on points."""

from __future__ import annotations

import numpy as np

from videogrammetry.accuracy.calibration_part import covariance_factor


def test_held_parameters_have_no_effect():
    """Rounding in the row of a held A3 would be metres: its derivative is 1e19 mm per unit."""
    rng = np.random.default_rng(0)
    scale = np.geomspace(1e-9, 1.0, 16)
    root = rng.normal(size=(16, 9)) * scale[:, None]
    root[[4, 5, 11]] = 0.0
    factor = covariance_factor(root @ root.T)
    assert (factor[[4, 5, 11]] == 0).all()
    unit = np.outer(scale, scale)
    np.testing.assert_allclose(factor @ factor.T / unit, root @ root.T / unit, atol=1e-11)
