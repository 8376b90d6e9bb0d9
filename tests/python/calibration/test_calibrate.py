"""Calibration against simulated truth: tolerances follow from the returned covariance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from videogrammetry.calibration import CalibrationOptions, calibrate
from videogrammetry.errors import CalibrationError
from videogrammetry.geometry import vector_from_rotation

SEEDS = (1, 2, 3)


def exterior_error(run, scene, name):
    found, truth = run.rig.cameras[name], scene.cameras[name]
    turn = vector_from_rotation(found.rotation @ truth.rotation.T)
    return np.r_[turn, found.translation_mm - truth.translation_mm]


def chi2_per_unknown(run, scene, name):
    """Normalised squared error of a camera's f, x0, y0 and pose, per unknown."""
    names = [f"{name}/{p}" for p in ("f", "x0", "y0", "rx", "ry", "rz", "tx", "ty", "tz")]
    rows = [run.rig.cov_names.index(n) for n in names]
    cov = run.rig.cov[np.ix_(rows, rows)]
    found, truth = run.rig.cameras[name], scene.cameras[name]
    error = np.r_[(found.interior - truth.interior)[:3], exterior_error(run, scene, name)]
    return float(error @ np.linalg.solve(cov, error)) / len(rows)


@pytest.mark.parametrize("method", ["joint", "mean"])
@pytest.mark.parametrize("seed", SEEDS)
def test_error_is_as_large_as_the_covariance_says(scene, method, seed):
    free = ("f", "x0", "y0", "A1")
    s = scene(seed=seed, free=free, num_stages=10, target_noise_mm=0.02)
    run = calibrate(s.frames, s.target, CalibrationOptions(sigma_mm=0.02, method=method))
    # Chi-square of 9 over 9: above 3.1 with 0.1 %; "mean" also estimates the
    # scatter from 10 stages, an F with heavier tails.
    assert chi2_per_unknown(run, s, "c2") < (3.1 if method == "joint" else 8.0), f"seed {seed}"
    assert run.rig.cameras["c1"].translation_mm.tolist() == [0, 0, 0]
    assert np.allclose(run.rig.cameras["c1"].rotation, np.eye(3))


def test_joint_covariance_by_monte_carlo(scene):
    free = ("f", "x0", "y0", "A1")
    options = CalibrationOptions(sigma_mm=0.02, critical_value=0.0)
    values = []
    for seed in range(12):
        s = scene(seed=seed, free=free, num_stages=6)
        values.append(chi2_per_unknown(calibrate(s.frames, s.target, options), s, "c2"))
    # Mean of 12 draws of chi-square_9 / 9: standard deviation sqrt(2 / 108); four of them.
    assert abs(np.mean(values) - 1.0) < 4 * np.sqrt(2 / 108)


def test_honest_sigmas_need_no_floor(scene):
    for seed in SEEDS:
        s = scene(seed=seed)
        run = calibrate(s.frames, s.target, CalibrationOptions(sigma_mm=0.02))
        # sigma0 scatters by 1 / sqrt(2 r); the w-test takes 1 % off.
        assert abs(run.sigma0 - 1) < 4 / np.sqrt(2 * run.redundancy) + 0.01, f"seed {seed}"
        assert max(run.rig.sigma_floor_px.values()) < 0.006, f"seed {seed}"


def test_floor_explains_optimistic_sigmas(scene):
    for seed in SEEDS:
        s = scene(seed=seed, noise_px=0.06, sigma_px=0.005)
        run = calibrate(s.frames, s.target, CalibrationOptions(sigma_mm=0.02))
        expected = np.sqrt(0.06**2 - 0.005**2)
        for name, floor in run.rig.sigma_floor_px.items():
            # The scatter of a standard deviation from about 500 residuals, five times.
            assert abs(floor - expected) < 5 * 0.06 / np.sqrt(2 * 500), f"seed {seed} {name}"


