"""Predictions over a volume against the normal case, the groups, and counting."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from plan_rigs import facing_rig, pair_rig
from two_pairs import two_pair_rig

from videogrammetry.accuracy import (
    needed_positions,
    pair_geometries,
    predict_distances,
    predict_places,
    prediction_statistics,
)
from videogrammetry.geometry import MeasuringVolume
from videogrammetry.reconstruction import Rig

CENTRE = np.zeros((1, 3))
BOX = MeasuringVolume(centre_mm=np.zeros(3), size_mm=np.array([400.0, 400, 400]))


@pytest.mark.parametrize("angle_deg", [10.0, 30.0, 60.0, 90.0])
def test_two_cameras_against_the_normal_case(angle_deg):
    rig = Rig.from_data(pair_rig(angle_deg))
    (pair,) = pair_geometries(rig, CENTRE[0], 0.05)
    assert pair.angle_rad == pytest.approx(math.radians(angle_deg))
    assert pair.base_mm == pytest.approx(2 * 4000 * math.sin(math.radians(angle_deg / 2)))
    place = predict_places(rig, CENTRE, 0.05)
    # In the middle of both pictures the equations are exact.
    q = 0.05 * 4000 / 2000
    half = math.radians(angle_deg / 2)
    across = q / math.sqrt(2)
    expected = [across / math.cos(half), across / math.sin(half), across]
    np.testing.assert_allclose(place.sigma_mm("image")[0], expected, rtol=1e-6)
    assert place.position_sigma_mm("image")[0] == pytest.approx(pair.sigma_mm, rel=1e-6)
    assert place.convergence_rad[0] == pytest.approx(pair.angle_rad)
    # What another base is said to give is what a rig with that base gives.
    for angle, base, sigma in zip(
        pair.better_angle_rad, pair.better_base_mm, pair.better_sigma_mm, strict=True
    ):
        other = Rig.from_data(pair_rig(math.degrees(angle)))
        assert predict_places(other, CENTRE, 0.05).position_sigma_mm("image")[0] == pytest.approx(
            sigma, rel=1e-6
        )
        centres = [c.centre_mm for c in other.cameras.values()]
        assert np.linalg.norm(centres[0] - centres[1]) == pytest.approx(base)


def test_places_and_distances_are_those_of_the_rig():
    rig = Rig.from_data(two_pair_rig(np.random.default_rng(1)))
    places = BOX.grid(3)
    predicted = predict_places(rig, places, 0.02)
    found = rig.intersect(rig.project(places), 0.02)
    np.testing.assert_allclose(predicted.covariance("together"), found.cov_mm2)
    np.testing.assert_allclose(predicted.covariance("calibration"), found.cov_rig_mm2)
    assert (predicted.cameras == 4).all()
    lengths = predict_distances(rig, BOX, 400.0, 0.02, count=3)
    # Only the distances along the axes, with their middles in the plane across, fit.
    ends = np.array([[-200.0, 0, 0], [200.0, 0, 0]])
    one = rig.intersect(rig.project(ends), 0.02).distance(0, 1)
    assert np.isclose(lengths.sigma_calibration_mm, one.sigma_rig_mm[0]).any()
    assert np.isclose(lengths.sigma_mm("together"), one.sigma_mm[0]).any()
    table = prediction_statistics(predicted, lengths)
    for by in table.values():
        together = by["together"]
        assert by["image"].median_mm < together.median_mm <= together.most_mm <= together.worst_mm
        assert together.rms_mm**2 == pytest.approx(
            by["image"].rms_mm ** 2 + by["calibration"].rms_mm ** 2
        )
    with pytest.raises(ValueError, match="source: expected one of image, calibration, together"):
        predicted.sigma_mm("both")
    with pytest.raises(ValueError, match="source: expected one of"):
        lengths.sigma_mm("both")


def test_groups_hide_the_other_side():
    rig = Rig.from_data(facing_rig())
    places = BOX.grid(3)
    names = list(rig.cameras)
    alone = [predict_places(rig, places, 0.02, groups=[g]) for g in (names[:2], names[2:])]
    both = predict_places(rig, places, 0.02, groups=[names[:2], names[2:]])
    together = predict_places(rig, places, 0.02)
    worst = np.maximum(*(a.position_sigma_mm("image") for a in alone))
    np.testing.assert_allclose(both.position_sigma_mm("image"), worst)
    assert (together.position_sigma_mm("image") < worst).all()
    assert (both.cameras == 2).all()


def test_places_out_of_sight_are_not_known():
    rig = Rig.from_data(pair_rig(40.0))
    # Far to the right only one camera sees; behind the cameras none does.
    places = np.array([[0.0, 0, 0], [0, -9000, 0], [1300, 500, 0], [5000, 0, 0]])
    seen = predict_places(rig, places, 0.05)
    assert seen.cameras.tolist() == seen.seen.sum(axis=1).tolist()
    assert np.isfinite(seen.position_sigma_mm("image")).tolist() == (seen.cameras >= 2).tolist()
    assert seen.cameras[0] == 2
    assert seen.cameras[3] == 0
    nothing = predict_distances(rig, BOX, 5000.0, 0.05)
    assert len(nothing.sigma_image_mm) == 0
    assert math.isnan(prediction_statistics(seen, nothing)["distance"]["image"].median_mm)


def test_without_covariance_the_calibration_adds_nothing():
    bare = Rig.from_data(dataclasses.replace(pair_rig()))
    seen = predict_places(bare, CENTRE, 0.05)
    assert (seen.covariance("calibration") == 0).all()


def test_needed_positions_by_halving():
    calls = []

    def sigma(count):
        calls.append(count)
        return math.inf if count < 3 else 1.2 / math.sqrt(count)

    needed = needed_positions(sigma, 0.2, image_mm=0.05)
    assert needed.count == 36  # 1.2 / sqrt(36) = 0.2
    assert needed.sigma_mm == pytest.approx(0.2)
    assert len(calls) == len(set(calls)) < 12
    assert needed_positions(lambda n: 0.1, 0.2, image_mm=0.0).count == 1
    impossible = needed_positions(sigma, 0.2, image_mm=0.2)
    assert impossible.count is None
    assert "the image noise alone gives 0.2 mm" in impossible.reason
    stuck = needed_positions(lambda n: 0.3 + 1 / n, 0.2, image_mm=0.1, limit=64)
    assert stuck.count is None
    assert "64 positions give" in stuck.reason
    with pytest.raises(ValueError, match="wanted: expected more than 0"):
        needed_positions(sigma, 0.0, image_mm=0.1)
