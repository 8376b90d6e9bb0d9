"""Where the real pictures are, and a marker that skips, saying so, where they are absent."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

DATA = Path(
    os.environ.get("VIDEOGRAMMETRY_DATA", Path(__file__).parents[2] / "shared" / "data")
).resolve()


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder of real pictures and measurements."""
    return DATA


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    if DATA.is_dir():
        return
    skip = pytest.mark.skip(reason=f"no real data at {DATA}; set VIDEOGRAMMETRY_DATA")
    for item in items:
        if "data" in item.keywords:
            item.add_marker(skip)
