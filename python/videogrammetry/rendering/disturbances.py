"""What goes wrong in a laboratory: noise, things in the way, pictures that are missing."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from videogrammetry.geometry import project
from videogrammetry.rendering.options import Background, Illumination, Sensor, SpecularSpot
from videogrammetry.rendering.scenes.base import (
    Marks,
    Placement,
    Scene,
    bodies,
    join,
    join_placements,
)
from videogrammetry.types import FloatArray, RigCamera

# Reflectances of the targets (scenes.base) and the light's level: what contrast means.
_WHITE, _BLACK, _LEVEL = 0.8, 0.06, 0.9
#: Read noise as a share of the noise at white; the rest is shot noise.
_READ_SHARE = 0.15
#: How far before its target a patch stands, over the radius of what is printed.
_ABOVE = 0.4
#: A patch's radius over that of what is printed; well below a sticker's.
_PATCH = 0.85


@dataclass(frozen=True, kw_only=True)
class Conditions:
    """How the pictures are taken, and what disturbs them.

    Attributes
    ----------
    bit_depth : 8, 12 or 16. contrast_noise : grey-value difference of white and
        black over the noise's standard deviation at white; inf = no noise.
    psf_sigma_px : of the lens. clutter : of the background, 0 ... 1.
    gradient : the light's relative change over width and height.
    spots : number of specular spots in each camera's picture.
    occluded : share of the targets that something hides, wholly or in part, at
        random at every stage. missing : share of the stages at which one camera
        (at random) delivers an empty picture.
    seed : of everything that is random.
    """

    bit_depth: int = 12
    contrast_noise: float = 75.0
    psf_sigma_px: float = 0.7
    clutter: float = 0.3
    gradient: tuple[float, float] = (0.15, -0.1)
    spots: int = 3
    occluded: float = 0.0
    missing: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        if self.bit_depth not in (8, 12, 16):
            raise ValueError(f"bits: expected 8, 12 or 16, got {self.bit_depth}")
        if isinstance(self.seed, bool) or self.seed < 0:
            raise ValueError(f"seed: expected a whole number from 0 on, got {self.seed}")
        if not self.contrast_noise > 0:
            raise ValueError(
                "contrast over noise: expected more than 0 (noise cannot be negative), got "
                f"{self.contrast_noise:g}; inf means no noise"
            )
        if not 0 <= self.psf_sigma_px <= 10:
            raise ValueError(f"PSF: expected 0 ... 10 px, got {self.psf_sigma_px:g}")
        for name in ("occluded", "missing", "clutter"):
            value = getattr(self, name)
            if not 0 <= value <= 1:
                raise ValueError(f"{name}: expected a share from 0 to 1, got {value:g}")
        if not abs(self.gradient[0]) + abs(self.gradient[1]) < 1.5:
            raise ValueError(f"gradient: expected |x| + |y| below 1.5, got {self.gradient}")
        if not 0 <= self.spots <= 1000:
            raise ValueError(f"spots: expected 0 ... 1000, got {self.spots}")

    def sensor(self) -> Sensor:
        """The sensor whose noise at white gives the contrast over noise.

        Examples
        --------
        >>> sensor = Conditions(contrast_noise=75).sensor()
        >>> noise = (sensor.read_noise**2 + sensor.shot_noise_gain * 0.8 * 0.9 * 4095) ** 0.5
        >>> round((0.8 - 0.06) * 0.9 * 4095 / noise, 6)
        75.0
        """
        full = 2.0**self.bit_depth - 1
        sigma = (_WHITE - _BLACK) * _LEVEL * full / self.contrast_noise
        read = _READ_SHARE * sigma
        return Sensor(
            psf_sigma_px=self.psf_sigma_px,
            bit_depth=self.bit_depth,
            read_noise=read,
            shot_noise_gain=(sigma**2 - read**2) / (_WHITE * _LEVEL * full),
        )

    def illumination(self) -> Illumination:
        """The light."""
        return Illumination(level=_LEVEL, gradient=self.gradient)

    def background(self, camera: RigCamera, index: int) -> Background:
        """What the index-th camera sees behind the targets, and the glare before them."""
        rng = np.random.default_rng([self.seed, 3, index])
        width, height = camera.image_size_px
        spots = tuple(
            SpecularSpot(
                x_px=float(rng.uniform(0, width)),
                y_px=float(rng.uniform(0, height)),
                sigma_px=float(rng.uniform(2, 8)),
                amplitude=float(rng.uniform(0.2, 0.8)),
            )
            for _ in range(self.spots)
        )
        seed = int(rng.integers(2**31))
        return Background(level=0.35, clutter=self.clutter, seed=seed, spots=spots)


def occluded(scene: Scene, share: float, seed: int) -> Scene:
    """The scene with patches before ``share`` of the targets, new ones at every stage.

    A patch is a disc, somewhat before its target and a little aside, and nearly
    as large as what is printed: some targets vanish, others are
    hidden in part. A few that are seen very obliquely look past their patch,
    and a few patches reach over a neighbour, too.

    Raises
    ------
    ValueError
        ``share`` lies outside 0 ... 1.
    """
    if not 0 <= share <= 1:
        raise ValueError(f"occluded: expected a share from 0 to 1, got {share:g}")
    if share == 0:
        return scene
    marks, n = scene.marks, int(scene.marks.is_target.sum())
    rows = np.flatnonzero(marks.is_target)
    printed = marks.radius_mm[rows] * np.where(marks.id[rows] > 0, marks.ring[1], 1.0)
    patches: Marks = bodies(marks, [1.0] * n, [0.4] * n, square=False)
    # Smaller than the sticker, under which a patch lies while it hides nothing.
    patches = replace(patches, sticker_mm=_PATCH * printed, radius_mm=0.3 * printed)

    def place(time_s: float) -> Placement:
        own = scene.place(time_s)
        stage = math.floor(time_s * scene.frame_rate_hz + 1.5)
        rng = np.random.default_rng([seed, 5, max(stage, 0)])
        hidden = rng.uniform(size=n) < share
        aside = rng.uniform(-1.2, 1.2, size=(n, 2)) * (hidden * printed)[:, None]
        at = Placement(
            centre_mm=own.centre_mm[rows], normal=own.normal[rows], x_axis=own.x_axis[rows]
        )
        y_axis = np.cross(at.x_axis, at.normal)
        above = np.where(hidden, _ABOVE * printed, -1.0)[:, None]
        centre = at.centre_mm + aside[:, :1] * at.x_axis + aside[:, 1:] * y_axis
        return join_placements(own, replace(at, centre_mm=centre + above * at.normal))

    return replace(scene, marks=join(marks, patches), place=place)


def missing_camera(scene: Scene, share: float, seed: int) -> dict[int, int]:
    """Stage -> index of the camera whose picture is empty there; ``share`` of the stages.

    Raises
    ------
    ValueError
        ``share`` lies outside 0 ... 1.

    Examples
    --------
    >>> from videogrammetry.recognition import code_family
    >>> from videogrammetry.rendering.scenes import tyre_scene
    >>> scene = tyre_scene(code_family("schneider-14"), num_stages=40)
    >>> len(missing_camera(scene, share=0.05, seed=0))
    2
    """
    if not 0 <= share <= 1:
        raise ValueError(f"missing: expected a share from 0 to 1, got {share:g}")
    rng = np.random.default_rng([seed, 9])
    count = round(share * scene.num_stages)
    stages = np.sort(rng.choice(scene.num_stages, size=count, replace=False)) + 1
    camera = rng.integers(len(scene.rig.cameras), size=count)
    return dict(zip(stages.tolist(), camera.tolist(), strict=True))


def exposure_for_blur(scene: Scene, blur_px: float) -> float:
    """The exposure, s, at which the fastest target moves by ``blur_px`` in a picture.

    The fastest is that with the greatest speed across a picture, at any stage, of
    those that face the camera and lie in its picture.

    Raises
    ------
    ValueError
        ``blur_px`` is below 0 px, or nothing moves in the scene.
    """
    if not 0 <= blur_px < math.inf:
        raise ValueError(f"blur: expected 0 px or more, got {blur_px:g} px")
    rows = np.flatnonzero(scene.marks.is_target)
    step = min(1e-4, 0.1 / scene.frame_rate_hz)
    fastest = 0.0
    for stage in range(1, scene.num_stages + 1):
        time = scene.time_s(stage)
        now, before, after = (scene.place(t) for t in (time, time - step, time + step))
        for camera in scene.rig.cameras.values():
            middle = _in_picture(camera, now.centre_mm[rows])
            facing = ((camera.centre_mm - now.centre_mm) * now.normal).sum(axis=1)[rows] > 0
            limit = np.array(camera.image_size_px) - 0.5
            seen = facing & ((middle > -0.5) & (middle < limit)).all(axis=1)
            way = _in_picture(camera, after.centre_mm[rows][seen]) - _in_picture(
                camera, before.centre_mm[rows][seen]
            )
            speed = np.linalg.norm(way, axis=1) / (2 * step)
            fastest = max(fastest, float(np.nanmax(speed, initial=0.0)))
    if fastest == 0:
        raise ValueError("blur: nothing moves in this scene; leave the blur out")
    return blur_px / fastest


def _in_picture(camera: RigCamera, points_mm: FloatArray) -> FloatArray:
    """Pixels (N, 2); NaN behind the camera."""
    return project(camera, points_mm @ camera.rotation.T + camera.translation_mm)
