"""The network file, network.toml: what ``adjust`` works on, and as frozen dataclasses.

Reading is strict, as of the project file: an unknown key, a wrong type or a value
out of range is a ProjectFileError that names file, line and the nearest known key.
File names in it are relative to the file. docs/how-to/adjust.md has an example.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from videogrammetry.errors import ProjectFileError
from videogrammetry.geometry import rotation_from_vector
from videogrammetry.project.camera_sections import MAX_CAMERAS
from videogrammetry.project.network_tables import point_name
from videogrammetry.project.schema import SCHEMA
from videogrammetry.project.toml_table import TomlTable, nearest
from videogrammetry.types import INTERIOR_NAMES, FloatArray

#: What ``free`` and ``sigma`` of a camera may name.
CAMERA_UNKNOWNS = (*INTERIOR_NAMES, "aspect", "time_offset")
DIRECTIONS = ("measured", "ideal")
Datum = Literal["free", "weighted", "fixed"]
DATUMS: tuple[Datum, ...] = ("free", "weighted", "fixed")
RESIDUALS = ("measured", "corrected")
DEFAULT_SIGMA_PX = 0.1
DEFAULT_CRITICAL_VALUE = 3.29
#: Lengths in pixels bear their unit in the file.
_KEY = {"f": "f_px", "x0": "x0_px", "y0": "y0_px"}
_ROTATION_TOLERANCE = 1e-6


@dataclass(frozen=True, kw_only=True)
class NetworkCameraSection:
    """``[cameras.NAME]``.

    Attributes
    ----------
    image_size_px : (width, height).
    start : start values by ``CAMERA_UNKNOWNS``, those that are given; pixels.
    free : what is estimated; None: all ten interior parameters, each kept only if
        significant; (): nothing.
    sigma : standard deviations with which start values are observed.
    measured : direction of the distortion (``distortion = "measured" | "ideal"``).
    r0_px : None: 2/3 of the picture's half diagonal.
    """

    name: str
    image_size_px: tuple[int, int]
    start: Mapping[str, float] = field(default_factory=dict)
    free: tuple[str, ...] | None = None
    sigma: Mapping[str, float] = field(default_factory=dict)
    measured: bool = True
    r0_px: float | None = None


@dataclass(frozen=True, kw_only=True)
class NetworkImageSection:
    """``[images.NAME]``: the camera and, where given, the start pose cam_from_world."""

    name: str
    camera: str
    rotation: FloatArray | None = None
    translation_mm: FloatArray | None = None


@dataclass(frozen=True, kw_only=True)
class NetworkFile:
    """A network file as read; all paths are absolute.

    Attributes
    ----------
    sigma_px : a-priori standard deviation of an image coordinate where the
        observations state none; None: not given.
    datum : None: not given; then fixed points, else weighted ones, else all fix it.
    critical_value : of the data snooping; 0 = none.
    diameter_mm : of circles whose diameter the points table does not state.
    residuals : whose the residuals and sigmas are, "measured" or "corrected"; None: not
        given; then the corrected points' of PhotoModeler's export, else the measured ones'.
    """

    path: Path
    cameras: Mapping[str, NetworkCameraSection]
    images: Mapping[str, NetworkImageSection]
    observations: Path
    points: Path | None = None
    fixed: tuple[str, ...] = ()
    scale_bars: Path | None = None
    sigma_px: float | None = None
    datum: Datum | None = None
    critical_value: float = DEFAULT_CRITICAL_VALUE
    diameter_mm: float | None = None
    residuals: str | None = None

    @property
    def inputs(self) -> tuple[Path, ...]:
        """The file itself and every table that it names."""
        tables = (self.observations, self.points, self.scale_bars)
        beside = None if self.points is None else self.points.with_suffix(".npz")
        if beside is not None and not beside.is_file():
            beside = None
        return (self.path, *(path for path in (*tables, beside) if path is not None))

    def error(self, key: str, message: str) -> ProjectFileError:
        """The error to raise about a top-level key, with its line."""
        return TomlTable.load(self.path).error(key, message)


def read_network_file(path: str | os.PathLike[str]) -> NetworkFile:
    """Reads a network file, or the network.toml of a folder.

    Raises
    ------
    ProjectFileError
        Not there, not TOML, unknown key, wrong value, newer schema: the message
        names file, line and remedy. Files that it names are not looked at yet.
    """
    root, file = TomlTable.open_schema(path, "network.toml", "network", SCHEMA)
    folder = file.parent
    observations = root.string("observations")
    points = root.string("points", None)
    bars = root.string("scale_bars", None)
    cameras, images = root.table("cameras"), root.table("images")
    network = {
        "fixed": _fixed(root),
        "sigma_px": root.number("sigma_px", None, above=0),
        "datum": root.choice("datum", DATUMS, None),
        "critical_value": _snooping(root),
        "diameter_mm": root.number("diameter_mm", None, above=0),
        "residuals": root.choice("residuals", RESIDUALS, None),
    }
    root.finish()
    sections = _cameras(cameras)
    ideal = [name for name, section in sections.items() if not section.measured]
    if network["residuals"] == "corrected" and ideal:
        raise root.error(
            "residuals",
            f'= "corrected" needs distortion = "measured", and camera {ideal[0]} has "ideal": a '
            "distortion of the ideal point corrects no measured one; take one of both away",
        )
    if network["fixed"] and points is None:
        raise root.error("fixed", 'names points, but there is no table of them: add points = "..."')
    return NetworkFile(
        path=file,
        cameras=sections,
        images=_images(images, list(sections)),
        observations=folder / observations,
        points=None if points is None else folder / points,
        scale_bars=None if bars is None else folder / bars,
        **network,
    )


def _snooping(root: TomlTable) -> float:
    value = root.number_or_bool("snooping", DEFAULT_CRITICAL_VALUE)
    if value is True:
        return DEFAULT_CRITICAL_VALUE
    if value is False:
        return 0.0
    if not 1.0 <= value <= 100.0:
        raise root.error(
            "snooping",
            f"= {value:g} is out of range: expected false, or a critical value from 1 to 100 "
            f"(usual: {DEFAULT_CRITICAL_VALUE})",
        )
    return float(value)


def _fixed(root: TomlTable) -> tuple[str, ...]:
    names = tuple(point_name(name) for name in root.names_or_numbers("fixed", ()))
    for name in names:
        if names.count(name) > 1:
            raise root.error("fixed", f"names point {name} twice: take one away")
    return names


def _cameras(table: TomlTable) -> dict[str, NetworkCameraSection]:
    names = table.names()
    if not names:
        raise table.error(None, "names no camera: add a table [cameras.NAME] for each")
    if len(names) > MAX_CAMERAS:
        raise table.error(None, f"has {len(names)} cameras: at most {MAX_CAMERAS} are possible")
    return {name: _camera(table.table(name), name) for name in names}


def _camera(table: TomlTable, name: str) -> NetworkCameraSection:
    size = table.numbers("image_size_px", 2, what="[width, height]")
    if not all(isinstance(v, int) for v in size):
        raise table.error("image_size_px", f"= {list(size)}: expected whole numbers of pixels")
    start = _start(table)
    section = NetworkCameraSection(
        name=name,
        image_size_px=size,
        start=start,
        free=_names(table, "free"),
        sigma=_sigma(table),
        measured=table.choice("distortion", DIRECTIONS, "measured") == "measured",
        r0_px=table.number("r0_px", None, above=0),
    )
    table.finish()
    for parameter in section.sigma:
        if section.free is not None and parameter not in section.free:
            raise table.error(
                "sigma",
                f"has {parameter}, which free does not name, so that it is held: add it to free, "
                "or take its sigma away",
            )
    return section


def _start(table: TomlTable) -> dict[str, float]:
    """Start values, in the camera's own table or in ``[cameras.NAME.start]`` as in a project."""
    values = _values(table)
    inner = table.table("start")
    for name, value in _values(inner).items():
        if name in values:
            raise inner.error(
                _KEY.get(name, name), "stands in the camera's table as well: take one away"
            )
        values[name] = value
    inner.finish()
    return values


