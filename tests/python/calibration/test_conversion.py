"""Conversion between the ten parameters and other programs' lenses, and what it leaves."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from export.lens_rigs import assert_within, points_seen_by, usual_rig

from videogrammetry.calibration.conversion import (
    camera_of_lens,
    fit_lens,
    fit_smallest_lens,
    lens_residual,
)
from videogrammetry.errors import CalibrationError
from videogrammetry.geometry import LensModel, project, project_lens
from videogrammetry.rendering.scenes.paper_rig import paper_rig

USUAL = usual_rig().cameras
PAPER = paper_rig().cameras


def in_lens(fit, camera, world):
    return (world @ camera.rotation.T + camera.translation_mm) @ fit.lens_from_cam.T


@pytest.mark.parametrize("name", list(USUAL))
@pytest.mark.parametrize(("kind", "count"), [("opencv", 4), ("opencv", 8), ("equidistant", 4)])
def test_stated_residual_is_that_of_other_points(name, kind, count):
    camera = USUAL[name]
    fit = fit_lens(camera, kind, count)
    world, pixels = points_seen_by(camera, seed=count)
    assert_within(project_lens(fit.lens, in_lens(fit, camera, world)), pixels, fit.residual, name)
    if count == 8:  # a third of a good target's standard deviation of 0.05 px
        assert fit.residual.max_px < 0.017


@pytest.mark.parametrize("name", list(PAPER))
def test_shear_needs_the_tilt(name):
    camera = PAPER[name]
    fit = fit_smallest_lens(camera, "opencv", (5, 8, 12, 14))
    assert len(fit.lens.coefficients) == 14
    # A shear E2 squeezes the picture by E2/2 along its diagonals, whatever turn and focal
    # lengths do: at the RMS half side of 1024 / sqrt(12) = 296 px in x and y, E2/2 * 418 px.
    shear = abs(camera.interior[9]) / 2 * 418
    others = fit_lens(camera, "opencv", 8)
    assert others.residual.rms_px == pytest.approx(shear, rel=0.2)
    assert fit.residual.rms_px < 0.1 * others.residual.rms_px
    # Half of the shear is the turn, by the 14 coefficients' fit more.
    assert abs(others.roll_rad) == pytest.approx(abs(camera.interior[9]) / 2, rel=0.1)


def test_axes_that_are_kept_are_kept():
    camera = PAPER["cam4"]
    fit = fit_lens(camera, "opencv", 5, roll=False)
    assert fit.roll_rad == 0
    turned = fit_lens(camera, "opencv", 5)
    assert turned.residual.rms_px < fit.residual.rms_px
    assert lens_residual(camera, fit.lens) == fit.residual


def test_a_camera_without_distortion_needs_four_numbers():
    camera = dataclasses.replace(
        USUAL["cam1"], interior=np.array([2000.0, 3, 4, 0, 0, 0, 0, 0, 0, 0])
    )
    fit = fit_smallest_lens(camera, "opencv", (5, 8, 12, 14))
    np.testing.assert_allclose(fit.lens.focal_px, 2000, rtol=1e-9)
    np.testing.assert_allclose(fit.lens.centre_px, [514.5, 515.5], rtol=1e-9)
    assert len(fit.lens.coefficients) == 5
    assert fit.residual.max_px < 1e-6


def test_distortion_that_folds_over_is_refused():
    camera = dataclasses.replace(
        USUAL["cam1"], interior=np.array([2000.0, 0, 0, -2e-6, 0, 0, 0, 0, 0, 0]), r0_px=0.0
    )
    with pytest.raises(CalibrationError, match=r"folds over within the picture \(at "):
        fit_lens(camera, "opencv", 5)


def opencv_lens(coefficients, focal=(1500.0, 1500.0)):
    return LensModel(
        kind="opencv",
        focal_px=np.array(focal),
        centre_px=np.array([530.25, 500.0]),
        coefficients=np.array(coefficients),
    )


def test_five_coefficients_and_square_pixels_are_exact():
    lens = opencv_lens([-0.2, 0.1, 4e-4, -7e-4, 0.05])
    fit = camera_of_lens(lens, (1024, 1024))
    assert not fit.camera.measured
    assert fit.residual.max_px < 1e-8
    points = np.random.default_rng(5).uniform([-2, -2, 6], [2, 2, 9], (300, 3))
    np.testing.assert_allclose(
        project(fit.camera, points), project_lens(lens, points), rtol=0, atol=1e-9
    )


@pytest.mark.parametrize("measured", [True, False, None])
@pytest.mark.parametrize(
    "lens",
    [
        opencv_lens([-0.2, 0.1, 4e-4, -7e-4, 0.05, 0.02, 0.01, -0.03], (1500.0, 1488.0)),
        opencv_lens([-0.05, 0.02, 1e-3, -7e-4], (1500.0, 1512.0)),
        LensModel(kind="equidistant", focal_px=np.array([1500.0, 1490.0]),
                  centre_px=np.array([530.0, 480.0]), coefficients=np.array([0.1, 0, 0, 0])),
    ],
    ids=["rational", "oblong", "equidistant"],
)  # fmt: skip
def test_other_lenses_are_fitted_and_the_residual_is_right(lens, measured):
    fit = camera_of_lens(lens, (1024, 1024), measured=measured)
    assert fit.camera.measured is (measured is not False)
    world, pixels = points_seen_by(fit.camera, seed=7)
    assert_within(project_lens(lens, world), pixels, fit.residual)
    assert fit.residual.max_px < 0.5


def test_a_lens_that_does_not_reach_the_corners_is_refused():
    with pytest.raises(CalibrationError, match="coefficients and image size do not belong"):
        camera_of_lens(opencv_lens([-3.0, 0, 0, 0, 0]), (1024, 1024))
