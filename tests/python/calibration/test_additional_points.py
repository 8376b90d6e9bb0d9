"""Coded targets beside the known target: free points of a calibration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from calibration.test_calibrate_bad_input import tables_of
from scipy.stats import chi2

from videogrammetry.calibration import CalibrationOptions, FrameTargets, calibrate
from videogrammetry.cli.main import main
from videogrammetry.geometry import project, vector_from_rotation
from videogrammetry.project import read_rig

NOISE_PX, SIGMA_MM, COUNT = 0.02, 0.05, 25
FREE = ("f", "x0", "y0", "A1")


def small_target(scene, seed):
    """Ten points on 400 mm, four stages, two cameras 3 m away: a weak calibration."""
    return scene(
        seed=seed, num_stages=4, size_mm=400, num_points=10, target_noise_mm=SIGMA_MM, free=FREE
    )


def with_more(s, moves, seed):
    """The scene's pictures with targets 500, 501, ... that stand still as ``moves`` says."""
    rng = np.random.default_rng(1000 + seed)
    middle = np.mean([shift for _, shift in s.stages.values()], axis=0)
    room = middle + rng.uniform(-1, 1, (COUNT, 3)) * [900, 900, 700]
    beside = rng.uniform(-1, 1, (COUNT, 3)) * [500, 500, 300]
    frames = {camera.name: [] for camera in s.frames}
    for stage, (rotation, shift) in s.stages.items():
        places = {"target": beside @ rotation.T + shift, "room": room}.get(moves)
        if places is None:
            places = middle + rng.uniform(-1, 1, (COUNT, 3)) * [900, 900, 700]
        for camera in s.frames:
            known = next(f for f in camera.frames if f.stage == stage)
            model = s.cameras[camera.name]
            xy = project(model, places @ model.rotation.T + model.translation_mm)
            inside = ((xy >= 0) & (xy < model.image_size_px)).all(axis=1)
            count = int(inside.sum())
            frames[camera.name].append(
                FrameTargets(
                    stage=stage,
                    image=known.image,
                    id=np.r_[known.id, 500 + np.flatnonzero(inside)].astype(np.int32),
                    xy_px=np.vstack(
                        [known.xy_px, xy[inside] + rng.normal(0, NOISE_PX, (count, 2))]
                    ),
                    cov_px2=np.vstack(
                        [known.cov_px2, np.tile([NOISE_PX**2, 0, NOISE_PX**2], (count, 1))]
                    ),
                )
            )
    return [replace(camera, frames=frames[camera.name]) for camera in s.frames]


def options(mode):
    return CalibrationOptions(sigma_mm=SIGMA_MM, free_points=mode)


def parameter_errors(run, s):
    """Errors of all estimated parameters, and their covariance."""
    errors = []
    for name, camera in run.rig.cameras.items():
        true = s.cameras[name]
        turn = vector_from_rotation(camera.rotation @ true.rotation.T)
        shift = camera.translation_mm - true.translation_mm
        errors.append(np.r_[camera.interior - true.interior, turn, shift])
    rows = np.flatnonzero(np.diag(run.rig.cov) > 0)
    return np.concatenate(errors)[rows], run.rig.cov[np.ix_(rows, rows)]


def chi_square(error, cov):
    scale = 1 / np.sqrt(np.diag(cov))
    z = error * scale
    return float(z @ np.linalg.solve(cov * np.outer(scale, scale), z))


@pytest.mark.parametrize("mode", ["target", "room", "stage"])
def test_the_relative_orientation_gains_and_the_covariance_is_honest(scene, mode):
    """Monte Carlo: chi-square of all 14 parameters, summed over the draws, in its 99.9 % range."""
    squares, freedom, gain, error_gain = 0.0, 0, [], []
    draws = 8
    for seed in range(draws):
        s = small_target(scene, seed)
        frames = with_more(s, mode, seed)
        plain, run = (calibrate(frames, s.target, options(m)) for m in ("none", mode))
        error, cov = parameter_errors(run, s)
        assert len(error) == 14
        squares += chi_square(error, cov)
        freedom += len(error)
        before, cov_before = parameter_errors(plain, s)
        gain.append(np.sqrt(np.diag(cov)[-6:] / np.diag(cov_before)[-6:]))
        error_gain.append([error[-6:] ** 2, before[-6:] ** 2])
        assert run.additional is not None
        assert run.additional.mode == mode
        assert len(run.observations) == len(plain.observations)
        # sigma0 of r degrees of freedom scatters by sqrt(1 / 2 r).
        assert run.sigma0 == pytest.approx(1.0, abs=4 / np.sqrt(2 * run.redundancy))
    low, high = chi2.ppf([0.0005, 0.9995], freedom)
    assert low < squares < high, (mode, squares, freedom)
    # Stated and true errors of the relative orientation shrink: rotations and shifts.
    assert np.mean(gain) < 0.6
    after, without = np.sum(error_gain, axis=0)
    assert np.mean(np.sqrt(after / without)) < 0.75


