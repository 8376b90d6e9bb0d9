"""Simulated measurements against their truth: frame, ratios, missing and wrong points."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from two_pairs import PAIRS, calibrated, falling, measure, two_pair_rig, without

from videogrammetry.accuracy import (
    CalibrationPart,
    KnownLength,
    TruePoints,
    check_scale_bars,
    compare_with_truth,
    lengths_from_calibration,
    measured_from_true,
)
from videogrammetry.motion import compute_motion


def truth_of(scene, seen=True):
    stages = len(scene.position)
    return TruePoints(
        stage=scene.table.stage,
        point_id=np.arange(1, 17, dtype=np.int32),
        position_mm=scene.position,
        cameras_seen=np.tile(scene.used, (stages, 1, 1)) if seen else None,
    )


def compared(scene, **more):
    return compare_with_truth(scene.table, scene.rig, scene.truth, truth_of(scene), **more)


@pytest.mark.parametrize("seed", [1, 2])
def test_ratios_are_one_on_average(seed):
    """One draw of the calibration a measurement: squared ratios average one."""
    rng = np.random.default_rng(seed)
    truth = two_pair_rig(rng)
    used = np.repeat(PAIRS, 8, axis=0)
    square = []
    for _ in range(200):
        rig = calibrated(truth, rng)
        position = rng.uniform(-1500, 1500, (1, 16, 3))
        table = measure(truth, rig, position, used, rng)
        points = TruePoints(stage=table.stage, point_id=table.point_id, position_mm=position)
        total = compare_with_truth(table, rig, truth, points).total
        square.append(
            np.square(
                [
                    total.ratio,
                    total.normalised_rms,
                    total.image_normalised_rms,
                    total.rig_normalised_rms,
                ]
            )  # fmt: skip
        )
    mean, sigma = np.mean(square, axis=0), np.std(square, axis=0) / np.sqrt(len(square))
    np.testing.assert_array_less(np.abs(mean - 1), 4 * sigma)
    np.testing.assert_array_less(sigma, 0.1)  # the bound above says something


def test_exact_pictures_leave_nothing_to_the_pictures():
    scene = falling(3, stages=3, lost=0.0)
    exact = measure(scene.truth, scene.rig, scene.position, scene.used, None)
    result = compared(dataclasses.replace(scene, table=exact))
    assert result.total.image_rms_mm < 1e-5
    np.testing.assert_allclose(result.error_mm, result.error_rig_mm, atol=1e-5)
    assert result.total.rig_rms_mm > 0.01


def test_a_perfect_calibration_in_another_frame():
    """Only the frame differs: it is found, and no error is left."""
    scene = falling(4, stages=3, lost=0.0)
    turn, shift = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix(), np.array([100.0, -50, 7])
    cameras = {
        name: dataclasses.replace(
            c,
            rotation=c.rotation @ turn.T,
            translation_mm=c.translation_mm - c.rotation @ turn.T @ shift,
        )
        for name, c in scene.truth.cameras.items()
    }
    rig = dataclasses.replace(
        scene.truth, cameras=cameras, volume_mm=scene.truth.volume_mm @ turn.T + shift
    )
    fit = measured_from_true(rig, scene.truth)
    np.testing.assert_allclose(fit.rotation, turn, atol=1e-9)
    np.testing.assert_allclose(fit.translation_mm, shift, atol=1e-5)
    assert abs(fit.scale_error) < 1e-9
    table = measure(scene.truth, rig, scene.position, scene.used, None)
    result = compared(dataclasses.replace(scene, rig=rig, table=table))
    assert result.total.rms_mm < 1e-5


def test_groups_missing_and_centroid():
    scene = falling(5, stages=30, lost=0.0)
    missing = np.zeros((30, 16), dtype=bool)
    missing[3, 0] = missing[4, 9] = missing[5, 9] = True
    table = without(scene.table, missing)
    motion = compute_motion(table)
    result = compared(dataclasses.replace(scene, table=table), motion=motion)
    assert {g.name: g.count for g in result.groups} == {"cam1+cam2": 239, "cam3+cam4": 238}
    assert result.missing.tolist() == [[4, 1], [5, 10], [6, 10]]
    assert (result.visible, result.measured) == (480, 477)
    assert result.wrong == ()
    assert result.unknown == ()
    c = result.centroid
    # 28 velocities of three axes, unequal in size: within a factor of two of what is predicted.
    assert 0.5 < c.velocity_rms_mm_s / c.velocity_predicted_mm_s < 2
    assert c.position_rms_mm <= c.position_largest_mm
    assert c.position_rms_mm < 5 * c.position_predicted_mm


def test_the_centroids_prediction_knows_the_correlation():
    """Over draws of the calibration: all points of a pair err alike, the two pairs apart."""
    draws, square = 60, []
    for seed in range(draws):
        scene = falling(seed, stages=5, lost=0.0)
        c = compared(scene, motion=compute_motion(scene.table)).centroid
        square.append(
            np.square(
                [
                    c.position_rms_mm / c.position_predicted_mm,
                    c.velocity_rms_mm_s / c.velocity_predicted_mm_s,
                ]
            )  # fmt: skip
        )
    mean, sigma = np.mean(square, axis=0), np.std(square, axis=0) / np.sqrt(draws)
    np.testing.assert_array_less(np.abs(mean - 1), 4 * sigma)
    np.testing.assert_array_less(sigma, 0.2)


def test_what_two_cameras_cannot_see_is_not_missing():
    scene = falling(6, stages=4, lost=0.0)
    truth = truth_of(scene)
    truth.cameras_seen[0, 2] = [True, False, False, True]
    truth.cameras_seen[1, 2] = [True, False, False, False]
    missing = np.zeros((4, 16), dtype=bool)
    missing[:2, 2] = True
    table = without(scene.table, missing)
    result = compare_with_truth(table, scene.rig, scene.truth, truth)
    assert result.missing.tolist() == [[1, 3]]
    assert result.visible == 63


def test_wrong_points_are_listed():
    scene = falling(7, stages=5, lost=0.0)
    position = scene.table.position_mm.copy()
    position[2, 6] += [4.0, 0, 0]
    table = dataclasses.replace(scene.table, position_mm=position)
    (wrong,) = compared(dataclasses.replace(scene, table=table)).wrong
    assert (wrong.stage, wrong.point_id, wrong.cameras) == (3, 7, "cam1+cam2")
    assert wrong.error_mm == pytest.approx(4, abs=6 * wrong.sigma_mm)


def test_uncoded_points_are_found_by_place():
    scene = falling(8, stages=5)
    numbers = scene.table.point_id.copy()
    numbers[10:] = [522, 521, 520, 519, 518, 517]
    order = np.argsort(numbers)
    table = dataclasses.replace(
        scene.table,
        point_id=numbers[order],
        **{
            name: getattr(scene.table, name)[:, order]
            for name in ("position_mm", "cov_mm2", "cov_image_mm2", "cameras_used", "rms_px")
        },
    )
    result = compared(dataclasses.replace(scene, table=table), first_free_id=517)
    assert dict(result.renumbered) == {522: 11, 521: 12, 520: 13, 519: 14, 518: 15, 517: 16}
    assert result.wrong == ()
    same = compared(scene)
    assert result.total.rms_mm == pytest.approx(same.total.rms_mm)
    by_number = compared(dataclasses.replace(scene, table=table))
    assert by_number.unknown == (517, 518, 519, 520, 521, 522)


def test_a_bars_error_from_the_calibration_alone():
    scene = falling(9, stages=3, lost=0.0)
    bars = [
        KnownLength(
            point_a=a,
            point_b=b,
            length_mm=float(np.linalg.norm(scene.position[0, a - 1] - scene.position[0, b - 1])),
            sigma_mm=1e-6,
        )
        for a, b in ((1, 2), (1, 10))
    ]
    errors = lengths_from_calibration(scene.rig, scene.truth, truth_of(scene), bars)
    exact = measure(scene.truth, scene.rig, scene.position, scene.used, None)
    test = check_scale_bars(exact, bars, CalibrationPart(scene.rig))
    for k in range(2):
        np.testing.assert_allclose(errors[:, k], test.error_mm[test.bar == k], atol=1e-5)
    # One draw: within five of its sigmas, and not for nothing.
    assert (np.abs(test.error_mm) < 5 * test.sigma_rig_mm).all()
    assert np.abs(errors).max() > 1e-3


def test_what_cannot_be_compared_is_said():
    scene = falling(10, stages=3)
    two = dict(list(scene.truth.cameras.items())[:2])
    with pytest.raises(ValueError, match="its cameras are cam1, cam2, the calibrated rig's cam1"):
        measured_from_true(scene.rig, dataclasses.replace(scene.truth, cameras=two))
    with pytest.raises(ValueError, match="which volume was calibrated"):
        measured_from_true(dataclasses.replace(scene.rig, volume_mm=None), scene.truth)
    stranger = dataclasses.replace(truth_of(scene), point_id=scene.table.point_id + 100)
    with pytest.raises(ValueError, match="no measured point is one of the truth's"):
        compare_with_truth(scene.table, scene.rig, scene.truth, stranger)
