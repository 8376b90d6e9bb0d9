"""Parts of a file: mapped or read, all of it or an error, also where reads give less."""

from __future__ import annotations

import os

import numpy as np
import pytest

from videogrammetry.errors import SequenceError
from videogrammetry.sequence.file_bytes import FileBytes, is_remote

DATA = np.random.default_rng(3).integers(0, 256, 10_000).astype(np.uint8)


@pytest.fixture
def path(tmp_path):
    DATA.tofile(tmp_path / "a.bin")
    return tmp_path / "a.bin"


@pytest.mark.parametrize("mapped", [True, False])
def test_parts(path, mapped):
    file = FileBytes(path, mapped=mapped)
    assert file.mapped == mapped
    np.testing.assert_array_equal(file.view(17, 9_000, "it"), DATA[17:9_000])
    assert file.view(5, 5, "nothing").size == 0
    assert not file.view(0, 10, "it").flags.writeable
    with pytest.raises(SequenceError, match="frame 3 would end at byte 10001, but the file has 10"):
        file.view(0, 10_001, "frame 3")


@pytest.mark.parametrize("mapped", [True, False])
def test_a_file_that_shrinks_or_grows(path, mapped):
    file = FileBytes(path, mapped=mapped)
    os.truncate(path, 4_000)
    np.testing.assert_array_equal(file.view(0, 4_000, "it"), DATA[:4_000])
    with pytest.raises(SequenceError, match=r"has 4000 \(it had 10000 when it was opened"):
        file.view(0, 4_001, "it")
    os.truncate(path, 12_000)
    assert (file.view(11_000, 12_000, "it") == 0).all()


def test_short_reads_are_continued_and_failing_ones_named(path, monkeypatch):
    if not hasattr(os, "preadv"):
        pytest.skip("no preadv here")
    whole = os.preadv
    monkeypatch.setattr(os, "preadv", lambda f, b, at: whole(f, [b[0][:777]], at))
    file = FileBytes(path, mapped=False)
    np.testing.assert_array_equal(file.view(3, 9_999, "it"), DATA[3:9_999])
    monkeypatch.setattr(os, "preadv", lambda f, b, at: 0)
    with pytest.raises(SequenceError, match="frame 1 would end"):
        file.view(0, 10, "frame 1")

    def fails(*_):
        raise OSError(116, "Stale file handle")

    monkeypatch.setattr(os, "preadv", fails)
    with pytest.raises(SequenceError, match="cannot be read .Stale file handle.*local disk"):
        file.view(0, 10, "frame 1")


def test_without_preadv(path, monkeypatch):
    monkeypatch.delattr(os, "preadv", raising=False)
    file = FileBytes(path, mapped=False)
    np.testing.assert_array_equal(file.view(3, 9_999, "it"), DATA[3:9_999])


@pytest.mark.skipif(os.name == "nt", reason="POSIX")
@pytest.mark.parametrize(("kind", "remote"), [("nfs4", True), ("cifs", True), ("ext4", False)])
def test_network_drives_by_the_systems_table(path, tmp_path, kind, remote):
    device = os.stat(path).st_dev
    numbers = f"{os.major(device)}:{os.minor(device)}"
    table = tmp_path / "mountinfo"
    table.write_text(
        f"1 0 0:1 / / rw - ext4 a rw\n36 35 {numbers} / /m rw,a shared:1 - {kind} s rw\n"
    )
    assert is_remote(path, table) == remote
    assert not is_remote(path, tmp_path / "none")


def test_opening_and_closing(path, tmp_path):
    with pytest.raises(SequenceError, match="cannot be opened .No such file"):
        FileBytes(tmp_path / "none")
    if os.path.isdir("/proc/self/fd"):
        before = len(os.listdir("/proc/self/fd"))
        for _ in range(20):
            FileBytes(path).view(0, 1, "it")
        assert len(os.listdir("/proc/self/fd")) <= before + 2