def _values(table: TomlTable) -> dict[str, float]:
    values = {
        name: table.number(_KEY.get(name, name), None, above=0 if name == "f" else -np.inf)
        for name in CAMERA_UNKNOWNS
    }
    f_mm = table.number("f_mm", None, above=0)
    pixel_mm = table.number("pixel_mm", None, above=0)
    if (f_mm is None) != (pixel_mm is None):
        raise table.error(None, "needs f_mm and pixel_mm together, or f_px alone")
    if f_mm is not None:
        if values["f"] is not None:
            raise table.error("f_mm", "and f_px are both given: take one away")
        values["f"] = f_mm / pixel_mm
    if values["aspect"] is not None and abs(values["aspect"]) > 0.5:
        raise table.error(
            "aspect",
            f"= {values['aspect']:g}: expected pixel height / width - 1, near 0 "
            "(square pixels: 0, not 1)",
        )
    return {name: float(value) for name, value in values.items() if value is not None}


def _names(table: TomlTable, key: str) -> tuple[str, ...] | None:
    names: tuple[str, ...] | None = table.strings(key, None, empty=True)
    for name in names or ():
        if name not in CAMERA_UNKNOWNS:
            raise table.error(
                key,
                f"has {name!r}, which is no parameter of a camera{nearest(name, CAMERA_UNKNOWNS)}",
            )
    if names is not None and len(set(names)) < len(names):
        raise table.error(key, "names a parameter twice: take one away")
    return names


