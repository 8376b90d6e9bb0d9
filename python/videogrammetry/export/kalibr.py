"""Kalibr's camchain: pinhole cameras with radtan or equidistant distortion, in a chain.

``T_cn_cnm1`` takes a point of the camera before into this one, in m. Where the
first camera stands has no place in the format: its frame is the world's.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from videogrammetry.export.lenses import LensCamera, notes, numbers
from videogrammetry.types import FloatArray

MODELS = ("opencv4", "equidistant")


def format_kalibr(cameras: Sequence[LensCamera]) -> str:
    """The text of a camchain YAML file."""
    lines = [f"# {line}" for line in notes(cameras, "m")]
    before: FloatArray | None = None
    for number, camera in enumerate(cameras):
        fx, fy = camera.lens.focal_px
        cx, cy = camera.lens.centre_px
        model = "equidistant" if camera.model == "equidistant" else "radtan"
        width, height = camera.image_size_px
        others = [n for n in range(len(cameras)) if n != number]
        lines += [
            f"cam{number}:  # {' '.join(camera.name.split())}",
            f"  cam_overlaps: {others}",
            "  camera_model: pinhole",
            f"  distortion_coeffs: [{numbers(camera.lens.coefficients)}]",
            f"  distortion_model: {model}",
            f"  intrinsics: [{numbers(np.array([fx, fy, cx, cy]))}]",
            f"  resolution: [{width}, {height}]",
            f"  rostopic: /cam{number}/image_raw",
        ]
        here = _transform(camera)
        if before is not None:
            lines.append("  T_cn_cnm1:")
            lines += [f"  - [{numbers(row)}]" for row in here @ np.linalg.inv(before)]
        before = here
    return "\n".join(lines) + "\n"


def _transform(camera: LensCamera) -> FloatArray:
    """(4, 4) camera from world, in m."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = camera.rotation, camera.translation_mm / 1000
    return matrix
