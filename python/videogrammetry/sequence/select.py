"""Which files a specification means: files, folders, patterns, in natural order."""

from __future__ import annotations

import glob
import os
import re
from collections.abc import Iterable
from pathlib import Path

from videogrammetry.errors import SequenceError

_WILDCARDS = re.compile(r"[*?\[]")


def natural_key(name: str | os.PathLike[str]) -> tuple[tuple[int, int, str], ...]:
    """Key that sorts ``img_9`` before ``img_10``; case does not count.

    Examples
    --------
    >>> sorted(["img10.tif", "img9.tif", "IMG1.tif"], key=natural_key)
    ['IMG1.tif', 'img9.tif', 'img10.tif']
    """
    parts = re.split(r"(\d+)", os.fspath(name).casefold())
    return tuple((1, int(part), part) if part.isdecimal() else (0, 0, part) for part in parts)


def expand_braces(pattern: str) -> list[str]:
    """The patterns that ``{a,b}`` stands for; without a comma braces mean themselves.

    Examples
    --------
    >>> expand_braces("left_{0005,0007}.{tif,png}")
    ['left_0005.tif', 'left_0005.png', 'left_0007.tif', 'left_0007.png']
    >>> expand_braces("a{b{c,d},e}")
    ['abc', 'abd', 'ae']
    """
    for start in (match.start() for match in re.finditer(r"\{", pattern)):
        alternatives, end = _alternatives(pattern, start)
        if len(alternatives) > 1:
            head, tail = pattern[:start], pattern[end:]
            return [full for part in alternatives for full in expand_braces(head + part + tail)]
    return [pattern]


def _alternatives(pattern: str, start: int) -> tuple[list[str], int]:
    """Parts between the brace at ``start`` and its partner, and the place after that."""
    depth, parts, begin = 0, [], start + 1
    for i in range(start, len(pattern)):
        if pattern[i] == "{":
            depth += 1
        elif pattern[i] == "," and depth == 1:
            parts.append(pattern[begin:i])
            begin = i + 1
        elif pattern[i] == "}":
            depth -= 1
            if depth == 0:
                return [*parts, pattern[begin:i]], i + 1
    return [], start


def find_files(spec: str | os.PathLike[str], base_dir: Path, suffixes: Iterable[str]) -> list[Path]:
    """Files that one file name, folder or pattern means, in natural order.

    Parameters
    ----------
    spec : a file; a folder (its files with one of ``suffixes``); or a pattern
        with ``*``, ``?``, ``[...]``, ``**`` and ``{a,b}``.
    base_dir : what a relative ``spec`` starts from.
    suffixes : lower-case endings (".tif") taken from a folder.

    Raises
    ------
    SequenceError
        If nothing matches; it says what was sought, and where.
    """
    text = os.fspath(spec)
    path = base_dir / text
    if path.is_dir():
        return _files_of_folder(path, frozenset(suffixes))
    if path.exists():
        return [path]
    patterns = expand_braces(text)
    if len(patterns) == 1 and not _WILDCARDS.search(text):
        raise SequenceError(_nothing_there(path))
    found: set[Path] = set()
    for pattern in patterns:
        if _WILDCARDS.search(pattern):
            names = glob.glob(pattern, root_dir=base_dir, recursive=True)
            found.update(p for p in (base_dir / n for n in names) if p.is_file())
        elif (base_dir / pattern).is_file():
            found.add(base_dir / pattern)
        else:
            raise SequenceError(f"{_nothing_there(base_dir / pattern)} (one of {text!r})")
    if not found:
        raise SequenceError(
            f"no file matches the pattern {text!r} in {base_dir.resolve()}: "
            "correct the pattern, or the folder that it starts from"
        )
    return sorted(found, key=natural_key)


def _files_of_folder(folder: Path, suffixes: frozenset[str]) -> list[Path]:
    files = [
        p
        for p in folder.iterdir()
        if p.suffix.lower() in suffixes and not p.name.startswith(".") and p.is_file()
    ]
    if not files:
        raise SequenceError(
            f"folder {folder} holds no picture: expected files ending in "
            f"{', '.join(sorted(suffixes))}"
        )
    return sorted(files, key=natural_key)


def _nothing_there(path: Path) -> str:
    """Says how far a path that does not exist goes along."""
    parent = path.parent
    while not parent.is_dir() and parent != parent.parent:
        parent = parent.parent
    if parent == path.parent:
        return f"{path}: no such file or folder; correct the name"
    missing = path.relative_to(parent).parts[0]
    return f"{path}: no such file; folder {parent} has no {missing!r}: correct the path"
