"""Hand-held photographs of a two-sided cross as tables, with the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from videogrammetry.calibration.network_frame import robust_similarity
from videogrammetry.calibration.network_input import (
    NetworkCamera,
    NetworkImage,
    NetworkInput,
    NetworkObservations,
    NetworkPoints,
)
from videogrammetry.geometry import default_r0_px, project
from videogrammetry.types import FloatArray, IntArray, RigCamera

SIZE_PX = (2592, 1728)
INTERIOR = np.array([2600.0, 14, -9, -2.4e-8, 2.5e-15, 0, 3e-7, -2e-7, 0, 0])
#: Largest angle between a target's normal and the line of sight.
_MAX_TILT = np.cos(np.radians(65))


@dataclass(frozen=True, kw_only=True)
class Truth:
    """Positions (N, 3) of coded then un-coded points; ``identity`` (M,) of every
    observation in them, -1 of clutter; ``wrong`` (M,) gross errors and swapped numbers."""

    position: FloatArray
    normal: FloatArray
    num_coded: int
    identity: IntArray
    wrong: np.ndarray
    rotation: FloatArray
    translation: FloatArray
    interior: FloatArray


def cross_points(
    rng: np.random.Generator, coded: int, uncoded: int, *, plane: bool = False
) -> tuple[FloatArray, FloatArray, int]:
    """Positions and normals: half of each on either side, 20 mm apart; coded ones first."""
    position, normal = [], []
    for count in (coded, uncoded):
        for side in (-1.0, 1.0):
            if plane and side > 0:
                continue
            number = count if plane else count // 2
            across = rng.uniform(-130, 130, number)
            along = rng.uniform(-520, 520, number)
            upright = rng.random(number) < 0.5
            x, y = np.where(upright, across, along), np.where(upright, along, across)
            z = np.zeros(number) if plane else side * 10 + 0.0001 * x * y
            position.append(np.stack([x, y, z], axis=1))
            normal.append(np.tile([0, 0, side], (number, 1)))
    return np.concatenate(position), np.concatenate(normal), coded


def boards(count: int) -> tuple[FloatArray, FloatArray]:
    """Targets on boards round the cross that lean back by 45 degrees: they tie its sides."""
    azimuth = 2 * np.pi * (np.arange(count) + 0.5) / count
    out = np.stack([np.sin(azimuth), np.zeros(count), -np.cos(azimuth)], axis=1)
    height = np.where(np.arange(count) % 2, 540.0, 640.0)
    position = 700.0 * out + height[:, None] * [0, 1, 0]
    return position, (out + np.array([0, -1, 0])) / np.sqrt(2)


def stations(
    rng: np.random.Generator, count: int, azimuths: Sequence[float], distance: float = 2400.0
) -> tuple[FloatArray, FloatArray]:
    """Poses of a hand that goes round: heights change, every third picture is rolled."""
    rotations, translations = [], []
    for k in range(count):
        azimuth = azimuths[k] + rng.normal(0, 0.05)
        height = (-300.0, -900.0, -1500.0)[k % 3]
        stand = [distance * np.sin(azimuth), height, -distance * np.cos(azimuth)]
        stand = np.array(stand) + rng.normal(0, 60, 3)
        forward = rng.normal(0, 50, 3) + np.array([0, 100, 0]) - stand
        forward /= np.linalg.norm(forward)
        right = np.cross([0, 1, 0], forward)
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(forward, right), forward])
        roll = np.pi / 2 * (k % 3 == 1) + rng.normal(0, 0.05)
        c, s = np.cos(roll), np.sin(roll)
        rotation = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ rotation
        rotations.append(rotation)
        translations.append(-rotation @ stand)
    return np.array(rotations), np.array(translations)


def sighted(camera, rotation, translation, position, normal):
    """Points that a picture shows, facing it and inside it, and where."""
    sight = -rotation.T @ translation - position
    sight /= np.linalg.norm(sight, axis=1, keepdims=True)
    pixel = project(camera, position @ rotation.T + translation)
    with np.errstate(invalid="ignore"):
        seen = np.sum(sight * normal, axis=1) > _MAX_TILT
        seen &= ((pixel > 5) & (pixel < np.array(SIZE_PX) - 6)).all(axis=1)
    point = np.flatnonzero(seen)
    return point, pixel[point]


def as_network(count, num_coded, noise_px, f_start, image, point, xy) -> NetworkInput:
    """Pictures of one camera whose interior is not known, nor any point."""
    return NetworkInput(
        cameras=(
            NetworkCamera(
                name="hand",
                image_size_px=SIZE_PX,
                interior=np.r_[np.nan if f_start is None else f_start, np.zeros(9)],
                r0_px=default_r0_px(SIZE_PX),
            ),
        ),
        images=tuple(NetworkImage(name=f"IMG_{k + 1:03d}", camera=0) for k in range(count)),
        points=NetworkPoints(
            name=tuple(str(k + 1) for k in range(num_coded)),
            position_mm=np.full((num_coded, 3), np.nan),
            kind=np.full(num_coded, "free"),
        ),
        observations=NetworkObservations(
            image=image.astype(np.int32),
            point=point.astype(np.int32),
            xy_px=xy,
            cov_px2=np.tile([noise_px**2, 0.0, noise_px**2], (len(xy), 1)),
        ),
    )


def photographs(
    seed: int,
    *,
    count: int = 20,
    coded: int = 98,
    uncoded: int = 0,
    tie: int = 32,
    plane: bool = False,
    azimuths: Sequence[float] | None = None,
    noise_px: float = 0.05,
    gross: float = 0.0,
    swapped: int = 0,
    clutter: int = 0,
    f_start: float | None = None,
    interior: FloatArray = INTERIOR,
) -> tuple[NetworkInput, Truth]:
    """The network as recognition would give it, and the truth.

    ``gross``: share of image points off by 5 to 200 px; ``swapped``: pairs of numbers
    exchanged, each in one picture; ``f_start``: None = unknown.
    """
    rng = np.random.default_rng(seed)
    position, normal, _ = cross_points(rng, coded, uncoded, plane=plane)
    if tie:
        extra, extra_normal = boards(tie)
        position = np.concatenate([position[:coded], extra, position[coded:]])
        normal = np.concatenate([normal[:coded], extra_normal, normal[coded:]])
    num_coded = coded + tie
    if azimuths is None:
        azimuths = 2 * np.pi * np.arange(count) / count
        if plane:
            azimuths = np.linspace(-0.7, 0.7, count)
    rotation, translation = stations(rng, count, azimuths)
    camera = RigCamera(
        image_size_px=SIZE_PX, interior=interior, r0_px=default_r0_px(SIZE_PX),
        rotation=np.eye(3), translation_mm=np.zeros(3),
    )  # fmt: skip
    image, identity, xy = [], [], []
    for k in range(count):
        point, pixel = sighted(camera, rotation[k], translation[k], position, normal)
        pixel = pixel + rng.normal(0, noise_px, (len(point), 2))
        if clutter:
            point = np.concatenate([point, np.full(clutter, -1)])
            spots = rng.uniform([5, 5], np.array(SIZE_PX) - 6, (clutter, 2))
            pixel = np.concatenate([pixel, spots])
        image.append(np.full(len(point), k))
        identity.append(point)
        xy.append(pixel)
    image, identity, xy = np.concatenate(image), np.concatenate(identity), np.concatenate(xy)
    point = np.where(identity < num_coded, identity, -1)
    wrong = (rng.random(len(point)) < gross) & (point >= 0)
    direction = rng.uniform(0, 2 * np.pi, len(point))
    length = rng.uniform(5, 200, len(point)) * wrong
    xy = xy + length[:, None] * np.stack([np.cos(direction), np.sin(direction)], axis=1)
    for _ in range(swapped):
        rows = np.flatnonzero((image == rng.integers(count)) & (point >= 0) & ~wrong)
        a, b = rng.choice(rows, 2, replace=False)
        point[[a, b]] = point[[b, a]]
        wrong[[a, b]] = True
    network = as_network(count, num_coded, noise_px, f_start, image, point, xy)
    truth = Truth(
        position=position, normal=normal, num_coded=num_coded, identity=identity, wrong=wrong,
        rotation=rotation, translation=translation, interior=interior,
    )  # fmt: skip
    return network, truth


def with_known(
    network: NetworkInput, truth: Truth, points: Sequence[int], kind: str = "fixed"
) -> NetworkInput:
    """The network with the true coordinates of some points stated."""
    position = network.points.position_mm.copy()
    kinds = network.points.kind.astype("U8")
    position[list(points)], kinds[list(points)] = truth.position[list(points)], kind
    return replace(network, points=replace(network.points, position_mm=position, kind=kinds))


def position_errors(network: NetworkInput, truth: Truth) -> FloatArray:
    """(K,) distances of the placed coded points from the truth after a similarity."""
    count = truth.num_coded
    placed = np.isfinite(network.points.position_mm[:count, 0])
    found, true = network.points.position_mm[:count][placed], truth.position[:count][placed]
    fit = robust_similarity(true, found)
    result: FloatArray = np.linalg.norm(fit.points(found) - true, axis=1)
    return result
