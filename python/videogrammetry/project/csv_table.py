"""Strict reading and plain writing of CSV: header line, comma, '.' decimal, empty = missing.

Every error names file, line, column, the value and what to do. A byte-order
mark, CRLF line ends and blank lines at the end are tolerated.
"""

from __future__ import annotations

import contextlib
import csv
import io
import math
import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from videogrammetry.errors import TableError
from videogrammetry.project.atomic import write_text
from videogrammetry.project.toml_table import nearest
from videogrammetry.types import FloatArray


@dataclass(frozen=True)
class CsvTable:
    """The rows of a CSV file as texts, with the lines they stand on.

    Attributes
    ----------
    path : for messages.
    columns : column name -> its cells, outer spaces taken off.
    lines : line number (from 1) of each row.
    """

    path: Path
    columns: dict[str, list[str]]
    lines: list[int]

    def __len__(self) -> int:
        return len(self.lines)

    def __contains__(self, column: str) -> bool:
        return column in self.columns

    def error(self, row: int, column: str, message: str) -> TableError:
        """The error to raise about one cell."""
        return TableError(f"{self.path}, line {self.lines[row]}, column {column}: {message}")

    def has_values(self, column: str) -> bool:
        """Whether the column is there and a cell of it holds something."""
        return any(self.columns.get(column, ()))

    def texts(self, column: str) -> list[str]:
        """The cells as texts; empty ones stay empty."""
        return self.columns[column]

    def floats(
        self,
        column: str,
        *,
        empty: float | None = None,
        check: Callable[[float], bool] | None = None,
        expected: str = "a number",
    ) -> FloatArray:
        """The cells as numbers; an empty cell gives ``empty``, an error if None."""
        values = np.empty(len(self))
        texts = self.columns[column]
        if check is None:
            with contextlib.suppress(ValueError):  # the slow way below says which cell is wrong
                values[:] = [float(text) for text in texts]
                if np.isfinite(values).all() and not any("_" in text for text in texts):
                    return values
        for row, text in enumerate(texts):
            if not text and empty is not None:
                values[row] = empty
                continue
            value = self._number(row, column, text, expected)
            if check is not None and not check(value):
                raise self.error(row, column, f"{text} is out of range: expected {expected}")
            values[row] = value
        return values

    def _number(self, row: int, column: str, text: str, expected: str) -> float:
        try:
            value = float(text) if "_" not in text else math.nan
        except ValueError:
            value = math.nan
        if math.isfinite(value):
            return value
        if not text:
            what = f"is empty: expected {expected}"
        elif text.replace(",", ".", 1) != text:
            what = f"{text!r} is not a number: write the decimal point as '.'"
        else:
            what = f"{text!r} is not a finite number: correct it, or take the row out"
        raise self.error(row, column, what)

    def integers(
        self, column: str, *, empty: int | None = None, minimum: int = 0
    ) -> np.ndarray[Any, np.dtype[np.int32]]:
        """The cells as whole numbers from ``minimum`` to 2^31 - 1."""
        values = np.empty(len(self), dtype=np.int32)
        for row, text in enumerate(self.columns[column]):
            if not text and empty is not None:
                values[row] = empty
                continue
            if not (text.isascii() and text.removeprefix("-").isdigit()):
                what = f"{text!r} is not" if text else "is empty: expected"
                raise self.error(row, column, f"{what} a whole number: correct it")
            if not minimum <= int(text) < 2**31:
                raise self.error(row, column, f"{text} is out of range: {minimum} to {2**31 - 1}")
            values[row] = int(text)
        return values

    def refuse_repeats(self, columns: Sequence[str], what: str, *, unless_empty: str = "") -> None:
        """TableError where the same cells of ``columns`` stand on two rows."""
        seen: dict[tuple[str, ...], int] = {}
        for row in range(len(self)):
            if unless_empty and not self.columns[unless_empty][row]:
                continue
            key = tuple(self.columns[c][row] for c in columns)
            if key in seen:
                names = " ".join(key)
                raise self.error(
                    row,
                    columns[-1],
                    f"{what} {names} stands twice, first on line {self.lines[seen[key]]}: "
                    "every one may stand once; rename or delete one",
                )
            seen[key] = row


