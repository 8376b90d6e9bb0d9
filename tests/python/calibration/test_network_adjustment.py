"""adjust_network: against truth, against its own covariance, and against bad input."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from network_fakes import (
    FIXED,
    INTERIOR,
    SIGMA_PX,
    Simulated,
    change,
    move_observation,
    simulate,
)
from scipy import stats

from videogrammetry.calibration.network_adjustment import adjust_network
from videogrammetry.calibration.network_input import NetworkInput
from videogrammetry.calibration.network_result import NetworkAdjustment
from videogrammetry.errors import CalibrationError

SEEDS = range(1, 9)
#: A level of one in a million keeps eight draws of some tests from failing by chance.
LEVEL = 1e-6


@pytest.fixture(scope="module")
def fixed() -> tuple[Simulated, NetworkAdjustment]:
    simulated = simulate(1)
    return simulated, adjust_network(simulated.network)


def with_observations(network: NetworkInput, **fields: object) -> NetworkInput:
    return dataclasses.replace(
        network, observations=dataclasses.replace(network.observations, **fields)
    )


def test_counts_and_sigma0(fixed: tuple[Simulated, NetworkAdjustment]) -> None:
    """Redundancy by hand; sigma0 of r degrees of freedom scatters by sqrt(1 / 2r)."""
    simulated, result = fixed
    s = result.summary
    m = 2 * len(simulated.network.observations)
    unknowns = 7 + 6 * 10 + 3 * 26
    assert (s.observations, s.unknowns, s.redundancy) == (m, unknowns, m - unknowns)
    assert abs(s.sigma0 - 1) < 5 * np.sqrt(0.5 / s.redundancy)
    assert s.sigma0_px == pytest.approx(s.sigma0 * SIGMA_PX)
    # The lens changes the weights by a few per cent towards the corners.
    assert s.rms_px == pytest.approx(s.sigma0_px * np.sqrt(s.redundancy / m), rel=0.03)
    assert (result.rejected, s.datum, s.converged) == ((), "fixed", True)


def test_camera(fixed: tuple[Simulated, NetworkAdjustment]) -> None:
    """Every estimated parameter within five of its standard deviations; held ones held."""
    camera = fixed[1].cameras[0]
    names = ("f", "x0", "y0", "A1", "A2", "A3", "B1", "B2", "E1", "E2")
    for name, truth in zip(names, INTERIOR, strict=True):
        if name in camera.free:
            assert abs(camera.values[name] - truth) < 5 * camera.sigma[name], name
            assert 0 < camera.sigma[name] < np.inf
        else:
            assert (camera.values[name], camera.sigma[name]) == (0.0, 0.0), name
    np.testing.assert_allclose(np.diag(camera.correlation), 1.0)
    assert camera.significance["A1"] == pytest.approx(abs(camera.values["A1"]) / camera.sigma["A1"])


def test_points_agree_with_their_covariance() -> None:
    """The full covariance's chi-square over eight draws: 26 free points, 78 coordinates each."""
    total, count = 0.0, 0
    for seed in SEEDS:
        simulated = simulate(seed)
        points = adjust_network(simulated.network).points
        free = points.kind == "free"
        rows = (3 * np.flatnonzero(free)[:, None] + np.arange(3)).ravel()
        error = (points.position_mm - simulated.position_mm).ravel()[rows]
        assert points.full_cov_mm2 is not None
        total += error @ np.linalg.solve(points.full_cov_mm2[np.ix_(rows, rows)], error)
        count += len(rows)
        np.testing.assert_allclose(
            points.cov_mm2[5], points.full_cov_mm2[15:18, 15:18], rtol=1e-6, atol=1e-12
        )
        assert (points.sigma_mm[:FIXED] == 0).all()
    low, high = stats.chi2.ppf([LEVEL, 1 - LEVEL], count)
    assert low < total < high, f"seeds {SEEDS}: {total} of {count}"


def test_poses_agree_with_their_covariance() -> None:
    """Poses and projection centres against truth: six and three degrees of freedom each."""
    totals, count = np.zeros(2), 0
    for seed in SEEDS:
        simulated = simulate(seed)
        images = adjust_network(simulated.network).images
        for i in range(len(images)):
            turn = images.rotation[i] @ simulated.rotation[i].T
            error = np.append(
                [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]],
                2 * (images.translation_mm[i] - simulated.translation_mm[i]),
            )
            totals[0] += 0.25 * error @ np.linalg.solve(images.cov[i], error)
            centre = -simulated.rotation[i].T @ simulated.translation_mm[i]
            error = images.centre_mm[i] - centre
            totals[1] += error @ np.linalg.solve(images.cov_centre_mm2[i], error)
            count += 1
    # Pictures of one draw share the camera's error, so that the sums scatter like
    # those of an eighth of the independent terms at worst.
    for total, freedom in zip(totals, (6, 3), strict=True):
        expected = freedom * count
        assert abs(total - expected) < 5 * np.sqrt(2 * expected * 10), (total, expected)


