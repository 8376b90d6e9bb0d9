"""What several verbs share: a verb's parser, and writing without overwriting."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from videogrammetry.project import refuse_overwrite
from videogrammetry.project.provenance import provenance_path

_POINTS = re.compile(r"\s*(\d{1,9})\s*(?:-\s*(\d{1,9})\s*)?")
_MAX_POINTS = 100_000

SubParsers = Any  # argparse names the type of add_subparsers() only privately


class UsageError(ValueError):
    """An option is wrong in itself, whatever the files hold: exit status 2."""


def add_verb(
    verbs: SubParsers,
    name: str,
    run: Callable[[argparse.Namespace], int] | None,
    *,
    help: str,
    description: str,
    example: str,
) -> argparse.ArgumentParser:
    """A verb's parser, with the example at the end of its help."""
    parser: argparse.ArgumentParser = verbs.add_parser(
        name,
        help=help,
        description=description,
        epilog=f"example:\n  {example}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    if run is not None:  # a verb of several parts leaves it to these
        parser.set_defaults(run=run)
    return parser


def add_force(parser: argparse.ArgumentParser) -> None:
    """The option without which nothing is overwritten."""
    parser.add_argument("--force", action="store_true", help="overwrite what is there already")


def refuse_overwrite_table(path: Path, force: bool) -> None:
    """``refuse_overwrite`` for a table and the provenance beside it."""
    refuse_overwrite(path, force)
    refuse_overwrite(provenance_path(path), force)


def point_list(text: str) -> tuple[int, ...]:
    """Numbers of points as people write them: single ones and ranges, both ends included.

    Examples
    --------
    >>> point_list("4-6,21")
    (4, 5, 6, 21)
    """
    numbers: list[int] = []
    for part in text.split(","):
        match = _POINTS.fullmatch(part)
        if match is None:
            raise argparse.ArgumentTypeError(
                f"{text!r}: expected numbers and ranges, like 4-11,21-30"
            )
        first = int(match[1])
        last = first if match[2] is None else int(match[2])
        if last < first or last - first >= _MAX_POINTS:
            raise argparse.ArgumentTypeError(
                f"{part.strip()!r}: the range must ascend, over {_MAX_POINTS} points at most"
            )
        numbers += range(first, last + 1)
    return tuple(sorted(set(numbers)))


def text_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table for the terminal: first column to the left, numbers to the right.

    Examples
    --------
    >>> print(text_table(["camera", "RMS px"], [["left", "0.036"]]), end="")
    camera  RMS px
    left     0.036
    """
    widths = [max(len(row[i]) for row in (header, *rows)) for i in range(len(header))]
    lines = []
    for row in (header, *rows):
        cells = [row[0].ljust(widths[0])]
        cells += [cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True)]
        lines.append("  ".join(cells).rstrip())
    return "\n".join(lines) + "\n"
