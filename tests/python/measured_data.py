"""What a measurement's file holds, for comparing byte by byte."""

from __future__ import annotations

from pathlib import Path

import h5py


def datasets(path: Path) -> dict[str, bytes]:
    """The bytes of every dataset of a measurement file."""
    found: dict[str, bytes] = {}
    with h5py.File(path) as file:
        for name, dataset in file.items():
            value = dataset[()]
            found[name] = value.tobytes() if value.dtype != object else repr(value).encode()
    return found
