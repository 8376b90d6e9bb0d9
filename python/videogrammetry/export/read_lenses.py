"""Cameras from other programs' files: OpenCV (YAML, JSON), ROS camera_info, mrcal."""

from __future__ import annotations

import ast
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from videogrammetry.calibration.conversion import CameraFit, camera_of_lens
from videogrammetry.errors import CalibrationError, ProjectFileError
from videogrammetry.export.lenses import LensCamera
from videogrammetry.geometry import LensModel, nearest_rotation, rotation_from_vector
from videogrammetry.types import FloatArray, RigCamera, RigData

SUFFIXES = (".yaml", ".yml", ".json", ".cameramodel")

# What programs and people call the same thing.
_MATRIX = ("camera_matrix", "cameraMatrix", "Camera_Matrix", "K", "M")
_COEFFICIENTS = (
    *("distortion_coefficients", "distCoeffs", "Distortion_Coefficients", "dist_coeffs", "D"),
)
_ROTATION = ("rotation", "R", "rvec")
_TRANSLATION = {"translation_mm": 1.0, "translation_m": 1000.0, "translation": 1.0, "T": 1.0}
_SIZE = (("image_width", "image_height"), ("width", "height"))
_SIZE_PAIR = ("image_size", "imageSize", "image_Size", "resolution")


def read_lens_cameras(
    path: str | os.PathLike[str], image_size_px: tuple[int, int] | None = None
) -> list[LensCamera]:
    """The cameras of a file of another program, in that program's terms.

    OpenCV: ``camera_matrix`` and ``distortion_coefficients`` (0, 4, 5, 8, 12 or 14),
    at the top or in each item of ``cameras``; ``rotation`` (matrix or vector) and
    ``translation`` (mm; ``translation_m``: m), if there, lead from the world into the
    camera. ROS: the same names; ``distortion_model: equidistant`` is understood.
    mrcal: LENSMODEL_PINHOLE and LENSMODEL_OPENCV4 ... 12, extrinsics in m.

    Parameters
    ----------
    image_size_px : (width, height) for a file that does not say it.

    Raises
    ------
    ProjectFileError
        Not there, damaged, without a camera, or of a model that is not known here.
    """
    file = Path(path)
    if not file.is_file():
        raise ProjectFileError(f"{file}: there is no such file; correct its name")
    try:
        text = file.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise ProjectFileError(f"{file}: not a text file in UTF-8; export it again") from error
    if file.suffix.lower() == ".cameramodel":
        return [_mrcal_camera(file, text)]
    document = _document(file, text)
    items = document.get("cameras", document)
    named = list(items.items()) if isinstance(items, Mapping) else []
    if items is document:
        named = [(str(document.get("name") or document.get("camera_name") or file.stem), document)]
    elif isinstance(items, Sequence):
        named = [
            (str(item.get("name", f"cam{n}")) if isinstance(item, Mapping) else f"cam{n}", item)
            for n, item in enumerate(items, start=1)
        ]
    cameras = [_opencv_camera(file, name, item, image_size_px) for name, item in named]
    if not cameras:
        raise ProjectFileError(f"{file}: it names no camera")
    return cameras


def rig_of_lenses(
    cameras: Sequence[LensCamera], *, measured: bool | None = None, reference: str = "imported"
) -> tuple[RigData, dict[str, CameraFit]]:
    """The rig of cameras in other programs' terms, and what each conversion leaves.

    ``measured`` None: the ideal point's direction if all cameras are ten-parameter
    cameras exactly, else the measured point's, fitted. The rig has no covariance:
    the files hold none.

    Raises
    ------
    CalibrationError
        Two cameras have one name, or a lens folds over within its picture.
    """
    names = [camera.name for camera in cameras]
    for name in names:
        if names.count(name) > 1:
            raise CalibrationError(f"two cameras are named {name!r}: give them different names")

    def converted(direction: bool | None) -> dict[str, CameraFit]:
        return {
            c.name: camera_of_lens(c.lens, c.image_size_px, measured=direction) for c in cameras
        }

    fits = converted(measured)
    if len({fit.camera.measured for fit in fits.values()}) > 1:  # a rig has one direction
        fits = converted(True)
    placed = {}
    for camera in cameras:
        own = fits[camera.name].camera
        placed[camera.name] = RigCamera(
            image_size_px=own.image_size_px,
            interior=own.interior,
            r0_px=own.r0_px,
            rotation=fits[camera.name].cam_from_lens @ camera.rotation,
            translation_mm=fits[camera.name].cam_from_lens @ camera.translation_mm,
            measured=own.measured,
        )
    return RigData(cameras=placed, reference=reference), fits