def _sigma(table: TomlTable) -> dict[str, float]:
    inner = table.table("sigma")
    values = {name: inner.number(name, None, above=0) for name in CAMERA_UNKNOWNS}
    inner.finish()
    return {name: value for name, value in values.items() if value is not None}


def _images(table: TomlTable, cameras: list[str]) -> dict[str, NetworkImageSection]:
    return {name: _image(table.table(name), name, cameras) for name in table.names()}


def _image(table: TomlTable, name: str, cameras: list[str]) -> NetworkImageSection:
    camera = table.string("camera", cameras[0] if len(cameras) == 1 else None)
    if camera is None:
        raise table.error(None, f'camera is missing: add camera = "{cameras[0]}", or another')
    if camera not in cameras:
        raise table.error("camera", f"= {camera!r} is no camera of this file"
                          f"{nearest(camera, cameras)}")  # fmt: skip
    inner = table.table("cam_from_world")
    pose = inner if inner.names() else table
    rotation = _rotation(pose)
    translation = pose.vector("translation_mm", 3, None, what="[tx, ty, tz] in mm", zero=True)
    inner.finish()
    table.finish()
    if (rotation is None) != (translation is None):
        raise pose.error(None, "needs rotation (or rotation_rad) and translation_mm together, "
                         "the transform from the object's to the camera's frame")  # fmt: skip
    return NetworkImageSection(
        name=name,
        camera=camera,
        rotation=rotation,
        translation_mm=None if translation is None else np.array(translation),
    )


def _rotation(table: TomlTable) -> FloatArray | None:
    vector = table.vector("rotation_rad", 3, None, what="a rotation vector of 3", zero=True)
    value: Any = table.value("rotation", (list,), "3 rows of 3 numbers")
    if value is None:
        return None if vector is None else rotation_from_vector(vector)
    if vector is not None:
        raise table.error("rotation", "and rotation_rad are both given: take one away")
    try:
        matrix = np.array(value, dtype=float)
    except (TypeError, ValueError):
        matrix = np.empty(0)
    if matrix.shape != (3, 3) or not np.isfinite(matrix).all():
        raise table.error("rotation", "is wrong: expected 3 rows of 3 numbers")
    off = np.abs(matrix @ matrix.T - np.eye(3)).max()
    if off > _ROTATION_TOLERANCE or np.linalg.det(matrix) < 0:
        raise table.error("rotation", f"is no rotation matrix (off by {off:.2g}, determinant "
                          f"{np.linalg.det(matrix):.3g})")  # fmt: skip
    return matrix
