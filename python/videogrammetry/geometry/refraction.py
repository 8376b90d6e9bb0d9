"""Cameras that look through a flat window into a fluid."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from videogrammetry._core import geometry as _geometry
from videogrammetry.geometry.camera import _rows, camera_model

if TYPE_CHECKING:
    from videogrammetry.types import FlatInterface, FloatArray, RigCamera


def interface_model(interface: FlatInterface | None) -> Any:
    """The C++ window of a :class:`~videogrammetry.types.FlatInterface`; None of None.

    Raises
    ------
    ValueError : a normal not of unit length, an index outside 1 to 4, a negative thickness.
    """
    if interface is None:
        return None
    try:
        return _geometry.FlatInterface(
            np.asarray(interface.normal, dtype=float).reshape(3),
            float(interface.distance_mm),
            float(interface.fluid_index),
            float(interface.glass_index),
            float(interface.glass_thickness_mm),
        )
    except ValueError as error:
        raise ValueError(f"interface {interface.name!r}: {error}") from error


def oriented_model(camera: RigCamera) -> Any:
    """The C++ camera with its pose and window."""
    return _geometry.OrientedCamera(
        camera_model(camera),
        camera.rotation,
        camera.translation_mm,
        interface_model(camera.interface),
    )


def project_from_world(camera: RigCamera, points_in_world: npt.ArrayLike) -> FloatArray:
    """Pictures (N, 2) px of points (N, 3) mm of the rig's frame, through the camera's window.

    Snell's law at each layer, exactly (see ``SeenThrough`` in C++); a point on the
    cameras' side of the window is seen straight. NaN where there is no picture.

    Examples
    --------
    A camera 100 mm over water of index 4/3 looks at a point 40 mm deep; near the axis
    it appears at 3/4 of its depth.

    >>> from videogrammetry.types import FlatInterface, RigCamera
    >>> water = FlatInterface(normal=np.array([0.0, 0, -1]), distance_mm=-100.0, fluid_index=4 / 3)
    >>> camera = RigCamera(image_size_px=(101, 101), interior=np.r_[1000.0, np.zeros(9)],
    ...                    r0_px=40.0, rotation=np.eye(3), translation_mm=np.zeros(3),
    ...                    interface=water)
    >>> project_from_world(camera, [[0.13, 0.0, 140.0], [0.0, 0.0, 90.0]]).round(3).tolist()
    [[51.0, 50.0], [50.0, 50.0]]
    """
    result: FloatArray = _geometry.project_from_world(
        oriented_model(camera), _rows(points_in_world, 3, "points_in_world")
    )
    return result


def project_from_world_with_jacobians(
    camera: RigCamera, points_in_world: npt.ArrayLike
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """As :func:`project_from_world`, with derivatives by the point and the camera.

    Returns
    -------
    pixels : (N, 2).
    by_point : (N, 2, 3) px per mm.
    by_camera : (N, 2, 16) by ``CAMERA_PARAMETERS``, the window held.
    """
    pixels, by_point, by_camera = _geometry.project_from_world_with_jacobians(
        oriented_model(camera), _rows(points_in_world, 3, "points_in_world")
    )
    return pixels, by_point, by_camera


def rays_from_pixels(camera: RigCamera, pixels: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Origins (N, 3) mm and unit directions (N, 3) of the rays through pixels, in the rig's frame.

    Through a window: the refracted rays, from where they enter the fluid.
    """
    origin, direction = _geometry.rays_from_pixels(
        oriented_model(camera), _rows(pixels, 2, "pixels")
    )
    return origin, direction


def apparent_points(interface: FlatInterface, points_mm: npt.ArrayLike) -> FloatArray:
    """Where points (N, 3) behind a window seem to lie, seen perpendicularly.

    A layer of thickness h and index n looks h / n thick. The pictures of a camera that
    looks across the window differ from those of these points in the second order of the
    angle: good for start values.

    Examples
    --------
    >>> from videogrammetry.types import FlatInterface
    >>> water = FlatInterface(normal=np.array([0.0, 0, 1]), distance_mm=0.0, fluid_index=1.25)
    >>> apparent_points(water, [[1.0, 2.0, -10.0], [1.0, 2.0, 3.0]]).tolist()
    [[1.0, 2.0, -8.0], [1.0, 2.0, 3.0]]
    """
    points = _rows(points_mm, 3, "points_mm")
    normal = np.asarray(interface.normal, dtype=float)
    depth = np.maximum(interface.distance_mm - points @ normal, 0.0)
    glass = np.minimum(depth, interface.glass_thickness_mm)
    fluid = depth - glass
    nearer = glass * (1.0 - 1.0 / interface.glass_index) + fluid * (
        1.0 - 1.0 / interface.fluid_index
    )
    return np.asarray(points + nearer[:, None] * normal)
