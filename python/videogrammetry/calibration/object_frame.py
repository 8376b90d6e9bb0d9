"""The frame of a measured object: on its own axes, or on the coordinates of a drawing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from videogrammetry.calibration.network_input import NetworkInput
from videogrammetry.calibration.network_result import NetworkAdjustment
from videogrammetry.errors import CalibrationError
from videogrammetry.geometry import fit_rigid
from videogrammetry.types import FloatArray

#: A drawing so many times larger or smaller than what scale bars say is in another unit.
_OTHER_UNIT = 2.0
#: A drawing is rough, but not by more than this part of the object's size (RMS).
_ROUGH = 0.1


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
    CalibrationError : fewer than three points in common, or all of them on a line; a drawing
        of another scale than the network's, of the mirror image, or of something else.
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
    ratio = float(np.linalg.norm(wanted - wanted.mean(axis=0)) / spread)
    if has_scale and not 1 / _OTHER_UNIT < ratio < _OTHER_UNIT:
        raise CalibrationError(
            f"the nominal coordinates are {ratio:.4g} times as large as the object measured with "
            "the scale bars: the one or the others are not in millimetres; correct them"
        )
    scale = 1.0 if has_scale else ratio
    _check_shape(scale * measured, wanted, [names[k] for _, k in common])
    rotation, shift, _ = fit_rigid(wanted, scale * measured)
    return rotation, shift, scale


def _check_shape(measured: FloatArray, wanted: FloatArray, names: list[str]) -> None:
    """CalibrationError if a drawing is far from what was measured, or its mirror image is nearer.

    Of a flat object there is no mirror image: a turn brings it onto itself.
    """
    size = float(np.sqrt(np.mean(np.sum((wanted - wanted.mean(axis=0)) ** 2, axis=1))))

    def away(points: FloatArray) -> FloatArray:
        rotation, shift, _ = fit_rigid(wanted, points)
        distance: FloatArray = np.linalg.norm(points @ rotation.T + shift - wanted, axis=1)
        return distance

    distance = away(measured)
    misfit = float(np.sqrt(np.mean(distance**2))) / size
    if misfit < _ROUGH:
        return
    mirrored = float(np.sqrt(np.mean(away(measured * [1.0, 1.0, -1.0]) ** 2))) / size
    if mirrored < _ROUGH:
        raise CalibrationError(
            f"the mirror image of the nominal coordinates fits the object ({mirrored:.1%} of its "
            f"size), they themselves do not ({misfit:.0%}): change the sign of one coordinate of "
            "theirs, or, if the photographs are mirrored, mirror them back"
        )
    worst = ", ".join(names[k] for k in np.argsort(-distance)[:4])
    raise CalibrationError(
        f"the nominal coordinates are not those of the object: after the best shift and turn the "
        f"{len(names)} common points are {misfit:.0%} of its size away (most: {worst}); are its "
        "points named by other numbers, or is it the table of another object?"
    )
