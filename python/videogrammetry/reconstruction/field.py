"""What the calibration leaves uncertain in each camera's picture."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from videogrammetry._core import reconstruction as _reconstruction
from videogrammetry.geometry import CAMERA_PARAMETERS, full_covariance, rays_from_pixels
from videogrammetry.reconstruction.uncertainty import picture_derivatives

if TYPE_CHECKING:
    from videogrammetry.reconstruction.triangulate import Triangulator
    from videogrammetry.types import FloatArray, RigCamera

_NODES = (9, 7)  # over width and height: the field is as smooth as the distortion
_PARAMETERS = len(CAMERA_PARAMETERS)


class CalibrationField:
    """Variance of where each camera would see a known point, from the calibration alone.

    The point is fixed in the frame of the calibrated volume (the rigid motion
    that errors of the calibration share over the volume is taken out, see
    :class:`Triangulator`), at the volume's mean depth along each pixel's ray.
    Inside the calibrated part of a picture this is a few hundredths of a pixel
    or less; it grows where the target never was, and matching must not be
    stricter there than the calibration is.
    """

    def __init__(self, triangulator: Triangulator) -> None:
        rig = triangulator.rig
        self._nodes: list[FloatArray | None] = []
        self._sizes = [camera.image_size_px for camera in rig.cameras.values()]
        cov = full_covariance(rig)
        frame = triangulator.frame_by_parameters
        for k, camera in enumerate(rig.cameras.values()):
            if not len(cov) or not len(frame) or rig.volume_mm is None:
                self._nodes.append(None)
                continue
            depth = float((rig.volume_mm @ camera.rotation[2] + camera.translation_mm[2]).mean())
            self._nodes.append(_variance_nodes(camera, k, depth, cov, frame))

    def covariance(self, camera: int, xy_px: FloatArray) -> FloatArray:
        """(N, 3) xx, xy, yy in px^2 at pixels (N, 2); 0 where the rig has no covariance."""
        nodes = self._nodes[camera]
        if nodes is None or not len(xy_px):
            return np.zeros((len(xy_px), 3))
        width, height = self._sizes[camera]
        field: FloatArray = _reconstruction.bilinear(
            nodes, float(width), float(height), np.ascontiguousarray(xy_px, dtype=float)
        )
        return field


def _variance_nodes(
    camera: RigCamera, index: int, depth_mm: float, cov: FloatArray, frame: FloatArray
) -> FloatArray:
    width, height = camera.image_size_px
    x, y = np.meshgrid(np.linspace(0, width - 1, _NODES[0]), np.linspace(0, height - 1, _NODES[1]))
    pixels = np.column_stack([x.ravel(), y.ravel()])
    # To that depth along the ray behind a window, if there is one.
    origin, direction = rays_from_pixels(camera, pixels)
    axis, start = camera.rotation[2], origin @ camera.rotation[2] + camera.translation_mm[2]
    in_world = origin + ((depth_mm - start) / (direction @ axis))[:, None] * direction
    _, _, total = picture_derivatives(camera, index, in_world, cov.shape[1] // _PARAMETERS, frame)
    variance = total @ cov @ np.swapaxes(total, 1, 2)
    nodes: FloatArray = np.stack(
        [variance[:, 0, 0], variance[:, 0, 1], variance[:, 1, 1]], axis=1
    ).reshape(_NODES[1], _NODES[0], 3)
    return np.ascontiguousarray(np.nan_to_num(nodes))
