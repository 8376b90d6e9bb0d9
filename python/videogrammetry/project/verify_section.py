"""``[verify]`` of the project file: what checks a measurement."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from videogrammetry.project.toml_table import TomlTable


@dataclass(frozen=True, kw_only=True)
class VerifySection:
    """``[verify]``: known things that check the measurement, none of them used to make it.

    Attributes
    ----------
    scale_bars : a scale-bar CSV of lengths to check.
    free_fall : first and last stage of a free fall, inclusive; None: none.
    gravity_m_s2 : the local one; None: the standard 9.80665.
    drag_per_m : k of dv/dt = g - k |v| v; ``estimate_drag``: ``drag_per_m = "estimate"``.
    points : numbers of the falling points; None: all.
    vertical : upward direction in the rig's frame; None: from the fall.
    truth : folder with the rig.json and trajectories.csv of a simulated sequence.
    """

    scale_bars: Path | None = None
    free_fall: tuple[int, int] | None = None
    gravity_m_s2: float | None = None
    drag_per_m: float = 0.0
    estimate_drag: bool = False
    points: tuple[int, ...] | None = None
    vertical: tuple[float, float, float] | None = None
    truth: Path | None = None

    @property
    def anything(self) -> bool:
        """Whether there is something to check against."""
        return not (self.scale_bars is None and self.free_fall is None and self.truth is None)


def verify_section(table: TomlTable, folder: Path) -> VerifySection:
    """The table as read; ProjectFileError for what is wrong in it."""
    estimate = table.is_text("drag_per_m")
    if estimate:
        table.choice("drag_per_m", ("estimate",))
    section = VerifySection(
        scale_bars=_path(table, "scale_bars", folder),
        free_fall=table.integers("free_fall", None, what="[first, last] stage", count=2),
        gravity_m_s2=table.number("gravity_m_s2", None, above=0),
        drag_per_m=0.0 if estimate else table.number("drag_per_m", 0.0),
        estimate_drag=estimate,
        points=table.integers("points", None, what="a list of point numbers"),
        vertical=table.vector("vertical", 3, None, what="[x, y, z], the direction upwards"),
        truth=_path(table, "truth", folder),
    )
    table.finish()
    if section.drag_per_m < 0:
        raise table.error("drag_per_m", f"= {section.drag_per_m:g} is negative: expected 0 or more")
    if section.free_fall is not None and not 1 <= section.free_fall[0] < section.free_fall[1]:
        raise table.error(
            "free_fall", f"= {list(section.free_fall)}: expected [first, last] stage, from 1"
        )
    return section


def _path(table: TomlTable, key: str, folder: Path) -> Path | None:
    name = table.string(key, None)
    return None if name is None else folder / name
