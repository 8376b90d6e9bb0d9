"""Imports and includes are held against docs/architecture.toml.

A violation names file, line and the edge. The second half of the file proves
that the checks can fail, on small trees with one violation each.
"""

from __future__ import annotations

import ast
import re
import shutil
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
INCLUDE = re.compile(r'^\s*#\s*include\s*[<"]([^>"]+)[>"]')
OURS = "videogrammetry"


@dataclass(frozen=True)
class Violation:
    """Something that docs/architecture.toml does not allow."""

    path: Path
    line: int
    what: str

    def __str__(self) -> str:
        return f"{self.path}:{self.line}: {self.what}"


def violations(root: Path) -> list[Violation]:
    """All violations of the tree at ``root``."""
    rules = tomllib.loads((root / "docs" / "architecture.toml").read_text())
    found = [*cpp_violations(root, rules["cpp"]), *python_violations(root, rules["python"])]
    return sorted(found, key=str)


# --- C++ ---------------------------------------------------------------------


def includes(path: Path) -> Iterator[tuple[int, str]]:
    for number, line in enumerate(path.read_text().splitlines(), start=1):
        match = INCLUDE.match(line)
        if match:
            yield number, match[1]


def cpp_violations(root: Path, rules: dict[str, Any]) -> Iterator[Violation]:
    base = root / "cpp" / OURS
    for path in sorted(base.rglob("*")):
        place = path.relative_to(root)
        if path.suffix in (".py", ".pyi", ".pyx"):
            yield Violation(place, 1, "no Python below cpp/videogrammetry")
        if path.suffix in (".h", ".cc", ".cpp", ".hpp"):
            room = path.relative_to(base).parts[0]
            if room not in rules["rooms"]:
                yield Violation(place, 1, f"room {room} is not in docs/architecture.toml")
                continue
            allowed = {room, *rules["rooms"][room]}
            yield from _bad_includes(path, place, room, allowed, rules["libraries"])
    rooms = set(rules["rooms"])
    for path in sorted((root / "python" / "bindings").glob("*")):
        if path.suffix in (".h", ".cc"):
            own = {path.stem} & rooms
            allowed = own | (
                set(rules["bindings"]["common"]) if own or path.suffix == ".h" else {"core"}
            )
            place = path.relative_to(root)
            libraries = {k: v for k, v in rules["libraries"].items() if v}
            yield from _bad_includes(path, place, f"bindings/{path.stem}", allowed, libraries)


def _bad_includes(
    path: Path, place: Path, room: str, allowed: set[str], libraries: dict[str, list[str]]
) -> Iterator[Violation]:
    for line, name in includes(path):
        parts = name.split("/")
        if parts[0] == OURS and len(parts) > 2 and parts[1] not in allowed:
            yield Violation(place, line, f"include edge {room} -> {parts[1]} is not allowed")
        for prefix, users in libraries.items():
            if name.startswith(prefix) and room not in users:
                yield Violation(
                    place, line, f"{room} includes {name}: only {users or 'nobody'} may"
                )


# --- Python ------------------------------------------------------------------


def python_violations(root: Path, rules: dict[str, Any]) -> Iterator[Violation]:
    base = root / "python" / OURS
    bound = {p.stem for p in (root / "python" / "bindings").glob("*.cc")} - {"module"}
    for path in sorted(base.rglob("*.py")):
        place = path.relative_to(root)
        parts = path.relative_to(base).with_suffix("").parts
        room = parts[0]
        if room not in rules["rooms"]:
            yield Violation(place, 1, f"room {room} is not in docs/architecture.toml")
            continue
        tree = ast.parse(path.read_text(), str(path))
        for line, name in used_names(tree, [OURS, *parts[:-1]]):
            what = _bad_use(room, name, base, rules, bound)
            if what:
                yield Violation(place, line, what)


def used_names(tree: ast.AST, package: list[str]) -> Iterator[tuple[int, str]]:
    """(line, dotted name) of everything imported, and of attributes of imported modules."""
    aliases: dict[str, str] = {}
    nodes = list(ast.walk(tree))
    for node in nodes:
        if isinstance(node, ast.Import):
            for item in node.names:
                aliases[item.asname or item.name.split(".")[0]] = (
                    item.name if item.asname else item.name.split(".")[0]
                )
                yield node.lineno, item.name
        elif isinstance(node, ast.ImportFrom):
            origin = node.module or ""
            if node.level:
                origin = ".".join(
                    [*package[: len(package) - node.level + 1], *filter(None, [origin])]
                )
            for item in node.names:
                aliases[item.asname or item.name] = f"{origin}.{item.name}"
                yield node.lineno, f"{origin}.{item.name}"
    inner = {id(node.value) for node in nodes if isinstance(node, ast.Attribute)}
    for node in nodes:
        if isinstance(node, ast.Attribute) and id(node) not in inner:
            chain: list[str] = []
            base: ast.expr = node
            while isinstance(base, ast.Attribute):
                chain.insert(0, base.attr)
                base = base.value
            if isinstance(base, ast.Name) and base.id in aliases:
                yield node.lineno, ".".join([aliases[base.id], *chain])


