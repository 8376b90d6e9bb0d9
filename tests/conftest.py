"""Where the real pictures are, and a marker that skips, saying so, where they are absent."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

DATA = Path(
    os.environ.get("VIDEOGRAMMETRY_DATA", Path(__file__).parents[2] / "shared" / "data")
).resolve()


def pytest_addoption(parser: pytest.Parser) -> None:
    """How often the measurement that must survive it is killed."""
    parser.addoption("--kills", type=int, default=4, help="kills of a measurement (default 4)")


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder of real pictures and measurements."""
    return DATA


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 1 MB; needs the right to mount one."""
    folder = tmp_path / "disk"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(folder)]
    try:
        mounted = subprocess.run(command, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        pytest.skip("no mount command here")
    if mounted.returncode != 0:
        pytest.skip(f"a small disk cannot be mounted: {mounted.stderr.strip()}")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    if DATA.is_dir():
        return
    skip = pytest.mark.skip(reason=f"no real data at {DATA}; set VIDEOGRAMMETRY_DATA")
    for item in items:
        if "data" in item.keywords:
            item.add_marker(skip)
