"""Recordings that are being written: no frame before it is whole, none lost, none twice."""

from __future__ import annotations

import subprocess
import sys
import threading
import time

import numpy as np
import pytest

from videogrammetry.errors import SequenceError
from videogrammetry.sequence import create_sequence, picture_bytes
from videogrammetry.sequence.growing import GrowingFolder, GrowingMraw, open_growing

SHAPE = (120, 160)


def picture(number: int, bits: int = 8) -> np.ndarray:
    """Noise of its own number, so that half of it is no other's."""
    kind = np.uint8 if bits == 8 else np.uint16
    return np.random.default_rng(number).integers(0, 2**bits, SHAPE).astype(kind)


class Clock:
    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


@pytest.mark.parametrize("format", ["png", "tiff"])
def test_pictures_that_a_thread_writes_in_pieces(tmp_path, format):
    suffix = {"png": ".png", "tiff": ".tif"}[format]
    count, folder = 25, tmp_path / "cam"

    def write() -> None:
        folder.mkdir()
        for k in range(count):
            data = picture_bytes(picture(k), format)
            with (folder / f"img{k + 1}{suffix}").open("wb") as file:
                for begin in range(0, len(data), len(data) // 4 + 1):
                    file.write(data[begin : begin + len(data) // 4 + 1])
                    file.flush()
                    time.sleep(0.002)

    source = GrowingFolder(folder, settle_s=0.3)
    writer = threading.Thread(target=write)
    writer.start()
    seen = 0
    end = time.monotonic() + 60
    while seen < count and time.monotonic() < end:
        now = source.available()
        assert now >= seen
        for k in range(seen, now):
            np.testing.assert_array_equal(source.read(k), picture(k))
        seen = now
        time.sleep(0.001)
    writer.join()
    assert seen == count
    assert source.image_size_px == SHAPE[::-1]
    assert source.name(11) == f"img12{suffix}"


def test_a_recording_that_another_process_writes(tmp_path):
    with create_sequence(
        tmp_path / "whole", format="mraw", image_size_px=SHAPE[::-1], num_frames=30, bit_depth=12,
        frame_rate_hz=1000.0,
    ) as writer:  # fmt: skip
        for k in range(30):
            writer.append(picture(k, 12))
    (tmp_path / "run.cihx").write_bytes((tmp_path / "whole.cihx").read_bytes())
    code = (
        "import time, sys\n"
        "data = open(sys.argv[1], 'rb').read()\n"
        "with open(sys.argv[2], 'wb') as file:\n"
        "    for at in range(0, len(data), 10007):\n"
        "        file.write(data[at:at + 10007]); file.flush(); time.sleep(0.003)\n"
    )
    source = GrowingMraw(tmp_path / "run.cihx")
    assert (source.available(), len(source)) == (0, 0)
    with pytest.raises(SequenceError, match="no frame is complete yet"):
        source.read(0)
    process = subprocess.Popen(
        [sys.executable, "-c", code, str(tmp_path / "whole.mraw"), str(tmp_path / "run.mraw")]
    )
    seen = 0
    while seen < 30:
        now = source.wait(seen + 1, timeout_s=30.0, poll_s=0.001)
        assert now > seen, f"only {now} frames after 30 s"
        for k in range(seen, now):
            np.testing.assert_array_equal(source.read(k), picture(k, 12))
        seen = now
    assert process.wait() == 0
    packed = source.packed(29)
    assert packed is not None
    assert packed.shape == SHAPE
    assert source.frame_rate_hz == 1000.0


def test_the_last_picture_counts_when_it_stands_still_and_decodes(tmp_path):
    clock = Clock()
    source = GrowingFolder(tmp_path, settle_s=1.0, clock=clock)
    data = picture_bytes(picture(1), "png")
    path = tmp_path / "a1.png"
    path.write_bytes(data[:500])
    assert source.available() == 0
    clock.now = 5.0
    assert source.available() == 0  # stands still, but does not decode
    path.write_bytes(data)
    clock.now = 5.5
    assert source.available() == 0  # has changed just now
    clock.now = 6.4
    assert source.available() == 0
    clock.now = 6.5
    assert source.available() == 1
    (tmp_path / "a2.png").write_bytes(data[:10])
    assert source.available() == 1
    assert len(source) == 1


def test_a_damaged_picture_keeps_its_number(tmp_path):
    clock = Clock()
    source = GrowingFolder(tmp_path, settle_s=1.0, clock=clock)
    (tmp_path / "a1.tif").write_bytes(b"II*\0 no more came")
    (tmp_path / "a2.tif").write_bytes(picture_bytes(picture(2), "tiff"))
    assert source.available() == 0  # perhaps a1 is still being written
    clock.now = 1.0
    assert source.available() == 2
    assert source.image_size_px == SHAPE[::-1]
    with pytest.raises(SequenceError, match=r"a1\.tif"):
        source.read(0)
    np.testing.assert_array_equal(source.read(1), picture(2))


def test_what_would_change_numbers_or_sizes_is_an_error(tmp_path):
    source = GrowingFolder(tmp_path, settle_s=0.0)
    (tmp_path / "a5.png").write_bytes(picture_bytes(picture(5), "png"))
    assert source.wait(1, timeout_s=5.0, poll_s=0.01) == 1
    (tmp_path / "a3.png").write_bytes(picture_bytes(picture(3), "png"))
    with pytest.raises(SequenceError, match=r"a3\.png: came after a5\.png was complete"):
        source.available()
    (tmp_path / "a3.png").unlink()
    (tmp_path / "a6.png").write_bytes(picture_bytes(picture(6)[:50], "png"))
    (tmp_path / "a7.png").write_bytes(picture_bytes(picture(7), "png"))
    with pytest.raises(SequenceError, match=r"a6\.png: has 160x50 px.*160x120 px"):
        source.available()


def test_nothing_comes_and_the_kinds(tmp_path):
    source = open_growing(tmp_path / "not yet")
    begin = time.monotonic()
    assert source.wait(1, timeout_s=0.2, poll_s=0.01) == 0
    assert time.monotonic() - begin < 5.0
    with pytest.raises(SequenceError, match="its header is missing"):
        open_growing(tmp_path / "a.mraw")
