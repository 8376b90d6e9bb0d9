"""Cameras out of step, cut short, or at different rates: what is refused, offered, said."""

from __future__ import annotations

import re
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from small_project import SIZE_PX, positions, write_small_project

from videogrammetry.errors import MeasurementError, SequenceError
from videogrammetry.pipeline import measure_to_file
from videogrammetry.pipeline.measure_sources import common_frames, frame_rate
from videogrammetry.project import CameraSection, Project, read_measurement, read_project
from videogrammetry.sequence import ArraySource

NAMES = ("left", "right")


class Stamped(ArraySource):
    """Frames that know when they were taken, as recordings' readers say it."""

    def __init__(self, count: int, first_frame: int | None = None, **facts) -> None:
        rate = facts.pop("rate", 100.0)
        super().__init__(np.zeros((count, 4, 6), np.uint8), frame_rate_hz=rate)
        self.first_frame = first_frame
        self.remarks: tuple[str, ...] = ()
        self.trigger_time = datetime(2026, 1, 1, tzinfo=UTC)
        self.__dict__.update(facts)


def project(**sections) -> Project:
    cameras = {n: CameraSection(name=n, sequence=("x",)) for n in NAMES}
    made = Project(path=Path("/p/project.toml"), name="p", cameras=cameras)
    return replace(made, **sections)


def pair(left: Stamped, right: Stamped) -> dict[str, Stamped]:
    return {"left": left, "right": right}


def test_cameras_out_of_step_are_refused_with_the_line_that_helps() -> None:
    sources = pair(Stamped(50, first_frame=-10), Stamped(50, first_frame=-7))
    with pytest.raises(SequenceError) as raised:
        common_frames(project(), sources)
    assert "trigger frames" in str(raised.value)
    assert "[cameras.left] first_frame = 4" in str(raised.value)
    assert "47 frames of every camera" in str(raised.value)


def test_the_offered_line_brings_them_into_step(tmp_path) -> None:
    # The first camera began three frames before the others.
    path = write_small_project(tmp_path / "small", 43)
    header = path.parent / "c1.cihx"
    text = header.read_text(encoding="utf-8", errors="surrogateescape")
    before = re.search(r"<startFrame>(-?\d+)</startFrame>", text)
    assert before is not None
    for name in ("c2", "c3"):
        # The others' files lack the first three frames, and say so.
        mraw = path.parent / f"{name}.mraw"
        mraw.write_bytes(mraw.read_bytes()[3 * SIZE_PX[0] * SIZE_PX[1] :])
        other = path.parent / f"{name}.cihx"
        said = other.read_text(encoding="utf-8", errors="surrogateescape")
        said = said.replace(before[0], f"<startFrame>{int(before[1]) + 3}</startFrame>")
        said = re.sub(r"<totalFrame>43<", "<totalFrame>40<", said)
        other.write_text(said, encoding="utf-8", errors="surrogateescape")
    with pytest.raises(SequenceError, match=r"\[cameras\.c1\] first_frame = 4"):
        measure_to_file(read_project(path))
    toml = path.read_text().replace("[cameras.c1]\n", "[cameras.c1]\nfirst_frame = 4\n")
    path.write_text(toml)
    table = measure_to_file(read_project(path))
    assert table.stage.tolist() == list(range(1, 41))
    assert table.num_points.tolist() == [8] * 40
    points = read_measurement(path.parent / "measurement.h5").trajectories
    # The first stage is now the fourth of the motion: 0.01 mm of noise, 1 mm of motion a stage.
    truth = positions(4)
    error = np.linalg.norm(points.position_mm[0] - truth, axis=1)
    assert error.max() < 5 * np.sqrt(points.cov_mm2[0][:, [0, 3, 5]].sum(axis=1)).max()


def test_first_frame_overrules_what_the_files_say() -> None:
    sources = pair(Stamped(50, first_frame=-10), Stamped(50, first_frame=-7))
    told = project(
        cameras={n: CameraSection(name=n, sequence=("x",), first_frame=1) for n in NAMES}
    )
    count, said = common_frames(told, sources)
    assert count == 50
    assert any("'left' is 3 frames early" in text for text in said)


@pytest.mark.parametrize(
    ("left", "right", "common"),
    [
        (Stamped(50), Stamped(41, remarks=("a.mraw: cut short: 41 whole frames are there",)), 41),
        (Stamped(50, first_frame=-10), Stamped(44, first_frame=-10), 44),
    ],
    ids=["cut short", "one trigger"],
)
def test_as_far_as_all_cameras_go(left, right, common) -> None:
    count, said = common_frames(project(), pair(left, right))
    assert count == common
    assert any(f"measured are the {common} that all cameras have" in text for text in said)
    for remark in right.remarks:
        assert f"camera 'right': {remark}" in said


def test_a_missing_frame_somewhere_is_refused_unless_the_last_is_named() -> None:
    sources = pair(Stamped(50), Stamped(49))
    with pytest.raises(SequenceError, match="'left' has 50 frames, but camera 'right' has 49"):
        common_frames(project(), sources)
    wanted = project()
    wanted = replace(wanted, sequence=replace(wanted.sequence, last=49))
    assert common_frames(wanted, sources) == (49, [])


def test_different_rates_are_refused() -> None:
    sources = pair(Stamped(50), Stamped(50, rate=50.0))
    with pytest.raises(MeasurementError, match="different frame rates"):
        frame_rate(project(), sources)
    wanted = project()
    wanted = replace(wanted, sequence=replace(wanted.sequence, frame_rate_hz=100.0))
    rate, said = frame_rate(wanted, sources)
    assert rate == 100.0
    assert len(said) == 1


def test_a_recording_cut_short_is_measured_as_far_as_it_goes(tmp_path) -> None:
    path = write_small_project(tmp_path / "small", 130)
    mraw = path.parent / "c2.mraw"
    mraw.write_bytes(mraw.read_bytes()[: 110 * SIZE_PX[0] * SIZE_PX[1] + 17])
    table = measure_to_file(read_project(path))
    assert table.stage.tolist() == list(range(1, 111))
    assert any("camera 'c2'" in w and "cut short" in w for w in table.warnings)
