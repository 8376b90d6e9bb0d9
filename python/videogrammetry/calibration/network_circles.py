"""A network's points as circles: normals and diameters that their ellipses tell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from videogrammetry.calibration.network_input import NetworkInput
from videogrammetry.calibration.network_result import AdjustedCamera, NetworkAdjustment
from videogrammetry.geometry import estimate_normals
from videogrammetry.types import INTERIOR_NAMES, FloatArray, RigCamera

#: A normal less sure than this, in rad, is not taken for known.
_SURE_RAD = 0.1
#: One ellipse leaves two normals.
_MIN_ELLIPSES = 2
#: A size that differs more from the others' middle is a dot of another kind.
_SAME_SIZE = 0.1


@dataclass(frozen=True, kw_only=True)
class PictureEllipses:
    """Ellipses of a picture, (n, 5) x, y, semi-axes (px), angle (rad), and their covariance.

    ``cov`` (n, 3, 3) is that of axes and angle.
    """

    ellipse: FloatArray
    cov: FloatArray


def circles_of(
    network: NetworkInput,
    result: NetworkAdjustment,
    ellipses: Mapping[str, PictureEllipses],
    diameter_mm: float | None,
) -> NetworkInput:
    """The network, its points circles where two ellipses or more make the normal sure.

    Normals by least squares over the ellipses' shapes from the adjusted poses
    (``estimate_normals``), to be held in the adjustment that follows. The diameter is the
    stated one, else what the ellipses tell in the network's scale: the middle of all dots
    where a dot's own lies within a tenth of it, because a middle is surer.

    Parameters
    ----------
    result : of the network without circles.
    ellipses : picture's name -> all its ellipses, whose centres are the observations.
    """
    o = result.observations
    row_of = [
        {(float(e[0]), float(e[1])): k for k, e in enumerate(ellipses[name].ellipse)}
        for name in result.images.name
    ]
    found = [
        (int(o.point[i]), int(o.image[i]), row)
        for i in np.flatnonzero(o.used)
        if (row := row_of[o.image[i]].get((float(o.xy_px[i, 0]), float(o.xy_px[i, 1])))) is not None
    ]
    if not found:
        return network
    found.sort()
    point, image, _ = np.array(found).T
    rows, first, count = np.unique(point, return_index=True, return_counts=True)
    pictures = [ellipses[name] for name in result.images.name]
    estimate = estimate_normals(
        [_camera_of(result, i) for i in range(len(result.images))],
        [*first, len(point)],
        image,
        np.stack([pictures[i].ellipse[k] for _, i, k in found]),
        np.stack([pictures[i].cov[k] for _, i, k in found]),
        result.points.position_mm[rows],
    )
    spread = np.trace(estimate.cov, axis1=1, axis2=2)
    sure = (spread < _SURE_RAD**2) & (count >= _MIN_ELLIPSES) & np.isfinite(estimate.diameter_mm)
    if not sure.any():
        return network
    size = _sizes(estimate.diameter_mm, sure, diameter_mm)
    at = {name: i for i, name in enumerate(network.points.name)}
    normal = np.full((len(network.points), 3), np.nan)
    diameter = np.full(len(network.points), np.nan)
    for k in np.flatnonzero(sure):
        place = at[result.points.name[rows[k]]]
        normal[place], diameter[place] = estimate.normal[k], size[k]
    return replace(network, points=replace(network.points, normal=normal, diameter_mm=diameter))


def _sizes(own: FloatArray, sure: np.ndarray, stated: float | None) -> FloatArray:
    middle = float(np.median(own[sure])) if stated is None else stated
    alike = np.abs(own / middle - 1) < _SAME_SIZE
    return np.where(alike, middle, own)


def _camera_of(result: NetworkAdjustment, image: int) -> RigCamera:
    camera: AdjustedCamera = result.cameras[result.images.camera[image]]
    return RigCamera(
        image_size_px=camera.image_size_px,
        interior=np.array([camera.values[name] for name in INTERIOR_NAMES]),
        r0_px=camera.r0_px,
        rotation=result.images.rotation[image],
        translation_mm=result.images.translation_mm[image],
        measured=camera.measured,
    )
