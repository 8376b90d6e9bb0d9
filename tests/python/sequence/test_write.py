"""Sequences that are written come back whole, or leave nothing behind."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import textwrap
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from videogrammetry.errors import SequenceError
from videogrammetry.sequence import SEQUENCE_FORMATS, create_sequence, open_sequence, parts
from videogrammetry.sequence.write import SequenceWriter

SIZE = (30, 20)
SEEDS = {8: 1, 10: 2, 12: 3, 14: 4, 16: 5}


def frames_of(bit_depth: int, count: int = 3) -> np.ndarray:
    random = np.random.default_rng(SEEDS[bit_depth])
    frames = random.integers(0, 2**bit_depth, (count, *SIZE[::-1]))
    return frames.astype(np.uint8 if bit_depth == 8 else np.uint16)


def writer_in(folder: Path, format: str = "mraw", **changes: object) -> SequenceWriter:
    options: dict = {"image_size_px": SIZE, "num_frames": 3, "bit_depth": 12, **changes}
    return create_sequence(folder / "cam1", format=format, **options)


def write(folder: Path, format: str = "mraw", bit_depth: int = 12, **changes: object) -> str:
    with writer_in(folder, format, bit_depth=bit_depth, **changes) as writer:
        for frame in frames_of(bit_depth):
            writer.append(frame)
    return writer.spec


@pytest.mark.parametrize("format", SEQUENCE_FORMATS)
@pytest.mark.parametrize("bit_depth", SEEDS)
def test_what_is_written_comes_back(tmp_path: Path, format: str, bit_depth: int) -> None:
    spec = write(
        tmp_path,
        format,
        bit_depth,
        frame_rate_hz=29.97,
        exposure_s=123.456e-6,
        camera_name="<links> & größer",
        date=datetime(2025, 12, 31, 7, 8),
    )
    source = open_sequence(spec, tmp_path)
    frames = frames_of(bit_depth)
    assert (len(source), source.image_size_px) == (3, SIZE)
    for i, frame in enumerate(frames):
        assert source.read(i).dtype == frame.dtype
        np.testing.assert_array_equal(source.read(i), frame)
    if format == "mraw":
        assert (source.frame_rate_hz, source.exposure_s) == (29.97, 123.456e-6)
        assert source.bit_depth == bit_depth
        assert source.sources[0].camera_name == "<links> & größer"
        assert source.sources[0].date == datetime(2025, 12, 31, 7, 8)
    else:
        suffix = {"tiff": "tif", "png": "png"}[format]
        assert [source.name(i) for i in (0, 2)] == [f"cam1_00000{k}.{suffix}" for k in (1, 3)]


@pytest.mark.parametrize("format", SEQUENCE_FORMATS)
def test_the_same_frames_give_the_same_bytes(tmp_path: Path, format: str) -> None:
    found = []
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        write(tmp_path / name, format)
        files = sorted(p for p in (tmp_path / name).rglob("*") if p.is_file())
        found.append([(p.relative_to(tmp_path / name), p.read_bytes()) for p in files])
    assert found[0] == found[1]
    assert len(found[0]) == (2 if format == "mraw" else 3)


def test_unknown_rate_and_exposure_stay_unknown(tmp_path: Path) -> None:
    source = open_sequence(write(tmp_path), tmp_path)
    assert (source.frame_rate_hz, source.exposure_s) == (None, None)


def test_names(tmp_path: Path) -> None:
    options = {"format": "mraw", "image_size_px": SIZE, "num_frames": 1, "bit_depth": 8}
    for given, spec in {"a.cihx": "a.cihx", "b.MRAW": "b.cihx", "c.v2": "c.v2.cihx"}.items():
        with create_sequence(tmp_path / given, **options) as writer:
            writer.append(np.zeros(SIZE[::-1], np.uint8))
        assert writer.spec == spec
        assert writer.path == tmp_path / spec
        assert len(open_sequence(writer.spec, tmp_path)) == 1
    # A name that would be a pattern itself stands for the folder.
    for folder, spec in {"x": "x/*.tif", "cam[1]": "cam[1]", "{a,b}": "{a,b}"}.items():
        with create_sequence(tmp_path / folder, **{**options, "format": "tiff"}) as writer:
            writer.append(np.zeros(SIZE[::-1], np.uint8))
        assert writer.spec == spec
        assert len(open_sequence(writer.spec, tmp_path)) == 1


@pytest.mark.parametrize("format", SEQUENCE_FORMATS)
def test_nothing_stands_under_its_name_before_the_end(tmp_path: Path, format: str) -> None:
    writer = writer_in(tmp_path, format)
    for frame in frames_of(12):
        writer.append(frame)
        assert [p.name for p in tmp_path.iterdir() if not p.name.startswith(".")] == []
        with pytest.raises(SequenceError):
            open_sequence(tmp_path)
    writer.close()
    writer.close()
    assert [p.name for p in tmp_path.iterdir() if p.name.startswith(".")] == []
    with pytest.raises(ValueError, match="is closed"):
        writer.append(frames_of(12)[0])


@pytest.mark.parametrize("format", SEQUENCE_FORMATS)
@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt])
def test_an_exception_leaves_nothing(
    tmp_path: Path, format: str, error: type[BaseException]
) -> None:
    def one_frame(stop: BaseException | None) -> None:
        with writer_in(tmp_path, format) as writer:
            writer.append(frames_of(12)[0])
            if stop is not None:
                raise stop

    with pytest.raises(error, match="stop"):
        one_frame(error("stop"))
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(ValueError, match="1 of 3 frames came; what was written"):
        one_frame(None)
    assert list(tmp_path.iterdir()) == []


def test_frames_are_checked_and_the_sequence_may_go_on(tmp_path: Path) -> None:
    good = frames_of(12)
    with writer_in(tmp_path) as writer:
        for wrong, message in [
            (good[0].T, r"expected \(20, 30\) of uint8 or uint16, got \(30, 20\) of uint16"),
            (good[0].astype(float), "got .* of float64"),
            (good, "expected"),
            (np.full(SIZE[::-1], 4096, np.uint16), "values up to 4095, got 4096 in frame 1"),
        ]:
            with pytest.raises(ValueError, match=message):
                writer.append(wrong)
        writer.append(good[0])
        writer.append((good[1] >> 4).astype(np.uint8))  # fewer bits than there is room for
        writer.append(np.asfortranarray(good[2]))
        with pytest.raises(ValueError, match="all 3 frames have come already"):
            writer.append(good[0])
    source = open_sequence(writer.spec, tmp_path)
    np.testing.assert_array_equal(source.read(1), good[1] >> 4)
    np.testing.assert_array_equal(source.read(2), good[2])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": "avi"}, "format: expected one of mraw, tiff, png, got 'avi'"),
        ({"image_size_px": (0, 20)}, "image_size_px"),
        ({"num_frames": 0}, "num_frames: expected at least 1, got 0"),
        ({"bit_depth": 7}, "bit_depth: expected 8 to 16, got 7"),
        ({"bit_depth": 17}, "bit_depth"),
        ({"frame_rate_hz": 0.0}, "frame_rate_hz"),
        ({"frame_rate_hz": float("nan")}, "frame_rate_hz"),
        ({"exposure_s": -1.0}, "exposure_s"),
        ({"camera_name": "a\nb"}, "camera_name: expected printable"),
        ({"image_size_px": (31, 21)}, "even number of pixels for packed 12 bit, got 31x21"),
    ],
)
def test_wrong_arguments(tmp_path: Path, changes: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        writer_in(tmp_path, **changes)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("format", SEQUENCE_FORMATS)
def test_what_is_there_is_not_overwritten(tmp_path: Path, format: str) -> None:
    write(tmp_path, format)
    before = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
    with pytest.raises(FileExistsError, match="is there already: choose another name"):
        writer_in(tmp_path, format)
    assert {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()} == before


@pytest.mark.parametrize("format", SEQUENCE_FORMATS)
def test_somebody_who_was_quicker_keeps_the_name(tmp_path: Path, format: str) -> None:
    writer = writer_in(tmp_path, format)
    for frame in frames_of(12):
        writer.append(frame)
    writer.path.write_bytes(b"theirs")
    with pytest.raises(FileExistsError):
        writer.close()
    assert [p.read_bytes() for p in tmp_path.iterdir()] == [b"theirs"]


def test_the_folder_must_be_there(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="there is no folder"):
        writer_in(tmp_path / "no")
    (tmp_path / "file").touch()
    with pytest.raises(NotADirectoryError, match="is no folder"):
        writer_in(tmp_path / "file")


@pytest.mark.parametrize("format", SEQUENCE_FORMATS)
def test_too_little_space_is_said_before_the_work(
    tmp_path: Path, format: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(parts, "free_bytes", lambda target: 2_000_000)
    with pytest.raises(SequenceError, match=r"needs 1\d\.\d GB, and .* has 2\.0 MB free; make"):
        writer_in(tmp_path, format, image_size_px=(1024, 1024), num_frames=8000, bit_depth=12)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("format", SEQUENCE_FORMATS)
def test_needed_bytes_are_enough(tmp_path: Path, format: str) -> None:
    writer = writer_in(tmp_path, format)
    with writer:
        for frame in frames_of(12):
            writer.append(frame)
    sizes = [p.stat().st_size for p in tmp_path.rglob("*") if p.is_file()]
    assert sum(sizes) <= writer.needed_bytes
    if format == "mraw":
        assert sum(sizes) == writer.needed_bytes


_WRITE = """
import resource, sys
import numpy as np
from videogrammetry.errors import SequenceError
from videogrammetry.sequence import create_sequence
format, folder, limit = sys.argv[1], sys.argv[2], int(sys.argv[3])
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
try:
    with create_sequence(
        folder + "/cam1", format=format, image_size_px=(200, 200), num_frames=5, bit_depth=12
    ) as writer:
        random = np.random.default_rng(1)
        for i in range(5):
            writer.append(random.integers(0, 4096, (200, 200)).astype(np.uint16))
            print(i)