class _Loader(yaml.SafeLoader):
    """YAML without objects, but with OpenCV's matrices as plain maps."""


def _plain_map(loader: yaml.SafeLoader, node: yaml.MappingNode) -> dict[Any, Any]:
    return loader.construct_mapping(node, True)


for _tag in ("opencv-matrix", "opencv-nd-matrix"):  # OpenCV 5 writes vectors as the latter
    _Loader.add_constructor(f"tag:yaml.org,2002:{_tag}", _plain_map)


def _document(file: Path, text: str) -> Mapping[str, Any]:
    try:
        if file.suffix.lower() == ".json":
            document = json.loads(text)
        else:
            # "%YAML:1.0" of OpenCV is not what YAML itself calls a directive.
            lines = text.splitlines()
            if lines and lines[0].startswith("%YAML"):
                lines[0] = ""
            document = yaml.load("\n".join(lines), _Loader)
    except (yaml.YAMLError, json.JSONDecodeError, RecursionError) as error:
        why = " ".join(str(error).split())
        raise ProjectFileError(
            f"{file}: not a whole YAML or JSON file ({why}): it is damaged or of another kind; "
            "export it again"
        ) from error
    if not isinstance(document, Mapping):
        raise ProjectFileError(f"{file}: it holds no camera_matrix; is it a calibration file?")
    return document


def _opencv_camera(
    file: Path, name: str, item: Any, image_size_px: tuple[int, int] | None
) -> LensCamera:
    where = f"{file}: camera {name!r}"
    if not isinstance(item, Mapping) or not (key := _present(item, _MATRIX)):
        raise ProjectFileError(
            f"{where} has no camera_matrix; known names are {', '.join(_MATRIX)}"
        )
    matrix = _array(item[key], f"{where} {key}", (3, 3))
    if matrix[0, 1] != 0 or not np.allclose(matrix[2], [0, 0, 1]):
        raise ProjectFileError(
            f"{where} {key} is not fx, 0, cx; 0, fy, cy; 0, 0, 1: a skew is not part of OpenCV's "
            "projection; take the matrix of calibrateCamera"
        )
    key = _present(item, _COEFFICIENTS)
    coefficients = _array(item[key], f"{where} {key}").ravel() if key else np.zeros(0)
    fisheye = item.get("distortion_model") in ("equidistant", "fisheye")
    size = _image_size(item, where) or image_size_px
    if size is None:
        raise ProjectFileError(f"{where} has no image_width and image_height; give --image-size")
    rotation, translation = _pose(item, where)
    return LensCamera(
        name=name,
        image_size_px=size,
        lens=_lens(
            where,
            "equidistant" if fisheye else "opencv",
            np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]]),
            coefficients,
        ),
        rotation=rotation,
        translation_mm=translation,
    )


