"""``videogrammetry doctor``: what is installed, and what is missing."""

from __future__ import annotations

import argparse
import importlib.metadata
import os
import platform
import sys

from videogrammetry.cli.common import SubParsers, add_verb
from videogrammetry.version import __version__

NEEDED = ("numpy", "scipy", "h5py", "tifffile", "pillow")
OPTIONAL = {
    "av": "video files: pip install 'videogrammetry[video]'",
    "imagecodecs": "TIFF with rare compressions",
}


def add_parser(verbs: SubParsers) -> None:
    """The verb's arguments (none)."""
    add_verb(
        verbs,
        "doctor",
        run,
        help="show what is installed and what is missing",
        description="Lists versions, the instruction set in use, and what is missing; exit "
        "status 1 if something needed is.",
        example="videogrammetry doctor",
    )


def run(args: argparse.Namespace) -> int:
    """Prints the list."""
    del args
    print(f"videogrammetry  {__version__}")
    print(f"python          {platform.python_version()}, {sys.executable}")
    print(f"system          {platform.platform()}, {os.cpu_count()} processors")
    core = _core_line()
    print(f"C++ core        {core or 'does not load: install again, or run scripts/setup'}")
    missing = []
    for name in NEEDED:
        version = _version(name)
        print(f"{name:<15} {version or 'missing: pip install ' + name}")
        missing += [] if version else [name]
    for name, use in OPTIONAL.items():
        print(f"{name:<15} {_version(name) or f'not installed (optional: {use})'}")
    if missing or core is None:
        wrong = ", ".join([*missing, *(["the C++ core"] if core is None else [])])
        print(f"doctor: {wrong} must be put right", file=sys.stderr)
        return 1
    print("all that is needed is there")
    return 0


def _core_line() -> str | None:
    try:
        from videogrammetry import _core
    except ImportError:
        return None
    named = os.environ.get("VIDEOGRAMMETRY_ISA")
    limit = f" (limited by VIDEOGRAMMETRY_ISA={named})" if named else ""
    return f"instruction set {_core.instruction_set()}{limit}"


def _version(name: str) -> str | None:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None
