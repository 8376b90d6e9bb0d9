"""The same chunks by other processes: the same data, byte for byte, whoever is lost."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from measured_data import datasets
from small_project import write_small_project

from videogrammetry.errors import MeasurementError, SequenceError
from videogrammetry.pipeline import ClusterRunner, measure_to_file
from videogrammetry.pipeline import cluster as cluster_module
from videogrammetry.project import read_project

distributed = pytest.importorskip("distributed", reason="pip install 'videogrammetry[cluster]'")

STAGES = 1500  # fifteen chunks


@pytest.fixture(scope="module")
def measured(tmp_path_factory) -> tuple[Path, dict[str, bytes]]:
    """A project, and what threads measure in it."""
    path = write_small_project(tmp_path_factory.mktemp("cluster") / "small", STAGES)
    project = read_project(path)
    measure_to_file(project, num_threads=2)
    expected = datasets(project.measurement_path)
    project.measurement_path.unlink()
    return path, expected


@pytest.fixture(scope="module")
def cluster():
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, memory_limit=0,
        silence_logs="CRITICAL",
    ) as cluster:  # fmt: skip
        yield cluster


def test_two_processes_give_the_same(measured, cluster) -> None:
    path, expected = measured
    project = read_project(path)
    told = []
    measure_to_file(
        project,
        run=ClusterRunner(cluster.scheduler_address),
        progress=lambda done, total, what="": told.append((done, total)),
    )
    assert datasets(project.measurement_path) == expected
    assert told[-1] == (STAGES, STAGES)
    assert not (path.parent / "measurement.parts").exists()
    project.measurement_path.unlink()


@pytest.mark.skipif(os.name != "posix", reason="kill -9 is POSIX's")
def test_a_worker_killed_again_and_again_changes_nothing(measured, cluster) -> None:
    path, expected = measured
    project = read_project(path)
    ended = threading.Event()
    killed = []

    def kill() -> None:
        while not ended.wait(0.15) and len(killed) < 6:
            # Those at work: one that is killed while it begins its nanny gives up.
            named = {info["name"] for info in cluster.scheduler_info["workers"].values()}
            pids = [w.pid for n, w in list(cluster.workers.items()) if n in named and w.pid]
            if pids:
                os.kill(pids[len(killed) % len(pids)], signal.SIGKILL)
                killed.append(pids[0])

    killer = threading.Thread(target=kill)
    killer.start()
    try:
        with distributed.Client(cluster) as client:
            measure_to_file(project, run=ClusterRunner(client=client))
    finally:
        ended.set()
        killer.join()
    assert killed
    assert datasets(project.measurement_path) == expected
    project.measurement_path.unlink()


def test_a_worker_that_cannot_see_a_file_is_named(measured, cluster, tmp_path, monkeypatch) -> None:
    path, _ = measured
    folder = shutil.copytree(path.parent, tmp_path / "copy")
    make = cluster_module._cluster_job

    def hidden(*args):
        # Gone after this process has opened it: what another machine would see.
        job = make(*args)
        (folder / "c2.mraw").rename(folder / "elsewhere")
        return job

    monkeypatch.setattr(cluster_module, "_cluster_job", hidden)
    with pytest.raises(SequenceError, match=r"worker tcp://.* cannot see the sequences.*'c2'"):
        measure_to_file(read_project(folder), run=ClusterRunner(cluster.scheduler_address))


def test_a_scheduler_that_is_not_there(measured, monkeypatch) -> None:
    path, _ = measured
    monkeypatch.setattr("videogrammetry.pipeline.cluster._FIRST_S", 1.0)
    with pytest.raises(MeasurementError, match="cannot be reached"):
        measure_to_file(read_project(path), run=ClusterRunner("tcp://127.0.0.1:1"))


@pytest.mark.skipif(os.name != "posix", reason="POSIX's signals")
def test_ctrl_c_leaves_whole_parts(measured, tmp_path) -> None:
    path, expected = measured
    folder = shutil.copytree(path.parent, tmp_path / "copy", copy_function=shutil.copy2)
    command = [sys.executable, "-m", "videogrammetry", "measure", str(folder)]
    local = [*command, "--scheduler", "local", "--workers", "2"]
    process = subprocess.Popen(
        local,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # Where these tests run in the background, Ctrl-C is ignored, also by what they begin.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    parts = folder / "measurement.parts"
    until = time.monotonic() + 120
    while not list(parts.glob("stages-*.npz")) and time.monotonic() < until:
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGINT)  # as the terminal does: all of its processes
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130, said
    assert "Traceback" not in said
    kept = sorted(parts.glob("stages-*.npz"))
    assert len(kept) > 0
    assert not list(parts.glob(".*.part.npz"))
    subprocess.run(command, check=True, capture_output=True)
    assert datasets(folder / "measurement.h5") == expected
