"""Disturbances are as large as asked for: measured on pictures and on the truth."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from videogrammetry.geometry import project
from videogrammetry.recognition import code_family
from videogrammetry.rendering import VISIBILITY, Renderer, SceneTargets
from videogrammetry.rendering.disturbances import (
    Conditions,
    exposure_for_blur,
    missing_camera,
    occluded,
)
from videogrammetry.rendering.scenes import calibration_scene, scale_bar_scene, tyre_scene
from videogrammetry.types import RigCamera

FAMILY = code_family("schneider-14")
SEEDS = (0, 1, 2)
SEEN, HIDDEN = VISIBILITY.index("visible"), VISIBILITY.index("occluded")


# At 300 and 8 bits the noise of half a grey value would be hidden by the rounding.
@pytest.mark.parametrize(
    ("bit_depth", "ratio"),
    [(b, r) for b in (8, 12, 16) for r in (20.0, 75.0, 300.0) if (b, r) != (8, 300.0)],
)
def test_contrast_over_noise_is_as_asked(bit_depth, ratio):
    """Measured on flat white and black areas of a rendered picture."""
    conditions = Conditions(
        bit_depth=bit_depth, contrast_noise=ratio, gradient=(0.0, 0.0), spots=0, clutter=0.0
    )
    camera = RigCamera(
        image_size_px=(200, 200), interior=np.r_[1000.0, np.zeros(9)], r0_px=0.0,
        rotation=np.eye(3), translation_mm=np.zeros(3),
    )  # fmt: skip
    renderer = Renderer(
        camera,
        background=conditions.background(camera, 0),
        illumination=conditions.illumination(),
        sensor=conditions.sensor(),
    )
    dot = SceneTargets(centre_mm=[[0, 0, 1000.0]], radius_mm=60.0, sticker_mm=99.0)
    image = renderer.render(dot, seed=int(ratio)).image.astype(float)
    y, x = np.mgrid[:200, :200] - 99.5
    white = image[np.hypot(x, y) < 50]
    black = image[(np.hypot(x, y) > 70) & (np.maximum(abs(x), abs(y)) < 90)]
    # Rounding adds 1/12 to the variance; a standard deviation from N samples is sure to
    # 1 / sqrt(2 N): five of them.
    noise = math.sqrt(white.var() - 1 / 12)
    found = (white.mean() - black.mean()) / noise
    assert found == pytest.approx(ratio, rel=5 / math.sqrt(2 * len(white)))


def test_no_noise_at_infinite_contrast():
    sensor = Conditions(contrast_noise=math.inf).sensor()
    assert (sensor.read_noise, sensor.shot_noise_gain) == (0, 0)


def seen_by(scene, stages):
    """Visibility (stages, cameras, targets) of the targets alone."""
    rows = np.flatnonzero(scene.marks.is_target)
    renderers = [Renderer(camera) for camera in scene.rig.cameras.values()]
    return np.array(
        [
            [r.truth(scene.targets(scene.time_s(s))).visibility[rows] for r in renderers]
            for s in stages
        ]
    )


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("share", [0.1, 0.4])
def test_the_share_that_is_hidden(share, seed):
    stages = range(1, 201, 8)
    clear = tyre_scene(FAMILY)
    scene = occluded(clear, share, seed)
    before, after = seen_by(clear, stages), seen_by(scene, stages)
    assert scene.marks.is_target.sum() == clear.marks.is_target.sum()
    was = before == SEEN
    assert (before == after)[~was].all()
    hidden = np.array([(after == HIDDEN)[k, :, :].any(axis=0) for k in range(len(stages))])
    # 18 targets at 25 stages, each hidden or not: binomial, four standard deviations; and at
    # most one in ten of the others stands beside a patch that reaches over.
    sigma = math.sqrt(share * (1 - share) / hidden.size)
    found = hidden.mean()
    assert share - 4 * sigma < found < share + 0.1 * share + 4 * sigma, f"seed {seed}"
    # New at each stage, and other ones with another seed.
    same = (hidden[1:] == hidden[:-1]).mean()
    expected = share**2 + (1 - share) ** 2
    assert same == pytest.approx(expected, abs=0.1), f"seed {seed}"
    other = seen_by(occluded(clear, share, seed + 10), stages[:4])
    assert (other != after[:4]).any()


@pytest.mark.parametrize("seed", SEEDS)
def test_oblique_targets_are_hidden_too(seed):
    clear = calibration_scene(FAMILY, num_orientations=8, seed=seed)
    before = seen_by(clear, range(1, 9))
    after = seen_by(occluded(clear, 0.3, seed), range(1, 9))
    found = (after[before == SEEN] == HIDDEN).mean()
    # 784 targets, seen by two cameras each: four standard deviations, and one in twenty that
    # sees past its patch, or has a neighbour's before it.
    assert found == pytest.approx(0.3, abs=4 * math.sqrt(0.3 * 0.7 / 784) + 0.05 * 0.3)


@pytest.mark.parametrize("uncoded", [False, True])
def test_patches_that_hide_nothing_are_not_seen(uncoded):
    """From either side, moving and not, tilted and not."""
    for clear, stage in (
        (tyre_scene(FAMILY, uncoded=uncoded), 1),
        (tyre_scene(FAMILY, uncoded=uncoded), 119),
        (calibration_scene(FAMILY, num_orientations=8), 3),
        (scale_bar_scene(FAMILY), 40),
    ):
        scene = occluded(clear, 1e-12, 0)
        assert len(scene.marks) > len(clear.marks)
        for name, camera in clear.rig.cameras.items():
            renderer = Renderer(camera)
            with_patches, without = (
                renderer.light(s.targets(s.time_s(stage))) for s in (scene, clear)
            )
            np.testing.assert_allclose(
                with_patches, without, atol=1e-6, err_msg=f"{clear.name} {name}"
            )


def test_a_patch_stays_during_the_longest_exposure():
    clear = tyre_scene(FAMILY, num_stages=5, frame_rate_hz=250.0)
    scene = occluded(replace(clear, exposure_s=1 / 250.0), 0.5, 1)
    patches = ~scene.marks.is_target
    patches[: len(clear.marks)] = False
    for stage in range(1, 6):
        targets = scene.targets(scene.time_s(stage))
        way = np.linalg.norm((targets.end_centre_mm - targets.centre_mm)[patches], axis=1)
        own = np.linalg.norm((targets.end_centre_mm - targets.centre_mm)[~patches], axis=1)
        assert way.max() < 1.5 * own.max() + 1.0


@pytest.mark.parametrize("share", [0.0, 0.05, 0.5, 1.0])
def test_missing_pictures(share):
    scene = tyre_scene(FAMILY, num_stages=60)
    for seed in SEEDS:
        missing = missing_camera(scene, share, seed)
        assert len(missing) == round(60 * share)
        assert set(missing) <= set(range(1, 61))
        assert set(missing.values()) <= {0, 1, 2, 3}
        assert list(missing) == sorted(missing)
    if share == 0.5:
        assert missing_camera(scene, share, 0) != missing_camera(scene, share, 1)
        assert set(missing.values()) == {0, 1, 2, 3}


@pytest.mark.parametrize("blur_px", [0.5, 3.0])
@pytest.mark.parametrize("name", ["tyre", "bar"])
def test_blur_is_the_fastest_image_motion(name, blur_px):
    if name == "tyre":
        scene = tyre_scene(FAMILY, num_stages=100)
    else:
        scene = scale_bar_scene(FAMILY, num_stages=24, seed=1)
    scene = replace(scene, exposure_s=exposure_for_blur(scene, blur_px))
    rows = np.flatnonzero(scene.marks.is_target)
    longest = 0.0
    for stage in range(1, scene.num_stages + 1):
        targets = scene.targets(scene.time_s(stage))
        for camera in scene.rig.cameras.values():
            seen = Renderer(camera).truth(targets).visible[rows]
            begin, end = (
                project(camera, p[rows][seen] @ camera.rotation.T + camera.translation_mm)
                for p in (targets.centre_mm, targets.end_centre_mm)
            )
            longest = max(longest, float(np.linalg.norm(end - begin, axis=1).max(initial=0)))
    # Chord for tangent: T^2 / 24 of the third derivative, below 1e-3 in exposures of 4 ms.
    assert longest == pytest.approx(blur_px, rel=2e-3)


def test_blur_needs_a_motion():
    still = calibration_scene(FAMILY, num_orientations=2)
    with pytest.raises(ValueError, match="nothing moves"):
        exposure_for_blur(still, 1.0)
    for wrong in (-1.0, math.nan, math.inf):
        with pytest.raises(ValueError, match="blur: expected 0 px or more"):
            exposure_for_blur(scale_bar_scene(FAMILY), wrong)


def test_the_light_of_each_camera_is_its_own():
    camera = tyre_scene(FAMILY).rig.cameras["cam1"]
    conditions = Conditions(spots=4, clutter=0.2, gradient=(0.1, 0.2))
    first, second = (conditions.background(camera, k) for k in (0, 1))
    assert len(first.spots) == len(second.spots) == 4
    assert first.seed != second.seed
    assert first == conditions.background(camera, 0)
    assert conditions.illumination().gradient == (0.1, 0.2)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"bit_depth": 10}, "bits: expected 8, 12 or 16, got 10"),
        ({"contrast_noise": 0.0}, "contrast over noise: expected more than 0"),
        ({"contrast_noise": -75.0}, "noise cannot be negative"),
        ({"contrast_noise": math.nan}, "contrast"),
        ({"psf_sigma_px": -0.1}, "PSF"),
        ({"psf_sigma_px": math.nan}, "PSF"),
        ({"clutter": 1.1}, "clutter: expected a share from 0 to 1, got 1.1"),
        ({"occluded": -0.1}, "occluded"),
        ({"missing": math.nan}, "missing"),
        ({"gradient": (1.0, 0.9)}, "gradient"),
        ({"gradient": (math.nan, 0.0)}, "gradient"),
        ({"spots": -1}, "spots"),
        ({"seed": -1}, "seed: expected a whole number from 0 on"),
    ],
)
def test_impossible_conditions(options, message):
    with pytest.raises(ValueError, match=message):
        Conditions(**options)


def test_impossible_shares():
    scene = tyre_scene(FAMILY, num_stages=2)
    for wrong in (-0.1, 1.1, math.nan):
        with pytest.raises(ValueError, match="occluded: expected a share"):
            occluded(scene, wrong, 0)
        with pytest.raises(ValueError, match="missing: expected a share"):
            missing_camera(scene, wrong, 0)
