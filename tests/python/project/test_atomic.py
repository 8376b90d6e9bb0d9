"""A file is whole or as it was before."""

from __future__ import annotations

import hashlib
import os
import re
from pathlib import Path

import pytest

from videogrammetry.project import atomic_path, provenance, refuse_overwrite, write_text
from videogrammetry.project.atomic import nearest_folder


def test_a_failure_leaves_the_old_file_and_no_rest(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    write_text(path, "old\n")

    def half() -> None:
        with atomic_path(path) as beside:
            beside.write_text("half")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        half()
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


def test_what_cannot_be_written_is_said_before_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(FileNotFoundError, match="a.csv cannot be written: there is no folder .*it"):
        refuse_overwrite(tmp_path / "nothere" / "a.csv", force=True)
    (tmp_path / "file").touch()
    with pytest.raises(NotADirectoryError, match=r"a\.csv cannot be written.*file is no folder"):
        refuse_overwrite(tmp_path / "file" / "a.csv", force=True)
    with pytest.raises(IsADirectoryError, match="is a folder"):
        refuse_overwrite(tmp_path, force=True)
    # Asked for, because the administrator may write everywhere.
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path) != tmp_path)
    place = re.escape(str(tmp_path / "a.csv"))
    for write in (lambda p: refuse_overwrite(p, force=False), lambda p: write_text(p, "x")):
        with pytest.raises(PermissionError, match=f"^{place} cannot be written: no permission"):
            write(tmp_path / "a.csv")


def test_a_folder_yet_to_be_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert nearest_folder(tmp_path) == tmp_path
    assert nearest_folder(tmp_path / "a" / "b") == tmp_path
    assert nearest_folder("nothere/b") == Path()
    (tmp_path / "file").touch()
    with pytest.raises(NotADirectoryError, match="file is no folder"):
        nearest_folder(tmp_path / "file" / "b")
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    with pytest.raises(PermissionError, match=f"b cannot be written.* folder {tmp_path};"):
        nearest_folder(tmp_path / "a" / "b")


def test_refused_permission_names_the_target(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    with pytest.raises(PermissionError) as caught, atomic_path(path) as beside:
        raise PermissionError(13, "Permission denied", str(beside))
    assert str(caught.value).startswith(f"{path} cannot be written: no permission")
    assert ".part" not in str(caught.value)
    with pytest.raises(PermissionError, match=r"input\.tif"), atomic_path(path):
        raise PermissionError(13, "Permission denied", "input.tif")
    assert list(tmp_path.iterdir()) == []


def test_provenance_names_its_inputs(tmp_path: Path) -> None:
    path = tmp_path / "in.csv"
    path.write_bytes(b"id\n")
    entry = provenance({"a": (1, 2)}, [path], base_dir=tmp_path)
    assert entry["inputs_sha256"] == {"in.csv": hashlib.sha256(b"id\n").hexdigest()}
    assert entry["options"] == {"a": [1, 2]}
    assert entry["time_utc"].endswith("Z")
