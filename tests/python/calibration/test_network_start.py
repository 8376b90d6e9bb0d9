"""Start values of simulated networks: near enough that a bundle finds the truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from network_simulation import (
    INTERIOR,
    SIZE_PX,
    photographs,
    position_errors,
    with_known,
)

from videogrammetry.calibration.network_input import ScaleBars
from videogrammetry.calibration.network_start import start_network
from videogrammetry.errors import CalibrationError

NOISE_PX = 0.05
# A point at 2400 mm: NOISE * 2400 / 2600 = 0.046 mm across a ray, about as much in
# depth from rays all round; the worst of 122 points is about four sigmas and is seen
# by a few pictures only. The start leaves out B1, B2: up to 2e-7 * 1500^2 = 0.5 px of
# bend, most of which poses take up. Ten times the noise is well inside a bundle's basin.
NEAR_MM = 10 * NOISE_PX * 2400 / 2600


def bars(network, truth, pairs):
    a, b = np.array(pairs).T
    length = np.linalg.norm(truth.position[a] - truth.position[b], axis=1)
    table = ScaleBars(point_a=a, point_b=b, length_mm=length, sigma_mm=np.full(len(a), 0.01))
    return replace(network, scale_bars=table)


def check(started, truth, *, pictures, f=INTERIOR[0]):
    """All pictures and nearly all points near the truth; outliers told apart."""
    report = started.report
    assert len(report.placed) == pictures, report.left_out
    errors = position_errors(started.network, truth)
    assert len(errors) >= 0.95 * truth.num_coded
    assert np.median(errors) < NEAR_MM
    assert np.quantile(errors, 0.95) < 4 * NEAR_MM
    assert abs(started.network.cameras[0].interior[0] / f - 1) < 0.02
    numbered = started.network.observations.point >= 0
    wrong = truth.wrong[numbered]
    agrees = report.agrees[numbered]
    assert agrees[~wrong].mean() > 0.97
    # Errors of 5 to 200 px, the gate about 1.5 px.
    assert agrees[wrong].mean() < 0.1 if wrong.any() else True


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("f_start", [None, 1.3 * INTERIOR[0], 0.7 * INTERIOR[0]])
def test_twenty_photographs_of_a_two_sided_cross(seed, f_start):
    """f unknown or 30 % off, 5 % gross errors, two pairs of swapped numbers."""
    network, truth = photographs(seed, gross=0.05, swapped=2, f_start=f_start)
    started = start_network(network)
    check(started, truth, pictures=20)
    assert started.report.scale == "unit baseline"
    assert any("scale is unknown" in doubt for doubt in started.report.doubts)
    assert any("f = " in d or "f was not given" in d for d in started.report.doubts)
    assert len(started.report.groups) == 1


def test_scale_bars_give_the_scale_and_the_first_picture_the_frame():
    network, truth = photographs(4, f_start=INTERIOR[0])
    network = bars(network, truth, [(0, 40), (60, 90)])
    started = start_network(network)
    assert started.report.scale == "scale bars"
    found = started.network.points.position_mm
    length = np.linalg.norm(found[0] - found[40])
    assert length == pytest.approx(network.scale_bars.length_mm[0], rel=1e-3)
    first = [i for i in started.network.images if np.allclose(i.translation_mm, 0, atol=1e-6)]
    assert len(first) == 1
    assert np.allclose(first[0].rotation, np.eye(3), atol=1e-9)


@pytest.mark.parametrize("f_start", [None, 1.3 * INTERIOR[0]])
def test_known_points_start_by_resection(f_start):
    network, truth = photographs(5, gross=0.05, f_start=f_start)
    started = start_network(with_known(network, truth, range(0, 130, 3)))
    check(started, truth, pictures=20)
    assert started.report.scale == "known points"
    found = started.network.points.position_mm[: truth.num_coded]
    placed = np.isfinite(found[:, 0])
    # In the known points' own frame, without a fit.
    errors = np.linalg.norm(found[placed] - truth.position[: truth.num_coded][placed], axis=1)
    assert np.median(errors) < NEAR_MM


def test_few_known_points_place_the_free_block():
    """Three known points see no picture alone: the block is transformed onto them."""
    network, truth = photographs(6, f_start=None)
    started = start_network(with_known(network, truth, [3, 30, 70, 100]))
    check(started, truth, pictures=20)
    assert started.report.scale == "known points"
    found = started.network.points.position_mm[: truth.num_coded]
    errors = np.linalg.norm(found - truth.position[: truth.num_coded], axis=1)
    assert np.nanmedian(errors) < 4 * NEAR_MM


@pytest.mark.parametrize("known", [range(0, 130, 3), [3, 30, 70, 100]])
def test_left_handed_known_points_are_named(known):
    network, truth = photographs(7, f_start=INTERIOR[0])
    network = with_known(network, truth, known)
    points = network.points
    mirrored = replace(points, position_mm=points.position_mm * [1, 1, -1])
    with pytest.raises(CalibrationError, match="left-handed"):
        start_network(replace(network, points=mirrored))


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
@pytest.mark.parametrize("f_start", [None, INTERIOR[0]])
def test_a_plane(seed, f_start):
    """Two motions of the first pair: further pictures decide."""
    network, truth = photographs(
        seed, coded=60, tie=0, plane=True, count=12, gross=0.03, f_start=f_start
    )
    started = start_network(network)
    check(started, truth, pictures=12)
    # Turned inside out, the plane stays a plane: its cameras tell.
    found = np.array([i.rotation.T @ i.translation_mm for i in started.network.images])
    true = np.einsum("nji,nj->ni", truth.rotation, truth.translation)
    step = np.linalg.norm(found[0] - found[-1]) / np.linalg.norm(true[0] - true[-1])
    pairs = [(0, 5), (3, 11), (2, 8)]
    for a, b in pairs:
        ratio = np.linalg.norm(found[a] - found[b]) / np.linalg.norm(true[a] - true[b])
        assert ratio == pytest.approx(step, rel=0.03), (seed, a, b)


def test_two_sides_that_nothing_ties_are_two_groups():
    azimuths = np.r_[np.linspace(-0.8, 0.8, 8), np.pi + np.linspace(-0.8, 0.8, 8)]
    network, _ = photographs(8, tie=0, count=16, azimuths=azimuths, f_start=INTERIOR[0])
    with pytest.raises(CalibrationError, match="fall into 2 groups") as caught:
        start_network(network)
    message = str(caught.value)
    assert "IMG_001" in message
    assert "IMG_009" in message
    assert "no point in common" in message
    started = start_network(network, partial=True)
    assert [len(group) for group in started.report.groups] == [8, 8]
    assert started.report.links[0].points == ()
    assert len(started.report.placed) == 8
    assert sum(image.rotation is None for image in started.network.images) == 8


def test_groups_that_two_points_tie_are_named_with_them():
    azimuths = np.r_[np.linspace(-0.8, 0.8, 8), np.pi + np.linspace(-0.8, 0.8, 8)]
    network, truth = photographs(9, tie=0, count=16, azimuths=azimuths, f_start=INTERIOR[0])
    # Numbers 1 and 2 of the front stand, as if seen, in a back picture too.
    observations = network.observations
    extra = np.flatnonzero(observations.image == 12)[:2]
    point = observations.point.copy()
    point[extra] = [0, 1]
    network = replace(network, observations=replace(observations, point=point))
    with pytest.raises(CalibrationError, match="2 points in common \\(1, 2\\)"):
        start_network(network)


def test_a_picture_of_too_few_points_is_left_out_with_the_reason():
    network, _ = photographs(10, f_start=INTERIOR[0])
    observations = network.observations
    rows = np.flatnonzero(observations.image == 4)[3:]
    point = observations.point.copy()
    point[rows] = -1
    network = replace(network, observations=replace(observations, point=point))
    started = start_network(network)
    assert started.report.left_out == (("IMG_005", "only 3 points with a number; a pose needs 5"),)


def test_no_common_points_says_so():
    network, _ = photographs(11, count=3, f_start=INTERIOR[0])
    observations = network.observations
    point = np.where(observations.image == observations.point % 3, observations.point, -1)
    network = replace(network, observations=replace(observations, point=point.astype(np.int32)))
    with pytest.raises(CalibrationError, match="common point"):
        start_network(network)


def test_a_held_f_needs_a_value():
    network, _ = photographs(12, count=3)
    camera = replace(network.cameras[0], free=("x0",))
    with pytest.raises(ValueError, match="f is held"):
        start_network(replace(network, cameras=(camera,)))


def test_given_poses_are_taken_over():
    network, truth = photographs(13, f_start=INTERIOR[0])
    camera = replace(network.cameras[0], interior=INTERIOR)
    images = tuple(
        replace(image, rotation=truth.rotation[k], translation_mm=truth.translation[k])
        if k % 2
        else image
        for k, image in enumerate(network.images)
    )
    started = start_network(replace(network, images=images, cameras=(camera,)))
    # (one picture sees four points only, and says so)
    assert len(started.report.placed) == 19
    assert "only 4 points" in started.report.left_out[0][1]
    errors = position_errors(started.network, truth)
    assert np.median(errors) < NEAR_MM


def test_pictures_of_an_unconnected_size():
    """The picture's size is only the unit of the gates: a quarter of it starts as well."""
    network, truth = photographs(14, f_start=None)
    observations = network.observations
    centre = (np.array(SIZE_PX) - 1) / 2
    small = (648, 432)
    xy = (observations.xy_px - centre) / 4 + (np.array(small) - 1) / 2
    camera = replace(network.cameras[0], image_size_px=small, r0_px=network.cameras[0].r0_px / 4)
    network = replace(network, cameras=(camera,), observations=replace(observations, xy_px=xy))
    started = start_network(network)
    assert len(started.report.placed) == 20
    assert np.median(position_errors(started.network, truth)) < 4 * NEAR_MM
