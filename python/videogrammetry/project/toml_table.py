"""Strict reading of TOML: every wrong key or value is named with its file and line."""

from __future__ import annotations

import difflib
import math
import os
import re
import tomllib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from videogrammetry.errors import ProjectFileError

_NEEDED: Any = object()
_HEADER = re.compile(r"^\s*\[\[?([^\[\]]+)\]\]?\s*(#.*)?$")


class TomlTable:
    """One table of a TOML file; what is taken from it is checked, the rest is an error.

    Call the typed getters for all known keys, then :meth:`finish`, which
    raises for any key that nobody asked for and names the nearest known one.
    A getter without a default means that the key must be there.
    """

    def __init__(
        self, file: Path, text: str, values: dict[str, Any], place: tuple[str, ...] = ()
    ) -> None:
        self._file = file
        self._text = text
        self._values = values
        self._place = place
        self._known: list[str] = []

    @classmethod
    def load(cls, path: Path) -> TomlTable:
        """Reads a file; ProjectFileError for what is not UTF-8 or not TOML."""
        try:
            text = path.read_text(encoding="utf-8-sig")
            return cls(path, text, tomllib.loads(text))
        except UnicodeDecodeError as error:
            raise ProjectFileError(
                f"{path}: not a text file in UTF-8 (byte {error.start}); save it as UTF-8"
            ) from error
        except tomllib.TOMLDecodeError as error:
            raise ProjectFileError(
                f"{path}: not valid TOML: {error}; texts stand in quotes, numbers do not"
            ) from error

    @classmethod
    def open_schema(
        cls, path: str | os.PathLike[str], default_name: str, what: str, newest: int
    ) -> tuple[TomlTable, Path]:
        """A file of a known schema, or the one named ``default_name`` in a folder; and its path.

        Raises
        ------
        ProjectFileError
            Not there, not TOML, no schema, or a newer one.
        """
        file = Path(path)
        if file.is_dir():
            file = file / default_name
        if not file.is_file():
            raise ProjectFileError(
                f"{file}: there is no such {what} file; give the path of a {default_name}"
            )
        root = cls.load(file)
        root._check_schema(newest)
        return root, file.resolve()

    def _check_schema(self, newest: int) -> None:
        if "schema" not in self.names():
            raise self.error(None, f"schema is missing: write schema = {newest} on its first line")
        schema = self.integer("schema")
        if schema > newest:
            raise self.error(
                "schema",
                f"= {schema} is newer than this program, which reads up to {newest}: "
                "update videogrammetry",
            )
        if schema < 1:
            raise self.error("schema", f"= {schema} has never been: write schema = {newest}")

    def error(self, key: str | None, message: str) -> ProjectFileError:
        """The error to raise about a key of this table (or the table itself)."""
        place = self._place if key is None else (*self._place, key)
        line = line_of_key(self._text, place)
        where = f"{self._file}, line {line}" if line else f"{self._file}"
        table = f"[{'.'.join(self._place)}] " if self._place else ""
        return ProjectFileError(f"{where}: {table}{'' if key is None else key + ' '}{message}")

    def names(self) -> list[str]:
        """The keys that are there."""
        return list(self._values)

    def finish(self) -> None:
        """Raises for the first key that no getter has asked for."""
        for key in self._values:
            if key not in self._known:
                raise self.error(key, f"is not a known key{nearest(key, self._known)}")

    def _take(self, key: str, default: Any, kinds: tuple[type, ...], what: str) -> Any:
        self._known.append(key)
        if key not in self._values:
            if default is _NEEDED:
                raise self.error(None, f"{key} is missing: add {key} = {what}")
            return default
        value = self._values[key]
        if not isinstance(value, kinds) or (isinstance(value, bool) and bool not in kinds):
            raise self.error(key, f"= {value!r} is of the wrong type: expected {what}")
        return value

    def string(self, key: str, default: Any = _NEEDED) -> Any:
        """A text that is not empty."""
        value = self._take(key, default, (str,), '"a text"')
        if value == "" and value is not default:
            raise self.error(key, "is empty: give a text, or leave the key out")
        return value

    def choice(self, key: str, choices: Sequence[str], default: Any = _NEEDED) -> Any:
        """One of some texts."""
        value = self.string(key, default)
        if value is not default and value not in choices:
            raise self.error(key, f"= {value!r} is not known{nearest(value, choices)}")
        return value

    def integer(self, key: str, default: Any = _NEEDED, *, minimum: int = 0) -> Any:
        """A whole number, at least ``minimum``."""
        value = self._take(key, default, (int,), "a whole number")
        if value is not default and value < minimum:
            raise self.error(key, f"= {value} is too small: expected {minimum} or more")
        return value

    def number(self, key: str, default: Any = _NEEDED, *, above: float = -math.inf) -> Any:
        """A finite number greater than ``above``, as float."""
        value = self._take(key, default, (int, float), "a number")
        if value is default:
            return value
        if not (math.isfinite(value) and value > above):
            bound = "a finite number" if above == -math.inf else f"a number greater than {above:g}"
            raise self.error(key, f"= {value} is out of range: expected {bound}")
        return float(value)

    def boolean(self, key: str, default: Any = _NEEDED) -> Any:
        """true or false."""
        return self._take(key, default, (bool,), "true or false")

    def numbers(self, key: str, count: int, default: Any = _NEEDED, *, what: str) -> Any:
        """A list of ``count`` positive, finite numbers."""
        value = self._take(key, default, (list,), what)
        if value is default:
            return value
        good = [v for v in value if isinstance(v, int | float) and not isinstance(v, bool)]
        if len(value) != count or len(good) != count or not all(0 < v < math.inf for v in good):
            raise self.error(key, f"= {value} is wrong: expected {what}, positive numbers")
        return tuple(value)

    def number_or_bool(self, key: str, default: Any = _NEEDED) -> Any:
        """A finite number as float, or true or false."""
        value = self._take(key, default, (int, float, bool), "a number, true or false")
        return value if isinstance(value, bool) or value is default else self.number(key)

    def value(self, key: str, kinds: tuple[type, ...], what: str) -> Any:
        """Whatever stands there, of these types, for the caller to check; None: nothing."""
        return self._take(key, None, kinds, what)

    def names_or_numbers(self, key: str, default: Any = _NEEDED) -> Any:
        """A list of texts and whole numbers, as texts."""
        value = self._take(key, default, (list,), "a list of names")
        if value is default:
            return value
        for item in value:
            if isinstance(item, bool) or not isinstance(item, str | int) or item == "":
                raise self.error(key, f"has {item!r}: expected names or whole numbers")
        return tuple(str(item) for item in value)

    def vector(
        self, key: str, count: int, default: Any = _NEEDED, *, what: str, zero: bool = False
    ) -> Any:
        """A list of ``count`` finite numbers of any sign, not all zero unless ``zero``."""
        value = self._take(key, default, (list,), what)
        if value is default:
            return value
        good = [v for v in value if isinstance(v, int | float) and not isinstance(v, bool)]
        finite = all(math.isfinite(v) for v in good)
        whole = len(value) == count == len(good) and finite
        if not whole or not (zero or any(good)):
            nonzero = "" if zero else ", not all zero"
            raise self.error(key, f"= {value} is wrong: expected {what}{nonzero}")
        return tuple(float(v) for v in value)

    def point(self, key: str, default: Any = _NEEDED) -> Any:
        """A place: three finite numbers of any sign."""
        what = "[x, y, z]"
        value = self._take(key, default, (list,), what)
        if value is default:
            return value
        good = [v for v in value if isinstance(v, int | float) and not isinstance(v, bool)]
        if len(value) != 3 or len(good) != 3 or not all(math.isfinite(v) for v in good):
            raise self.error(key, f"= {value} is wrong: expected {what}, three numbers")
        return tuple(float(v) for v in value)

    def integers(self, key: str, default: Any = _NEEDED, *, what: str, count: int = 0) -> Any:
        """A list of whole numbers from 0, each once; of ``count`` if that is not 0."""
        value = self._take(key, default, (list,), what)
        if value is default:
            return value
        good = [v for v in value if isinstance(v, int) and not isinstance(v, bool) and v >= 0]
        if len(good) != len(value) or not value or (count and len(value) != count):
            raise self.error(key, f"= {value} is wrong: expected {what}")
        if not count and len(set(value)) < len(value):
            raise self.error(key, "names a number twice: take one away")
        return tuple(value)

    def strings(self, key: str, default: Any = _NEEDED, *, empty: bool = False) -> Any:
        """One text or a list of texts, as a tuple; ``empty``: the list may be so."""
        value = self._take(key, default, (str, list), '"a text" or a list of texts')
        if value is default:
            return value
        items = [value] if isinstance(value, str) else value
        if not (items or empty) or not all(isinstance(item, str) and item for item in items):
            raise self.error(key, f"= {value!r} is wrong: expected texts, none of them empty")
        return tuple(items)

    def table(self, key: str) -> TomlTable:
        """The table of that name, empty where there is none."""
        value = self._take(key, {}, (dict,), "a table, [" + ".".join((*self._place, key)) + "]")
        return TomlTable(self._file, self._text, value, (*self._place, key))

    def is_table(self, key: str) -> bool:
        """Whether the key is there and holds a table."""
        return isinstance(self._values.get(key), dict)

    def is_text(self, key: str) -> bool:
        """Whether the key is there and holds a text."""
        return isinstance(self._values.get(key), str)