def read_csv(
    path: str | os.PathLike[str], required: Sequence[str], optional: Sequence[str] = ()
) -> CsvTable:
    """Reads a CSV file that has the ``required`` columns, in any order.

    Raises
    ------
    TableError
        Not there, not text, no header or row, missing, repeated or unknown
        column, or a row with more or fewer cells than the header.
    """
    file = Path(path)
    rows = _rows(file)
    if not rows:
        raise TableError(f"{file}: the table is empty; its first line must be {','.join(required)}")
    header_line, header = rows[0]
    header = [cell.strip() for cell in header]
    _check_header(file, header_line, header, required, optional)
    if len(rows) == 1:
        raise TableError(f"{file}: the table has a header but no row; add one row an item")
    for line, cells in rows[1:]:
        if len(cells) != len(header):
            raise TableError(
                f"{file}, line {line}: {len(cells)} cells, but the header names {len(header)} "
                "columns; a missing value still needs its comma, a decimal comma is not possible"
            )
    columns = {name: [cells[i].strip() for _, cells in rows[1:]] for i, name in enumerate(header)}
    return CsvTable(file, columns, [line for line, _ in rows[1:]])


def _rows(file: Path) -> list[tuple[int, list[str]]]:
    """(line, cells) of all rows that are not blank."""
    if not file.is_file():
        raise TableError(f"{file}: there is no such table; correct its name")
    try:
        text = file.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise TableError(
            f"{file}: not a text file in UTF-8 (byte {error.start}); save it as CSV in UTF-8"
        ) from error
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        return [(reader.line_num, cells) for cells in reader if any(c.strip() for c in cells)]
    except csv.Error as error:
        raise TableError(f"{file}, line {reader.line_num}: not valid CSV: {error}") from error


def _check_header(
    file: Path, line: int, header: list[str], required: Sequence[str], optional: Sequence[str]
) -> None:
    where = f"{file}, line {line}"
    known = (*required, *optional)
    unknown = [name for name in header if name not in known]
    for name in required:
        if name not in header:
            given = f"; the header has {','.join(header)}" if header else ""
            sep = "; columns are separated by commas" if ";" in "".join(header) else ""
            raise TableError(f"{where}: column {name} is missing: add it{given}{sep}")
    if unknown:
        raise TableError(f"{where}: column {unknown[0]!r} is not known{nearest(unknown[0], known)}")
    if len(set(header)) < len(header):
        twice = next(name for name in header if header.count(name) > 1)
        raise TableError(f"{where}: column {twice} stands twice; take one away")


def write_csv(
    path: str | os.PathLike[str], header: Sequence[str], columns: Iterable[Sequence[Any]]
) -> None:
    """Writes columns of equal length, all of the file or nothing; see :func:`format_csv`."""
    write_text(path, format_csv(header, columns))


def format_csv(header: Sequence[str], columns: Iterable[Sequence[Any]]) -> str:
    """CSV text of columns of equal length: 12 significant digits, NaN and None empty.

    Examples
    --------
    >>> format_csv(["id", "x_mm"], [[1, 2], np.array([0.5, np.nan])])
    'id,x_mm\\n1,0.5\\n2,\\n'
    """
    cells = [_cells(column) for column in columns]
    if len(cells) != len(header):
        raise ValueError(f"columns: expected {len(header)} for the header, got {len(cells)}")
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(zip(*cells, strict=True))
    return text.getvalue()


def _cells(column: Sequence[Any]) -> list[str]:
    if isinstance(column, np.ndarray) and column.dtype.kind == "f":
        return ["" if value != value else f"{value:.12g}" for value in column.tolist()]
    return [_cell(value) for value in column]


def _cell(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, float | np.floating):
        return "" if math.isnan(value) else format(float(value), ".12g")
    return str(value)
