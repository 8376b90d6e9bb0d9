"""A measurement that is killed goes on where it ended, and ends the same.

More kills than here: pytest tests/integration/test_resume.py --kills 100
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from measured_data import datasets
from small_project import write_small_project

STAGES = 1500  # fifteen chunks


def begin(folder: Path) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "videogrammetry", "measure", str(folder), "--threads", "2"]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def parts(folder: Path) -> int:
    return len(list((folder / "measurement.parts").glob("stages-*.npz")))


@pytest.mark.skipif(os.name != "posix", reason="kill -9 is POSIX's")
def test_killed_again_and_again_gives_the_same(tmp_path, pytestconfig, capsys) -> None:
    kills = pytestconfig.getoption("--kills")
    rng = np.random.default_rng(kills)
    folder = write_small_project(tmp_path / "small", STAGES).parent
    file = folder / "measurement.h5"
    started = time.monotonic()
    assert begin(folder).wait() == 0
    whole_s = time.monotonic() - started
    expected = datasets(file)
    assert np.frombuffer(expected["point_id"], np.int32).tolist() == list(range(1, 9))
    file.unlink()
    killed, midway, finished = 0, 0, 0
    while killed < kills:
        process = begin(folder)
        if killed % 2:  # at any time, also while the program starts
            time.sleep(rng.uniform(0.1, 1.0) * whole_s)
        else:  # while it measures, numbers the points or writes the file
            wanted = int(rng.integers(1, STAGES // 100 + 1))
            while parts(folder) < wanted and process.poll() is None:
                time.sleep(0.002)
            time.sleep(rng.exponential(0.05))
        if process.poll() is None:
            process.send_signal(signal.SIGKILL)
            killed += 1
            midway += parts(folder) > 0
        process.wait()
        if file.exists():  # it was faster: whole, or it would not be there
            assert datasets(file) == expected
            file.unlink()
            finished += 1
    assert begin(folder).wait() == 0
    assert datasets(file) == expected
    assert not (folder / "measurement.parts").exists()
    with capsys.disabled():
        print(
            f"\n{killed} kills, {midway} of them with parts kept, {finished + 1} measurements "
            "finished: all datasets the same, byte for byte"
        )
    assert midway > 0


def test_another_rig_begins_anew(tmp_path, monkeypatch) -> None:
    from small_project import small_rig

    from videogrammetry.pipeline import measure_to_file
    from videogrammetry.pipeline.chunk_store import FolderStore
    from videogrammetry.project import read_measurement, read_project, write_rig

    path = write_small_project(tmp_path / "small", 250)
    project = read_project(path)
    monkeypatch.setattr(FolderStore, "remove", lambda self: None)
    measure_to_file(project)
    kept = path.parent / "measurement.parts"
    assert len(list(kept.glob("stages-*.npz"))) == 3
    first = (kept / "stages-0000001-0000100.npz").stat().st_mtime_ns
    measure_to_file(project)  # nothing is measured again
    assert (kept / "stages-0000001-0000100.npz").stat().st_mtime_ns == first
    before = read_measurement(project.measurement_path).trajectories.position_mm
    rig = small_rig()
    rig.cameras["c1"].translation_mm[0] += 1.0
    write_rig(path.parent / "rig.json", rig)
    measure_to_file(project)
    after = read_measurement(project.measurement_path).trajectories.position_mm
    assert (kept / "stages-0000001-0000100.npz").stat().st_mtime_ns != first
    assert np.abs(after - before).max() > 0.01
