"""The project file, project.toml: what it may say, and as frozen dataclasses.

Reading is strict: an unknown key, a wrong type or a value out of range is a
ProjectFileError that names file, line and the nearest known key. File names in
it are relative to the file. docs/how-to/first-measurement.md has an example.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from videogrammetry.project.toml_table import TomlTable, nearest
from videogrammetry.project.verify_section import VerifySection, verify_section
from videogrammetry.types import INTERIOR_NAMES, POINT_FLAGS

#: The version of the file's layout that this program writes and reads.
SCHEMA = 1
MAX_CAMERAS = 64
DIRECTIONS = ("clockwise", "counter-clockwise")
POLARITIES = ("white-on-black", "black-on-white")
ESTIMATORS = ("auto", "mean-gradient", "dual-conic", "model")
FREE_POINTS = ("none", "target", "room", "stage")
FILTERS = ("none", "savitzky-golay", "butterworth")
START_NAMES = ("f_px", "x0_px", "y0_px", "A1", "A2", "A3", "B1", "B2", "E1", "E2")

_FAMILY = re.compile(r"(schneider|metashape)-\d+|none")
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


@dataclass(frozen=True, kw_only=True)
class CalibrationSection:
    """``[calibration]``: target and scale bars (CSV files), how good the target is, the start.

    Without ``target``, ``scale_bars`` name targets of a waved bar (a wand): they and all
    others are points of unknown place, but those of ``still``, which keep it at all stages.
    ``free_points``: what coded targets beside the target stand still relative to, see
    ``calibration.CalibrationOptions``. ``time_offset``: estimate how late each camera is.
    ``rig``: an earlier rig.json whose interior parameters are start values, and observed
    with their standard deviations if ``hold_to_rig``.
    """

    target: Path | None = None
    sigma_mm: float | None = None
    scale_bars: Path | None = None
    still: tuple[int, ...] = ()
    free_points: str = "none"
    time_offset: bool = False
    rig: Path | None = None
    hold_to_rig: bool = False


@dataclass(frozen=True, kw_only=True)
class TargetsSection:
    """``[targets]``: what the targets look like.

    ``codes`` is a family's name, ``none``, or the absolute path of a table file.
    ``diameter_px`` is the smallest minor and the largest major axis;
    ``diameter_mm`` the circle's diameter: ``measure`` leaves out what has another
    size, and corrects the ellipses' centres to those of the circles;
    ``thickness_mm`` a sticker's height over the surface. ``estimator`` is how a
    dot that was found is measured, see ``recognition.RecognitionOptions``. Of a
    sequence targets are followed from frame to frame; every ``full_every`` frames
    the whole one is searched (1: every one).
    """

    codes: str = "schneider-14"
    direction: str = "clockwise"
    polarity: str = "white-on-black"
    diameter_px: tuple[float, float] = (5.0, 200.0)
    method: str = "edge-pair"
    estimator: str = "auto"
    diameter_mm: float | None = None
    thickness_mm: float = 0.0
    full_every: int = 25


@dataclass(frozen=True, kw_only=True)
class SequenceSection:
    """``[sequence]``: frame rate over the files' own; stages to take, inclusive, from 1."""

    frame_rate_hz: float | None = None
    first: int = 1
    last: int | None = None


@dataclass(frozen=True, kw_only=True)
class StabilitySection:
    """``[stability]``: points that do not move, a points CSV."""

    points: Path | None = None


#: Stages of the largest gap that may be filled: what lies behind a longer one is a guess.
MOST_FILLED = 100


@dataclass(frozen=True, kw_only=True)
class MotionSection:
    """``[motion]``: the stage that displacements refer to, and the smoothing filter.

    Where a point is missing for ``fill_gaps`` stages in a row or fewer, its positions are
    estimated and flagged ``filled``; 0: none are.
    ``filter_window`` (stages, odd) and ``filter_order`` are for savitzky-golay,
    ``filter_order`` and ``filter_cutoff_hz`` for butterworth. Positions with a flag of
    ``leave_out`` (names of ``types.POINT_FLAGS``) take no part in the motion.
    """

    reference_stage: int = 1
    fill_gaps: int = 0
    leave_out: tuple[str, ...] = ()
    filter: str = "none"
    filter_window: int = 5
    filter_order: int = 2
    filter_cutoff_hz: float | None = None


@dataclass(frozen=True, kw_only=True)
class Project:
    """A project file as read; ``path`` is absolute.

    ``rig``: the calibrated cameras that it shares with other projects; None: its own.
    """

    path: Path
    name: str
    cameras: Mapping[str, CameraSection]
    interfaces: Mapping[str, InterfaceSection] = field(default_factory=dict)
    calibration: CalibrationSection = field(default_factory=CalibrationSection)
    targets: TargetsSection = field(default_factory=TargetsSection)
    sequence: SequenceSection = field(default_factory=SequenceSection)
    stability: StabilitySection = field(default_factory=StabilitySection)
    motion: MotionSection = field(default_factory=MotionSection)
    verify: VerifySection = field(default_factory=VerifySection)
    rig: Path | None = None

    @property
    def folder(self) -> Path:
        """Where relative names start from, and where the results lie."""
        return self.path.parent

    @property
    def rig_path(self) -> Path:
        """rig.json beside the project file, or the one that ``rig`` names."""
        return self.rig or self.folder / "rig.json"

    @property
    def measurement_path(self) -> Path:
        """measurement.h5 beside the project file."""
        return self.folder / "measurement.h5"


