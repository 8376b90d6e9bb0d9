"""A simulated network with its truth, as arrays and as the files of the command."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from videogrammetry.calibration.network_input import (
    NetworkCamera,
    NetworkImage,
    NetworkInput,
    NetworkObservations,
    NetworkPoints,
    ScaleBars,
)
from videogrammetry.geometry import project, rotation_from_vector
from videogrammetry.project import format_csv
from videogrammetry.types import RigCamera

SIZE = (1600, 1200)
R0_PX = 600.0
#: f, x0, y0, A1, A2, A3, B1, B2, E1, E2
INTERIOR = np.array([2000.0, 6.0, -4.0, -2e-8, 3e-15, 0.0, 2e-7, -1e-7, 0.0, 0.0])
SIGMA_PX = 0.05
FIXED = 4


@dataclass(frozen=True)
class Simulated:
    """The tables with errors, and the truth behind them."""

    network: NetworkInput
    position_mm: np.ndarray
    rotation: np.ndarray
    translation_mm: np.ndarray
    interior: np.ndarray


def object_points(seed: int = 3, flat: bool = False) -> np.ndarray:
    """30 points in a box of a metre, half a metre deep; the first four its corners."""
    rng = np.random.default_rng(seed)
    points = rng.uniform([-500, -400, -150], [500, 400, 150], (30, 3))
    points[:4] = [[-480, -380, 100], [480, -380, -100], [480, 380, 100], [-480, 380, -100]]
    if flat:
        points[:, 2] = 0.0
    return points


def poses(count: int = 10, tilt: float = 0.6) -> tuple[np.ndarray, np.ndarray]:
    """Convergent pictures around the box, every other one turned by 90 degrees."""
    rotation, translation = [], []
    for i in range(count):
        turn = 2 * np.pi * i / count
        look = rotation_from_vector([tilt * np.cos(turn), tilt * np.sin(turn), 0.0])
        roll = rotation_from_vector([0.0, 0.0, (i % 4) * np.pi / 2 + 0.1 * i])
        rotation.append(roll @ look)
        translation.append([5.0 * (i % 3), -4.0 * (i % 2), 1900.0 + 20 * (i % 5)])
    return np.array(rotation), np.array(translation)


def simulate(
    seed: int = 1,
    *,
    sigma_px: float = SIGMA_PX,
    count: int = 10,
    free: tuple[str, ...] | None = ("f", "x0", "y0", "A1", "A2", "B1", "B2"),
    kind: str = "fixed",
    bars: int = 0,
    flat: bool = False,
    tilt: float = 0.6,
    start_mm: float = 2.0,
    aspect: float = 0.0,
) -> Simulated:
    """A network of one camera.

    ``kind``: the first four points are so ("fixed", "weighted" by 0.05 mm), or all
    are "free"; every point has a start value that errs by ``start_mm``.
    """
    rng = np.random.default_rng(seed)
    truth = object_points(flat=flat)
    rotation, translation = poses(count, tilt)
    image, point, xy = [], [], []
    for i in range(count):
        camera = RigCamera(
            image_size_px=SIZE, interior=INTERIOR, r0_px=R0_PX,
            rotation=rotation[i], translation_mm=translation[i],
        )  # fmt: skip
        ideal = project(camera, truth @ rotation[i].T + translation[i])
        centre = (np.array(SIZE) - 1) / 2 + INTERIOR[1:3]
        # The pixel's height is (1 + aspect) of its width.
        pixels = np.stack(
            [ideal[:, 0], centre[1] + (ideal[:, 1] - centre[1]) / (1 + aspect)], axis=1
        )
        inside = ((pixels > 2) & (pixels < np.array(SIZE) - 3)).all(axis=1)
        image.append(np.full(inside.sum(), i))
        point.append(np.flatnonzero(inside))
        xy.append(pixels[inside])
    xy_px = np.concatenate(xy)
    xy_px = xy_px + rng.normal(0, sigma_px, xy_px.shape)
    kinds = np.full(len(truth), "free", dtype="<U8")
    start = truth + rng.normal(0, start_mm, truth.shape)
    cov = np.full((len(truth), 3, 3), np.nan)
    if kind == "fixed":
        kinds[:FIXED] = "fixed"
        start[:FIXED] = truth[:FIXED]
    elif kind == "weighted":
        kinds[:FIXED] = "weighted"
        start[:FIXED] = truth[:FIXED] + rng.normal(0, 0.05, (FIXED, 3))
        cov[:FIXED] = 0.05**2 * np.eye(3)
    ends = np.array([[0, 1], [1, 2], [2, 3], [3, 0], [0, 2]][:bars], int).reshape(-1, 2)
    length = np.linalg.norm(truth[ends[:, 0]] - truth[ends[:, 1]], axis=1)
    interior = np.zeros(10)
    interior[0] = 1980.0
    network = NetworkInput(
        cameras=(
            NetworkCamera(
                name="hand", image_size_px=SIZE, interior=interior, r0_px=R0_PX, free=free
            ),
        ),
        images=tuple(NetworkImage(name=f"p{i:02d}", camera=0) for i in range(count)),
        points=NetworkPoints(
            name=tuple(f"T{i}" for i in range(len(truth))),
            position_mm=start,
            kind=kinds,
            cov_mm2=cov,
        ),
        observations=NetworkObservations(
            image=np.concatenate(image).astype(np.int32),
            point=np.concatenate(point).astype(np.int32),
            xy_px=xy_px,
            cov_px2=np.tile([sigma_px**2, 0, sigma_px**2], (len(xy_px), 1)),
        ),
        scale_bars=ScaleBars(
            point_a=ends[:, 0].astype(np.int32),
            point_b=ends[:, 1].astype(np.int32),
            length_mm=length + rng.normal(0, 0.01, len(length)),
            sigma_mm=np.full(len(length), 0.01),
        ),
        sigma_px=sigma_px,
        datum="free" if kind == "free" else kind,
        critical_value=0.0,
    )
    return Simulated(network, truth, rotation, translation, INTERIOR)


def change(simulated: Simulated, **fields: object) -> NetworkInput:
    """The network with other tables."""
    return dataclasses.replace(simulated.network, **fields)


def move_observation(network: NetworkInput, row: int, by_px: tuple[float, float]) -> NetworkInput:
    """The network with one gross error."""
    xy = network.observations.xy_px.copy()
    xy[row] += by_px
    return dataclasses.replace(
        network, observations=dataclasses.replace(network.observations, xy_px=xy)
    )


def write_network(folder: Path, network: NetworkInput, more: str = "") -> Path:
    """The network as network.toml and its tables."""
    camera = network.cameras[0]
    seen, points, bars = network.observations, network.points, network.scale_bars
    names = points.name
    (folder / "observations.csv").write_text(
        format_csv(
            ("image", "point", "x_px", "y_px"),
            [
                [network.images[i].name for i in seen.image],
                [names[i] for i in seen.point],
                *seen.xy_px.T,
            ],
        )
    )
    header = ["id", "x_mm", "y_mm", "z_mm"]
    columns: list[object] = [names, *points.position_mm.T]
    if (points.kind == "weighted").any():
        header += ["sigma_x_mm", "sigma_y_mm", "sigma_z_mm"]
        columns += [*np.sqrt(np.diagonal(points.cov_mm2, axis1=1, axis2=2)).T]
    (folder / "points.csv").write_text(format_csv(header, columns))
    fixed = ", ".join(f'"{n}"' for n, k in zip(names, points.kind, strict=True) if k == "fixed")
    lines = [
        "schema = 1",
        'observations = "observations.csv"',
        'points = "points.csv"',
        f"sigma_px = {network.sigma_px}",
    ]
    if fixed:
        lines.append(f"fixed = [{fixed}]")
    if len(bars):
        (folder / "bars.csv").write_text(
            format_csv(
                ("point_a", "point_b", "length_mm", "sigma_mm"),
                [[names[i] for i in bars.point_a], [names[i] for i in bars.point_b],
                 bars.length_mm, bars.sigma_mm],
            )
        )  # fmt: skip
        lines.append('scale_bars = "bars.csv"')
    if more:
        lines.append(more)
    free = ", ".join(f'"{n}"' for n in camera.free or ())
    lines += [
        f"[cameras.{camera.name}]",
        f"image_size_px = [{camera.image_size_px[0]}, {camera.image_size_px[1]}]",
        f"f_px = {camera.interior[0]}",
        f"r0_px = {camera.r0_px}",
    ]
    if camera.free is not None:
        lines.append(f"free = [{free}]")
    path = folder / "network.toml"
    path.write_text("\n".join(lines) + "\n")
    return path
