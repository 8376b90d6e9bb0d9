"""``[cameras]`` and ``[interfaces]`` of the project file."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from videogrammetry.project.toml_table import TomlTable, nearest
from videogrammetry.types import INTERIOR_NAMES

MAX_CAMERAS = 64
START_NAMES = ("f_px", "x0_px", "y0_px", "A1", "A2", "A3", "B1", "B2", "E1", "E2")

_CAMERA_NAME = re.compile(r"[^\s+,/\\\"']([^+,/\\\"'\n]*[^\s+,/\\\"'])?")


@dataclass(frozen=True, kw_only=True)
class CameraSection:
    """``[cameras.NAME]``.

    Attributes
    ----------
    calibration, sequence : files, folders or patterns, relative to the project
        file (for ``sequence.open_sequence``), or None. ``calibration`` may also
        be one observations CSV, see :attr:`observations`.
    image_size_px : (width, height), needed with an observations CSV only.
    start : start values by ``START_NAMES``, pixels.
    free : interior parameters to estimate, this camera's or ``[calibration]``'s;
        None: all ten, each kept only if significant; (): none, poses alone.
    r0_px : this camera's or ``[calibration]``'s; None: 2/3 of the half diagonal.
    interface : the window ``[interfaces.NAME]`` that it looks through; None: none.
    first_frame : the frame of ``sequence`` (from 1) that is the first stage's; None: the
        first, where nothing says that the cameras are out of step.
    """

    name: str
    calibration: tuple[str, ...] | None = None
    sequence: tuple[str, ...] | None = None
    image_size_px: tuple[int, int] | None = None
    start: Mapping[str, float] = field(default_factory=dict)
    free: tuple[str, ...] | None = None
    r0_px: float | None = None
    interface: str | None = None
    first_frame: int | None = None

    @property
    def observations(self) -> str | None:
        """The observations CSV that stands for calibration pictures, or None."""
        if self.calibration and self.calibration[0].lower().endswith(".csv"):
            return self.calibration[0]
        return None


@dataclass(frozen=True, kw_only=True)
class InterfaceSection:
    """``[interfaces.NAME]``: a flat window into a fluid that cameras look through.

    Attributes
    ----------
    normal, distance_mm : the plane normal . X = distance_mm of the window's face on the
        cameras' side, ``normal`` pointing to them (made of unit length), in the target's
        frame (``frame`` = "target", one stage) or the first camera's ("rig").
    fluid : refractive index. glass : (index, thickness in mm); None: not counted.
    free : "normal", "distance": what the calibration estimates.
    sigma_normal_deg, sigma_distance_mm : how well the start values are known; None: not.
    """

    name: str
    normal: tuple[float, float, float]
    distance_mm: float
    fluid: float = 1.333
    glass: tuple[float, float] | None = None
    free: tuple[str, ...] = ()
    sigma_normal_deg: float | None = None
    sigma_distance_mm: float | None = None
    frame: str = "target"


def camera_sections(
    table: TomlTable, calibration: TomlTable, interfaces: list[str]
) -> dict[str, CameraSection]:
    """Reads all cameras; ``calibration`` has what holds for all of them.

    Raises
    ------
    ProjectFileError
        Names file, line and what to write instead.
    """
    names = table.names()
    if not names:
        raise table.error(None, "names no camera: add a table [cameras.NAME] for each")
    if len(names) > MAX_CAMERAS:
        raise table.error(None, f"has {len(names)} cameras: at most {MAX_CAMERAS} are possible")
    for name in names:
        if not _CAMERA_NAME.fullmatch(name):
            raise table.error(
                name, "is not a possible camera name: no + , / \\ quotes or outer spaces in it"
            )
    r0_px = calibration.number("r0_px", None, above=0)
    frees = _frees(calibration, names)
    return {
        name: _camera(table.table(name), name, frees[name], r0_px, interfaces) for name in names
    }


def _frees(calibration: TomlTable, cameras: list[str]) -> dict[str, tuple[str, ...] | None]:
    """``[calibration] free``: one list for all cameras, or a table of lists by camera."""
    if not calibration.is_table("free"):
        free = _interior_names(calibration, "free")
        return dict.fromkeys(cameras, free)
    table = calibration.table("free")
    for name in table.names():
        if name not in cameras:
            raise table.error(name, f"is not a camera of this project{nearest(name, cameras)}")
    return {name: _interior_names(table, name) for name in cameras}


def _interior_names(table: TomlTable, key: str) -> tuple[str, ...] | None:
    names: tuple[str, ...] | None = table.strings(key, None, empty=True)
    for name in names or ():
        if name not in INTERIOR_NAMES:
            raise table.error(
                key, f"has {name!r}, which is no interior parameter{nearest(name, INTERIOR_NAMES)}"
            )
    if names is not None and len(set(names)) < len(names):
        raise table.error(key, "names a parameter twice: take one away")
    return names


def _camera(
    table: TomlTable,
    name: str,
    free: tuple[str, ...] | None,
    r0_px: float | None,
    interfaces: list[str],
) -> CameraSection:
    size = table.numbers("image_size_px", 2, None, what="[width, height]")
    if size is not None and not all(isinstance(v, int) for v in size):
        raise table.error("image_size_px", f"= {list(size)}: expected whole numbers of pixels")
    own_free = _interior_names(table, "free")
    camera = CameraSection(
        name=name,
        calibration=table.strings("calibration", None),
        sequence=table.strings("sequence", None),
        image_size_px=size,
        start=_start(table.table("start")),
        free=free if own_free is None else own_free,
        r0_px=table.number("r0_px", r0_px, above=0),
        interface=table.string("interface", None),
        first_frame=table.integer("first_frame", None, minimum=1),
    )
    table.finish()
    if camera.interface is not None and camera.interface not in interfaces:
        raise table.error(
            "interface",
            f"= {camera.interface!r}: there is no table [interfaces.{camera.interface}]"
            f"{nearest(camera.interface, interfaces)}",
        )
    if camera.observations is not None:
        if len(camera.calibration or ()) > 1:
            raise table.error("calibration", "mixes an observations CSV with other files")
        if size is None:
            raise table.error(
                "calibration",
                "is a table of observations, which does not say how large the pictures are: "
                "add image_size_px = [width, height]",
            )
    return camera


def _start(table: TomlTable) -> dict[str, float]:
    start = {key: table.number(key, None) for key in START_NAMES if key != "f_px"}
    start["f_px"] = table.number("f_px", None, above=0)
    f_mm = table.number("f_mm", None, above=0)
    pixel_mm = table.number("pixel_mm", None, above=0)
    table.finish()
    if (f_mm is None) != (pixel_mm is None):
        raise table.error(None, "needs f_mm and pixel_mm together, or f_px alone")
    if f_mm is not None:
        if start["f_px"] is not None:
            raise table.error("f_mm", "and f_px are both given: take one away")
        start["f_px"] = f_mm / pixel_mm
    return {key: start[key] for key in START_NAMES if start[key] is not None}


def interface_sections(table: TomlTable) -> dict[str, InterfaceSection]:
    """Reads all windows; raises ProjectFileError as :func:`camera_sections`."""
    return {name: _interface(table.table(name), name) for name in table.names()}


def _interface(table: TomlTable, name: str) -> InterfaceSection:
    normal = table.vector("normal", 3, what="[x, y, z], pointing to the cameras")
    length = math.sqrt(sum(v * v for v in normal))
    glass = table.numbers("glass", 2, None, what="[index, thickness_mm]")
    section = InterfaceSection(
        name=name,
        normal=(normal[0] / length, normal[1] / length, normal[2] / length),
        distance_mm=table.number("distance_mm"),
        fluid=table.number("fluid", 1.333),
        glass=None if glass is None else (float(glass[0]), float(glass[1])),
        free=table.strings("free", (), empty=True),
        sigma_normal_deg=table.number("sigma_normal_deg", None, above=0),
        sigma_distance_mm=table.number("sigma_distance_mm", None, above=0),
        frame=table.choice("frame", ("target", "rig"), "target"),
    )
    table.finish()
    for word in section.free:
        if word not in ("normal", "distance"):
            raise table.error("free", f"has {word!r}: expected normal, distance")
    if not 1 <= section.fluid <= 4:
        raise table.error("fluid", f"= {section.fluid:g}: a refractive index is 1 to 4")
    if section.glass is not None and not (1 <= section.glass[0] <= 4 and section.glass[1] >= 0):
        raise table.error(
            "glass", f"= {list(section.glass)}: expected an index of 1 to 4 and a thickness in mm"
        )
    return section
