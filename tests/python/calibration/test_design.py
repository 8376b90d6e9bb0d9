"""A simulated design says what calibrations with these positions scatter by."""

from __future__ import annotations

import numpy as np
import pytest
from plan_rigs import camera, facing_rig, pair_rig
from plan_targets import two_sided

from videogrammetry.adjustment import AdjustOptions, Network
from videogrammetry.calibration import DesignOptions, design_calibration, flat_board
from videogrammetry.calibration.design import even_sequence
from videogrammetry.errors import CalibrationError
from videogrammetry.geometry import MeasuringVolume, project, vector_from_rotation
from videogrammetry.types import PointSet, RigData

VOLUME = MeasuringVolume(centre_mm=np.zeros(3), size_mm=np.array([800.0, 600, 700]))
BOARD = flat_board((500.0, 400.0), (5, 4))
FREE = ("f", "x0", "y0")


def adjusted(rig, target, design, options, rng):
    """Errors of the cameras' parameters (16 each) that an adjustment of noisy pictures finds."""
    network = Network()
    names = list(rig.cameras)
    noisy = target.position_mm + rng.normal(0, options.target_sigma_mm, target.position_mm.shape)
    cams = [network.add_camera(n, rig.cameras[n], free=options.free) for n in names]
    outer = [
        network.add_pose(n, rig.cameras[n].rotation, rig.cameras[n].translation_mm, free=k > 0)
        for k, n in enumerate(names)
    ]
    image, point, xy = [], [], []
    for i, (rotation, shift) in enumerate(design.world_from_target):
        inner = network.add_pose(f"p{i}", rotation, shift)
        for k, name in enumerate(names):
            c = rig.cameras[name]
            seen = project(
                c, (target.position_mm @ rotation.T + shift) @ c.rotation.T + c.translation_mm
            )
            # Of a one-sided board either all points face the camera or none does.
            assert design.points_seen[i, k] in (0, len(target))
            if design.points_seen[i, k]:
                index = network.add_image(f"{name}{i}", cams[k], outer=outer[k], inner=inner)
                image.append(np.full(len(target), index))
                point.append(np.arange(len(target)))
                xy.append(seen + rng.normal(0, options.sigma_px, seen.shape))
    variance = options.target_sigma_mm**2 * np.tile(np.eye(3), (len(target), 1, 1))
    network.set_points(target.id, noisy, variance)
    count = sum(map(len, point))
    network.set_observations(
        np.concatenate(image), np.concatenate(point), np.concatenate(xy),
        np.tile([options.sigma_px**2, 0, options.sigma_px**2], (count, 1)),
    )  # fmt: skip
    network.adjust(AdjustOptions(critical_value=0, estimate_floor=False, robust_start=False))
    found = []
    for k, name in enumerate(names):
        c = rig.cameras[name]
        rotation, shift = network.pose(outer[k])
        turn = vector_from_rotation(rotation @ c.rotation.T)
        found += [network.interior(cams[k]) - c.interior, turn, shift - c.translation_mm]
    return np.concatenate(found)


def test_the_covariance_is_the_scatter_of_adjustments():
    rig = pair_rig(40.0)
    # Small tilts and a small board: all of its points are always seen, as `adjusted` needs.
    options = DesignOptions(
        count=6, sigma_px=0.03, target_sigma_mm=0.03, free=FREE, largest_tilt_rad=0.4
    )
    small = flat_board((260.0, 200.0), (5, 4))
    volume = MeasuringVolume(centre_mm=np.zeros(3), size_mm=np.array([500.0, 600, 400]))
    design = design_calibration(rig, small, volume, options)
    cov = design.rig.cov
    free = np.flatnonzero(np.diag(cov) > 0)
    assert len(free) == 2 * 3 + 6
    rng = np.random.default_rng(11)
    draws = 150
    errors = np.array([adjusted(rig, small, design, options, rng)[free] for _ in range(draws)])
    chi2 = np.einsum("mi,ij,mj->m", errors, np.linalg.inv(cov[np.ix_(free, free)]), errors)
    # Chi-square with 12 degrees of freedom: the mean over m draws is 12 +- sqrt(24 / m). The
    # adjustment is not linear: steps of up to 0.5 % of f (weak in so narrow a field) leave some
    # 1e-2 of the errors, 2e-2 of chi-square.
    assert abs(chi2.mean() - 12) < 4.5 * np.sqrt(24 / draws) + 0.02 * 12
    ratio = errors.std(axis=0) / np.sqrt(np.diag(cov)[free])
    assert np.abs(ratio - 1).max() < 4.5 / np.sqrt(2 * draws) + 0.02