except SequenceError as error:
    print(error)
    sys.exit(3)
"""


@pytest.mark.parametrize(
    ("format", "limit", "frames"),
    # 60000 bytes a packed frame: the third fails, or the fifth; 80000 a TIFF.
    [("mraw", 150_000, 2), ("mraw", 299_999, 4), ("mraw", 100, 0), ("tiff", 50_000, 0)],
)
def test_a_file_size_limit_met_midway(tmp_path: Path, format: str, limit: int, frames: int) -> None:
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(_WRITE), format, str(tmp_path), str(limit)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 3, done.stderr
    lines = done.stdout.splitlines()
    assert lines[:-1] == [str(i) for i in range(frames)]
    for part in ("cam1", "no file may be that large", "it needs", "free now", "has been removed"):
        assert part in lines[-1]
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("format", SEQUENCE_FORMATS)
def test_a_small_disk_refuses_early_and_a_full_one_leaves_nothing(
    small_disk: Path, format: str
) -> None:
    with pytest.raises(SequenceError, match=r"does not fit: it needs .* has 1\.0 MB free"):
        writer_in(small_disk, format, image_size_px=(500, 500))
    writer = writer_in(small_disk, format, image_size_px=(300, 300))
    random = np.random.default_rng(1)
    frame = random.integers(0, 4096, (300, 300)).astype(np.uint16)
    writer.append(frame)
    (small_disk / "other").write_bytes(bytes(os.statvfs(small_disk).f_bavail * 4096 - 8192))

    def two_more() -> None:
        writer.append(frame)
        writer.append(frame)
        writer.close()

    with pytest.raises(SequenceError, match=r"disk .* is full; it needs .* free now"):
        two_more()
    assert [p.name for p in small_disk.iterdir()] == ["other"]


def test_memory_is_that_of_a_frame(tmp_path: Path) -> None:
    """100 frames of 2 MB are written; the process grows by far less than they are."""
    frame = np.zeros((1024, 1024), np.uint16)
    options = {"image_size_px": (1024, 1024), "num_frames": 100}
    with writer_in(tmp_path, **options) as writer:
        writer.append(frame)
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        for _ in range(99):
            writer.append(frame)
        grown_mb = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    assert grown_mb < 20
