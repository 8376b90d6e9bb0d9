"""Families of ring codes: the built-in ones and the user's tables."""

from __future__ import annotations

import json
import tomllib
import warnings
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TypeGuard

from videogrammetry._core import recognition as _core

#: Names that ``code_family`` knows.
CODE_FAMILIES: tuple[str, ...] = tuple(_core.code_family_names())

_KEYS = ("name", "bits", "ring", "codes", "min_distance")


@dataclass(frozen=True, kw_only=True)
class CodeFamily:
    """A family of ring codes.

    The ring around a dot is divided into ``bits`` equal sectors, bright (1) or
    dark (0) for bright dots, read clockwise in the picture, most significant
    bit first; a code is the smallest number among its rotations.

    Attributes
    ----------
    name : for messages.
    bits : sectors of the ring, 4 to 24; 0 for ``none``.
    ring : inner and outer radius of the ring in radii of the dot.
    codes : the codes; the i-th (from 0) has the ID i + 1.
    """

    name: str
    bits: int
    ring: tuple[float, float]
    codes: tuple[int, ...]

    def __len__(self) -> int:
        return len(self.codes)

    @cached_property
    def core(self) -> _core.CodeFamily:
        """The family as the C++ core takes it: checked and indexed once.

        Raises
        ------
        ValueError
            It is no family that could be read.
        """
        return _core.CodeFamily(self.name, self.bits, *self.ring, list(self.codes))


def code_family(name_or_path: str | Path) -> CodeFamily:
    """Return the code family of a name, or read one from a table file.

    A table file is TOML or JSON (by its suffix) with the keys ``bits``,
    ``ring = [inner, outer]`` in radii of the dot, ``codes`` in the order of
    their IDs from 1, and optionally ``name``::

        bits = 12
        ring = [2.0, 3.0]
        codes = [65, 71, 75]

    Codes may be given in any rotation. Two codes that differ in one sector (in some
    rotation) are refused: a sector read wrongly would turn one ID into the other. For
    targets that are printed already, ``min_distance = 1`` lets them pass with a
    warning. Mirror images of one another are no fault as long as no picture is
    mirrored: :func:`mirror_images` names them.

    Parameters
    ----------
    name_or_path
        One of ``CODE_FAMILIES``, or the path of a ``.toml`` or ``.json`` file.

    Returns
    -------
    CodeFamily

    Raises
    ------
    ValueError
        The name is unknown, or the file is malformed: the message names the
        file, the key, what was expected and what was found; of codes too much
        alike, their two IDs.

    Warns
    -----
    UserWarning
        ``min_distance = 1`` and two codes are one sector apart.

    Examples
    --------
    >>> family = code_family("schneider-14")
    >>> len(family), family.ring, family.codes[:3]
    (516, (2.0, 3.0), (129, 135, 139))
    """
    if str(name_or_path) in CODE_FAMILIES:
        family = _core.named_code_family(str(name_or_path))
        return CodeFamily(
            name=family.name,
            bits=family.num_bits,
            ring=(family.ring_inner, family.ring_outer),
            codes=tuple(family.codes),
        )
    path = Path(name_or_path)
    if path.suffix not in (".toml", ".json"):
        raise ValueError(
            f"codes: expected one of {', '.join(CODE_FAMILIES)} or a .toml or .json table, "
            f"got '{name_or_path}'"
        )
    return _read_table(path)


def _read_table(path: Path) -> CodeFamily:
    try:
        text = path.read_text(encoding="utf-8")
        table: Any = tomllib.loads(text) if path.suffix == ".toml" else json.loads(text)
    except (OSError, UnicodeDecodeError, ValueError) as error:
        raise ValueError(f"{path}: cannot be read as a code table: {error}") from error
    if not isinstance(table, dict):
        raise ValueError(f"{path}: expected a table with bits, ring and codes")
    unknown = sorted(set(table) - set(_KEYS))
    if unknown:
        raise ValueError(f"{path}: unknown key '{unknown[0]}'; known are {', '.join(_KEYS)}")
    bits, ring, codes = table.get("bits"), table.get("ring", [2.0, 3.0]), table.get("codes")
    if not _is_integer(bits) or not 4 <= bits <= 24:
        raise ValueError(f"{path}: bits: expected a whole number 4 ... 24, got {bits!r}")
    if (
        not isinstance(ring, list)
        or len(ring) != 2
        or not all(isinstance(r, int | float) and not isinstance(r, bool) for r in ring)
    ):
        raise ValueError(f"{path}: ring: expected [inner, outer] in radii of the dot, got {ring!r}")
    if not isinstance(codes, list) or not all(_is_integer(c) for c in codes):
        raise ValueError(f"{path}: codes: expected a list of whole numbers")
    wrong = next((c for c in codes if not 0 < c < 1 << bits), None)
    if wrong is not None:
        raise ValueError(f"{path}: codes: {wrong} does not fit into {bits} bits")
    distance = table.get("min_distance", 2)
    if not _is_integer(distance) or distance not in (1, 2):
        raise ValueError(f"{path}: min_distance: expected 1 or 2, got {distance!r}")
    family = CodeFamily(
        name=str(table.get("name", path.stem)),
        bits=bits,
        ring=(float(ring[0]), float(ring[1])),
        codes=tuple(_canonical(c, bits) for c in codes),
    )
    try:
        core = family.core
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    near = _core.one_sector_apart(core)
    if near is not None:
        _one_sector_apart(path, family, near, refuse=distance > 1)
    return family


def _one_sector_apart(
    path: Path, family: CodeFamily, ids: tuple[int, int], *, refuse: bool
) -> None:
    first, second = (f"ID {i} (code {family.codes[i - 1]})" for i in ids)
    text = (
        f"{path}: codes: {first} and {second} differ in one sector: read wrongly, "
        "one becomes the other"
    )
    if refuse:
        raise ValueError(
            f"{text}; leave one of them out, or set min_distance = 1 if they are printed already"
        )
    warnings.warn(text, stacklevel=4)


def mirror_images(family: CodeFamily) -> tuple[tuple[int, int], ...]:
    """Pairs of IDs whose codes are mirror images of one another, each pair once.

    In a mirrored picture (or one read in the wrong direction) each of the two is read as
    the other; codes without such a partner are refused as ``mirrored``, and codes
    that are their own mirror image are read as themselves.

    Examples
    --------
    >>> family = CodeFamily(name="ours", bits=6, ring=(2.0, 3.0), codes=(9, 11, 13))
    >>> mirror_images(family)
    ((2, 3),)
    """
    number = {code: i for i, code in enumerate(family.codes, start=1)}
    pairs = []
    for i, code in enumerate(family.codes, start=1):
        mirrored = _canonical(int(f"{code:0{family.bits}b}"[::-1], 2), family.bits)
        partner = number.get(mirrored)
        if partner is not None and i < partner:
            pairs.append((i, partner))
    return tuple(pairs)


def _is_integer(value: Any) -> TypeGuard[int]:
    return isinstance(value, int) and not isinstance(value, bool)


def _canonical(code: int, bits: int) -> int:
    mask = (1 << bits) - 1
    return min(((code << i) | (code >> (bits - i))) & mask for i in range(bits))


def to_core(family: CodeFamily) -> _core.CodeFamily:
    """Return the family as the C++ core takes it."""
    return family.core