def read_project(path: str | os.PathLike[str]) -> Project:
    """Reads a project file, or the project.toml of a folder.

    Raises
    ------
    ProjectFileError
        Not there, not TOML, unknown key, wrong value, newer schema: the message
        names file, line and remedy. Files that it names are not looked at yet.
    """
    root, file = TomlTable.open_schema(path, "project.toml", "project", SCHEMA)
    folder = file.parent
    name = root.string("name", folder.name)
    rig = _file(root, "rig", folder)
    sections = (
        "cameras",
        "interfaces",
        "calibration",
        "targets",
        "sequence",
        "stability",
        "motion",
        "verify",
    )
    tables = {section: root.table(section) for section in sections}
    root.finish()
    return Project(
        path=file,
        name=name,
        cameras=_cameras(tables["cameras"], tables["calibration"], tables["interfaces"].names()),
        interfaces=_interfaces(tables["interfaces"]),
        calibration=_calibration(tables["calibration"], folder),
        targets=_targets(tables["targets"], folder),
        sequence=_sequence(tables["sequence"]),
        stability=_stability(tables["stability"], folder),
        motion=_motion(tables["motion"]),
        verify=verify_section(tables["verify"], folder),
        rig=rig,
    )


def _interfaces(table: TomlTable) -> dict[str, InterfaceSection]:
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


def _cameras(
    table: TomlTable, calibration: TomlTable, interfaces: list[str]
) -> dict[str, CameraSection]:
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


def _file(table: TomlTable, key: str, folder: Path) -> Path | None:
    name = table.string(key, None)
    return None if name is None else folder / name


def _calibration(table: TomlTable, folder: Path) -> CalibrationSection:
    section = CalibrationSection(
        target=_file(table, "target", folder),
        sigma_mm=table.number("sigma_mm", None, above=0),
        scale_bars=_file(table, "scale_bars", folder),
        still=table.integers("still", (), what="targets' numbers, like [101, 102]"),
        free_points=table.choice("free_points", FREE_POINTS, "none"),
        time_offset=table.boolean("time_offset", False),
        rig=_file(table, "rig", folder),
        hold_to_rig=table.boolean("hold_to_rig", False),
    )
    if section.free_points != "none" and section.target is None:
        raise table.error(
            "free_points",
            "is for targets beside a known one: add target, or leave it out (a "
            "waved bar's targets are all free; those of still keep their place)",
        )
    if section.free_points != "none" and section.time_offset:
        raise table.error("free_points", "and time_offset do not go together: take one away")
    if section.hold_to_rig and section.rig is None:
        raise table.error("hold_to_rig", 'needs the rig to be held to: rig = "rig.json"')
    table.finish()
    return section


def _targets(table: TomlTable, folder: Path) -> TargetsSection:
    default = TargetsSection()
    codes = table.string("codes", default.codes)
    if not _FAMILY.fullmatch(codes):
        if not (folder / codes).is_file():
            raise table.error(
                "codes",
                f"= {codes!r} is neither a family (schneider-14, metashape-12, ...), nor none, "
                f"nor a table file in {folder}",
            )
        codes = str(folder / codes)
    what = "[smallest, largest] diameter in pixels"
    smallest, largest = table.numbers("diameter_px", 2, default.diameter_px, what=what)
    if smallest >= largest:
        raise table.error("diameter_px", f"= [{smallest}, {largest}]: expected {what}")
    thickness_mm = table.number("thickness_mm", default.thickness_mm)
    if thickness_mm < 0:
        raise table.error("thickness_mm", f"= {thickness_mm:g} is negative: expected 0 or more")
    section = TargetsSection(
        codes=codes,
        direction=table.choice("direction", DIRECTIONS, default.direction),
        polarity=table.choice("polarity", POLARITIES, default.polarity),
        diameter_px=(float(smallest), float(largest)),
        method=table.string("method", default.method),
        estimator=table.choice("estimator", ESTIMATORS, default.estimator),
        diameter_mm=table.number("diameter_mm", None, above=0),
        thickness_mm=thickness_mm,
        full_every=table.integer("full_every", default.full_every, minimum=1),
    )
    table.finish()
    return section


def _sequence(table: TomlTable) -> SequenceSection:
    section = SequenceSection(
        frame_rate_hz=table.number("frame_rate_hz", None, above=0),
        first=table.integer("first", 1, minimum=1),
        last=table.integer("last", None, minimum=1),
    )
    table.finish()
    if section.last is not None and section.last < section.first:
        raise table.error("last", f"= {section.last} comes before first = {section.first}")
    return section


def _stability(table: TomlTable, folder: Path) -> StabilitySection:
    section = StabilitySection(points=_file(table, "points", folder))
    table.finish()
    return section


def _motion(table: TomlTable) -> MotionSection:
    default = MotionSection()
    section = MotionSection(
        reference_stage=table.integer("reference_stage", default.reference_stage, minimum=1),
        fill_gaps=table.integer("fill_gaps", default.fill_gaps),
        leave_out=table.strings("leave_out", (), empty=True),
        filter=table.choice("filter", FILTERS, default.filter),
        filter_window=table.integer("filter_window", default.filter_window, minimum=3),
        filter_order=table.integer("filter_order", default.filter_order, minimum=1),
        filter_cutoff_hz=table.number("filter_cutoff_hz", None, above=0),
    )
    table.finish()
    for word in section.leave_out:
        if word not in POINT_FLAGS:
            raise table.error("leave_out", f"has {word!r}: expected {', '.join(POINT_FLAGS)}")
    if section.fill_gaps > MOST_FILLED:
        raise table.error("fill_gaps", f"= {section.fill_gaps}: expected 0 to {MOST_FILLED} stages")
    if section.filter_window % 2 == 0 or section.filter_window <= section.filter_order:
        raise table.error(
            "filter_window", "must be odd and larger than filter_order, so that it has a middle"
        )
    if section.filter == "butterworth" and section.filter_cutoff_hz is None:
        raise table.error("filter", "= 'butterworth' needs filter_cutoff_hz")
    return section
