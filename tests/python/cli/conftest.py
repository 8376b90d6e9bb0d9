"""The command as its users run it, and pictures for it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
import tifffile
from command_fakes import Run, dots


@pytest.fixture
def run(tmp_path: Path) -> Run:
    """Runs the command in ``tmp_path``; asserts the exit status."""

    def call(*args: object, status: int = 0) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "videogrammetry", *map(str, args)]
        result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert result.returncode == status, result.stderr
        assert "Traceback" not in result.stderr
        return result

    return call


@pytest.fixture
def pictures(tmp_path: Path) -> Path:
    folder = tmp_path / "pictures"
    folder.mkdir()
    for i in (1, 2, 10):
        tifffile.imwrite(folder / f"img{i}.tif", dots([(40 + i, 50), (110, 70.5)]))
    return folder