def test_weighted_points_move_by_their_sigma() -> None:
    """Four points of 0.05 mm: residuals of the prior are no larger, all are better than it."""
    simulated = simulate(2, kind="weighted")
    result = adjust_network(simulated.network)
    assert result.summary.observations == 2 * len(simulated.network.observations) + 12
    moved = result.points.position_mm[:FIXED] - simulated.network.points.position_mm[:FIXED]
    assert 0 < np.abs(moved).max() < 5 * 0.05
    assert (result.points.sigma_mm[:FIXED] < 1.2 * 0.05).all()


def test_a_free_network_keeps_lengths() -> None:
    """Inner constraints and a scale bar: lengths within five of their standard deviations."""
    simulated = simulate(3, kind="free", bars=3)
    result = adjust_network(simulated.network)
    unknowns = 7 + 6 * 10 + 3 * 30
    assert result.summary.redundancy == result.summary.observations - unknowns + 6
    points = result.points
    assert points.full_cov_mm2 is not None
    rng = np.random.default_rng(0)
    for a, b in rng.choice(30, (40, 2)):
        if a == b:
            continue
        d = points.position_mm[a] - points.position_mm[b]
        truth = np.linalg.norm(simulated.position_mm[a] - simulated.position_mm[b])
        by = np.zeros((30, 3))
        by[a], by[b] = d / np.linalg.norm(d), -d / np.linalg.norm(d)
        sigma = np.sqrt(by.ravel() @ points.full_cov_mm2 @ by.ravel())
        assert abs(np.linalg.norm(d) - truth) < 5 * sigma
    # The frame is that of the start values.
    shift = (points.position_mm - simulated.network.points.position_mm).mean(axis=0)
    np.testing.assert_allclose(shift, 0, atol=1e-6)
    assert result.scale_bars.used.all()
    assert (np.abs(result.scale_bars.residual_mm) < 5 * 0.01).all()


def test_a_free_network_without_scale() -> None:
    result = adjust_network(simulate(3, kind="free").network)
    assert result.summary.redundancy == result.summary.observations - (7 + 60 + 90) + 7
    assert any("gives the scale" in warning for warning in result.warnings)


def test_gross_errors_are_found_and_named() -> None:
    """Five errors of 15 sigma: found, named, and no more than the level's share beside them."""
    simulated = simulate(4)
    network = dataclasses.replace(simulated.network, critical_value=3.29)
    rows = [3, 60, 110, 160, 220]
    for row in rows:
        network = move_observation(network, row, (15 * SIGMA_PX, 0))
    result = adjust_network(network)
    found = {(r.image, r.point) for r in result.rejected if r.kind == "observation"}
    seen = network.observations
    wanted = {
        (network.images[seen.image[row]].name, network.points.name[seen.point[row]]) for row in rows
    }
    assert wanted <= found
    # 1 in 1000 per coordinate; Poisson's upper bound at the level.
    assert len(found - wanted) <= stats.poisson.ppf(1 - LEVEL, 2e-3 * len(seen))
    assert all(r.value > 3.29 for r in result.rejected if (r.image, r.point) in wanted)
    assert not result.observations.used[rows].any()


@pytest.mark.parametrize("factor", [0.1, 10.0])
def test_a_wrong_sigma_is_said_and_costs_nothing(factor: float) -> None:
    """The tests take the noise that the residuals show, whatever was stated."""
    simulated = simulate(5)
    network = dataclasses.replace(simulated.network, critical_value=3.29)
    network = move_observation(network, 40, (1.0, 1.0))
    wrong = dataclasses.replace(
        with_observations(network, cov_px2=factor**2 * network.observations.cov_px2),
        sigma_px=factor * SIGMA_PX,
    )
    good, bad = adjust_network(network), adjust_network(wrong)
    assert not bad.observations.used[40]
    assert (~bad.observations.used).sum() <= (~good.observations.used).sum() + 2
    assert bad.summary.sigma0_px == pytest.approx(good.summary.sigma0_px, rel=0.01)
    np.testing.assert_allclose(bad.points.sigma_mm, good.points.sigma_mm, rtol=0.02, atol=1e-9)
    assert any("was stated" in warning for warning in bad.warnings)
    assert not any("was stated" in warning for warning in good.warnings)