def nearest(name: str, known: Iterable[str]) -> str:
    """The end of a message about an unknown name: the nearest known one, and all of them.

    Examples
    --------
    >>> nearest("calibraton", ["calibration", "sequence"])
    ": did you mean 'calibration'? known: calibration, sequence"
    """
    names = list(dict.fromkeys(known))
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    hint = f"did you mean {close[0]!r}? " if close else ""
    return f": {hint}known: {', '.join(names)}"


def line_of_key(text: str, place: tuple[str, ...]) -> int | None:
    """Line (from 1) on which the key or table ``place`` stands, or None if not found.

    Examples
    --------
    >>> line_of_key('schema = 1\\n[cameras.left]\\nsequence = "a"', ("cameras", "left", "sequence"))
    3
    """
    current: tuple[str, ...] = ()
    loose: int | None = None
    for number, line in enumerate(text.splitlines(), start=1):
        header = _HEADER.match(line)
        if header:
            current = _split_key(header[1])
            if current[: len(place)] == place:
                return number
            continue
        name, equals, _ = line.partition("=")
        if equals and (*current, *_split_key(name))[: len(place)] == place:
            return number
        if place and loose is None and re.search(rf"\b{re.escape(place[-1])}\b['\"]?\s*=", line):
            loose = number  # within an inline table
    return loose


def _split_key(dotted: str) -> tuple[str, ...]:
    """The names of a dotted key, quotes taken off; () if it is none."""
    try:
        value: Any = tomllib.loads(f"{dotted.strip()} = 0")
    except tomllib.TOMLDecodeError:
        return ()
    names = []
    while isinstance(value, dict):
        name, value = next(iter(value.items()))
        names.append(name)
    return tuple(names)
