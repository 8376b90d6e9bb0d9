"""ROS: the camera_info of one camera, as camera_calibration_parsers reads it.

R is the identity and P = [K | 0]: the picture is rectified onto a pinhole of the
same focal lengths, and no stereo rectification is meant. Where the camera stands
has no place in the format: it is in the comments.
"""

from __future__ import annotations

import json

import numpy as np

from videogrammetry.export.lenses import LensCamera, notes, numbers, quaternion
from videogrammetry.types import FloatArray

MODELS = ("opencv5", "opencv8", "equidistant")
_NAMES = {"opencv5": "plumb_bob", "opencv8": "rational_polynomial", "equidistant": "equidistant"}


def format_ros(camera: LensCamera) -> str:
    """The text of a camera_info YAML file."""
    width, height = camera.image_size_px
    projection = np.column_stack([camera.camera_matrix, np.zeros(3)])
    w, x, y, z = quaternion(camera.rotation)
    lines = [
        *(f"# {line}" for line in notes([camera], "m")),
        f"# camera from world: quaternion x, y, z, w [{numbers(np.array([x, y, z, w]))}], "
        f"translation [{numbers(camera.translation_mm / 1000)}] m",
        f"image_width: {width}",
        f"image_height: {height}",
        f"camera_name: {json.dumps(camera.name)}",
        *_matrix("camera_matrix", camera.camera_matrix),
        f"distortion_model: {_NAMES[camera.model]}",
        *_matrix("distortion_coefficients", camera.lens.coefficients[None, :]),
        *_matrix("rectification_matrix", np.eye(3)),
        *_matrix("projection_matrix", projection),
    ]
    return "\n".join(lines) + "\n"


def _matrix(name: str, value: FloatArray) -> list[str]:
    rows, cols = value.shape
    return [f"{name}:", f"  rows: {rows}", f"  cols: {cols}", f"  data: [{numbers(value)}]"]