def test_reliability(fixed: tuple[Simulated, NetworkAdjustment]) -> None:
    """Redundancy numbers sum to the redundancy; an error of the size stated is found in 80 %."""
    simulated, result = fixed
    table, s = result.observations, result.summary
    assert table.redundancy.sum() == pytest.approx(s.redundancy, rel=1e-6)
    delta0 = 3.29 + 0.8416
    np.testing.assert_allclose(
        table.detectable_px,
        delta0 * s.sigma0 * table.sigma_px / np.sqrt(table.redundancy),
        rtol=1e-4,
    )
    np.testing.assert_allclose(
        table.external, delta0 * np.sqrt((1 - table.redundancy) / table.redundancy), rtol=1e-4
    )
    # w answers to an error e in its own observation by e sqrt(r) / sigma.
    row = 33
    moved = adjust_network(
        move_observation(simulated.network, row, (float(table.detectable_px[row, 0]), 0))
    )
    w = moved.observations.normalised[row, 0] * moved.summary.sigma0
    before = table.normalised[row, 0] * s.sigma0
    assert w - before == pytest.approx(delta0 * s.sigma0, rel=0.01)


def test_all_ten_are_offered_and_only_the_significant_kept() -> None:
    """The simulated lens has A1, A2, B1, B2: others stay by chance alone (2.58: one in 100)."""
    kept: list[str] = []
    for seed in SEEDS:
        camera = adjust_network(simulate(seed, free=None).network).cameras[0]
        assert {"f", "x0", "y0", "A1"} <= set(camera.free)
        kept += [name for name in camera.free if name in ("A3", "E1", "E2")]
        named = {d.name for d in camera.dropped}
        assert named | set(camera.free) == {
            *("f", "x0", "y0", "A1", "A2", "A3", "B1", "B2", "E1", "E2")
        }
    assert len(kept) <= stats.binom.ppf(1 - LEVEL, 3 * len(SEEDS), 0.02)


def test_aspect() -> None:
    free = ("f", "x0", "y0", "A1", "A2", "B1", "B2", "aspect")
    result = adjust_network(simulate(6, free=free, aspect=4e-4).network)
    camera = result.cameras[0]
    assert abs(camera.values["aspect"] - 4e-4) < 5 * camera.sigma["aspect"]
    assert camera.sigma["aspect"] < 4e-5
    assert camera.significance["aspect"] > 5


def test_an_observed_focal_length() -> None:
    """f stated to 0.01 px stays there, and counts as an observation."""
    simulated = simulate(1)
    camera = dataclasses.replace(
        simulated.network.cameras[0],
        interior=INTERIOR * (np.arange(10) == 0),
        sigma={"f": 0.01},
    )
    result = adjust_network(change(simulated, cameras=(camera,)))
    assert result.summary.observations == 2 * len(simulated.network.observations) + 1
    assert abs(result.cameras[0].values["f"] - 2000.0) < 0.05
    assert result.cameras[0].sigma["f"] < 0.015


# Bad input: refused, or solved with a warning, the cause named.


def test_a_lonely_point_is_left_out() -> None:
    simulated = simulate(1)
    seen = simulated.network.observations
    keep = (seen.point != 20) | (seen.image == 0)
    network = with_observations(
        simulated.network,
        **{f: getattr(seen, f)[keep] for f in ("image", "point", "xy_px", "cov_px2")},
    )
    result = adjust_network(network)
    assert [(r.kind, r.point, r.test) for r in result.rejected] == [("point", "T20", "rays")]
    assert "T20" not in result.points.name


def test_disconnected_pictures_are_named() -> None:
    """Two halves without a common point: the larger is adjusted, the other named."""
    simulated = simulate(1, kind="free")
    seen = simulated.network.observations
    half = np.where(seen.image < 6, seen.point < 15, seen.point >= 15)
    network = with_observations(
        simulated.network,
        **{f: getattr(seen, f)[half] for f in ("image", "point", "xy_px", "cov_px2")},
    )
    result = adjust_network(network)
    assert result.images.name == tuple(f"p{i:02d}" for i in range(6))
    assert any("2 groups without a common point" in w and "p06" in w for w in result.warnings)
    assert {r.image for r in result.rejected if r.kind == "image"} == {"p06", "p07", "p08", "p09"}


