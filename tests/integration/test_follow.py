"""Recordings measured while they are written: the same file, and positions soon after."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import tifffile
from measured_data import datasets
from small_project import SIZE_PX, frames_of, small_rig, write_small_project

from videogrammetry.pipeline import FollowOptions, LiveTable, follow_project, measure_to_file
from videogrammetry.pipeline.measure_job import first_free_id
from videogrammetry.project import read_project, read_trajectories, write_rig

STAGES, RATE_HZ = 230, 100.0  # two whole chunks and a part
#: On two cores that others use as well: the piece's wait, its measuring, a chunk's measuring.
BOUND_S = 10.0


def fill_folders(folder: Path, frames: dict[str, list[np.ndarray]], came_s: list[float]) -> None:
    """Writes pictures at the rate, as a camera's program would, all cameras' side by side."""
    begun = time.monotonic()
    for s in range(STAGES):
        for name, pictures in frames.items():
            beside = folder / name / f".{s}.tif"
            tifffile.imwrite(beside, pictures[s])
            beside.rename(folder / name / f"img{s + 1}.tif")
        came_s.append(time.monotonic())
        time.sleep(max(0.0, begun + (s + 1) / RATE_HZ - time.monotonic()))


def append_samples(folder: Path, samples: dict[str, bytes], came_s: list[float]) -> None:
    frame = SIZE_PX[0] * SIZE_PX[1]
    begun = time.monotonic()
    for s in range(STAGES):
        for name, data in samples.items():
            with (folder / f"{name}.mraw").open("ab") as file:
                # Not always whole frames: what is half there must not be taken.
                done = file.tell()
                file.write(data[done : (s + 1) * frame + (frame // 2 if s % 2 else 0)])
        came_s.append(time.monotonic())
        time.sleep(max(0.0, begun + (s + 1) / RATE_HZ - time.monotonic()))


def follow(path: Path, write, live: Path):
    """Follows the project while ``write`` runs; returns pieces (first, last, told delay, when)."""
    pieces: list[tuple[int, int, float, float]] = []

    def publisher(rig, options, rate):
        stream = live.open("w", newline="")
        table = LiveTable([stream], tuple(rig.cameras), first_free_id(options.recognition), rate)

        def publish(record, delay_s):
            table.add(record)
            first, last = int(record.stage[0]), int(record.stage[-1])
            pieces.append((first, last, delay_s, time.monotonic()))

        return publish

    writer = threading.Thread(target=write)
    writer.start()
    options = FollowOptions(idle_s=2.0, piece_stages=20, piece_s=0.5, num_threads=1)
    table = follow_project(read_project(path), options=options, publisher=publisher)
    writer.join()
    return table, pieces


def check(path: Path, pieces, came_s, live: Path, capsys, what: str) -> None:
    assert [p[0] for p in pieces] == [1, *(p[1] + 1 for p in pieces[:-1])]
    assert pieces[-1][1] == STAGES
    delay = [when - came_s[first - 1] for first, _, _, when in pieces]
    with capsys.disabled():
        print(
            f"\n{what}: {STAGES} stages at {RATE_HZ:g} Hz in {len(pieces)} pieces; oldest stage of "
            f"a piece published after {np.median(delay):.2f} s (median), {max(delay):.2f} s (most)"
        )
    assert max(delay) < BOUND_S
    table = read_trajectories(live)
    project = read_project(path)
    followed = datasets(project.measurement_path)
    project.measurement_path.unlink()
    measure_to_file(project)
    assert datasets(project.measurement_path) == followed
    # The live points are the file's, but for what a piece's first stage knows less of.
    stage = np.frombuffer(followed["stage"], np.int32)
    position = np.frombuffer(followed["position_mm"]).reshape(len(stage), -1, 3)
    point = np.array([int(p) for p in table.point])
    assert set(point.tolist()) == set(range(1, 9))
    apart = np.linalg.norm(table.position_mm - position[table.stage - 1, point - 1], axis=1)
    bound = np.linalg.norm(table.sigma_mm, axis=1)
    assert len(point) == np.isfinite(position[..., 0]).sum()
    assert (apart < bound).all()


@pytest.fixture(scope="module")
def frames() -> dict[str, list[np.ndarray]]:
    rig = small_rig()
    return {name: frames_of(rig, name, STAGES) for name in rig.cameras}


def test_a_folder_that_is_being_filled(tmp_path, frames, capsys) -> None:
    folder = tmp_path / "project"
    for name in frames:
        (folder / name).mkdir(parents=True)
    write_rig(folder / "rig.json", small_rig())
    sections = "".join(f'[cameras.{n}]\nsequence = "{n}"\n' for n in frames)
    (folder / "project.toml").write_text(
        f'schema = 1\n{sections}[targets]\ncodes = "schneider-14"\n'
        f"[sequence]\nframe_rate_hz = {RATE_HZ}\n"
    )
    came_s: list[float] = []
    live = tmp_path / "live.csv"
    path = folder / "project.toml"
    _, pieces = follow(path, lambda: fill_folders(folder, frames, came_s), live)
    check(path, pieces, came_s, live, capsys, "pictures")


def test_an_mraw_that_is_being_saved(tmp_path, capsys) -> None:
    path = write_small_project(tmp_path / "small", STAGES)
    samples = {}
    for file in sorted(path.parent.glob("*.mraw")):
        samples[file.stem] = file.read_bytes()
        file.write_bytes(b"")
    came_s: list[float] = []
    live = tmp_path / "live.csv"
    _, pieces = follow(path, lambda: append_samples(path.parent, samples, came_s), live)
    for name, data in samples.items():
        assert (path.parent / f"{name}.mraw").read_bytes() == data
    check(path, pieces, came_s, live, capsys, ".mraw")


def test_one_camera_ends_before_the_others(tmp_path, frames) -> None:
    folder = tmp_path / "project"
    for name, pictures in frames.items():
        (folder / name).mkdir(parents=True)
        for s in range(30 if name != "c2" else 27):
            tifffile.imwrite(folder / name / f"img{s + 1}.tif", pictures[s])
    write_rig(folder / "rig.json", small_rig())
    sections = "".join(f'[cameras.{n}]\nsequence = "{n}"\n' for n in frames)
    (folder / "project.toml").write_text(f"schema = 1\n{sections}")
    project = read_project(folder / "project.toml")
    table = follow_project(project, options=FollowOptions(idle_s=0.8))
    assert table.stage.tolist() == list(range(1, 28))
    assert any("measured are the 27 of all" in warning for warning in table.warnings)


@pytest.mark.skipif(os.name != "posix", reason="POSIX's signals")
def test_ctrl_c_ends_the_following_with_a_whole_file(tmp_path) -> None:
    path = write_small_project(tmp_path / "small", 130)
    command = [sys.executable, "-m", "videogrammetry", "measure", str(path)]
    process = subprocess.Popen(
        [*command, "--follow", "--idle", "1000"], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        text=True,
    )  # fmt: skip
    live = path.parent / "trajectories.live.csv"
    until = time.monotonic() + 60
    while time.monotonic() < until and not (live.exists() and "130," in live.read_text()):
        time.sleep(0.1)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 0, said
    followed = datasets(path.parent / "measurement.h5")
    subprocess.run([*command, "--force"], check=True, capture_output=True)
    assert datasets(path.parent / "measurement.h5") == followed


def test_only_growing_recordings_are_followed(tmp_path) -> None:
    path = write_small_project(tmp_path / "small", 3)
    text = path.read_text().replace('"c1.cihx"', '"c*.cihx"')
    path.write_text(text)
    with pytest.raises(RuntimeError, match="must be one folder"):
        follow_project(read_project(path))
    shutil.rmtree(path.parent)
