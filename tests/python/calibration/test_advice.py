"""Advice appears exactly when its number asks, and the numbers are those of the geometry."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from calibration_fakes import fake_run
from network_fakes import move_observation, simulate

from videogrammetry.calibration.advice import advise
from videogrammetry.calibration.network_adjustment import adjust_network
from videogrammetry.calibration.network_result import AdjustedBars
from videogrammetry.calibration.picture_angles import rolls_against, tilts_and_rolls, upright
from videogrammetry.calibration.picture_coverage import (
    evenly_over_picture,
    picture_coverage,
    radial_profile,
)
from videogrammetry.calibration.quality import (
    CameraQuality,
    Correlations,
    NetworkQuality,
    PictureFacts,
    Reliability,
    VarianceComponent,
    variance_component,
)
from videogrammetry.calibration.quality_of import quality_of_network, quality_of_run
from videogrammetry.geometry import rotation_from_vector

SIZE = (900, 600)


def everywhere() -> np.ndarray:
    """A point in every cell of the picture."""
    x, y = np.meshgrid(np.arange(50, 900, 100), np.arange(50, 600, 100))
    return np.stack([x.ravel(), y.ravel()], axis=1).astype(float)


def facts(count: int = 12) -> PictureFacts:
    return PictureFacts(
        name=tuple(f"p{i}" for i in range(count)),
        points=np.full(count, 40),
        depth_mm=np.tile([1000.0, 1200.0, 1500.0], (count, 1)),
        tilt_rad=np.full(count, 0.5),
        roll_rad=np.linspace(0, np.pi / 2, count),
    )


def camera(**fields: Any) -> CameraQuality:
    """One that needs no advice, but for what is given."""
    good = CameraQuality(
        name="left",
        image_size_px=SIZE,
        coverage=picture_coverage(SIZE, everywhere()),
        pictures=facts(),
        points=1000,
        rejected=2,
        depth_mm=(1000.0, 1500.0),
        roll_span_rad=np.pi / 2,
        tilt_rad=0.6,
        free=("f", "x0", "y0", "A1"),
        undetermined=(),
        correlations=Correlations(names=("f", "x0"), matrix=np.array([[1, 0.3], [0.3, 1]])),
        reliability=Reliability(
            coordinates=2000, mean=0.8, weak=0, median_detectable_px=0.2, largest_detectable_px=0.5
        ),
    )
    return dataclasses.replace(good, **fields)


def bars(normalised: tuple[float, ...] = (0.3, -0.8)) -> AdjustedBars:
    n = len(normalised)
    return AdjustedBars(
        point_a=np.arange(n), point_b=np.arange(n) + 1, length_mm=np.full(n, 1000.0),
        sigma_mm=np.full(n, 0.02), residual_mm=0.02 * np.array(normalised),
        normalised=np.array(normalised), redundancy=np.full(n, 0.9), used=np.ones(n, bool),
        certificate=("",) * n,
    )  # fmt: skip


def network(of: CameraQuality | None = None, **fields: Any) -> NetworkQuality:
    good = NetworkQuality(
        target=False,
        up=np.array([0.0, -1.0, 0.0]),
        sigma0=1.0,
        cameras=(of or camera(),),
        rays=np.full(50, 6),
        shared={},
        scale_free=True,
        bars=bars(),
        components=(VarianceComponent(group="image points of left", factor=1.1, redundancy=900),),
        reliability=Reliability(
            coordinates=2000, mean=0.8, weak=0, median_detectable_px=0.2, largest_detectable_px=0.5
        ),
    )
    return dataclasses.replace(good, **fields)


def topics(quality: NetworkQuality) -> list[str]:
    return [one.topic for one in advise(quality)]


def test_a_good_network_needs_nothing() -> None:
    assert topics(network()) == []
    assert topics(network(target=True, bars=None, scale_free=False, rays=np.empty(0, int))) == []


def reliable(**fields: Any) -> Reliability:
    return dataclasses.replace(network().reliability, **fields)


def correlated(a: str, b: str, r: float) -> Correlations:
    return Correlations(names=(a, b), matrix=np.array([[1, r], [r, 1]]))


@pytest.mark.parametrize(
    ("topic", "quality", "words"),
    [
        ("coverage", network(camera(coverage=picture_coverage(SIZE, everywhere()[:36]))),
         ("3 of the nine", "bottom left, bottom, bottom right", "67%")),
        ("coverage", network(camera(coverage=picture_coverage(SIZE, everywhere()[::3]))),
         ("only 33%",)),
        ("pictures", network(camera(pictures=facts(7))), ("only 7 pictures",)),
        ("pictures", network(camera(
            pictures=facts(0), coverage=picture_coverage(SIZE, np.empty((0, 2))),
            depth_mm=(np.nan, np.nan), tilt_rad=0.0, roll_span_rad=0.0)),
         ("no picture was used",)),
        ("roll", network(camera(roll_span_rad=np.radians(59))), ("59 degrees", "+0 to +90")),
        ("tilt", network(camera(tilt_rad=np.radians(19))), ("19 degrees at most",)),
        ("depth", network(camera(depth_mm=(1000.0, 1190.0))), ("1000 to 1190 mm", "1.19")),
        ("correlation", network(camera(correlations=correlated("f", "tz", -0.985))),
         ("f and tz (-0.985)", "More depth")),
        ("correlation", network(camera(correlations=correlated("x0", "B1", 0.99))),
         ("x0 and B1 (+0.990)",)),
        ("rejected", network(camera(points=940, rejected=60)), ("60 of 1000", "6%")),
        ("shared", network(shared={"left": 4, "right": 9}), ("only 4 positions",)),
        ("rays", network(rays=np.array([2, 2, 5, 6])), ("2 of 4 points", "mean 3.8")),
        ("redundancy", network(reliability=reliable(mean=0.45)), ("0.45",)),
        ("reliability", network(reliability=reliable(weak=3, largest_detectable_px=1.7)),
         ("3 of 2000", "1.7 px")),
        ("reliability", network(reliability=reliable(weak=1, largest_detectable_px=np.inf)),
         ("not controlled",)),
        ("scale", network(bars=None), ("No scale bar",)),
        ("scale", network(bars=bars((0.1,))), ("nothing controls it",)),
        ("bar", network(bars=bars((0.3, -4.1, 0.2))), ("1 of 3", "0.082 mm")),
        ("weights", network(components=(
            VarianceComponent(group="scale bars", factor=4.84, redundancy=12.0),)),
         ("scale bars", "2.2 times")),
        ("weights", network(components=(
            VarianceComponent(group="image points of left", factor=0.16, redundancy=99.0),)),
         ("only 0.40 of",)),
    ],
)  # fmt: skip
def test_each_advice_has_its_number(
    topic: str, quality: NetworkQuality, words: tuple[str, ...]
) -> None:
    (one,) = advise(quality)
    assert one.topic == topic
    for word in words:
        assert word in one.text


@pytest.mark.parametrize(
    "quality",
    [
        network(camera(roll_span_rad=np.radians(61))),
        network(camera(roll_span_rad=0.0, free=("f", "A1"))),  # x0, y0 were not asked for
        network(camera(tilt_rad=np.radians(21))),
        network(camera(depth_mm=(1000.0, 1201.0))),
        network(camera(depth_mm=(1000.0, 1001.0), free=("x0", "y0"))),
        network(camera(pictures=facts(8))),
        network(camera(rejected=50, points=950)),
        network(camera(correlations=correlated("A1", "A2", -0.999))),
        network(camera(correlations=correlated("x0", "tx", 0.999))),
        network(camera(correlations=correlated("tx", "ry", 0.999))),
        network(shared={"left": 5}),
        network(rays=np.array([3, 0])),  # 0: a point of rejected observations
        network(bars=None, scale_free=False),
        network(bars=bars((3.2, 0.1))),
        network(bars=bars((3.4, *[0.1] * 40))),
        network(components=(VarianceComponent(group="bars", factor=9.0, redundancy=2.0),)),
    ],
)
def test_nothing_is_said_on_this_side_of_a_number(quality: NetworkQuality) -> None:
    assert topics(quality) == []


def test_undetermined_parameters_ask_for_what_determines_them() -> None:
    of = camera(free=("A1",), undetermined=("x0",), roll_span_rad=0.1, tilt_rad=0.1)
    assert topics(network(of)) == ["roll", "tilt"]


@pytest.mark.parametrize("seed", range(3))
def test_tilts_and_rolls_are_those_that_were_made(seed: int) -> None:
    rng = np.random.default_rng(seed)
    board = np.column_stack([rng.uniform(-1, 1, (20, 2)), 0.001 * rng.normal(size=20)])
    tilt, roll = rng.uniform(0, 0.8, 30), rng.uniform(-3.0, 3.0, 30)
    way = rng.uniform(0, 2 * np.pi, 30)
    rotations = np.array([
        rotation_from_vector([t * np.cos(a), t * np.sin(a), 0])
        @ rotation_from_vector([0, 0, r])
        for t, r, a in zip(tilt, roll, way, strict=True)
    ])  # fmt: skip
    # Every other one from behind: turned by half a turn about its own y axis first.
    rotations[::2] = rotations[::2] @ np.diag([-1.0, 1.0, -1.0])
    found = tilts_and_rolls(rotations, board)
    # The plane of the points is off by about 0.001 rad; rolls about it by no more / cos tilt.
    np.testing.assert_allclose(found[:, 0], tilt, atol=0.003)
    np.testing.assert_allclose(found[:, 1], roll, atol=0.006)


@pytest.mark.parametrize("seed", range(3))
def test_up_is_found_whatever_the_frame(seed: int) -> None:
    rng = np.random.default_rng(seed)
    frame = rotation_from_vector(rng.normal(size=3))
    roll = np.where(np.arange(24) % 3 == 1, np.pi / 2, 0.0) + rng.normal(0, 0.03, 24)
    rotations = np.array([
        rotation_from_vector([0, 0, -r]) @ rotation_from_vector([rng.uniform(-0.6, 0.6), 0, 0])
        @ rotation_from_vector([0, 2 * np.pi * i / 24, 0]) @ frame
        for i, r in enumerate(roll)
    ])  # fmt: skip
    up = upright(rotations)
    # Hands that err by 0.03 rad: the best axis of pairs of pictures is at most a few off.
    assert np.degrees(np.arccos(up @ (frame.T @ [0, -1, 0]))) < 5
    rolls = rolls_against(rotations, up)
    assert np.abs(np.abs(rolls) - np.abs(roll)).max() < 0.15
    assert np.isnan(rolls_against(np.eye(3)[None], np.array([0.0, 0, 1.0]))).all()


def test_a_simulated_network_has_its_geometry() -> None:
    simulated = simulate(seed=3, kind="free", bars=3)
    gross = 17
    result = adjust_network(move_observation(
        dataclasses.replace(simulated.network, critical_value=4.0), gross, (3.0, -2.0)
    ))  # fmt: skip
    quality = quality_of_network(result)
    (of,) = quality.cameras
    seen = simulated.network.observations
    depth = (
        np.einsum("nj,nj->n", simulated.rotation[seen.image][:, 2],
                  simulated.position_mm[seen.point]) + simulated.translation_mm[seen.image][:, 2]
    )  # fmt: skip
    kept = np.delete(depth, gross)
    # Start values err by 2 mm, the bars by 0.01: lengths agree to 1e-3 and better.
    np.testing.assert_allclose(of.depth_mm, (kept.min(), kept.max()), rtol=2e-3)
    axes = simulated.rotation[:, 2]
    assert of.tilt_rad == pytest.approx(np.arccos((axes @ axes.T).min()), abs=2e-3)
    assert of.roll_span_rad > np.pi / 2
    assert of.rejected == 1
    assert of.points == len(seen) - 1
    assert of.coverage.cells.sum() == of.points
    assert len(of.pictures) == 10
    assert quality.rays.sum() == of.points
    assert quality.bars is not None
    assert [c.group for c in quality.components] == ["image points of hand", "scale bars"]
    # The model is true: the component's mean is 1, its variance 2 / redundancy.
    component = quality.components[0]
    assert abs(component.factor - 1) < 5 * np.sqrt(2 / component.redundancy)
    assert component.factor == pytest.approx(result.summary.sigma0**2, rel=0.05)
    assert "scale" not in topics(quality)


def test_a_calibration_has_its_numbers() -> None:
    run = fake_run(cameras=2, stages=4)
    # Poses that are all the same mean points of their own, as of a waved bar: no target to tilt.
    assert not {"roll", "tilt"} & set(topics(quality_of_run(run)))
    poses = {s: (np.eye(3), np.array([0.0, 0, 12e3 + s])) for s in range(1, 5)}
    run = dataclasses.replace(run, rig_from_target=poses)
    quality = quality_of_run(run)
    assert quality.target
    assert set(topics(quality)) >= {"pictures", "shared", "depth", "roll", "tilt"}
    first = quality.cameras[0]
    assert len(first.pictures) == 4
    # All its target positions are 12 m in front of camera 1, not turned.
    np.testing.assert_allclose(first.pictures.depth_mm[:, 1], 12e3, atol=10)
    assert quality.shared == {"cam1": 4, "cam2": 4}
    assert first.points + first.rejected == 4 * 49


def test_variance_component_is_that_of_the_residuals() -> None:
    rng = np.random.default_rng(5)
    # 2000 observations of one unknown: redundancy 1 - 1 / n each, true sigma twice the stated.
    values = rng.normal(0, 0.2, 2000)
    one = variance_component(
        "g", values - values.mean(), np.full(2000, 0.1), np.full(2000, 1 - 5e-4)
    )
    assert abs(one.factor - 4) < 5 * 4 * np.sqrt(2 / 1999)


def test_thinning_keeps_the_corners() -> None:
    rng = np.random.default_rng(1)
    xy = np.concatenate([rng.normal(500, 20, (9000, 2)), [[0, 0], [999, 0], [0, 999], [999, 999]]])
    kept = evenly_over_picture(xy, 400)
    assert len(np.unique(kept)) == 400
    assert set(range(9000, 9004)) <= set(kept.tolist())


def test_profile_shows_a_radial_error_and_nothing_else() -> None:
    rng = np.random.default_rng(2)
    xy = rng.uniform(0, 1000, (4000, 2))
    centre = np.array([480.0, 530.0])
    noise = rng.normal(0, 0.05, (4000, 2))
    flat = radial_profile(xy, noise, centre)
    assert (np.abs(flat.outward_px / flat.sigma_px)[flat.count > 30] < 5).all()
    away = xy - centre
    bent = radial_profile(xy, noise + 3e-4 * away, centre)
    np.testing.assert_allclose(
        bent.outward_px[flat.count > 30], 3e-4 * bent.radius_px[flat.count > 30], atol=0.05
    )
    few = radial_profile(xy[:3], noise[:3], centre)
    assert np.isnan(few.rms_px).all()
