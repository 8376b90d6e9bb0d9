"""``plan.toml``: a rig that is planned, the volume it is to measure, how it will be calibrated."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from videogrammetry.errors import ProjectFileError
from videogrammetry.geometry import MeasuringVolume, default_r0_px, rotation_looking_at
from videogrammetry.project.rig_file import read_rig
from videogrammetry.project.toml_table import TomlTable, nearest
from videogrammetry.types import INTERIOR_NAMES, RigCamera, RigData

#: The version of the file's layout that this program reads.
PLAN_SCHEMA = 1
TARGET_KINDS = ("cross", "board")


@dataclass(frozen=True, kw_only=True)
class PlanTarget:
    """``[target]``: the calibration target.

    Attributes
    ----------
    points : a points CSV; None: ``kind``.
    kind : "cross" (two-sided, 98 points, ``span_mm``) or "board" (flat, ``size_mm``, ``grid``).
    sigma_mm : of the points' coordinates.
    part : of the volume's extent over which its middle is moved; tilt_deg : largest tilt
        against the direction to the cameras; whole : it is always whole in the pictures.
    """

    points: Path | None = None
    kind: str = "cross"
    span_mm: float = 1400.0
    size_mm: tuple[float, float] = (1000.0, 800.0)
    grid: tuple[int, int] = (7, 5)
    sigma_mm: float = 0.1
    part: float = 1.0
    tilt_deg: float = 45.0
    whole: bool = False


@dataclass(frozen=True, kw_only=True)
class PlanFile:
    """What ``plan`` works on.

    Attributes
    ----------
    rig : the cameras, with a covariance where a calibrated rig was given.
    volume : None: where the cameras look. groups : names of cameras that see a place together.
    sigma_px : of an image coordinate; None: the rig's own, else 0.05.
    positions : of the target; None: a calibrated rig's own covariance, else 16.
    free : interior parameters that the calibration estimates; None: the usual.
    frame : "volume" or "rig": of a position's uncertainty.
    length_mm : of the distances; None: 1000, or what the volume holds.
    inputs : files read.
    """

    name: str
    rig: RigData
    target: PlanTarget = field(default_factory=PlanTarget)
    volume: MeasuringVolume | None = None
    groups: tuple[tuple[str, ...], ...] = ()
    sigma_px: float | None = None
    positions: int | None = None
    free: tuple[str, ...] | None = None
    frame: str = "volume"
    length_mm: float | None = None
    inputs: tuple[Path, ...] = ()


def read_plan(path: str | os.PathLike[str]) -> PlanFile:
    """Read plan.toml, or a rig.json with everything else at its default.

    Raises
    ------
    ProjectFileError
        Not there, not TOML, an unknown key, a value that cannot be; with file and line.
    """
    file = Path(path)
    if file.is_dir():
        found = [file / n for n in ("plan.toml", "rig.json") if (file / n).is_file()]
        if not found:
            raise ProjectFileError(f"{file}: neither plan.toml nor rig.json lies in this folder")
        file = found[0]
    if not file.is_file():
        raise ProjectFileError(
            f"{file}: there is no such file; give a plan.toml, or the rig.json of a calibration"
        )
    if file.suffix.lower() == ".json":
        return PlanFile(name=file.stem, rig=read_rig(file), inputs=(file,))
    table = TomlTable.load(file)
    schema = table.integer("schema", PLAN_SCHEMA, minimum=1)
    if schema > PLAN_SCHEMA:
        raise table.error("schema", f"= {schema} is newer than this program; update videogrammetry")
    rig, inputs = _rig(table, file)
    target = _target(table.table("target"), file.parent)
    plan = PlanFile(
        name=table.string("name", file.stem),
        rig=rig,
        target=target,
        volume=_volume(table.table("volume"), "volume" in table.names()),
        groups=_groups(table.table("groups"), rig),
        sigma_px=table.number("sigma_px", None, above=0),
        positions=table.integer("positions", None, minimum=1),
        free=_free(table),
        frame=table.choice("frame", ("volume", "rig"), "volume"),
        length_mm=table.number("length_mm", None, above=0),
        inputs=(file, *inputs, *([] if target.points is None else [target.points])),
    )
    table.finish()
    return plan


def _rig(table: TomlTable, file: Path) -> tuple[RigData, list[Path]]:
    """The cameras of ``[cameras]`` or of the rig file that is named."""
    beside = table.string("rig", None)
    cameras = table.table("cameras")
    names = cameras.names()
    if (beside is None) == (not names):
        raise table.error(
            None, 'one of rig = "rig.json" and [cameras.NAME] must say which cameras there are'
        )
    if beside is not None:
        return read_rig(file.parent / beside), [file.parent / beside]
    rig = RigData(
        cameras={name: _camera(cameras, name) for name in names}, reference="the plan's own axes"
    )
    cameras.finish()
    return rig, []


def _camera(cameras: TomlTable, name: str) -> RigCamera:
    table = cameras.table(name)
    width, height = table.numbers("image_size_px", 2, what="[width, height] in pixels")
    f_px = table.number("f_px", None, above=0)
    f_mm = table.number("f_mm", None, above=0)
    pixel_mm = table.number("pixel_mm", None, above=0)
    if (f_px is None) == (f_mm is None) or (f_mm is None) != (pixel_mm is None):
        raise table.error(None, "needs f_px, or f_mm and pixel_mm (a pixel's size), not both")
    interior = np.zeros(len(INTERIOR_NAMES))
    interior[0] = f_px if f_px is not None else f_mm / pixel_mm
    for k, key in enumerate(("x0_px", "y0_px", *INTERIOR_NAMES[3:]), start=1):
        interior[k] = table.number(key, 0.0)
    r0 = table.number("r0_px", None, above=0)
    position = table.point("position_mm")
    look_at = table.point("look_at_mm")
    up = table.vector("up", 3, (0.0, 0.0, 1.0), what="[x, y, z], the direction upwards")
    table.finish()
    try:
        rotation = rotation_looking_at(position, look_at, up)
    except ValueError as error:
        raise table.error("look_at_mm", f"= {list(look_at)}: {error}") from error
    size = (int(width), int(height))
    return RigCamera(
        image_size_px=size,
        interior=interior,
        r0_px=default_r0_px(size) if r0 is None else r0,
        rotation=rotation,
        translation_mm=-rotation @ np.array(position),
    )


def _volume(table: TomlTable, given: bool) -> MeasuringVolume | None:
    if not given:
        return None
    centre = table.point("centre_mm", (0.0, 0.0, 0.0))
    radius = table.number("radius_mm", None, above=0)
    size = table.numbers("size_mm", 3, None, what="[x, y, z], the box's edges in mm")
    if (radius is None) == (size is None):
        raise table.error(None, "needs size_mm of a box, or radius_mm of a ball")
    table.finish()
    return MeasuringVolume(
        centre_mm=np.array(centre),
        size_mm=np.array(size, dtype=float) if radius is None else np.full(3, 2 * radius),
        shape="box" if radius is None else "sphere",
    )


def _groups(table: TomlTable, rig: RigData) -> tuple[tuple[str, ...], ...]:
    groups = []
    for key in table.names():
        group = table.strings(key)
        for name in group:
            if name not in rig.cameras:
                raise table.error(key, f"names no camera {name!r}{nearest(name, rig.cameras)}")
        if len(set(group)) < 2:
            raise table.error(key, "needs two cameras or more")
        groups.append(group)
    return tuple(groups)


def _target(table: TomlTable, folder: Path) -> PlanTarget:
    points = table.string("points", None)
    kind = table.choice("kind", TARGET_KINDS, None)
    if points is not None and kind is not None:
        raise table.error("kind", "and points both say which target: take one away")
    standard = PlanTarget()
    span = table.number("span_mm", None, above=0)
    size = table.numbers("size_mm", 2, None, what="[width, height] in mm")
    grid = table.integers("grid", None, what="[across, down], numbers of points", count=2)
    if span is not None and (points is not None or kind == "board"):
        raise table.error("span_mm", "belongs to the cross; a board has size_mm")
    if kind != "board" and not (size is None and grid is None):
        raise table.error("size_mm" if size else "grid", 'belongs to kind = "board"')
    if grid is not None and min(grid) < 2:
        raise table.error("grid", f"= {list(grid)}: expected 2 x 2 points or more")
    target = PlanTarget(
        points=None if points is None else folder / points,
        kind=kind or standard.kind,
        span_mm=span or standard.span_mm,
        size_mm=standard.size_mm if size is None else (float(size[0]), float(size[1])),
        grid=standard.grid if grid is None else (int(grid[0]), int(grid[1])),
        sigma_mm=table.number("sigma_mm", standard.sigma_mm, above=0),
        part=table.number("part", standard.part, above=0),
        tilt_deg=table.number("tilt_deg", standard.tilt_deg, above=0),
        whole=table.boolean("whole", standard.whole),
    )
    table.finish()
    if target.tilt_deg >= 90:
        raise table.error("tilt_deg", f"= {target.tilt_deg:g}: expected less than 90 degrees")
    return target


def _free(table: TomlTable) -> tuple[str, ...] | None:
    free = table.strings("free", None, empty=True)
    for name in free or ():
        if name not in INTERIOR_NAMES:
            raise table.error(
                "free", f"names no interior parameter {name!r}{nearest(name, INTERIOR_NAMES)}"
            )
    return None if free is None else tuple(free)