def _bad_use(
    room: str, name: str, base: Path, rules: dict[str, Any], bound: set[str]
) -> str | None:
    """What is wrong with ``room`` using the dotted ``name``, or None."""
    parts = name.split(".")
    for library, users in rules["libraries"].items():
        if parts[0] == library and room not in users:
            return f"{room} imports {name}: only {users or 'nobody'} may"
    shows = room in rules["no_numerics"]["rooms"]
    if shows and name not in rules["no_numerics"]["but"]:
        for forbidden in rules["no_numerics"]["names"]:
            if f"{name}.".startswith(f"{forbidden}."):
                return f"{room} uses {name}: it shows and does not calculate"
    if parts[0] != OURS:
        return None
    other = parts[1] if len(parts) > 1 else "__init__"
    if other == "_core":
        return _bad_core_use(room, parts[2] if len(parts) > 2 else "", rules, bound)
    if not (base / other).is_dir() and not (base / f"{other}.py").is_file():
        other = "__init__"  # a name of the package's face, not a module
    if other == "__init__" and room != "__init__":
        return f"import edge {room} -> the package's face ({name}) is not allowed: a cycle"
    if other in {room, *rules["everyone"], *rules["rooms"][room]}:
        return None
    return f"import edge {room} -> {other} is not allowed"


def _bad_core_use(room: str, part: str, rules: dict[str, Any], bound: set[str]) -> str | None:
    if part in bound:
        return None if part == room else f"{room} uses _core.{part}: only {part} may"
    if room in bound or room in rules["core"]["others"]:
        return None
    return f"{room} uses _core: only {sorted(bound)} and {rules['core']['others']} may"


# --- the tests ---------------------------------------------------------------


def test_the_tree_keeps_to_its_architecture() -> None:
    found = violations(ROOT)
    assert not found, "\n" + "\n".join(map(str, found))


def test_something_was_looked_at() -> None:
    assert len(list((ROOT / "cpp" / OURS).rglob("*.cc"))) > 5
    assert len(list((ROOT / "python" / OURS).rglob("*.py"))) > 20
    uses = [
        name
        for path in (ROOT / "python" / OURS).rglob("*.py")
        for _, name in used_names(ast.parse(path.read_text()), [OURS])
    ]
    assert sum(name.startswith(OURS) for name in uses) > 50


def test_rules_have_no_circle() -> None:
    for side in ("cpp", "python"):
        edges = tomllib.loads((ROOT / "docs" / "architecture.toml").read_text())[side]["rooms"]
        done: set[str] = set()
        while len(done) < len(edges):
            free = {room for room, to in edges.items() if room not in done and set(to) <= done}
            assert free, f"{side}: circle among {sorted(set(edges) - done)}"
            done |= free


CPP, PY = "cpp/videogrammetry", "python/videogrammetry"
#: (file, its text, line, what must be said)
BAD = [
    (f"{CPP}/core/a.cc", '#include "videogrammetry/geometry/x.h"', 1, "core -> geometry"),
    (f"{CPP}/matching/a.h", '\n#include "videogrammetry/tracking/x.h"', 2, "matching -> tracking"),
    (f"{CPP}/geometry/a.cc", "#include <opencv2/core.hpp>", 1, "opencv2"),
    (f"{CPP}/reconstruction/a.cc", "#include <ceres/ceres.h>", 1, "ceres"),
    (f"{CPP}/geometry/a.h", "#include <pybind11/numpy.h>", 1, "pybind11"),
    (f"{CPP}/geometry/tool.py", "", 1, "no Python"),
    (f"{CPP}/kitchen/a.cc", "", 1, "kitchen is not in"),
    ("python/bindings/geometry.cc", '#include "videogrammetry/matching/x.h"', 1, "-> matching"),
    ("python/bindings/matching.cc", "#include <opencv2/core.hpp>", 1, "opencv2"),
    (f"{PY}/geometry/a.py", "from videogrammetry.project import x", 1, "geometry -> project"),
    (f"{PY}/sequence/a.py", "def f():\n    import videogrammetry.cli.x", 2, "sequence -> cli"),
    (f"{PY}/project/a.py", "from ..report import page", 1, "project -> report"),
    (f"{PY}/project/a.py", "from .. import pipeline", 1, "project -> pipeline"),
    (f"{PY}/motion/a.py", "from videogrammetry._core import geometry", 1, "_core.geometry"),
    (f"{PY}/cli/a.py", "from videogrammetry import _core\n_core.geometry.x", 2, "_core.geometry"),
    (f"{PY}/motion/a.py", "from videogrammetry import _core", 1, "motion uses _core"),
    (f"{PY}/matching/a.py", "import cv2", 1, "cv2"),
    (f"{PY}/motion/a.py", "import h5py as h", 1, "h5py"),
    (f"{PY}/report/a.py", "import numpy as np\n\nnp.linalg.inv(1).T", 3, "numpy.linalg.inv"),
    (f"{PY}/report/b.py", "from numpy.linalg import inv", 1, "numpy.linalg.inv"),
    (f"{PY}/report/a.py", "from scipy import stats", 1, "scipy"),
    (f"{PY}/project/a.py", "from videogrammetry import recognize", 1, "face"),
    (f"{PY}/pantry/a.py", "", 1, "pantry is not in"),
]


@pytest.mark.parametrize(("name", "text", "line", "words"), BAD)
def test_a_violation_is_found(tmp_path: Path, name: str, text: str, line: int, words: str) -> None:
    (tmp_path / "docs").mkdir()
    shutil.copy(ROOT / "docs" / "architecture.toml", tmp_path / "docs")
    for module in ("cli", "geometry", "pipeline", "project", "report"):
        package = tmp_path / "python" / OURS / module
        package.mkdir(parents=True)
        (package / "__init__.py").touch()
    (tmp_path / "python" / "bindings").mkdir()
    (tmp_path / "python" / "bindings" / "geometry.cc").touch()
    assert violations(tmp_path) == []
    path = tmp_path / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    found = violations(tmp_path)
    assert [(str(v.path), v.line) for v in found] == [(name, line)], found
    assert words in str(found[0])
