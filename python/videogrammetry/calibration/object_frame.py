"""The frame of a measured object: on its own axes, or on the coordinates of a drawing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from videogrammetry.calibration.network_input import NetworkInput
from videogrammetry.calibration.network_result import NetworkAdjustment
from videogrammetry.errors import CalibrationError
from videogrammetry.geometry import fit_rigid
from videogrammetry.types import FloatArray


def own_axes(points_mm: FloatArray, towards_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Origin at the points' mean, x along their longest, y along the next extent.

    z points towards ``towards_mm`` (3,), where the first picture was taken from, or away
    from it, so that x, y, z are right-handed with x towards the last point.
    """
    centre = points_mm.mean(axis=0)
    axes = np.linalg.svd(points_mm - centre, full_matrices=False)[2]
    z = axes[2] * (np.sign(axes[2] @ (towards_mm - centre)) or 1.0)
    x = axes[0] * (np.sign(axes[0] @ (points_mm[-1] - centre)) or 1.0)
    rotation = np.stack([x, np.cross(z, x), z])
    return rotation, -rotation @ centre


def moved_network(
    network: NetworkInput,
    result: NetworkAdjustment,
    rotation: FloatArray,
    shift_mm: FloatArray,
    scale: float = 1.0,
) -> NetworkInput:
    """The network with the result's values as start values, carried to another frame.

    new = ``rotation`` (``scale`` old) + ``shift_mm``; a scale other than 1 is for networks
    that nothing else gives one.
    """
    at = {name: i for i, name in enumerate(result.images.name)}
    images = []
    for image in network.images:
        if image.name not in at:
            images.append(image)
            continue
        i = at[image.name]
        turned = result.images.rotation[i] @ rotation.T
        shift = scale * result.images.translation_mm[i] - turned @ shift_mm
        images.append(replace(image, rotation=turned, translation_mm=shift))
    row = {name: i for i, name in enumerate(result.points.name)}
    positions = np.full((len(network.points), 3), np.nan)
    for i, name in enumerate(network.points.name):
        if name in row:
            positions[i] = rotation @ (scale * result.points.position_mm[row[name]]) + shift_mm
    return replace(
        network, images=tuple(images), points=replace(network.points, position_mm=positions)
    )


def drawing_fit(
    result: NetworkAdjustment, names: tuple[str, ...], drawn_mm: FloatArray, has_scale: bool
) -> tuple[FloatArray, FloatArray, float]:
    """Rotation, shift and scale onto the coordinates of a drawing, by the points of equal names.

    The scale is 1 where the network has one of its own (``has_scale``).

    Raises
    ------
    CalibrationError : fewer than three points in common, or all of them on a line.
    """
    row = {name: i for i, name in enumerate(result.points.name)}
    common = [(row[name], k) for k, name in enumerate(names) if name in row]
    if len(common) < 3:
        raise CalibrationError(
            f"the table of nominal coordinates and the photographs have {len(common)} points in "
            "common; three that are not on one line are needed to place the object: are they "
            "named by the same numbers?"
        )
    measured = result.points.position_mm[[i for i, _ in common]]
    wanted = drawn_mm[[k for _, k in common]]
    extents = np.linalg.svd(wanted - wanted.mean(axis=0), compute_uv=False)
    if extents[1] < 1e-3 * extents[0]:
        raise CalibrationError(
            "the points that the table of nominal coordinates and the photographs have in common "
            "lie on one line, about which the object could turn; add points beside it"
        )
    spread = np.linalg.norm(measured - measured.mean(axis=0))
    scale = 1.0 if has_scale else float(np.linalg.norm(wanted - wanted.mean(axis=0)) / spread)
    rotation, shift, _ = fit_rigid(wanted, scale * measured)
    return rotation, shift, scale