def test_unneeded_parameters_are_dropped(scene):
    s = scene(num_stages=10)
    run = calibrate(s.frames, s.target, CalibrationOptions(sigma_mm=0.02))
    for name, kept in run.parameters_kept.items():
        assert {"f", "x0", "y0", "A1"} <= set(kept), name
        assert "A3" not in kept or "A2" in kept, name
        assert len(kept) <= 5, f"{name}: {kept}"  # one false positive of six at 1 % each
    dropped = [r for r in run.rejected if r.kind == "parameter"]
    assert dropped
    assert all("not significant" in r.reason for r in dropped)


def test_chosen_parameters_stay(scene):
    free = ("f", "A1", "E1")
    s = scene(free=free, interior=(0, 0, 0, 2e-8, 0, 0, 0, 0, 0, 0))
    run = calibrate(s.frames, s.target, CalibrationOptions(sigma_mm=0.02))
    assert run.parameters_kept == {"c1": free, "c2": free}
    assert run.rig.cameras["c1"].interior[1] == 0.0
    assert run.rig.cameras["c1"].sigma["x0"] == 0.0


@pytest.mark.parametrize(
    "kwargs",
    [
        {"f_px": 500, "distance_mm": 800, "interior": (0, 5, 5, 2e-7, 0, 0, 0, 0, 0, 0)},
        {"f_px": 8000, "distance_mm": 12000},
        {"f_px": 8000, "distance_mm": 12000, "relief_mm": 0.0},
        {"num_cameras": 1},
        {"num_cameras": 5, "num_stages": 12},
    ],
    ids=["wide", "narrow", "narrow and flat", "one camera", "five cameras"],
)
def test_finds_f_without_a_start(scene, kwargs):
    s = scene(**kwargs)
    run = calibrate(s.frames, s.target, CalibrationOptions(sigma_mm=0.02))
    for name, camera in run.rig.cameras.items():
        error = abs(camera.interior[0] - s.cameras[name].interior[0])
        assert error < 5 * camera.sigma["f"], name
        assert camera.sigma["f"] < 0.01 * camera.interior[0], name


def spoil_ids(frames, rng, count):
    """The frames with ``count`` numbers a picture exchanged among each other."""
    result = []
    for camera in frames:
        new = []
        for frame in camera.frames:
            ids = frame.id.copy()
            pick = rng.choice(len(ids), count, replace=False)
            ids[pick] = np.roll(ids[pick], 1)
            new.append(replace(frame, id=ids))
        result.append(replace(camera, frames=new))
    return result


@pytest.mark.parametrize("seed", SEEDS)
def test_wrong_numbers_are_rejected_by_name(scene, seed):
    s = scene(seed=seed)
    frames = spoil_ids(s.frames, np.random.default_rng(seed), 4)
    run = calibrate(frames, s.target, CalibrationOptions(sigma_mm=0.02))
    table = run.observations
    truth = {
        (c, f.stage, int(n)): xy
        for c, camera in enumerate(s.frames)
        for f in camera.frames
        for n, xy in zip(f.id, f.xy_px, strict=True)
    }
    wrong = np.array(
        [
            np.linalg.norm(truth[c, stage, n] - xy) > 1.0
            for c, stage, n, xy in zip(
                table.camera.tolist(),
                table.stage.tolist(),
                table.point_id.tolist(),
                table.xy_px,
                strict=True,
            )
        ]  # fmt: skip
    )
    assert wrong.sum() > 50
    assert not (wrong & table.used).any(), f"seed {seed}"
    # 0.1 % per coordinate of the good ones go too.
    assert (~wrong & ~table.used).sum() <= 0.02 * (~wrong).sum()
    listed = [r for r in run.rejected if r.kind == "observation"]
    assert len(listed) == (~table.used).sum()
    assert all(r.image and r.camera and r.point_id for r in listed)
    assert run.rms_px < 0.025


