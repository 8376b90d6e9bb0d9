"""Progress: a bar on a terminal, few plain lines elsewhere."""

from __future__ import annotations

import io

import pytest

from videogrammetry.cli.progress import Progress


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now = [100.0]
    monkeypatch.setattr("videogrammetry.cli.progress.time.monotonic", lambda: now[0])
    return now


def test_bar_with_rate_and_time_left(clock: list[float]) -> None:
    stream = Terminal()
    progress = Progress("measure", "stages", stream)
    for done in range(1, 11):
        clock[0] += 2.0
        progress(done, 10)
    frames = stream.getvalue().split("\r")
    assert frames[5].startswith("measure: [############............] 5/10 stages 0.5/s 10 s left")
    assert frames[-1].startswith("measure: [########################] 10/10 stages 0.5/s in 20 s")
    assert stream.getvalue().endswith("\n")


def test_plain_lines_are_few(clock: list[float]) -> None:
    stream = io.StringIO()
    progress = Progress("recognize", "pictures", stream)
    for done in range(1, 1001):
        clock[0] += 0.1
        progress(done, 1000)
    lines = stream.getvalue().splitlines()
    assert 5 <= len(lines) <= 11
    assert lines[-1] == "recognize: 1000/1000 pictures 10/s in 1 min 40 s"
    assert "\r" not in stream.getvalue()


def test_a_new_part_of_the_work_has_its_own_rate(clock: list[float]) -> None:
    stream = Terminal()
    progress = Progress("calibrate", stream=stream)
    clock[0] += 100
    progress(0, 1, "adjusting")
    clock[0] += 4
    progress(1, 1, "adjusting")
    assert stream.getvalue().split("\r")[-1].startswith("adjusting:")
    assert "in 4 s" in stream.getvalue()


def test_a_part_first_told_when_something_is_done(clock: list[float]) -> None:
    stream = Terminal()
    progress = Progress("measure", stream=stream)
    clock[0] += 5
    progress(1, 4, "measuring")
    assert "1/4 0.2/s 15 s left" in stream.getvalue()


def test_an_unfinished_line_is_ended(clock: list[float]) -> None:
    stream = Terminal()
    progress = Progress("x", stream=stream)
    progress(1, 3)
    progress.close()
    progress.close()
    assert stream.getvalue().count("\n") == 1
