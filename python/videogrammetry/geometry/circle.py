"""Circles: where the ellipses' centres lie, and the normals that ellipses tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from videogrammetry._core import geometry as _geometry
from videogrammetry.geometry.camera import camera_model
from videogrammetry.geometry.refraction import oriented_model

if TYPE_CHECKING:
    from videogrammetry.types import FloatArray, RigCamera


def ellipse_centres(
    camera: RigCamera,
    centres_in_cam: npt.ArrayLike,
    normals_in_cam: npt.ArrayLike,
    diameter_mm: npt.ArrayLike,
) -> FloatArray:
    """Centres (N, 2) px of the ellipses that a camera measures of circles.

    Exact through the circle's dual conic, C* = r^2 (I - n n') - c c', and to
    second order in the circle's size through the distortion. Less
    :func:`project` of the same centres this is the eccentricity.

    Parameters
    ----------
    centres_in_cam, normals_in_cam : (N, 3) in the camera's frame; unit normals,
        of either sign.
    diameter_mm : (N,) or one number.

    Raises
    ------
    ValueError
        A diameter that is not positive, a normal that is not of unit length.

    Examples
    --------
    >>> from videogrammetry.types import RigCamera
    >>> cam = RigCamera(image_size_px=(101, 101), interior=np.r_[1000.0, np.zeros(9)],
    ...                 r0_px=40.0, rotation=np.eye(3), translation_mm=np.zeros(3))
    >>> tilted = [[np.sin(0.5), 0.0, -np.cos(0.5)]]
    >>> (ellipse_centres(cam, [[0.0, 0.0, 1000.0]], tilted, 20.0) - 50).round(4).tolist()
    [[-0.0421, 0.0]]
    """
    centres = np.ascontiguousarray(centres_in_cam, dtype=np.float64)
    normals = np.ascontiguousarray(normals_in_cam, dtype=np.float64)
    for name, rows in (("centres_in_cam", centres), ("normals_in_cam", normals)):
        if rows.ndim != 2 or rows.shape[1] != 3:
            raise ValueError(f"{name}: expected shape (N, 3), got {rows.shape}")
    diameter = np.broadcast_to(np.asarray(diameter_mm, dtype=float), len(centres)).copy()
    result: FloatArray = _geometry.ellipse_centers(camera_model(camera), centres, normals, diameter)
    return result


@dataclass(frozen=True, kw_only=True)
class CircleNormals:
    """Normals (P, 3) towards the cameras, their covariance (P, 3, 3), diameters (P,); NaN: none."""

    normal: FloatArray
    cov: FloatArray
    diameter_mm: FloatArray


def estimate_normals(
    cameras: Sequence[RigCamera],
    offsets: npt.ArrayLike,
    camera: npt.ArrayLike,
    ellipse: npt.ArrayLike,
    ellipse_cov: npt.ArrayLike,
    position_mm: npt.ArrayLike,
) -> CircleNormals:
    """Normals of circles from their ellipses in all cameras that see them.

    Least squares over the ellipses' shapes with normal and diameter unknown;
    see ``cpp/videogrammetry/geometry/circle_normal.h``.

    Parameters
    ----------
    cameras : the cameras, with their orientation (or pictures of one camera).
    offsets : (P + 1,): circle i has the ellipses ``offsets[i]:offsets[i + 1]``.
    camera : (M,) index into ``cameras``.
    ellipse : (M, 5) centre x, y, semi-major, semi-minor axis, angle (px, rad).
    ellipse_cov : (M, 3, 3) covariance of axes and angle.
    position_mm : (P, 3) the circles' centres.
    """
    rig = [oriented_model(c) for c in cameras]
    rows = np.ascontiguousarray(ellipse, dtype=np.float64).reshape(-1, 5)
    normal, cov, diameter = _geometry.estimate_normals(
        rig,
        np.asarray(offsets, dtype=np.int64).tolist(),
        np.asarray(camera, dtype=np.int32).tolist(),
        rows,
        np.ascontiguousarray(ellipse_cov, dtype=np.float64).reshape(-1, 9),
        np.ascontiguousarray(position_mm, dtype=np.float64).reshape(-1, 3),
    )
    return CircleNormals(normal=normal, cov=cov.reshape(-1, 3, 3), diameter_mm=diameter)
