"""The ten-parameter camera of Hu et al. (2012), Eqs. (2)-(3), in arrays."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from videogrammetry._core import geometry as _geometry

if TYPE_CHECKING:
    from videogrammetry.types import FloatArray, RigCamera


def default_r0_px(image_size_px: tuple[int, int]) -> float:
    """2/3 of the picture's half diagonal: r0 where nothing is said.

    Examples
    --------
    >>> round(default_r0_px((1024, 1024)), 3)
    482.718
    """
    return float(_geometry.default_r0_px(*image_size_px))


def camera_model(camera: RigCamera) -> Any:
    """The C++ camera of a :class:`~videogrammetry.types.RigCamera`."""
    width, height = camera.image_size_px
    return _geometry.Camera(width, height, camera.interior, camera.r0_px, camera.measured)


def _rows(array: npt.ArrayLike, columns: int, name: str) -> FloatArray:
    rows = np.ascontiguousarray(array, dtype=np.float64)
    if rows.ndim != 2 or rows.shape[1] != columns:
        raise ValueError(f"{name}: expected shape (N, {columns}), got {rows.shape}")
    return rows


def project(camera: RigCamera, points_in_cam: npt.ArrayLike) -> FloatArray:
    """Pictures (N, 2) px of points (N, 3) mm of the camera's frame.

    With (xc, yc) the picture from the principal point, xc + dx = f X/Z and
    yc + dy = f Y/Z (paper's Eq. 2; dx, dy from Eq. 3); inverted by Newton's
    method to 1e-10 px. A point behind the camera, or where the distortion
    folds over, gives NaN.

    Examples
    --------
    >>> from videogrammetry.types import RigCamera
    >>> cam = RigCamera(image_size_px=(101, 101), interior=np.r_[1000.0, np.zeros(9)],
    ...                 r0_px=40.0, rotation=np.eye(3), translation_mm=np.zeros(3))
    >>> project(cam, [[10.0, 0.0, 1000.0]]).tolist()
    [[60.0, 50.0]]
    """
    result: FloatArray = _geometry.project(
        camera_model(camera), _rows(points_in_cam, 3, "points_in_cam")
    )
    return result


def project_with_jacobians(
    camera: RigCamera, points_in_cam: npt.ArrayLike
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Pictures (N, 2), their derivatives by the point (N, 2, 3) and by the interior (N, 2, 10)."""
    pixels, by_point, by_interior = _geometry.project_with_jacobians(
        camera_model(camera), _rows(points_in_cam, 3, "points_in_cam")
    )
    return pixels, by_point, by_interior


def rays_through_pixels(camera: RigCamera, pixels: npt.ArrayLike) -> FloatArray:
    """Directions (N, 3) = (X/Z, Y/Z, 1) of the rays through pixels (N, 2), in the camera's frame.

    Examples
    --------
    >>> from videogrammetry.types import RigCamera
    >>> cam = RigCamera(image_size_px=(101, 101), interior=np.r_[1000.0, np.zeros(9)],
    ...                 r0_px=40.0, rotation=np.eye(3), translation_mm=np.zeros(3))
    >>> rays_through_pixels(cam, [[60.0, 50.0]]).tolist()
    [[0.01, 0.0, 1.0]]
    """
    result: FloatArray = _geometry.rays(camera_model(camera), _rows(pixels, 2, "pixels"))
    return result


def rotation_from_vector(rotation_rad: npt.ArrayLike) -> FloatArray:
    """Rotation matrix (3, 3) of a rotation vector (3,) in rad (Rodrigues)."""
    result: FloatArray = _geometry.rotation_from_vector(np.asarray(rotation_rad, dtype=float))
    return result


def vector_from_rotation(rotation: npt.ArrayLike) -> FloatArray:
    """Rotation vector (3,) in rad of a rotation matrix (3, 3)."""
    result: FloatArray = _geometry.vector_from_rotation(np.asarray(rotation, dtype=float))
    return result


def nearest_rotation(matrix: npt.ArrayLike) -> FloatArray:
    """The rotation nearest to a (3, 3) matrix (SVD): what Eq. (8)'s mean needs."""
    result: FloatArray = _geometry.nearest_rotation(np.asarray(matrix, dtype=float))
    return result
