"""The formats that a rig can be written in, by name: texts by file name."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from videogrammetry.errors import CalibrationError
from videogrammetry.export import colmap, kalibr, mrcal, opencv, ros
from videogrammetry.export.lenses import LensCamera, convert_rig
from videogrammetry.types import RigData

RigFormatName = Literal["opencv", "ros", "kalibr", "colmap", "mrcal"]


@dataclass(frozen=True)
class RigFormat:
    """How a format is laid out.

    ``suffixes`` of its files; ``models`` that it can hold, as for ``convert_rig``, and
    those taken where nothing is said (``default``); ``one`` writes one camera, ``joint``
    writes all of them into one file; a format with neither is a folder of fixed names.
    """

    suffixes: tuple[str, ...]
    default: tuple[str, ...]
    models: tuple[str, ...]
    one: Callable[[LensCamera], str] | None = None
    joint: Callable[[Sequence[LensCamera]], str] | None = None
    folder: Callable[[Sequence[LensCamera]], dict[str, str]] | None = None


RIG_FORMATS: dict[str, RigFormat] = {
    "opencv": RigFormat(
        (".yaml", ".yml", ".json"), opencv.MODELS, opencv.MODELS, joint=opencv.format_opencv_yaml
    ),
    "ros": RigFormat((".yaml", ".yml"), ros.MODELS[:2], ros.MODELS, one=ros.format_ros),
    "kalibr": RigFormat(
        (".yaml", ".yml"), kalibr.MODELS, kalibr.MODELS, joint=kalibr.format_kalibr
    ),
    "colmap": RigFormat(
        (), colmap.MODELS, (*colmap.MODELS, "equidistant"), folder=colmap.colmap_files
    ),
    "mrcal": RigFormat(
        (".cameramodel",), mrcal.MODELS, ("opencv4", *mrcal.MODELS), one=mrcal.format_mrcal
    ),
}


def convert_for(
    rig: RigData, name: RigFormatName, model: str | None = None, *, keep_axes: bool = False
) -> list[LensCamera]:
    """The rig's cameras in the terms of a format; ``model`` one of ``RIG_FORMATS[name].models``.

    Raises
    ------
    ValueError
        The format does not have this model.
    CalibrationError
        A camera's distortion folds over within its picture, or it looks through a window.
    """
    for camera, data in rig.cameras.items():
        if data.interface is not None:
            raise CalibrationError(
                f"camera {camera}: it looks through the interface {data.interface.name!r} into a "
                f"fluid, which {name} files cannot say; read rig.json itself"
            )
    form = RIG_FORMATS[name]
    if model is not None and model not in form.models:
        raise ValueError(f"model: {name} has {', '.join(form.models)}, not {model}")
    return convert_rig(rig, form.default if model is None else (model,), keep_axes=keep_axes)


def format_file(cameras: Sequence[LensCamera], name: RigFormatName, suffix: str) -> str:
    """The text of a single file.

    Raises
    ------
    ValueError
        The format is a folder, or holds one camera a file and there are several.
    """
    form = RIG_FORMATS[name]
    if form.folder is not None:
        raise ValueError(f"{name} is a folder of files; give a folder's name")
    if form.one is not None:
        if len(cameras) != 1:
            raise ValueError(
                f"a {name} file holds one camera, the rig has "
                f"{', '.join(c.name for c in cameras)}: give --camera NAME, or the name of a "
                "folder for all"
            )
        return form.one(cameras[0])
    if suffix == ".json":
        return opencv.format_opencv_json(cameras)
    assert form.joint is not None
    return form.joint(cameras)


def format_folder(cameras: Sequence[LensCamera], name: RigFormatName) -> dict[str, str]:
    """The texts of a folder by file name: COLMAP's, or one file a camera.

    Raises
    ------
    ValueError
        The format is one file for all cameras, or names of cameras give one file name.
    """
    form = RIG_FORMATS[name]
    if form.folder is not None:
        return form.folder(cameras)
    if form.one is None:
        raise ValueError(
            f"{name} is one file for all cameras; give a name that ends in {form.suffixes[0]}"
        )
    texts = {
        re.sub(r"[^\w.-]", "_", camera.name) + form.suffixes[0]: form.one(camera)
        for camera in cameras
    }
    if len(texts) < len(cameras):
        raise ValueError("names of two cameras give one file name; export them with --camera")
    return texts
