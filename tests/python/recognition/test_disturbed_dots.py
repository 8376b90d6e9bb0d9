"""Dots of 9.5 px in rings of code, behind patches and under glare: errors against their sigmas.

At contrast / noise 75, as a camera 12 m away sees dots of 43 mm.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from videogrammetry.recognition import RecognitionOptions, code_family, recognize
from videogrammetry.rendering import Background, Renderer, SceneTargets, SpecularSpot
from videogrammetry.rendering.disturbances import Conditions
from videogrammetry.types import RigCamera

FAMILY = code_family("schneider-14")
CODED = RecognitionOptions(codes="schneider-14")
CONDITIONS = Conditions(contrast_noise=75.0, gradient=(0.0, 0.0), clutter=0.0, spots=0)
FOCAL_PX, DEPTH_MM, DIAMETER_PX = 2640.0, 12000.0, 9.5
MM_PER_PX = DEPTH_MM / FOCAL_PX
RADIUS_MM = 0.5 * DIAMETER_PX * MM_PER_PX
ROWS, COUNT = 9, 81
SEEDS = (1, 2, 3)
CAMERA = RigCamera(
    image_size_px=(480, 480), interior=np.r_[FOCAL_PX, np.zeros(9)], r0_px=0.0,
    rotation=np.eye(3), translation_mm=np.zeros(3),
)  # fmt: skip


def board(rng, tilt_deg: float, coded: bool) -> dict:
    """A grid of dots at random sub-pixel places, each tilted about an axis of its own."""
    place = (np.arange(ROWS) - ROWS // 2) * 5.2 * DIAMETER_PX
    grid = np.stack(np.meshgrid(place, place), axis=-1).reshape(-1, 2)
    grid = MM_PER_PX * (grid + rng.uniform(-0.5, 0.5, grid.shape))
    angle = rng.uniform(0, 2 * np.pi, COUNT)
    axis = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(COUNT)])
    turn = Rotation.from_rotvec(np.deg2rad(tilt_deg) * axis).as_matrix()
    code = rng.permutation(len(FAMILY.codes))[:COUNT]
    return {
        "centre_mm": np.column_stack([grid, np.full(COUNT, DEPTH_MM)]),
        "normal": -turn[:, :, 2],
        "x_axis": turn[:, :, 0],
        "radius_mm": np.full(COUNT, RADIUS_MM),
        "num_bits": np.full(COUNT, 14 if coded else 0),
        "code": np.array(FAMILY.codes)[code] if coded else np.zeros(COUNT, dtype=int),
        "sticker_mm": np.full(COUNT, 3.8 * RADIUS_MM),
        "white": np.full(COUNT, 0.8),
        "black": np.full(COUNT, 0.06),
        "square": np.ones(COUNT, dtype=bool),
    }


def patches(rng, dots: dict) -> tuple[dict, np.ndarray]:
    """A large grey disc before a part of each dot, and by how much it reaches in, in radii."""
    angle = rng.uniform(0, 2 * np.pi, COUNT)
    inwards = rng.uniform(0.1, 1.9, COUNT)
    radius = 3.0 * RADIUS_MM  # smaller ones inside a dot would be dots themselves
    aside = radius + (1.0 - inwards) * RADIUS_MM
    way = np.column_stack([np.cos(angle) * aside, np.sin(angle) * aside, np.full(COUNT, -90.0)])
    grey = {
        **dots,
        "centre_mm": dots["centre_mm"] + way,
        "normal": np.tile([0.0, 0.0, -1.0], (COUNT, 1)),
        "x_axis": np.tile([1.0, 0.0, 0.0], (COUNT, 1)),
        "num_bits": np.zeros(COUNT, dtype=int),
        "code": np.zeros(COUNT, dtype=int),
        "radius_mm": np.full(COUNT, 0.5 * radius),
        "sticker_mm": np.full(COUNT, radius),
        "white": np.full(COUNT, 0.4),
        "black": np.full(COUNT, 0.4),
        "square": np.zeros(COUNT, dtype=bool),
    }
    return grey, inwards


def rendered(dots: dict, seed: int, spots=()):
    """The picture and the true centres of the dots, the first ``COUNT``."""
    renderer = Renderer(
        CAMERA,
        background=Background(level=0.35, clutter=0.0, seed=0, spots=tuple(spots)),
        illumination=CONDITIONS.illumination(),
        sensor=CONDITIONS.sensor(),
    )
    frame = renderer.render(SceneTargets(**dots), seed=seed)
    return frame.image, frame.truth.centre_px[:COUNT]


def errors(image, truth, within_px: float, method: str = "edge-pair"):
    """Errors (N, 2) of the targets within that distance of a true centre, their sigmas, which."""
    targets = recognize(image, dataclasses.replace(CODED, method=method))
    gap = np.linalg.norm(truth[:, None] - targets.centre_px, axis=2)
    nearest = gap.argmin(axis=1)
    found = np.flatnonzero(gap[np.arange(len(truth)), nearest] < within_px)
    error = targets.centre_px[nearest[found]] - truth[found]
    return error, targets.sigma_px[nearest[found]], found


@pytest.mark.parametrize("tilt_deg", [0, 15, 30, 45])
def test_a_ring_of_code_does_not_disturb_its_dot(tilt_deg):
    rms = {}
    for coded in (False, True):
        error, sigma = [], []
        for seed in SEEDS:
            dots = board(np.random.default_rng(seed), tilt_deg, coded)
            e, s, found = errors(*rendered(dots, seed), within_px=1)
            assert len(found) == COUNT, f"seed {seed}"
            error.append(e)
            sigma.append(s)
        error, sigma = np.concatenate(error), np.concatenate(sigma)
        rms[coded] = np.sqrt((error**2).mean())
        # 486 normalised errors: their RMS scatters by 1 / sqrt(2 * 486) = 0.03.
        assert 0.8 < np.sqrt(((error / sigma) ** 2).mean()) < 1.25, f"coded {coded}"
    # The same noise on both; measured 1.00 to 1.29: before a ring less ground is free to say
    # how the light changes. A ring in the half-way level made it 1.5.
    assert rms[True] < 1.4 * rms[False]


@pytest.mark.parametrize(("method", "most_wrong"), [("local-canny", 0.0), ("edge-pair", 0.02)])
@pytest.mark.parametrize("coded", [False, True])
def test_dots_hidden_in_part_are_left_out_or_right(coded, method, most_wrong):
    reported = wrong = 0
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        dots = board(rng, 20, coded)
        grey, inwards = patches(rng, dots)
        both = {k: np.concatenate([dots[k], grey[k]]) for k in dots}
        error, sigma, found = errors(*rendered(both, seed), 0.5 * DIAMETER_PX, method)
        off = np.abs(error / sigma).max(axis=1)
        # All dots are hidden in part here: the fast method may take what they leave for
        # noise where it learns from this picture alone.
        wrong += int((off >= 5).sum())
        reported += len(found)
        # What is right lacks two thirds of a radius at most, and says so in its sigma.
        assert (inwards[found[off < 5]] < 0.9).all(), f"seed {seed}"
    assert wrong <= most_wrong * COUNT * len(SEEDS)
    # A tenth of them, or a little more: those are reached by 0.1 to 0.3 radii, of 0.1 to 1.9.
    assert reported < 0.2 * COUNT * len(SEEDS)


@pytest.mark.parametrize("coded", [False, True])
def test_dots_under_glare_know_of_it(coded):
    off = []
    for seed in range(1, 17):
        rng = np.random.default_rng(seed)
        dots = board(rng, 20, coded)
        _, truth = rendered(dots, seed)
        under = rng.permutation(COUNT)[: COUNT // 3]
        spots = [
            SpecularSpot(
                x_px=float(x), y_px=float(y),
                sigma_px=float(rng.uniform(2, 8)), amplitude=float(rng.uniform(0.2, 0.8)),
            )
            for x, y in truth[under] + rng.uniform(-DIAMETER_PX, DIAMETER_PX, (len(under), 2))
        ]  # fmt: skip
        image, truth = rendered(dots, seed, spots)
        error, sigma, _ = errors(image, truth[under], within_px=0.5 * DIAMETER_PX)
        off.append(np.abs(error / sigma).max(axis=1))
    off = np.concatenate(off)
    # A spot of 2 to 8 px within a diameter. Of 60 seeds 93 % (plain) and 94 % (coded) of the 45 %
    # that are reported lie within 6 sigmas, 87 and 89 % where the spot's own middle lies on the
    # dot: short of 95 %. From 190 dots, the share scatters by 0.018.
    assert len(off) > 150
    assert (off < 6).mean() > 0.93 - 3 * 0.018
