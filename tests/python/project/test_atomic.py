"""A file is whole or as it was before."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

from videogrammetry.project import atomic_path, provenance, refuse_overwrite, write_text


def test_a_failure_leaves_the_old_file_and_no_rest(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    write_text(path, "old\n")
    with pytest.raises(ZeroDivisionError), atomic_path(path) as beside:  # noqa: PT012
        beside.write_text("half")
        raise ZeroDivisionError
    assert path.read_bytes() == b"old\n"
    assert list(tmp_path.iterdir()) == [path]
    write_text(path, "new\n")
    assert path.read_text() == "new\n"


def test_where_nothing_can_be_written(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="no folder"):
        write_text(tmp_path / "nothere" / "a.txt", "x")
    with pytest.raises(IsADirectoryError):
        write_text(tmp_path, "x")


def test_overwriting_needs_force(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    refuse_overwrite(path, force=False)
    path.touch()
    refuse_overwrite(path, force=True)
    with pytest.raises(FileExistsError, match=r"a\.txt is there already.*--force"):
        refuse_overwrite(path, force=False)


def test_provenance_names_its_inputs(tmp_path: Path) -> None:
    path = tmp_path / "in.csv"
    path.write_bytes(b"id\n")
    entry = provenance({"a": (1, 2)}, [path], base_dir=tmp_path)
    assert entry["inputs_sha256"] == {"in.csv": hashlib.sha256(b"id\n").hexdigest()}
    assert entry["options"] == {"a": [1, 2]}
    assert entry["time_utc"].endswith("Z")
