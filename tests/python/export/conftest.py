"""Peers that read what the program writes."""

from __future__ import annotations

import shutil
import subprocess

import pytest


@pytest.fixture(scope="session")
def mrcal_python():
    """Debian's Python with mrcal."""
    python = shutil.which("python3", path="/usr/bin")
    if python is None:
        pytest.skip("no /usr/bin/python3 here")
    tried = subprocess.run(
        [python, "-c", "import mrcal"], capture_output=True, text=True, check=False
    )
    if tried.returncode != 0:
        pytest.skip("python3-mrcal is not installed (scripts/setup python3-mrcal installs it)")
    return python
