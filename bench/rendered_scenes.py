"""Scenes of the project's own renderer for the benches of recognition, and how targets are judged.

Targets as in the rendered pictures of the shared data: dots of 8 to 20 px on
stickers before clutter, some with a ring of code, at most 45 degrees oblique,
before clouds, bars and patches; without round spots, which count as targets.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from videogrammetry import recognition
from videogrammetry.recognition import RecognitionOptions, code_family, recognize
from videogrammetry.rendering import Background, Illumination, Renderer, SceneTargets, Sensor
from videogrammetry.sequence.packing import pack_12bit
from videogrammetry.types import RigCamera

METHODS = ("edge-pair", "local-canny")
ESTIMATORS = ("mean-gradient", "dual-conic", "model")
#: Reflectances of print and sticker, and the light's level.
WHITE, BLACK, LEVEL = 0.8, 0.1, 0.85
#: Share of the noise at white that does not grow with the light.
READ_SHARE = 0.15
#: Standard deviation of the light's relative change over a radius, along either axis.
GRADIENT = 0.003
#: Print differs in brightness from target to target by at most so much.
WHITE_SPREAD = 0.14
PSF_PX = (0.6, 0.8)
#: What moves goes around in circles of this radius, which its cell has room for.
CIRCLE_PX = 7.0


def combinations(methods=METHODS, estimators=ESTIMATORS):
    """(method, estimator) of those that recognition has; says what it has not."""
    known = []
    for method in methods:
        for estimator in estimators:
            try:
                recognize(
                    np.zeros((8, 8), np.uint8),
                    RecognitionOptions(method=method, estimator=estimator),
                )
            except ValueError as error:
                print(f"left out: {method}, {estimator} ({error})")
            else:
                known.append((method, estimator))
    return known


@dataclass(frozen=True, kw_only=True)
class Scene:
    """Light of a picture without noise, as a share of full scale, and what is true of it.

    ``white``, ``black`` are the targets' own grey values as such shares, ``coded``
    which have a ring, ``psf_px`` the lens' blur.
    """

    light: np.ndarray
    centre_px: np.ndarray
    semi_axes_px: np.ndarray
    angle_rad: np.ndarray
    id: np.ndarray
    coded: np.ndarray
    white: np.ndarray
    black: np.ndarray
    psf_px: float

    def __len__(self):
        return len(self.centre_px)


def _orientations(rng, centre, tilt_deg):
    """Normals up to ``tilt_deg`` off the way to the camera, and axes in the planes."""
    n = len(centre)
    towards = -centre / np.linalg.norm(centre, axis=1)[:, None]
    tilt, turn = np.radians(rng.uniform(0, tilt_deg, n)), rng.uniform(0, 2 * math.pi, n)
    side = np.cross(towards, [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side, axis=1)[:, None]
    up = np.cross(towards, side)
    away = np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * up
    normal = np.cos(tilt)[:, None] * towards + np.sin(tilt)[:, None] * away
    x_axis = np.cross(normal, np.cross(away, towards))
    x_axis -= (x_axis * normal).sum(axis=1)[:, None] * normal
    x_axis /= np.linalg.norm(x_axis, axis=1)[:, None]
    y_axis = np.cross(normal, x_axis)
    spin = rng.uniform(0, 2 * math.pi, n)[:, None]
    x_axis = np.cos(spin) * x_axis + np.sin(spin) * y_axis
    return normal, x_axis


def make_scene(seed, **scene):
    """A picture of grid[0] x grid[1] targets, or ``count`` of them, at random places."""
    return next(make_film(seed, 1, **scene))


def make_film(
    seed,
    frames,
    *,
    size=(1024, 1024),
    grid=(7, 7),
    coded=16,
    count=None,
    diameter_px=(8.0, 20.0),
    tilt_deg=45.0,
    clutter=0.6,
    step_px=1.5,
):
    """Pictures in which the targets of a scene move by ``step_px`` from one to the next,
    each on a circle of its own, before a background that stands."""
    rng = np.random.default_rng([seed, 77])
    n = count or math.prod(grid)
    targets = _scattered_targets(rng, n, size, grid, coded, diameter_px, tilt_deg)
    psf = float(rng.uniform(*PSF_PX))
    renderer = _renderer(rng, size, clutter, psf)
    begin = rng.uniform(0, 2 * math.pi, n)
    for k in range(frames):
        turn = begin + k * step_px / CIRCLE_PX
        away = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
        away -= np.stack([np.cos(begin), np.sin(begin), 0 * begin], axis=1)
        moved = replace(targets, centre_mm=targets.centre_mm + CIRCLE_PX * away)
        truth = renderer.truth(moved)
        seen = truth.visible
        yield Scene(
            light=renderer.light(moved),
            centre_px=truth.centre_px[seen],
            semi_axes_px=truth.semi_axes_px[seen],
            angle_rad=truth.angle_rad[seen],
            id=truth.id[seen],
            coded=(targets.num_bits > 0)[seen],
            white=LEVEL * targets.white[seen],
            black=np.full(seen.sum(), LEVEL * BLACK),
            psf_px=psf,
        )


def _focal_length_px(size):
    return 1.5 * max(size)


def _scattered_targets(rng, n, size, grid, coded, diameter_px, tilt_deg):
    """Targets at random places of cells of their own; one millimetre is one pixel where
    a target's plane faces the camera."""
    family = code_family("schneider-14")
    rows, columns = grid
    cell = np.array([size[0] / columns, size[1] / rows])
    place = rng.permutation(rows * columns)[:n]
    radius = 0.5 * rng.uniform(*diameter_px, n)
    has_ring = np.zeros(n, bool)
    has_ring[rng.permutation(n)[:coded]] = True
    # What is printed stays in its cell, 8 px off the border.
    printed = 1.5 * radius * np.where(has_ring, 3.0, 1.6)
    room = np.maximum(0.0, 0.5 * cell[None] - printed[:, None] - 8)
    middle = (np.stack([place % columns, place // columns], axis=1) + 0.5) * cell - 0.5
    xy = middle + rng.uniform(-1, 1, (n, 2)) * room - 0.5 * (np.array(size) - 1)
    centre = np.column_stack([xy, np.full(n, _focal_length_px(size))])
    normal, x_axis = _orientations(rng, centre, tilt_deg)
    ids = np.where(has_ring, rng.permutation(np.arange(n) % len(family.codes)) + 1, -1)
    return SceneTargets(
        centre_mm=centre,
        normal=normal,
        x_axis=x_axis,
        radius_mm=radius,
        id=ids,
        num_bits=np.where(has_ring, 14, 0),
        code=np.where(has_ring, np.array(family.codes)[np.maximum(ids, 1) - 1], 0),
        sticker_mm=np.where(has_ring, 3.6, 1.9) * radius,
        white=WHITE * (1 + rng.uniform(-WHITE_SPREAD, WHITE_SPREAD, n)),
        black=BLACK,
        gradient=rng.normal(0, GRADIENT, (n, 2)),
    )


def _renderer(rng, size, clutter, psf_px):
    camera = RigCamera(
        image_size_px=size,
        interior=np.r_[_focal_length_px(size), np.zeros(9)],
        r0_px=0.4 * max(size),
        rotation=np.eye(3),
        translation_mm=np.zeros(3),
    )
    area = size[0] * size[1] / 1024**2
    background = Background(
        level=0.35,
        clutter=clutter,
        seed=int(rng.integers(2**31)),
        num_discs=0,
        num_lines=round(20 * area),
        num_patches=round(20 * area),
    )
    return Renderer(
        camera,
        background=background,
        illumination=Illumination(level=LEVEL),
        sensor=Sensor(psf_sigma_px=psf_px),
    )


@dataclass(frozen=True, kw_only=True)
class GreyNoise:
    """Variance read^2 + gain grey of a grey value, such that contrast over the standard
    deviation at white is ``contrast_noise`` (inf: none)."""

    bits: int
    contrast_noise: float

    @property
    def full(self):
        return 2.0**self.bits - 1

    @property
    def at_white(self):
        return (WHITE - BLACK) * LEVEL * self.full / self.contrast_noise

    @property
    def read(self):
        return READ_SHARE * self.at_white

    @property
    def gain(self):
        return (self.at_white**2 - self.read**2) / (WHITE * LEVEL * self.full)

    def variance(self, grey):
        return self.read**2 + self.gain * np.maximum(grey, 0.0)

    def picture(self, light, seed):
        """The scene's picture, uint8 or uint16."""
        grey = self.full * light.astype(np.float64)
        if np.isfinite(self.contrast_noise):
            rng = np.random.default_rng([seed, self.bits, round(10 * self.contrast_noise)])
            grey += np.sqrt(self.variance(grey)) * rng.standard_normal(grey.shape, np.float32)
        kind = np.uint8 if self.bits == 8 else np.uint16
        return np.clip(np.rint(grey), 0, self.full).astype(kind)


def match(truth_px, found_px, limit_px=1.0):
    """For each true place the nearest found one's number or -1; and the false ones' numbers."""
    if len(found_px) == 0 or len(truth_px) == 0:
        return np.full(len(truth_px), -1), np.arange(len(found_px))
    gap = np.hypot(*np.moveaxis(truth_px[:, None] - found_px[None], -1, 0))
    nearest = gap.argmin(axis=1)
    hit = np.where(gap[np.arange(len(truth_px)), nearest] < limit_px, nearest, -1)
    return hit, np.setdiff1d(np.arange(len(found_px)), hit)


def packed_frame(image):
    """The picture's 12-bit samples packed as in Photron's files, as recognition takes them.

    None where recognition has no such frames: ``videogrammetry.recognition.PackedFrame``.
    """
    kind = getattr(recognition, "PackedFrame", None)
    return None if kind is None else kind(pack_12bit(image), image.shape)