def test_uncoded_points_are_assigned(scene):
    for seed in SEEDS:
        s = scene(seed=seed, num_points=60, coded=16)
        run = calibrate(s.frames, s.target, CalibrationOptions(sigma_mm=0.02))
        table = run.observations
        uncoded = table.point_id > 16
        available = sum(int((f.id < 0).sum()) for c in s.frames for f in c.frames)
        assert uncoded.sum() > 0.8 * available, f"seed {seed}"
        # A wrong assignment would leave a residual beyond any w-test.
        assert run.rms_px < 0.025, f"seed {seed}"
        whole = scene(seed=seed, num_points=60)
        best = calibrate(whole.frames, whole.target, CalibrationOptions(sigma_mm=0.02))
        assert run.rig.cameras["c2"].sigma["tz"] < 1.2 * best.rig.cameras["c2"].sigma["tz"]


def test_two_pairs_without_common_points(scene):
    """Cameras 1, 2 see points 1-20, cameras 3, 4 points 21-40: the stages tie them."""
    s = scene(num_cameras=4, num_stages=10, free=("f", "x0", "y0", "A1"))
    frames = [
        replace(
            camera,
            frames=[
                replace(f, id=f.id[m], xy_px=f.xy_px[m], cov_px2=f.cov_px2[m])
                for f in camera.frames
                for m in [(f.id <= 20) if c < 2 else (f.id > 20)]
            ],
        )
        for c, camera in enumerate(s.frames)
    ]
    run = calibrate(frames, s.target, CalibrationOptions(sigma_mm=0.02))
    for name in ("c2", "c3", "c4"):
        assert chi2_per_unknown(run, s, name) < 3.5, name


def test_result_is_complete(scene):
    s = scene()
    run = calibrate(s.frames, s.target)
    assert run.rig.cov_names[:3] == ("c1/f", "c1/x0", "c1/y0")
    assert run.rig.cov_names[-6:] == ("c2/rx", "c2/ry", "c2/rz", "c2/tx", "c2/ty", "c2/tz")
    assert run.rig.cov.shape == (32, 32)
    assert np.linalg.eigvalsh(run.rig.cov).min() > -1e-9 * np.linalg.eigvalsh(run.rig.cov).max()
    assert run.target.cov_mm2.shape == (len(s.target), 6)
    assert run.image_names["c1", 1] == "c1_01"
    assert set(run.rig_from_target) == set(s.stages)
    assert run.rig.how["method"] == "joint"
    assert run.rig.reference == "camera c1"
    assert run.observations.residual_px.shape == (len(run.observations), 2)


# What must not be calibrated, and what the message must name.


def shift_stages(camera, shift):
    return replace(camera, frames=[replace(f, stage=f.stage + shift) for f in camera.frames])


def test_camera_without_common_stage_is_named(scene):
    s = scene()
    frames = [s.frames[0], shift_stages(s.frames[1], 100)]
    with pytest.raises(CalibrationError, match=r"camera c2 cannot be tied to c1.*101-108.*1-8"):
        calibrate(frames, s.target)


def test_pictures_that_are_not_synchronous_are_refused(scene):
    s = scene()
    late = replace(
        s.frames[1], frames=[replace(f, stage=f.stage % 8 + 1) for f in s.frames[1].frames]
    )
    with pytest.raises(CalibrationError, match="not synchronous"):
        calibrate([s.frames[0], late], s.target)


def test_two_exchanged_pictures_are_dropped_by_name(scene):
    s = scene()
    exchanged = replace(
        s.frames[1],
        frames=[replace(f, stage={3: 4, 4: 3}.get(f.stage, f.stage)) for f in s.frames[1].frames],
    )
    run = calibrate([s.frames[0], exchanged], s.target, CalibrationOptions(sigma_mm=0.02))
    images = [r.image for r in run.rejected if r.kind == "image"]
    assert len(images) == 2
    assert chi2_per_unknown(run, s, "c2") < 3.5


