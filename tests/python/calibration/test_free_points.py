"""Calibration by a waved bar: no known target, one known length."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from videogrammetry.calibration.free_points import KnownLength, calibrate_free_points
from videogrammetry.calibration.run import CalibrationOptions, CameraFrames, FrameTargets
from videogrammetry.errors import CalibrationError
from videogrammetry.geometry import project, rotation_looking_at, vector_from_rotation
from videogrammetry.types import RigCamera

SIGMA_PX, LENGTH_MM = 0.02, 1000.0
SIZE = (1280, 1024)
FREE = ("f", "x0", "y0", "A1")


def rig():
    """Three cameras on an arc, 4 m away."""
    cameras = {}
    for k, azimuth in enumerate((-0.5, 0.0, 0.6)):
        stand = 4000.0 * np.array([np.sin(azimuth), -0.1 * (k + 1), -np.cos(azimuth)])
        rotation = rotation_looking_at(stand, np.zeros(3))
        cameras[f"c{k}"] = RigCamera(
            image_size_px=SIZE, interior=np.r_[1900.0 + 20 * k, 5.0, -8.0, -3e-8, np.zeros(6)],
            r0_px=540.0, rotation=rotation, translation_mm=-rotation @ stand,
        )  # fmt: skip
    return cameras


def waved(count, seed=0):
    """(S, 2, 3) ends of a bar all over a volume of 1.6 m, in all directions."""
    rng = np.random.default_rng(seed)
    way = rng.normal(size=(count, 3))
    way *= 0.5 * LENGTH_MM / np.linalg.norm(way, axis=1)[:, None]
    middle = rng.uniform(-450, 450, (count, 3))
    return np.stack([middle - way, middle + way], axis=1)


def observed(cameras, ends, rng, free=FREE, still=None):
    """What the cameras see; numbers 1 and 2 of the bar, 11, 12, ... of points that stand still.

    The calibration is told r0: with another zero of the distortion f means something else, by
    0.4 px here, which many positions show as an error of several standard deviations.
    """
    frames = {name: [] for name in cameras}
    for stage, pair in enumerate(ends, start=1):
        points = pair if still is None else np.vstack([pair, still])
        number = np.arange(1, 3)
        if still is not None:
            number = np.r_[number, 11 + np.arange(len(still))]
        for name, camera in cameras.items():
            xy = project(camera, points @ camera.rotation.T + camera.translation_mm)
            inside = ((xy > 5) & (xy < np.array(SIZE) - 6)).all(axis=1)
            frames[name].append(
                FrameTargets(
                    stage=stage, image=f"{name}_{stage}", id=number[inside],
                    xy_px=xy[inside] + rng.normal(0, SIGMA_PX, (int(inside.sum()), 2)),
                    cov_px2=np.tile([SIGMA_PX**2, 0, SIGMA_PX**2], (int(inside.sum()), 1)),
                )
            )  # fmt: skip
    return [
        CameraFrames(name=name, image_size_px=SIZE, frames=f, free=free, r0_px=540.0)
        for name, f in frames.items()
    ]


def relative(cameras, name):
    first = cameras["c0"]
    turn = cameras[name].rotation @ first.rotation.T
    return turn, cameras[name].translation_mm - turn @ first.translation_mm


BAR = [KnownLength(point_a=1, point_b=2, length_mm=LENGTH_MM, sigma_mm=0.01)]


def errors_over_sigma(run, truth):
    """Errors of all interior and relative parameters over their standard deviations."""
    found = []
    for name, camera in run.rig.cameras.items():
        for k, parameter in enumerate(("f", "x0", "y0", "A1")):
            sigma = camera.sigma[parameter]
            found.append((camera.interior[k] - truth[name].interior[k]) / sigma)
        if name == "c0":
            continue
        turn, shift = relative(truth, name)
        error = np.r_[vector_from_rotation(camera.rotation @ turn.T), camera.translation_mm - shift]
        found += list(error / [camera.sigma[p] for p in ("rx", "ry", "rz", "tx", "ty", "tz")])
    return np.array(found)


@pytest.mark.parametrize(("count", "seed"), [(80, 1), (80, 2), (210, 1)])
def test_a_waved_bar_gives_the_rig_within_its_sigmas(count, seed):
    truth = rig()
    run = calibrate_free_points(
        observed(truth, waved(count, seed), np.random.default_rng(100 + seed)),
        BAR,
        CalibrationOptions(),
    )
    scaled = errors_over_sigma(run, truth)
    assert np.abs(scaled).max() < 4.5
    rows = np.flatnonzero(np.diag(run.rig.cov) > 0)
    assert len(rows) == len(scaled) == 24
    sigma = np.sqrt(np.diag(run.rig.cov)[rows])
    correlation = run.rig.cov[np.ix_(rows, rows)] / np.outer(sigma, sigma)
    # Chi-square of all parameters together, however correlated: one in a thousand is beyond.
    square = scaled @ np.linalg.solve(correlation, scaled)
    assert square < chi2.ppf(0.999, 24), (count, seed)
    assert run.rig.cameras["c0"].rotation == pytest.approx(np.eye(3))
    assert run.sigma0 == pytest.approx(1.0, abs=4 / np.sqrt(2 * run.redundancy))
    assert run.rms_px == pytest.approx(SIGMA_PX, rel=0.4)
    assert run.rig.volume_mm is not None
    # The wanted accuracy of a length is that of the bar, seen 80 times and more.
    baseline = np.linalg.norm(run.rig.cameras["c2"].centre_mm)
    true = np.linalg.norm(truth["c2"].centre_mm - truth["c0"].centre_mm)
    assert baseline == pytest.approx(true, rel=2e-4)


def test_every_sighting_of_the_bar_is_listed():
    run = calibrate_free_points(observed(rig(), waved(30), np.random.default_rng(2)), BAR)
    bars, at = run.bars, run.target.position_mm
    seen = {tuple(remark.split(", stage ")) for remark in bars.certificate}
    assert {targets for targets, _ in seen} == {"targets 1 and 2"}
    assert len(seen) == len(bars) > 20
    adjusted = np.linalg.norm(at[bars.point_a] - at[bars.point_b], axis=1)
    np.testing.assert_allclose(bars.length_mm - bars.residual_mm, adjusted, atol=1e-6)


def test_points_that_stand_still_are_one_point_for_all_stages():
    truth = rig()
    still = np.random.default_rng(5).uniform(-600, 600, (12, 3))
    cameras = observed(truth, waved(30), np.random.default_rng(2), still=still)
    run = calibrate_free_points(cameras, BAR, still=range(11, 23))
    moving = calibrate_free_points(cameras, BAR)
    assert len(run.target) < len(moving.target)
    # The same observations with fewer unknowns: surer parameters.
    assert run.rig.cameras["c1"].sigma["f"] < moving.rig.cameras["c1"].sigma["f"]
    assert np.abs(errors_over_sigma(run, truth)).max() < 4.5


def test_a_wrong_sighting_is_listed():
    truth = rig()
    cameras = observed(truth, waved(60), np.random.default_rng(3))
    frame = cameras[1].frames[7]
    xy = frame.xy_px.copy()
    xy[0] += [3.0, 0.0]
    cameras[1].frames[7] = replace(frame, xy_px=xy)
    run = calibrate_free_points(cameras, BAR)
    assert any(r.image == frame.image for r in run.rejected)
    assert np.abs(errors_over_sigma(run, truth)).max() < 4.5


def test_without_a_length_or_a_common_target_it_says_so():
    cameras = observed(rig(), waved(10), np.random.default_rng(4))
    with pytest.raises(CalibrationError, match="no known length has both ends seen"):
        calibrate_free_points(
            cameras, [KnownLength(point_a=1, point_b=9, length_mm=1.0, sigma_mm=0.1)]
        )
    alone = [
        replace(c, frames=[replace(f, stage=f.stage + 100 * k) for f in c.frames])
        for k, c in enumerate(cameras)
    ]
    with pytest.raises(CalibrationError, match="no coded target was read by two cameras"):
        calibrate_free_points(alone, BAR)
