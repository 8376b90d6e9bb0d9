"""From tables to the network that is adjusted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from videogrammetry.adjustment import Network
from videogrammetry.calibration.bundle import DISTORTION_NAMES
from videogrammetry.calibration.network_input import NetworkCamera, NetworkInput
from videogrammetry.types import INTERIOR_NAMES, FloatArray, RigCamera


@dataclass(frozen=True, kw_only=True)
class Built:
    """The network of the tables.

    ``poses``: its pose of each picture; ``given``: the cameras as the user gave them,
    whose values hold what is not estimated, and from which significance counts.
    """

    network: Network
    given: tuple[NetworkCamera, ...]
    poses: tuple[int, ...]
    warnings: tuple[str, ...]


def free_names(camera: NetworkCamera) -> tuple[str, ...]:
    """What is estimated at first; ``free = None``: all ten."""
    return INTERIOR_NAMES if camera.free is None else camera.free


def offered_names(network: NetworkInput) -> list[tuple[str, ...]]:
    """Per camera, what the test of significance may drop: nothing that was asked for."""
    return [
        tuple(n for n in DISTORTION_NAMES if n not in camera.sigma) if camera.free is None else ()
        for camera in network.cameras
    ]


def start_values(given: NetworkCamera, found: NetworkCamera) -> FloatArray:
    """(12,) what is held or observed: as given, an unknown f as found."""
    values = np.append(given.interior, [given.aspect, 0.0])
    values[0] = values[0] if np.isfinite(values[0]) else found.interior[0]
    return values


def build_network(
    tables: NetworkInput, given: Sequence[NetworkCamera], *, eccentricity: bool
) -> Built:
    """The adjustment's network: a pose a picture, points by kind, bars, circles, datum."""
    network = Network()
    for camera, original in zip(tables.cameras, given, strict=True):
        network.add_camera(
            camera.name,
            RigCamera(
                image_size_px=camera.image_size_px,
                interior=camera.interior,
                r0_px=camera.r0_px,
                rotation=np.eye(3),
                translation_mm=np.zeros(3),
                measured=camera.measured,
            ),
            free=free_names(camera),
            prior_sigma=dict(camera.sigma),
            start=start_values(original, camera),
            aspect=camera.aspect,
            residuals="corrected" if camera.corrected_residual else "measured",
        )
    poses = []
    for image in tables.images:
        if image.rotation is None or image.translation_mm is None:
            raise ValueError(f"images: picture {image.name} has no start pose")
        pose = network.add_pose(image.name, image.rotation, image.translation_mm)
        network.add_image(image.name, image.camera, inner=pose)
        poses.append(pose)
    points = tables.points
    weighted = points.kind == "weighted"
    cov = None
    if weighted.any():
        if points.cov_mm2 is None:
            raise ValueError("points.cov_mm2: expected covariances of the weighted points")
        cov = np.tile(np.eye(3), (len(points), 1, 1))
        cov[weighted] = points.cov_mm2[weighted]
    network.set_points(np.arange(len(points)), points.position_mm, cov, kind=points.kind.tolist())
    if points.full_cov_mm2 is not None and weighted.any():
        rows = np.flatnonzero(weighted)
        network.set_point_prior(rows, points.position_mm[rows], points.full_cov_mm2)
    warnings = _set_circles(network, tables) if eccentricity else []
    bars = tables.scale_bars
    if len(bars):
        network.set_scale_bars(bars.point_a, bars.point_b, bars.length_mm, bars.sigma_mm)
    seen = tables.observations
    network.set_observations(seen.image, seen.point, seen.xy_px, seen.cov_px2)
    network.set_datum(tables.datum)
    return Built(network=network, given=tuple(given), poses=tuple(poses), warnings=tuple(warnings))


def _set_circles(network: Network, tables: NetworkInput) -> list[str]:
    """Circles whose diameter and normal are known have their ellipses' centres modelled."""
    diameter = tables.points.diameter_mm
    if diameter is None or not np.isfinite(diameter).any():
        return []
    normal = tables.points.normal
    whole = np.isfinite(diameter)
    if normal is not None:
        whole &= np.isfinite(normal).all(axis=1)
        network.set_circles(_units(normal), np.where(whole, diameter, np.nan))
    else:
        whole &= False
    missing = int(np.isfinite(diameter).sum() - whole.sum())
    if not missing:
        return []
    return [
        f"{missing} circles have a diameter and no normal: their ellipses' centres are taken for "
        "the centres' pictures; add nx, ny, nz to the points table"
    ]


def _units(normal: FloatArray) -> FloatArray:
    return np.asarray(normal / np.linalg.norm(normal, axis=1, keepdims=True))
