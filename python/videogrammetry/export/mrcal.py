"""mrcal's .cameramodel of one camera: a Python literal with comments.

``extrinsics`` is rt_cam_ref: rotation vector in rad and translation in m that
take a point of the reference (our rig's frame) into the camera.
"""

from __future__ import annotations

import numpy as np

from videogrammetry.export.lenses import LensCamera, notes, numbers
from videogrammetry.geometry import vector_from_rotation

MODELS = ("opencv5", "opencv8", "opencv12")


def format_mrcal(camera: LensCamera) -> str:
    """The text of a .cameramodel file."""
    width, height = camera.image_size_px
    lens = camera.lens
    intrinsics = np.concatenate([lens.focal_px, lens.centre_px, lens.coefficients])
    pose = np.concatenate([vector_from_rotation(camera.rotation), camera.translation_mm / 1000])
    lines = [
        *(f"# {line}" for line in notes([camera], "m")),
        "{",
        f"    'lensmodel':  'LENSMODEL_OPENCV{len(lens.coefficients)}',",
        "",
        "    # intrinsics are fx,fy,cx,cy,distortion0,distortion1,....",
        f"    'intrinsics': [ {numbers(intrinsics)} ],",
        "",
        "    # extrinsics are rt_fromref",
        f"    'extrinsics': [ {numbers(pose)} ],",
        "",
        f"    'imagersize': [ {width}, {height} ]",
        "}",
    ]
    return "\n".join(lines) + "\n"
