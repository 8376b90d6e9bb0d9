"""Start values that are wrong: recognised, said, and without effect on the result."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from network_fakes import SIGMA_PX, Simulated, simulate

from videogrammetry.calibration.network_adjustment import adjust_network
from videogrammetry.calibration.network_input import NetworkInput
from videogrammetry.calibration.network_start import start_network
from videogrammetry.geometry import rotation_from_vector


def with_poses(
    simulated: Simulated, turn_rad: float, seed: int = 0, only: int | None = None
) -> NetworkInput:
    """True poses, those of all pictures (or the first ``only``) turned about random axes."""
    rng = np.random.default_rng(seed)
    images = []
    for i, image in enumerate(simulated.network.images):
        axis = rng.normal(size=3)
        turn = rotation_from_vector(turn_rad * axis / np.linalg.norm(axis))
        rotation = simulated.rotation[i]
        images.append(
            dataclasses.replace(
                image,
                rotation=turn @ rotation if only is None or i < only else rotation,
                translation_mm=simulated.translation_mm[i],
            )
        )
    return dataclasses.replace(simulated.network, images=tuple(images))


def with_f(network: NetworkInput, f_px: float) -> NetworkInput:
    interior = np.zeros(10)
    interior[0] = f_px
    camera = dataclasses.replace(network.cameras[0], interior=interior)
    return dataclasses.replace(network, cameras=(camera,))


@pytest.mark.parametrize("kind", ["fixed", "free"])
@pytest.mark.parametrize("f_px", [1400.0, 2600.0])
def test_poses_45_degrees_off_and_f_30_per_cent(kind: str, f_px: float) -> None:
    """The same minimum as from no start at all, to the convergence of the adjustment."""
    simulated = simulate(1, kind=kind, bars=2)
    good = adjust_network(simulated.network)
    bad = adjust_network(with_f(with_poses(simulated, np.radians(45.0)), f_px))
    assert any(f"px fits, {f_px:.0f} px was given" in w for w in bad.warnings)
    assert len(bad.images) == 10
    assert bad.cameras[0].values["f"] == pytest.approx(
        good.cameras[0].values["f"], abs=0.01 * good.cameras[0].sigma["f"]
    )
    assert bad.summary.sigma0 == pytest.approx(good.summary.sigma0, rel=1e-6)
    moved = np.abs(bad.points.position_mm - good.points.position_mm)
    assert (moved <= 0.01 * good.points.sigma_mm + 1e-9).all()


@pytest.mark.parametrize("kind", ["fixed", "free"])
def test_poses_of_other_pictures(kind: str) -> None:
    """Poses that no adjustment mends are found anew, and that is said.

    Where all points are free, a robust adjustment gets from nearly anywhere to the
    minimum: nothing needs to be said then.
    """
    simulated = simulate(1, kind=kind, bars=2)
    turned = with_poses(simulated, np.radians(150.0)).images
    images = [
        dataclasses.replace(image, rotation=turned[-1 - i].rotation, translation_mm=1e-3
                            * turned[-1 - i].translation_mm)
        for i, image in enumerate(turned)
    ]  # fmt: skip
    result = adjust_network(dataclasses.replace(simulated.network, images=tuple(images)))
    assert kind == "free" or any("10 given poses do not fit" in w for w in result.warnings)
    assert result.summary.sigma0 == pytest.approx(
        adjust_network(simulated.network).summary.sigma0, rel=1e-6
    )


def test_good_poses_are_kept() -> None:
    """Rough ones (two degrees) lead to the right place; their frame is kept without a doubt."""
    simulated = simulate(1, kind="free", bars=2)
    tables = dataclasses.replace(
        with_poses(simulated, np.radians(2.0)),
        points=dataclasses.replace(simulated.network.points, position_mm=np.full((30, 3), np.nan)),
    )
    start = start_network(tables)
    assert not any("given poses" in doubt for doubt in start.report.doubts)
    moved = np.linalg.norm(start.network.points.position_mm - simulated.position_mm, axis=1)
    # Two degrees of a metre are 35 mm; a frame of the first picture would be metres away.
    assert np.median(moved) < 100
    assert start.report.rms_px < 10 * SIGMA_PX


def test_a_few_wrong_poses_among_good_ones() -> None:
    simulated = simulate(1, kind="free", bars=2)
    result = adjust_network(with_poses(simulated, np.radians(45.0), only=2))
    assert len(result.images) == 10
    assert result.summary.sigma0 == pytest.approx(
        adjust_network(simulated.network).summary.sigma0, rel=1e-6
    )