def _mrcal_camera(file: Path, text: str) -> LensCamera:
    try:
        model = ast.literal_eval(text.lstrip())
        name = str(model["lensmodel"])
        values = _array(model["intrinsics"], f"{file}: intrinsics").ravel()
        pose = model.get("rt_cam_ref", model.get("extrinsics"))
        extrinsics = _array(np.zeros(6) if pose is None else pose, f"{file}: extrinsics", (6,))
        width, height = (int(v) for v in model["imagersize"])
    except (SyntaxError, ValueError, KeyError, TypeError, AttributeError, MemoryError) as error:
        raise ProjectFileError(
            f"{file}: not a whole .cameramodel ({type(error).__name__}: {error}); export it again"
        ) from error
    known = {"LENSMODEL_PINHOLE": 0, **{f"LENSMODEL_OPENCV{n}": n for n in (4, 5, 8, 12)}}
    if name not in known or len(values) != 4 + known[name]:
        raise ProjectFileError(
            f"{file}: {name} with {len(values)} intrinsics is not known here; known are "
            f"{', '.join(known)}: convert it with mrcal-convert-lensmodel"
        )
    return LensCamera(
        name=file.stem,
        image_size_px=(width, height),
        lens=_lens(str(file), "opencv", values[:4], values[4:]),
        rotation=rotation_from_vector(extrinsics[:3]),
        translation_mm=1000 * extrinsics[3:],
    )


def _lens(where: str, kind: Any, pinhole: FloatArray, coefficients: FloatArray) -> LensModel:
    try:
        return LensModel(
            kind=kind, focal_px=pinhole[:2], centre_px=pinhole[2:], coefficients=coefficients
        )
    except ValueError as error:
        raise ProjectFileError(f"{where}: {error}; correct the file") from error


def _present(item: Mapping[str, Any], names: Sequence[str]) -> str:
    return next((name for name in names if item.get(name) is not None), "")


def _array(value: Any, where: str, shape: tuple[int, ...] | None = None) -> FloatArray:
    """Numbers of a list, or of a matrix with data, and rows and cols, or sizes."""
    try:
        if isinstance(value, Mapping):
            sizes = value["sizes"] if "sizes" in value else (value["rows"], value["cols"])
            sizes = [int(size) for size in np.ravel(sizes)]
            value = np.reshape(np.array(value["data"], dtype=float), sizes)
        result = np.array(value, dtype=float)
    except (KeyError, TypeError, ValueError) as error:
        raise ProjectFileError(f"{where} is not a matrix of numbers; export it again") from error
    if not np.isfinite(result).all() or (shape is not None and result.shape != shape):
        wanted = "" if shape is None else f" of shape {shape}"
        raise ProjectFileError(
            f"{where} is not a matrix of finite numbers{wanted}; export it again"
        )
    return result


def _image_size(item: Mapping[str, Any], where: str) -> tuple[int, int] | None:
    pair: Any = next(([item[w], item[h]] for w, h in _SIZE if w in item and h in item), None)
    if pair is None and (key := _present(item, _SIZE_PAIR)):
        pair = item[key]
    if pair is None:
        return None
    size = _array(pair, f"{where} image size").ravel()
    if len(size) != 2 or not all(v >= 1 and v == int(v) for v in size):
        raise ProjectFileError(f"{where} image size is {pair}: expected width and height in pixels")
    return int(size[0]), int(size[1])


def _pose(item: Mapping[str, Any], where: str) -> tuple[FloatArray, FloatArray]:
    """Rotation and translation in mm from the world into the camera; identity where not said."""
    rotation, translation = np.eye(3), np.zeros(3)
    if key := _present(item, _ROTATION):
        value = _array(item[key], f"{where} {key}")
        if value.size == 3:
            rotation = rotation_from_vector(value.ravel())
        elif value.shape == (3, 3) and np.allclose(value @ value.T, np.eye(3), atol=1e-4):
            rotation = nearest_rotation(value)
        else:
            raise ProjectFileError(f"{where} {key} is neither a rotation matrix nor vector")
    if key := _present(item, tuple(_TRANSLATION)):
        value = _array(item[key], f"{where} {key}")
        if value.size != 3:
            raise ProjectFileError(f"{where} {key} is not three numbers")
        translation = _TRANSLATION[key] * value.ravel()
    return rotation, translation
