"""The project file, project.toml: what it may say, and as frozen dataclasses.

Reading is strict: an unknown key, a wrong type or a value out of range is a
ProjectFileError that names file, line and the nearest known key. File names in
it are relative to the file. docs/how-to/first-measurement.md has an example.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from videogrammetry.project.camera_sections import (
    CameraSection,
    InterfaceSection,
    camera_sections,
    interface_sections,
)
from videogrammetry.project.toml_table import TomlTable
from videogrammetry.project.verify_section import VerifySection, verify_section
from videogrammetry.types import POINT_FLAGS

#: The version of the file's layout that this program writes and reads.
SCHEMA = 1
DIRECTIONS = ("clockwise", "counter-clockwise")
POLARITIES = ("white-on-black", "black-on-white")
ESTIMATORS = ("auto", "mean-gradient", "dual-conic", "model")
FREE_POINTS = ("none", "target", "room", "stage")
FILTERS = ("none", "savitzky-golay", "butterworth")

_FAMILY = re.compile(r"(schneider|metashape)-\d+|none")


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
        cameras=camera_sections(
            tables["cameras"], tables["calibration"], tables["interfaces"].names()
        ),
        interfaces=interface_sections(tables["interfaces"]),
        calibration=_calibration(tables["calibration"], folder),
        targets=_targets(tables["targets"], folder),
        sequence=_sequence(tables["sequence"]),
        stability=_stability(tables["stability"], folder),
        motion=_motion(tables["motion"]),
        verify=verify_section(tables["verify"], folder),
        rig=rig,
    )


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
