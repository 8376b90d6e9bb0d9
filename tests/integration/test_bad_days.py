"""Full disks, damaged parts, two at a time, unreadable frames: nothing measured is lost."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import tifffile
from measured_data import datasets
from small_project import frames_of, small_rig, write_small_project

from videogrammetry.errors import (
    MeasurementError,
    MeasurementWarning,
    ProjectFileError,
    SequenceError,
)
from videogrammetry.pipeline import measure_to_file
from videogrammetry.pipeline.chunk_store import FolderStore
from videogrammetry.project import one_at_a_time, read_measurement, read_project, write_rig
from videogrammetry.sequence import JoinedSource

STAGES = 400


@pytest.fixture(scope="module")
def small(tmp_path_factory) -> Path:
    return write_small_project(tmp_path_factory.mktemp("days") / "small", STAGES)


@pytest.fixture(scope="module")
def expected(small) -> dict[str, bytes]:
    project = read_project(small)
    measure_to_file(project)
    found = datasets(project.measurement_path)
    project.measurement_path.unlink()
    return found


def test_a_full_disk(small, expected, small_disk) -> None:
    text = small.read_text()
    for name in ("c1", "c2", "c3"):
        text = text.replace(f'"{name}.cihx"', f'"{small.parent / name}.cihx"')
    (small_disk / "project.toml").write_text(text)
    write_rig(small_disk / "rig.json", small_rig())
    filler = small_disk / "filler"
    parts = small_disk / "measurement.parts"
    filler.write_bytes(b"x" * 350_000)
    project = read_project(small_disk / "project.toml")
    with pytest.raises(MeasurementError, match="cannot be kept .*make room.* again"):
        measure_to_file(project, num_threads=1)
    kept = sorted(path.name for path in parts.glob("*.npz"))
    assert 0 < len(kept) < 4
    assert not list(parts.glob(".*"))
    filler.unlink()
    subprocess.run(["mount", "-o", "remount,size=20m", str(small_disk)], check=True)
    measured: list[int] = []
    measure_to_file(project, progress=lambda done, total, what="": measured.append(total))
    assert measured[-1] == STAGES - 100 * len(kept)
    assert datasets(project.measurement_path) == expected


def test_a_disk_that_is_full_when_the_file_is_written(small, expected, small_disk) -> None:
    subprocess.run(["mount", "-o", "remount,size=20m", str(small_disk)], check=True)
    text = small.read_text()
    for name in ("c1", "c2", "c3"):
        text = text.replace(f'"{name}.cihx"', f'"{small.parent / name}.cihx"')
    (small_disk / "project.toml").write_text(text)
    write_rig(small_disk / "rig.json", small_rig())
    parts = small_disk / "measurement.parts"
    filler = small_disk / "filler"
    project = read_project(small_disk / "project.toml")

    def stop(done: int, total: int, what: str = "") -> None:
        if done == total:  # the parts are all there
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        measure_to_file(project, progress=stop)
    filler.write_bytes(b"x" * (shutil.disk_usage(small_disk).free - 20_000))
    command = [sys.executable, "-m", "videogrammetry", "measure", str(small_disk)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    said = done.stderr.splitlines()[-1]
    assert "measurement.h5 cannot be written" in said
    assert "all stages are measured and kept: make room" in said
    assert len(list(parts.glob("*.npz"))) == 4
    assert not list(small_disk.glob(".measurement*"))
    assert not project.measurement_path.exists()
    filler.unlink()
    told: list[int] = []
    measure_to_file(project, progress=lambda done, total, what="": told.append(total))
    assert not told  # nothing is measured again
    assert datasets(project.measurement_path) == expected


@pytest.mark.skipif(os.name != "posix", reason="a limit of a file's size is POSIX's")
def test_a_disk_that_fills_while_the_file_is_written(small, expected) -> None:
    project = read_project(small)
    parts = small.parent / "measurement.parts"
    # A part has 290 kB, the whole file 2.3 MB; Python takes the signal for an error.
    limited = "import resource, runpy, sys; sys.argv = ['videogrammetry', 'measure', sys.argv[1]]; "
    limited += "resource.setrlimit(resource.RLIMIT_FSIZE, (BYTES, resource.RLIM_INFINITY)); "
    limited += "runpy.run_module('videogrammetry', run_name='__main__')"
    for limit in (500_000, 1_500_000, 2_200_000):
        command = [sys.executable, "-c", limited.replace("BYTES", str(limit)), str(small)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 1  # and not by a signal
        said = done.stderr.splitlines()[-1]
        assert "measurement.h5 cannot be written (File too large" in said
        assert "all stages are measured and kept: make room" in said
        assert len(list(parts.glob("*.npz"))) == 4
        assert not list(small.parent.glob(".measurement*.part*"))
        assert not project.measurement_path.exists()
    told: list[int] = []
    measure_to_file(project, progress=lambda done, total, what="": told.append(total))
    assert not told  # nothing is measured again
    assert datasets(project.measurement_path) == expected
    project.measurement_path.unlink()


@pytest.mark.parametrize("damage", ["cut", "flipped", "empty"])
def test_a_damaged_part_is_measured_anew(small, expected, monkeypatch, damage) -> None:
    project = read_project(small)
    with monkeypatch.context() as patch:
        patch.setattr(FolderStore, "remove", lambda self: None)
        measure_to_file(project)
    project.measurement_path.unlink()
    part = small.parent / "measurement.parts" / "stages-0000101-0000200.npz"
    data = bytearray(part.read_bytes())
    if damage == "flipped":
        data[len(data) // 2] ^= 0xFF
    part.write_bytes({"cut": data[: len(data) // 2], "flipped": data, "empty": b""}[damage])
    with pytest.warns(MeasurementWarning, match=r"stages-0000101.*damaged.*measured anew"):
        measure_to_file(project)
    assert datasets(project.measurement_path) == expected
    project.measurement_path.unlink()


def test_two_at_a_time(small) -> None:
    project = read_project(small)
    with one_at_a_time(small.parent / ".measurement.lock", "measured"):
        command = [sys.executable, "-m", "videogrammetry", "measure", str(small)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "is being measured already, by process" in done.stderr
    assert str(os.getpid()) in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert not (small.parent / ".measurement.lock").exists()
    with (
        one_at_a_time(small.parent / ".measurement.lock", "measured"),
        pytest.raises(ProjectFileError, match="already"),
    ):
        measure_to_file(project)


@pytest.mark.skipif(os.name != "posix", reason="kill -9 is POSIX's")
def test_the_lock_ends_with_a_killed_process(tmp_path) -> None:
    lock = tmp_path / ".lock"
    code = (
        "import sys, time; from videogrammetry.project import one_at_a_time\n"
        "with one_at_a_time(sys.argv[1], 'measured'): print('held', flush=True); time.sleep(60)"
    )
    holder = subprocess.Popen(
        [sys.executable, "-c", code, str(lock)], stdout=subprocess.PIPE, text=True
    )
    assert holder.stdout is not None
    assert holder.stdout.readline() == "held\n"
    with (
        pytest.raises(ProjectFileError, match=f"process {holder.pid} on "),
        one_at_a_time(lock, "measured"),
    ):
        pass
    holder.send_signal(signal.SIGKILL)
    holder.communicate()
    assert lock.exists()  # what a killed process leaves is in nobody's way
    with one_at_a_time(lock, "measured"):
        pass
    assert not lock.exists()


@pytest.fixture
def pictures(tmp_path) -> Path:
    """A project of folders of pictures, the 151st of the second camera cut short."""
    folder = tmp_path / "pictures"
    rig = small_rig()
    for name in rig.cameras:
        (folder / name).mkdir(parents=True)
        for s, frame in enumerate(frames_of(rig, name, 230)):
            tifffile.imwrite(folder / name / f"img{s + 1}.tif", frame)
    write_rig(folder / "rig.json", rig)
    sections = "".join(f'[cameras.{n}]\nsequence = "{n}"\n' for n in rig.cameras)
    (folder / "project.toml").write_text(f'schema = 1\n{sections}[targets]\ncodes="schneider-14"\n')
    return folder


@pytest.mark.parametrize("keep_bytes", [0, 4, 20000])
def test_an_unreadable_frame(pictures, keep_bytes) -> None:
    bad = pictures / "c2" / "img151.tif"
    bad.write_bytes(bad.read_bytes()[:keep_bytes])
    project = read_project(pictures)
    with pytest.raises(SequenceError, match=r"camera 'c2'.*img151\.tif"):
        measure_to_file(project)
    table = measure_to_file(project, skip_unreadable=True)
    said = [w for w in table.warnings if "img151.tif" in w]
    assert len(said) == 1
    assert said[0].startswith("camera 'c2', stage 151: cannot be read and is left empty")
    points = read_measurement(project.measurement_path).trajectories
    assert table.num_points.tolist() == [8] * 230  # the other two cameras see them all the same
    assert not points.cameras_used[150, :, 1].any()
    assert points.cameras_used[149, :, 1].all()
    assert points.cameras_used[151, :, 1].all()


def test_a_frame_that_cannot_be_read_keeps_what_was_before(pictures, monkeypatch) -> None:
    project = read_project(pictures)
    read = JoinedSource.read

    def failing(self, index):
        if self.name(index) == "img151.tif" and "c2" in str(self.file(index)):
            raise SequenceError(f"{self.file(index)}: input/output error")
        return read(self, index)

    monkeypatch.setattr(JoinedSource, "read", failing)
    with pytest.raises(SequenceError, match=r"img151\.tif.*are kept.*--skip-unreadable"):
        measure_to_file(project, num_threads=1)
    parts = pictures / "measurement.parts"
    assert (parts / "stages-0000001-0000100.npz").exists()
    before = (parts / "stages-0000001-0000100.npz").stat().st_mtime_ns
    told: list[int] = []
    monkeypatch.setattr(FolderStore, "remove", lambda self: None)
    measure_to_file(
        project, skip_unreadable=True, progress=lambda d, total, what="": told.append(total)
    )
    assert told[-1] < 230
    assert (parts / "stages-0000001-0000100.npz").stat().st_mtime_ns == before
    shutil.rmtree(parts)


def test_a_measurement_killed_while_another_waits_for_it(small, expected) -> None:
    command = [sys.executable, "-m", "videogrammetry", "measure", str(small), "--threads", "1"]
    first = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    until = time.monotonic() + 60
    while not (small.parent / ".measurement.lock").exists() and time.monotonic() < until:
        time.sleep(0.01)
    first.kill()
    first.wait()
    file = small.parent / "measurement.h5"
    file.unlink(missing_ok=True)
    subprocess.run(command, check=True, capture_output=True)
    assert datasets(file) == expected
    file.unlink()
