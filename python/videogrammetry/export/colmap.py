"""COLMAP's sparse model as text: cameras, one image of each, and the rig that they form.

Lengths in m. COLMAP's (0, 0) is the *corner* of the first pixel: cx and cy are
larger by 0.5 here. ``images.txt`` names the pictures ``NAME.png``: put your own
names there. The model has no 3-D points yet.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from videogrammetry.export.lenses import LensCamera, notes, numbers, quaternion
from videogrammetry.types import FloatArray

MODELS = ("opencv4", "opencv8")
_NAMES = {"opencv4": "OPENCV", "opencv8": "FULL_OPENCV", "equidistant": "OPENCV_FISHEYE"}


def colmap_files(cameras: Sequence[LensCamera]) -> dict[str, str]:
    """The texts of cameras.txt, images.txt, points3D.txt, rigs.txt and frames.txt."""
    head = [f"# {line}" for line in notes(cameras, "m")]
    lenses, images = [], []
    for number, camera in enumerate(cameras, start=1):
        width, height = camera.image_size_px
        values = np.concatenate(
            [camera.lens.focal_px, camera.lens.centre_px + 0.5, camera.lens.coefficients]
        )
        lenses.append(f"{number} {_NAMES[camera.model]} {width} {height} {_spaced(values)}")
        images += [f"{number} {_pose(camera)} {number} {camera.name}.png", ""]
    return {
        "cameras.txt": _text(head, "CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]", lenses),
        "images.txt": _text(
            head, "IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME / POINTS2D[]", images
        ),
        "points3D.txt": _text(head, "no points", []),
        "rigs.txt": _text(
            head,
            "RIG_ID, NUM_SENSORS, REF_SENSOR_TYPE, REF_SENSOR_ID, SENSORS[] as "
            "(SENSOR_TYPE, SENSOR_ID, HAS_POSE, [QW, QX, QY, QZ, TX, TY, TZ])",
            [_rig(cameras)],
        ),
        "frames.txt": _text(
            head,
            "FRAME_ID, RIG_ID, RIG_FROM_WORLD[QW, QX, QY, QZ, TX, TY, TZ], NUM_DATA_IDS, "
            "DATA_IDS[] as (SENSOR_TYPE, SENSOR_ID, DATA_ID)",
            [_frame(cameras)],
        ),
    }


def _text(head: Sequence[str], columns: str, lines: Sequence[str]) -> str:
    return "\n".join([*head, f"# {columns}", *lines]) + "\n"


def _spaced(values: FloatArray) -> str:
    return numbers(values).replace(",", "")


def _pose(camera: LensCamera, before: LensCamera | None = None) -> str:
    """Quaternion and translation: from the world, or from another camera."""
    rotation, translation = camera.rotation, camera.translation_mm / 1000
    if before is not None:
        rotation = rotation @ before.rotation.T
        translation = translation - rotation @ before.translation_mm / 1000
    return f"{_spaced(quaternion(rotation))} {_spaced(translation)}"


def _rig(cameras: Sequence[LensCamera]) -> str:
    """The rig's frame is the first camera's, as COLMAP wants it."""
    parts = [f"1 {len(cameras)} CAMERA 1"]
    for number, camera in enumerate(cameras[1:], start=2):
        parts.append(f"CAMERA {number} 1 {_pose(camera, cameras[0])}")
    return " ".join(parts)


def _frame(cameras: Sequence[LensCamera]) -> str:
    data = " ".join(f"CAMERA {n} {n}" for n in range(1, len(cameras) + 1))
    return f"1 1 {_pose(cameras[0])} {len(cameras)} {data}"