def test_without_the_option_nothing_changes(scene):
    s = small_target(scene, 1)
    plain = calibrate(s.frames, s.target, options("none"))
    more = calibrate(with_more(s, "room", 1), s.target, options("none"))
    # Threads add up in any order: the last digits differ.
    np.testing.assert_allclose(np.diag(more.rig.cov), np.diag(plain.rig.cov), rtol=1e-6)
    assert more.additional is None
    assert any("not in the target's point list" in w for w in more.warnings)
    # Nor where there is nothing beside the target, but for a warning.
    asked = calibrate(s.frames, s.target, options("room"))
    np.testing.assert_allclose(np.diag(asked.rig.cov), np.diag(plain.rig.cov), rtol=1e-6)
    assert any("no target beside the known one" in w for w in asked.warnings)


def test_points_that_move_are_named_and_left_out(scene):
    s = small_target(scene, 2)
    run = calibrate(with_more(s, "stage", 2), s.target, options("room"))
    warned = [w for w in run.warnings if "did not stand still in the room" in w]
    assert len(warned) == 1
    assert "501" in warned[0]
    assert 'free_points = "stage"' in warned[0]
    # What only one stage shows may as well have stood still.
    assert run.additional is not None
    seen = run.additional.observations
    for number in run.additional.number:
        assert len(np.unique(seen.stage[seen.point_id == number])) == 1, number
    # On the target they stand still relative to it, and not in the room.
    run = calibrate(with_more(s, "target", 2), s.target, options("room"))
    assert any("did not stand still in the room" in w for w in run.warnings)


def test_a_misread_number_is_rejected_and_places_are_right(scene):
    s = small_target(scene, 3)
    frames = with_more(s, "room", 3)
    good = calibrate(frames, s.target, options("room"))
    frame = frames[1].frames[2]
    row = int(np.flatnonzero(frame.id == 500 + 3)[0]) if 503 in frame.id else len(frame.id) - 1
    number, xy = int(frame.id[row]), frame.xy_px.copy()
    xy[row] += [4.0, -3.0]
    frames[1].frames[2] = replace(frame, xy_px=xy)
    run = calibrate(frames, s.target, options("room"))
    assert run.additional is not None
    out = run.additional.observations
    [bad] = np.flatnonzero(~out.used)
    assert (out.point_id[bad], out.stage[bad], out.camera[bad]) == (number, frame.stage, 1)
    assert any(r.kind == "observation" and r.point_id == number for r in run.rejected)
    assert good.additional is not None
    moved = run.additional.position_mm - good.additional.position_mm
    sigma = np.sqrt(np.diagonal(good.additional.cov_mm2, axis1=1, axis2=2))
    # One of some 130 image points less.
    assert np.abs(moved / sigma).max() < 1.0


def test_by_the_project_file(scene, tmp_path, capsys):
    s = small_target(scene, 5)
    s.frames = with_more(s, "room", 5)
    tables = tables_of(s)
    tables.calibration = ["r0_px = 400.0", f"sigma_mm = {SIGMA_MM}", 'free = ["f", "x0"]']
    sigmas = []
    for more in ([], ['free_points = "room"']):
        tables.calibration += more
        tables.write(tmp_path)
        assert main(["calibrate", str(tmp_path), "--force"]) == 0
        rig = read_rig(tmp_path / "rig.json")
        sigmas.append(rig.cameras["c2"].sigma["rx"])
    assert sigmas[1] < 0.7 * sigmas[0]
    assert "free points (room) in" in capsys.readouterr().out
    assert rig.how["additional_points"]["fixed_to"] == "room"
    assert "points beside the target (room)" in (tmp_path / "rig-report.html").read_text()
    tables.calibration += ["time_offset = true"]
    tables.write(tmp_path)
    assert main(["calibrate", str(tmp_path), "--force"]) == 1
    assert "free_points and time_offset do not go together" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (CalibrationOptions(free_points="floor"), "expected one of none, target, room, stage"),
        (CalibrationOptions(free_points="room", method="mean"), "does not go with method 'mean'"),
        (CalibrationOptions(free_points="room", time_offset=True), "with time_offset"),
    ],
)
def test_what_does_not_go_together_says_so(scene, change, said):
    s = small_target(scene, 4)
    with pytest.raises(ValueError, match=said):
        calibrate(s.frames, s.target, change)
