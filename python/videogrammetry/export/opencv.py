"""OpenCV's calibration files, YAML or JSON, as its FileStorage reads and writes them.

One camera: ``image_width``, ``image_height``, ``camera_matrix``,
``distortion_coefficients`` (the names of OpenCV's own calibration sample),
``rotation`` and ``translation_mm`` (camera from world), ``residual_rms_px``,
``residual_max_px``. Several: a sequence ``cameras`` of such maps, with ``name``.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from videogrammetry.export.lenses import LensCamera, notes, numbers
from videogrammetry.types import FloatArray

MODELS = ("opencv5", "opencv8", "opencv12", "opencv14")


def format_opencv_yaml(cameras: Sequence[LensCamera]) -> str:
    """The text of a YAML file."""
    lines = ["%YAML:1.0", "---", *(f"# {line}" for line in notes(cameras, "mm"))]
    if len(cameras) == 1:
        lines += _yaml(_entries(cameras[0]), "")
    else:
        lines.append("cameras:")
        for camera in cameras:
            lines.append("   -")
            lines += _yaml(_entries(camera), "      ")
    return "\n".join(lines) + "\n"


def format_opencv_json(cameras: Sequence[LensCamera]) -> str:
    """The text of a JSON file; JSON has no comments, so ``notes`` is a list of texts."""
    document: dict[str, Any] = {"notes": notes(cameras, "mm")}
    items = [
        {
            key: _matrix(value) if isinstance(value, np.ndarray) else value
            for key, value in _entries(camera).items()
        }
        for camera in cameras
    ]
    document |= items[0] if len(items) == 1 else {"cameras": items}
    return json.dumps(document, indent=4) + "\n"


def _entries(camera: LensCamera) -> dict[str, Any]:
    width, height = camera.image_size_px
    entries: dict[str, Any] = {
        "name": camera.name,
        "image_width": int(width),
        "image_height": int(height),
        "camera_matrix": camera.camera_matrix,
        "distortion_model": camera.model,
        "distortion_coefficients": camera.lens.coefficients[None, :],
        "rotation": camera.rotation,
        "translation_mm": camera.translation_mm[:, None],
    }
    if camera.residual is not None:
        entries["residual_rms_px"] = camera.residual.rms_px
        entries["residual_max_px"] = camera.residual.max_px
    return entries


def _matrix(value: FloatArray) -> dict[str, Any]:
    rows, cols = value.shape
    data = [float(v) for v in value.ravel()]
    return {"type_id": "opencv-matrix", "rows": rows, "cols": cols, "dt": "d", "data": data}


def _yaml(entries: dict[str, Any], indent: str) -> list[str]:
    lines = []
    for key, value in entries.items():
        if isinstance(value, np.ndarray):
            rows, cols = value.shape
            lines += [
                f"{indent}{key}: !!opencv-matrix",
                f"{indent}   rows: {rows}",
                f"{indent}   cols: {cols}",
                f"{indent}   dt: d",
                f"{indent}   data: [ {numbers(value)} ]",
            ]
        else:
            text = json.dumps(value) if isinstance(value, str) else repr(value)
            lines.append(f"{indent}{key}: {text}")
    return lines