def test_one_picture_of_unknown_points() -> None:
    with pytest.raises(CalibrationError, match="one picture alone"):
        adjust_network(simulate(1, kind="free", count=1).network)


def test_one_picture_of_known_points() -> None:
    """A resection: six unknowns, of points all of which are known."""
    simulated = simulate(1, count=1, free=(), start_mm=0.0)
    points = dataclasses.replace(simulated.network.points, kind=np.full(30, "fixed"))
    camera = dataclasses.replace(simulated.network.cameras[0], interior=INTERIOR)
    result = adjust_network(change(simulated, points=points, cameras=(camera,)))
    assert result.summary.unknowns == 6
    error = result.images.translation_mm[0] - simulated.translation_mm[0]
    sigma = np.sqrt(np.diag(result.images.cov[0])[3:])
    assert (np.abs(error) < 5 * sigma).all()


def test_a_point_twice_in_a_picture() -> None:
    network = simulate(1).network
    point = network.observations.point.copy()
    point[1] = point[0]
    with pytest.raises(CalibrationError, match="picture p00, point T0: observed 2 times"):
        adjust_network(with_observations(network, point=point))


def test_not_finite() -> None:
    network = move_observation(simulate(1).network, 5, (np.nan, 0))
    with pytest.raises(ValueError, match="row 5 .picture p00, point T5. is not finite"):
        adjust_network(network)


def test_pixels_in_millimetres() -> None:
    network = simulate(1).network
    with pytest.raises(CalibrationError, match="these are millimetres"):
        adjust_network(with_observations(network, xy_px=0.005 * network.observations.xy_px))


def test_outside_the_picture() -> None:
    network = simulate(1).network
    camera = dataclasses.replace(network.cameras[0], image_size_px=(800, 600))
    with pytest.raises(CalibrationError, match="outside the picture of 800 x 600"):
        adjust_network(dataclasses.replace(network, cameras=(camera,)))


def test_points_in_metres() -> None:
    simulated = simulate(1, bars=2)
    points = dataclasses.replace(
        simulated.network.points, position_mm=1e-3 * simulated.network.points.position_mm
    )
    with pytest.raises(CalibrationError, match="are these metres"):
        adjust_network(change(simulated, points=points))


def stretched(simulated: Simulated, bar: int, by_mm: float) -> NetworkInput:
    bars = simulated.network.scale_bars
    length = bars.length_mm.copy()
    length[bar] += by_mm
    return change(simulated, scale_bars=dataclasses.replace(bars, length_mm=length))


@pytest.mark.parametrize("by_mm", [1.0, 400.0])
def test_a_wrong_bar_among_five(by_mm: float) -> None:
    simulated = simulate(1, kind="free", bars=5)
    network = dataclasses.replace(stretched(simulated, 1, by_mm), critical_value=3.29)
    result = adjust_network(network)
    assert [r.point for r in result.rejected if r.kind == "scale-bar"] == ["T1-T2"]
    assert any("T1-T2" in warning for warning in result.warnings)


@pytest.mark.parametrize("by_mm", [1.0, 400.0])
def test_two_bars_that_contradict_each_other(by_mm: float) -> None:
    simulated = simulate(1, kind="free", bars=2)
    network = dataclasses.replace(stretched(simulated, 1, by_mm), critical_value=3.29)
    with pytest.raises(CalibrationError, match=r"contradict each other.*T1-T2|T0-T1"):
        adjust_network(network)


def test_a_flat_object_seen_square_says_what_is_weak() -> None:
    """Pictures that look straight at a plane: f and the distance are one unknown."""
    simulated = simulate(1, kind="free", bars=2, flat=True, tilt=0.01, free=None)
    result = adjust_network(simulated.network)
    assert any("f" in w and ("plane" in w or "not determined" in w) for w in result.warnings)


def test_two_fixed_points_are_no_frame() -> None:
    simulated = simulate(1)
    kind = simulated.network.points.kind.copy()
    kind[2:] = "free"
    points = dataclasses.replace(simulated.network.points, kind=kind)
    with pytest.raises(CalibrationError, match="a frame needs three"):
        adjust_network(change(simulated, points=points))


def test_fixed_points_in_a_free_network_are_starts() -> None:
    simulated = simulate(1)
    result = adjust_network(change(simulated, datum="free"))
    assert (result.points.kind == "free").all()
    assert any("are unknowns as all others" in w for w in result.warnings)
