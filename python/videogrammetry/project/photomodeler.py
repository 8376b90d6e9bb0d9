"""PhotoModeler's text export of a project: the marks, as image points."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path, PureWindowsPath

import numpy as np

from videogrammetry.errors import TableError
from videogrammetry.types import FloatArray

#: PhotoModeler counts pixels from the corner of the top-left one, we from its centre.
CORNER_TO_CENTRE_PX = 0.5
_PICTURE = re.compile(r"\s*(\d+)\s+(\S.*\.\w+)\s*")
#: Lines of one picture: its name, pose and sigmas, covariance, interior and sigmas.
_LINES_OF_PICTURE = 6
_MARK_CELLS = 6


@dataclass(frozen=True, kw_only=True)
class PhotoModelerMarks:
    """Marks by names: picture (its file's name) and point; (M, 2) px and (M,) sigma, px."""

    image: tuple[str, ...]
    point: tuple[str, ...]
    xy_px: FloatArray
    sigma_px: FloatArray


def read_photomodeler_marks(path: Path) -> PhotoModelerMarks | None:
    """Reads the marks of PhotoModeler's text export, or None if the file is none.

    The export has five lines of head (title; tolerance, iterations, picture's
    width and height; nine sigmas; the default camera and its sigmas), six a picture
    (number and file; pose; its sigmas; covariances; interior; its sigmas), and then,
    each block ended by an empty line: control points, object points (id, x, y, z
    and sigmas), marks ``picture point x y sigma_x sigma_y`` in pixels, and features,
    which are not read. Pictures are numbered from 0 and named by their file without
    its folder. x and y count from the picture's corner; 0.5 px is taken off.

    Raises
    ------
    TableError
        The file begins as an export and goes on as something else, line named.
    """
    if path.suffix.lower() == ".csv" or not path.is_file():
        return None
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    if not _is_export(lines):
        return None
    pictures, at = _pictures(lines)
    if not pictures:
        raise TableError(f"{path}: PhotoModeler's export names no picture; export the project anew")
    blocks = _blocks(lines, at)
    # The first block of lines with six numbers; control and object points have seven.
    marks = next((b for b in blocks if len(lines[b[0]].split()) == _MARK_CELLS), None)
    if marks is None:
        raise TableError(
            f"{path}: PhotoModeler's export holds no marks (lines of picture, point, x, y and two "
            "sigmas); export it with its marks, or give the observations as a CSV table"
        )
    images, points, values = [], [], np.empty((len(marks), 4))
    seen: dict[tuple[str, str], int] = {}
    for row, index in enumerate(marks):
        cells = lines[index].split()
        picture, point = pictures.get(cells[0]), cells[1]
        where = f"{path}, line {index + 1}"
        if picture is None:
            raise TableError(
                f"{where}: a mark of picture {cells[0]}, which the export does not name"
            )
        try:
            values[row] = [float(cell) for cell in cells[2:]]
        except ValueError:
            values[row] = math.nan
        if len(cells) != _MARK_CELLS or not np.isfinite(values[row]).all():
            raise TableError(
                f"{where}: {lines[index].strip()!r} is no mark (picture, point, x, y, sigma_x, "
                "sigma_y); correct it, or take it out"
            )
        if (picture, point) in seen:
            raise TableError(
                f"{where}: point {point} stands twice in picture {picture}, first on line "
                f"{seen[picture, point]}: every one may stand once; take one out"
            )
        seen[picture, point] = index + 1
        images.append(picture)
        points.append(point)
    sigma = np.sqrt((values[:, 2:] ** 2).mean(axis=1))
    return PhotoModelerMarks(
        image=tuple(images),
        point=tuple(points),
        xy_px=values[:, :2] - CORNER_TO_CENTRE_PX,
        sigma_px=np.where(sigma > 0, sigma, np.nan),
    )


def _is_export(lines: list[str]) -> bool:
    """Nine numbers on the third line, ten or eleven on both that follow, as every export has."""
    if len(lines) < 12:
        return False
    counts = [_count_numbers(line) for line in lines[1:5]]
    return counts[0] in (2, 4) and counts[1] == 9 and all(9 <= c <= 11 for c in counts[2:])


def _count_numbers(line: str) -> int:
    """How many numbers a line holds, -1 if anything else is in it."""
    try:
        return len([float(cell) for cell in line.split()])
    except ValueError:
        return -1


def _pictures(lines: list[str]) -> tuple[dict[str, str], int]:
    """Number -> file name of the pictures, and where what follows them begins."""
    pictures: dict[str, str] = {}
    at = 5
    while at < len(lines):
        match = _PICTURE.fullmatch(lines[at])
        if match is None or _count_numbers(lines[at]) > 0:
            break
        # Names of Windows and of others alike.
        pictures[match[1]] = PureWindowsPath(match[2].replace("/", "\\")).name
        at += _LINES_OF_PICTURE
    return pictures, at


def _blocks(lines: list[str], start: int) -> list[list[int]]:
    """Line numbers (from 0) of the runs of lines that are not empty."""
    blocks: list[list[int]] = [[]]
    for index in range(start, len(lines)):
        if lines[index].strip():
            blocks[-1].append(index)
        elif blocks[-1]:
            blocks.append([])
    return [block for block in blocks if block]