def test_more_positions_are_better_and_begin_with_the_fewer():
    rig = pair_rig()
    designs = [
        design_calibration(rig, BOARD, VOLUME, DesignOptions(count=n, free=FREE)) for n in (6, 12)
    ]
    for a, b in zip(designs[0].world_from_target, designs[1].world_from_target, strict=False):
        np.testing.assert_array_equal(a[1], b[1])
    # Added observations: the covariance falls in every direction.
    free = np.flatnonzero(np.diag(designs[0].rig.cov) > 0)
    block = np.ix_(free, free)
    sigma = np.sqrt(np.diag(designs[0].rig.cov)[free])
    less = (designs[0].rig.cov - designs[1].rig.cov)[block] / np.outer(sigma, sigma)
    assert np.linalg.eigvalsh(less).min() > -1e-6
    again = design_calibration(rig, BOARD, VOLUME, DesignOptions(count=12, free=FREE))
    np.testing.assert_array_equal(again.rig.cov, designs[1].rig.cov)


def test_the_rig_carries_what_a_calibration_gives():
    rig = facing_rig()
    design = design_calibration(rig, two_sided(), VOLUME, DesignOptions(count=8, free=FREE))
    found = design.rig
    assert found.cov.shape == (64, 64)
    assert found.cov_names[16] == "right/f"
    assert (np.diag(found.cov)[10:16] == 0).all()  # the first camera's pose is the frame
    assert found.cameras["right"].sigma["f"] > 0
    assert found.volume_mm.shape[1] == 3
    assert (found.volume_seen.sum(axis=1) >= 2).all()
    assert VOLUME.contains(np.array([t for _, t in design.world_from_target])).mean() > 0.5
    assert design.points_seen.shape == (8, 4)
    # Circles face away from the cameras on the other side.
    assert design.points_seen.max() <= 20


def test_a_target_without_normals_is_seen_from_all_sides():
    target = two_sided()
    blank = PointSet(id=target.id, position_mm=target.position_mm)
    design = design_calibration(facing_rig(), blank, VOLUME, DesignOptions(count=8, free=FREE))
    assert design.points_seen.max() == 40


def test_what_cannot_be_calibrated_is_said():
    options = DesignOptions(count=8, free=FREE)
    with pytest.raises(CalibrationError, match="nothing ties them together; take a target with"):
        design_calibration(facing_rig(), BOARD, VOLUME, options)
    away = MeasuringVolume(centre_mm=np.array([9000.0, 0, 0]), size_mm=np.full(3, 100.0))
    with pytest.raises(CalibrationError, match="only 0 are seen by two cameras"):
        design_calibration(pair_rig(), BOARD, away, options)
    blind = RigData(
        cameras={**pair_rig().cameras, "blind": camera([0, -4000, 0], look_at=(0, -9000, 0))}
    )
    with pytest.raises(CalibrationError, match="camera blind sees the target at none of 8"):
        design_calibration(blind, BOARD, VOLUME, options)
    few = DesignOptions(count=1, free=("f", "x0", "y0", "A1", "A2", "A3"), target_sigma_mm=1000.0)
    with pytest.raises(CalibrationError, match="1 positions of the target do not determine"):
        design_calibration(pair_rig(), flat_board((100.0, 100.0), (3, 2)), VOLUME, few)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"count": 0}, "count: expected a position"),
        ({"sigma_px": 0.0}, "sigma_px: expected more than 0"),
        ({"target_sigma_mm": -1.0}, "target_sigma_mm: expected more than 0"),
        ({"free": ("f", "K1")}, "'K1' is no interior parameter"),
    ],
)
def test_wrong_options(wrong, message):
    with pytest.raises(ValueError, match=message):
        DesignOptions(**wrong)


def test_the_sequence_is_even_from_the_start():
    numbers = even_sequence(48, 6)
    assert ((numbers >= 0) & (numbers < 1)).all()
    for count in (8, 16, 48):
        # The largest gap of n even numbers is below 3 / n in every dimension (random: 4 to 6 / n).
        ordered = np.sort(numbers[:count], axis=0)
        gaps = np.diff(np.concatenate([ordered[-1:] - 1, ordered]), axis=0)
        assert gaps.max() < 3 / count