def test_mirrored_target_is_refused(scene):
    s = scene()
    mirrored = replace(s.target, position_mm=s.target.position_mm * [1, 1, -1])
    with pytest.raises(CalibrationError, match="mirror"):
        calibrate(s.frames, mirrored)


def test_flat_target_seen_from_behind_its_normals_is_refused(scene):
    s = scene(relief_mm=0.0)
    normal = np.tile([0.0, 0.0, 1.0], (len(s.target), 1))
    rotation, _ = s.stages[1]
    away = normal if (rotation @ [0, 0, 1.0])[2] > 0 else -normal
    with pytest.raises(CalibrationError, match="mirrored"):
        calibrate(s.frames, replace(s.target, normal=away))
    calibrate(s.frames, replace(s.target, normal=-away))


def test_other_target_is_refused(scene):
    s = scene()
    order = np.random.default_rng(1).permutation(len(s.target))
    with pytest.raises(CalibrationError, match="c1"):
        calibrate(s.frames, replace(s.target, position_mm=s.target.position_mm[order]))


def test_unknown_numbers_are_counted_or_refused(scene):
    s = scene()
    with pytest.raises(CalibrationError, match=r"none of the \d+ numbers"):
        calibrate(s.frames, replace(s.target, id=s.target.id + 500))
    few = replace(s.target, id=s.target.id[:-2], position_mm=s.target.position_mm[:-2])
    run = calibrate(s.frames, few)
    assert any("not in the target's point list" in w for w in run.warnings)
    assert {r.point_id for r in run.rejected if r.kind == "unknown-target"} == {39, 40}


def test_square_view_of_a_plane_does_not_give_f(scene):
    s = scene(num_cameras=1, num_stages=1, relief_mm=0.0, tilt_rad=0.01)
    with pytest.raises(CalibrationError, match="camera c1: the pictures do not determine f"):
        calibrate(s.frames, s.target)
    # With f given it is held, and said.
    given = replace(s.frames[0], start={"f_px": 2000.0}, free=("f",))
    run = calibrate([given], s.target)
    assert run.rig.cameras["c1"].interior[0] == 2000.0
    assert any("f is not determined" in w for w in run.warnings)


@pytest.mark.parametrize("seed", range(1, 7))
def test_one_tilted_flat_picture_gives_f_or_says_no(scene, seed):
    s = scene(num_cameras=1, num_stages=1, relief_mm=0.0, seed=seed)
    try:
        camera = calibrate(s.frames, s.target).rig.cameras["c1"]
    except CalibrationError:
        return  # it said so
    assert abs(camera.interior[0] - 2000) < 5 * camera.sigma["f"]


def test_too_few_points_name_the_camera(scene):
    s = scene(num_points=3)
    with pytest.raises(CalibrationError, match=r"camera c1.*4 known points"):
        calibrate(s.frames, s.target)


def test_malformed_input_is_a_value_error(scene):
    s = scene()
    with pytest.raises(ValueError, match="at least one"):
        calibrate([], s.target)
    with pytest.raises(ValueError, match="method"):
        calibrate(s.frames, s.target, CalibrationOptions(method="best"))
    with pytest.raises(ValueError, match="unknown interior parameter"):
        calibrate([replace(s.frames[0], free=("f", "K1"))], s.target)
    with pytest.raises(ValueError, match="unknown start value"):
        calibrate([replace(s.frames[0], start={"focal": 1.0})], s.target)
    frame = s.frames[0].frames[0]
    broken = replace(frame, cov_px2=frame.cov_px2 * 0)
    with pytest.raises(ValueError, match="positive definite"):
        calibrate([replace(s.frames[0], frames=[broken])], s.target)
    with pytest.raises(ValueError, match="two pictures of one stage"):
        calibrate([replace(s.frames[0], frames=[frame, frame])], s.target)


def test_a_held_f_needs_a_value(scene):
    s = scene()
    held = [replace(c, free=("x0", "y0"), start={}) for c in s.frames]
    with pytest.raises(CalibrationError, match="f is held"):
        calibrate(held, s.target)
