"""Cameras out of step: found from trigger frames and time stamps, and the offset offered."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from videogrammetry.errors import SequenceError
from videogrammetry.sequence import RangeSource, align, check_same_length, check_synchronous

ZERO = datetime(2024, 5, 1, 12, 0, 0, tzinfo=UTC)


@dataclass
class Recording:
    """Frame k bears the number of the instant at which it was taken."""

    count: int = 20
    start: int = 0
    rate: float | None = 1000.0
    first_frame: int | None = None
    save_step: int = 1
    clock_s: float | None = None  # of the trigger, after ZERO
    image_size_px: tuple[int, int] = (6, 4)

    @property
    def frame_rate_hz(self) -> float | None:
        return self.rate

    @property
    def trigger_time(self) -> datetime | None:
        return None if self.clock_s is None else ZERO + timedelta(seconds=self.clock_s)

    def times_s(self) -> npt.NDArray[np.float64] | None:
        if self.clock_s is None or self.rate is None:
            return None
        return (np.arange(self.count) + self.start) / self.rate - self.clock_s

    def __len__(self) -> int:
        return self.count

    def name(self, index: int) -> str:
        return f"{index}"

    def read(self, index: int) -> npt.NDArray[Any]:
        return np.full(self.image_size_px[::-1], self.start + index, np.uint8)


def test_cameras_in_step_have_nothing_said_of_them():
    cameras = {c: Recording(first_frame=-5, image_size_px=(6 + k, 4)) for k, c in enumerate("abc")}
    found = check_synchronous(cameras)
    assert (found.errors, found.warnings) == ((), ())
    assert (found.num_common, found.evidence) == (20, "trigger frames")
    alone = check_synchronous({"a": Recording()})
    assert (alone.errors, alone.skip, alone.num_common) == ((), {"a": 0}, 20)


@pytest.mark.parametrize("late", [1, 7])
def test_trigger_frames_give_the_offset(late):
    cameras = {
        "left": Recording(start=0, first_frame=-10),
        "right": Recording(start=late, first_frame=-10 + late, count=15),
    }
    found = check_synchronous(cameras)
    assert found.skip == {"left": late, "right": 0}
    assert f"'left' {late}, 'right' 0 frames" in found.errors[0]
    assert found.num_common == min(20 - late, 15)
    aligned = align(cameras)
    for k in range(found.num_common):
        np.testing.assert_array_equal(aligned["left"].read(k), aligned["right"].read(k))
    assert len(aligned["left"]) == len(aligned["right"]) == found.num_common


def test_time_stamps_stand_above_trigger_frames():
    # "right" got its trigger 3 ms later: its frame 0 is another instant.
    cameras = {
        "left": Recording(start=0, first_frame=0, clock_s=0.0),
        "right": Recording(start=3, first_frame=0, clock_s=0.003),
    }
    found = check_synchronous(cameras)
    assert found.skip == {"left": 3, "right": 0}
    assert found.evidence == "time stamps"
    assert "not triggered at once" in found.warnings[0]


def test_clocks_that_were_not_set_are_not_followed(monkeypatch):
    cameras = {
        "left": Recording(first_frame=0, clock_s=0.0),
        "right": Recording(first_frame=0, clock_s=0.0),
    }
    monkeypatch.setattr(cameras["right"], "times_s", lambda: np.arange(20) / 1000 + 5000.0)
    found = check_synchronous(cameras)
    assert "clocks differ by 5000 s" in found.warnings[0]
    assert found.skip == {"left": 0, "right": 0}


def test_shutters_that_open_apart_are_said(monkeypatch):
    left, right = Recording(clock_s=0.0), Recording(clock_s=0.0)
    monkeypatch.setattr(right, "times_s", lambda: (np.arange(20) + 0.4) / 1000)
    found = check_synchronous({"left": left, "right": right})
    assert "0.40 of a frame's time apart" in found.warnings[0]


def test_lengths_rates_and_steps():
    found = check_synchronous({"a": Recording(count=20), "b": Recording(count=18)})
    assert "camera 'a' has 20 frames, camera 'b' has 18 frames" in found.errors[0]
    assert "last = 18" in found.errors[0]
    found = check_synchronous({"a": Recording(rate=1000), "b": Recording(rate=1001)})
    assert "different rates ('a' 1000 Hz, 'b' 1001 Hz)" in found.errors[0]
    found = check_synchronous({"a": Recording(rate=1000), "b": Recording(rate=None)})
    assert not found.errors
    assert "'b' state no frame rate" in found.warnings[0]
    found = check_synchronous({"a": Recording(save_step=2), "b": Recording()})
    assert "different shares" in found.errors[0]
    found = check_synchronous(
        {"a": Recording(save_step=4, first_frame=0), "b": Recording(save_step=4, first_frame=6)}
    )
    assert "not whole steps of 4" in found.warnings[0]


def test_different_lengths_come_with_the_offset_where_it_is_known():
    cameras = {
        "left": Recording(start=0, first_frame=-10),
        "right": Recording(start=7, first_frame=-3, count=13),
    }
    with pytest.raises(SequenceError, match=r"leave out 'left' 7, 'right' 0 .* 13 of every"):
        check_same_length(cameras)
    with pytest.raises(SequenceError, match=r"narrow the pattern$"):
        check_same_length({"a": Recording(count=20), "b": Recording(count=18)})
    assert check_same_length({"a": Recording(), "b": Recording()}) == 20


def test_what_has_nothing_in_common_cannot_be_aligned():
    cameras = {"a": Recording(first_frame=0), "b": Recording(first_frame=100)}
    assert check_synchronous(cameras).num_common == 0
    with pytest.raises(ValueError, match="frames in common"):
        align(cameras)
    with pytest.raises(ValueError, match="at least one camera"):
        check_synchronous({})
    with pytest.raises(ValueError, match="a part of 20 frames"):
        RangeSource(Recording(), 5, 16)
    with pytest.raises(IndexError):
        RangeSource(Recording(), 5, 3).read(3)


@pytest.mark.data
def test_a_real_recordings_bad_stamp_is_named(data, capsys):
    from videogrammetry.cli.main import main

    assert main(["info", str(data / "high-speed/data_small_cine.cine")]) == 0
    text = capsys.readouterr().out
    assert "10000.000 us apart, but irregular at frame 235" in text
    assert main(["info", str(data / "high-speed/phantom_v1610.cine")]) == 0
    text = capsys.readouterr().out
    assert "the camera's frame -85 (0: the trigger)" in text
    assert "time stamps: -0.844701095 to -0.794701097 s, 10000.000 us apart" in text
