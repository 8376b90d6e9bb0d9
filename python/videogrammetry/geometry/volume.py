"""A measuring volume, and where a camera must point to see it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from videogrammetry._core import geometry as _geometry
from videogrammetry.types import FloatArray, RigData

SHAPES = ("box", "sphere")


@dataclass(frozen=True, kw_only=True)
class MeasuringVolume:
    """A box along the axes of the rig's frame, or a ball.

    Attributes
    ----------
    centre_mm : (3,). size_mm : (3,) edges of the box; a ball's diameter, three times.
    shape : "box" or "sphere".

    Examples
    --------
    >>> ball = MeasuringVolume(centre_mm=np.zeros(3), size_mm=np.full(3, 2.0), shape="sphere")
    >>> ball.contains(np.array([[0.0, 0, 0.9], [0.8, 0.8, 0.0]])).tolist()
    [True, False]
    >>> len(ball.grid(5)), len(MeasuringVolume(centre_mm=np.zeros(3), size_mm=np.ones(3)).grid(5))
    (81, 125)
    """

    centre_mm: FloatArray
    size_mm: FloatArray
    shape: str = "box"

    def __post_init__(self) -> None:
        if self.shape not in SHAPES:
            raise ValueError(f"shape: expected one of {', '.join(SHAPES)}, got {self.shape!r}")
        size = np.asarray(self.size_mm)
        if size.shape != (3,) or not (np.isfinite(size) & (size > 0)).all():
            raise ValueError(f"size_mm: expected three lengths above 0 mm, got {size.tolist()}")
        if np.shape(self.centre_mm) != (3,) or not np.isfinite(self.centre_mm).all():
            raise ValueError(f"centre_mm: expected three numbers, got {self.centre_mm}")

    def contains(self, points_mm: FloatArray) -> npt.NDArray[np.bool_]:
        """(N,) whether points (N, 3) lie in it, its surface included."""
        part = 2 * (points_mm - self.centre_mm) / self.size_mm
        if self.shape == "sphere":
            return np.asarray((part**2).sum(axis=1) <= 1 + 1e-9)
        return np.asarray((np.abs(part) <= 1 + 1e-9).all(axis=1))

    def fill(self, unit: FloatArray) -> FloatArray:
        """(N, 3) places of coordinates (N, 3) in [0, 1]: evenly spread ones fill it evenly."""
        if self.shape == "box":
            return np.asarray(self.centre_mm + (unit - 0.5) * self.size_mm)
        radius = 0.5 * np.cbrt(unit[:, 0])
        height, angle = 2 * unit[:, 1] - 1, 2 * np.pi * unit[:, 2]
        ring = np.sqrt(1 - height**2)
        direction = np.stack([ring * np.cos(angle), ring * np.sin(angle), height], axis=1)
        return np.asarray(self.centre_mm + radius[:, None] * direction * self.size_mm)

    def grid(self, count: int) -> FloatArray:
        """(N, 3) middles of ``count`` cells along every edge; those outside a ball left out.

        Each stands for as much of the volume, so that parts of the places are parts of it.
        """
        steps = (np.arange(count) + 0.5) / count - 0.5
        cube = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
        points = self.centre_mm + cube * self.size_mm
        return np.asarray(points[self.contains(points)])


def rotation_looking_at(
    position_mm: npt.ArrayLike, point_mm: npt.ArrayLike, up: npt.ArrayLike = (0.0, 0.0, 1.0)
) -> FloatArray:
    """Rotation cam_from_world of a camera whose axis goes through a point, its top towards ``up``.

    A camera that looks along ``up`` has its top towards world y instead.

    Raises
    ------
    ValueError : the camera stands on the point, or ``up`` is no direction.

    Examples
    --------
    >>> (rotation_looking_at([0, -10, 0], [0, 0, 0]) + 0.0).tolist()
    [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]
    """
    axis = np.asarray(point_mm, dtype=float) - np.asarray(position_mm, dtype=float)
    length = np.linalg.norm(axis)
    top = np.asarray(up, dtype=float)
    if not (np.isfinite(length) and length > 0):
        raise ValueError("the camera stands on the point that it looks at")
    if not (np.isfinite(top).all() and top.any()):
        raise ValueError(f"up: expected a direction, got {top.tolist()}")
    axis /= length
    top /= np.linalg.norm(top)
    if np.linalg.norm(np.cross(axis, top)) < 1e-6:
        top = np.array([0.0, 1.0, 0.0]) if abs(axis[1]) < 0.9 else np.array([1.0, 0.0, 0.0])
    right = np.cross(axis, top)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(axis, right), axis])


def point_nearest_to_axes(rig: RigData) -> FloatArray:
    """(3,) mm: the point nearest to the axes of all cameras, least squares.

    Where the axes are parallel, nothing says how far: the point of least norm
    from the cameras' mean.
    """
    axes = np.stack([camera.rotation[2] for camera in rig.cameras.values()])
    centres = np.stack([camera.centre_mm for camera in rig.cameras.values()])
    middle = centres.mean(axis=0)
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    step = np.einsum("kij,kj->i", across, centres - middle)
    return np.asarray(middle + np.linalg.lstsq(across.sum(axis=0), step, rcond=1e-9)[0])


def inside_half_spaces(
    points: FloatArray, planes: FloatArray, border: float
) -> npt.NDArray[np.bool_]:
    """(N,) whether points (N, 3) lie in a convex body grown by ``border``.

    ``planes`` (F, 4): outward unit normal n and d of all planes n x + d = 0 that bound it, as
    ``scipy.spatial.ConvexHull.equations``. False where a coordinate is not finite.

    Examples
    --------
    >>> slab = np.array([[0.0, 0, 1, -1], [0, 0, -1, -1]])  # -1 <= z <= 1
    >>> inside_half_spaces(np.array([[0.0, 0, 1.1], [0, 0, 1.3]]), slab, 0.2).tolist()
    [True, False]
    """
    inside: npt.NDArray[np.bool_] = _geometry.inside_half_spaces(
        np.ascontiguousarray(points, dtype=float), np.ascontiguousarray(planes), float(border)
    )
    return inside
