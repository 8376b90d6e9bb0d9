"""AICON's table of object coordinates, ``.obc``."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from videogrammetry.errors import TableError
from videogrammetry.types import FloatArray

_COMMENT = ("#", ";", "//", "%", "*", "!")


@dataclass(frozen=True, kw_only=True)
class AiconPoints:
    """Names, (N, 3) positions and (N, 3) sigmas in mm, NaN where the line has none."""

    name: tuple[str, ...]
    position_mm: FloatArray
    sigma_mm: FloatArray


def read_aicon_points(path: Path) -> AiconPoints:
    """Reads ``.obc``: one point a line, ``id x y z [sx sy sz] [more]``, in mm.

    Cells stand apart by blanks, tabs, commas or semicolons. Lines before the first
    point that are no points are taken for a heading; empty lines and those that
    begin with # ; // % * ! are passed over. Columns 5 to 7 are taken as sigmas
    where they are three positive numbers; what stands behind them (numbers of rays,
    diameters) is not read.

    Raises
    ------
    TableError
        Not there, no point, a line that is none among the points, a repeated id.
    """
    if not path.is_file():
        raise TableError(f"{path}: there is no such table; correct its name")
    names: list[str] = []
    rows: list[list[float]] = []
    lines: dict[str, int] = {}
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.lstrip().startswith(_COMMENT):
            continue
        cells = re.split(r"[\s,;]+", line.strip(" \t,;"))
        values = [_number(cell) for cell in cells[1:7]]
        if len(values) < 3 or not all(math.isfinite(v) for v in values[:3]):
            if not names:
                continue  # a heading
            raise TableError(
                f"{path}, line {number}: {line.strip()!r} is no point (id x y z [sx sy sz]); "
                "correct it, or take it out"
            )
        if cells[0] in lines:
            raise TableError(
                f"{path}, line {number}: point {cells[0]} stands twice, first on line "
                f"{lines[cells[0]]}: every one may stand once; rename or delete one"
            )
        lines[cells[0]] = number
        names.append(cells[0])
        sigmas = values[3:] if len(values) == 6 and all(v > 0 for v in values[3:]) else []
        rows.append(values[:3] + (sigmas or [math.nan] * 3))
    if not names:
        raise TableError(
            f"{path}: no point in this table; expected lines id x y z [sx sy sz] in mm"
        )
    table = np.array(rows)
    return AiconPoints(name=tuple(names), position_mm=table[:, :3], sigma_mm=table[:, 3:])


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return math.nan
