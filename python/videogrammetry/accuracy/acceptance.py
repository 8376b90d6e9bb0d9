"""What an acceptance test of lengths by VDI/VDE 2634 part 1 needs, and what a set has of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from videogrammetry.types import FloatArray

#: Numbers of the guideline: measuring lines, test lengths on each, longest length by the diagonal.
MIN_LINES = 7
MIN_LENGTHS_PER_LINE = 5
MIN_DIAGONAL_SHARE = 2 / 3

# Two placements belong to one measuring line if they point alike and lie beside each other.
_SAME_DIRECTION_RAD = np.deg2rad(5.0)
_SAME_PLACE_BY_DIAGONAL = 0.05
_SAME_LENGTH = 0.01  # relative: nearer ones are the same test length
_CORNER = 0.25  # share of each side within which a length ends "in the corner"


@dataclass(frozen=True, kw_only=True)
class AcceptanceCheck:
    """One condition: what is asked for, what the set has; ``met`` None: cannot be judged."""

    condition: str
    found: str
    met: bool | None


def acceptance_checks(
    end_a_mm: FloatArray,
    end_b_mm: FloatArray,
    nominal_mm: FloatArray,
    error_mm: FloatArray,
    volume_mm: FloatArray | None,
) -> tuple[AcceptanceCheck, ...]:
    """The conditions of VDI/VDE 2634 part 1 for lengths (N,) with ends (N, 3).

    The measuring volume is the box, along the frame's axes, around
    ``volume_mm`` (the calibrated places); None: around the ends themselves. A
    measuring line gathers placements within 5 degrees and 5 % of the diagonal
    of each other; test lengths differ by 1 % or more.

    References
    ----------
    VDI/VDE 2634 part 1, Optical 3D measuring systems - Imaging systems with
    point-by-point probing: seven or more measuring lines through the volume,
    five or more test lengths on each, the longest of a line at least the
    volume's shortest side, one at least two thirds of its diagonal, ends in
    the corners, every error within the stated limit E = A + K L <= B.
    """
    places = np.concatenate([end_a_mm, end_b_mm]) if volume_mm is None else volume_mm
    low, high = places.min(axis=0), places.max(axis=0)
    sides = high - low
    diagonal = float(np.linalg.norm(sides))
    lines = measuring_lines(end_a_mm, end_b_mm, _SAME_PLACE_BY_DIAGONAL * diagonal)
    per_line = [_distinct(nominal_mm[lines == k]) for k in range(int(lines.max()) + 1)]
    longest = [float(nominal_mm[lines == k].max()) for k in range(len(per_line))]
    full = sum(n >= MIN_LENGTHS_PER_LINE for n in per_line)
    reaching = sum(length >= sides.min() for length in longest)
    corners = _corners(np.concatenate([end_a_mm, end_b_mm]), low, sides)
    share = float(nominal_mm.max()) / diagonal if diagonal > 0 else float("nan")
    return (
        AcceptanceCheck(
            condition=f"{MIN_LINES} measuring lines or more",
            found=f"{len(per_line)}",
            met=len(per_line) >= MIN_LINES,
        ),
        AcceptanceCheck(
            condition=f"{MIN_LENGTHS_PER_LINE} test lengths or more on each of them",
            found=f"at most {max(per_line)}, {full} lines with enough",
            met=full >= MIN_LINES,
        ),
        AcceptanceCheck(
            condition="longest of every line at least the shortest side",
            found=f"{reaching} lines reach {sides.min():.0f} mm",
            met=reaching == len(per_line),
        ),
        AcceptanceCheck(
            condition="longest of all at least 2/3 of the diagonal",
            found=f"{share:.2f} of {diagonal:.0f} mm",
            met=share >= MIN_DIAGONAL_SHARE,
        ),
        AcceptanceCheck(
            condition="ends in the eight corners of the volume",
            found=f"{corners}",
            met=corners == 8,
        ),
        AcceptanceCheck(
            condition="every error within the stated E = A + K L",
            found=f"no E stated; largest {float(np.abs(error_mm).max()):.3f} mm",
            met=None,
        ),
    )


def measuring_lines(end_a_mm: FloatArray, end_b_mm: FloatArray, reach_mm: float) -> FloatArray:
    """(N,) number of the straight line on which each placement of a bar lies.

    Examples
    --------
    >>> a = np.array([[0.0, 0, 0], [500, 0, 0], [0, 900, 0]])
    >>> measuring_lines(a, a + [100.0, 0, 0], 50.0).tolist()
    [0, 0, 1]
    """
    direction = (end_b_mm - end_a_mm) / np.linalg.norm(end_b_mm - end_a_mm, axis=1)[:, None]
    middle = (end_a_mm + end_b_mm) / 2
    number = np.full(len(middle), -1)
    count = 0
    for i in range(len(middle)):
        if number[i] >= 0:
            continue
        away = middle - middle[i]
        beside = np.linalg.norm(away - np.outer(away @ direction[i], direction[i]), axis=1)
        alike = np.abs(direction @ direction[i]) >= np.cos(_SAME_DIRECTION_RAD)
        number[(number < 0) & alike & (beside <= reach_mm)] = count
        number[i] = count
        count += 1
    return number


def _distinct(lengths: FloatArray) -> int:
    ordered = np.sort(lengths)
    return 1 + int((np.diff(ordered) > _SAME_LENGTH * ordered[:-1]).sum())


def _corners(ends: FloatArray, low: FloatArray, sides: FloatArray) -> int:
    """How many of the eight corners have an end within a quarter of each side."""
    share = (ends - low) / np.where(sides > 0, sides, 1.0)
    near = (share <= _CORNER) | (share >= 1 - _CORNER)
    place = (share >= 0.5) @ np.array([1, 2, 4])
    return len(np.unique(place[near.all(axis=1)]))
