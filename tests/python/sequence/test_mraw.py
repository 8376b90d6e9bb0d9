"""Photron recordings: samples as pyMRAW reads them; whatever is wrong is said."""

from __future__ import annotations

import shutil
import warnings
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from mraw_recordings import FRAMES12, RNG, SIZE, recording, text_recording

from videogrammetry.cli.main import main
from videogrammetry.errors import SequenceWarning
from videogrammetry.sequence import create_sequence, open_sequence
from videogrammetry.sequence.mraw import looks_low_first
from videogrammetry.sequence.packing import pack_12bit


@pytest.mark.data
@pytest.mark.peer
@pytest.mark.parametrize("name", ["beam.cihx", "data_showcase.cih"])
def test_real_recordings_are_read_as_pymraw_does(data: Path, name: str) -> None:
    pymraw = pytest.importorskip("pyMRAW")
    path = data / "high-speed" / name
    expected, header = pymraw.load_video(str(path))
    for opened in (path, path.with_suffix(".mraw")):
        source = open_sequence(opened)
        assert len(source) == len(expected) == header["Total Frame"]
        for i, frame in enumerate(expected):
            assert source.read(i).dtype == frame.dtype
            np.testing.assert_array_equal(source.read(i), frame)


@pytest.mark.data
def test_real_headers_say_when_how_fast_and_how_long(
    data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    beam = open_sequence(data / "high-speed/beam.cihx")
    assert beam.image_size_px == (1024, 80)
    assert (beam.frame_rate_hz, beam.exposure_s, beam.bit_depth) == (50000.0, 5e-6, 12)
    assert beam.save_step == 2500
    assert [beam.name(i) for i in (0, 3)] == ["beam.cihx#1", "beam.cihx#4"]
    assert [p.name for p in beam.paths] == ["beam.cihx", "beam.mraw"]
    assert beam.file(2).name == "beam.cihx"
    assert beam.files(2) == beam.paths
    showcase = open_sequence(data / "high-speed/data_showcase.mraw")
    # The upper 8 of 12 bits are stored.
    assert (showcase.frame_rate_hz, showcase.exposure_s) == (15000.0, 65.060e-6)
    assert (showcase.bit_depth, showcase.image_size_px) == (8, (640, 40))
    assert main(["info", str(data / "high-speed/beam.mraw")]) == 0
    text = capsys.readouterr().out
    for part in (
        "4 frames, 1024x80 px, 12 bit, 50000 Hz, exposure 5 us",
        "Camera No.1, FASTCAM SA-Z type 2100K-M-64GB, 2017-07-13 13:13, recorded at 50000 Hz, "
        "header: 1 in 2500 frames saved",
        "beam.cihx#1 to beam.cihx#4",
    ):
        assert part in text


@pytest.mark.peer
@pytest.mark.parametrize("bit_depth", [8, 10, 12, 16])
def test_pymraw_reads_what_we_write(tmp_path: Path, bit_depth: int) -> None:
    pymraw = pytest.importorskip("pyMRAW")
    largest = 2**bit_depth - 1
    frames = RNG.integers(0, largest, (4, *SIZE[::-1]), endpoint=True).astype(np.uint16)
    frames[0, 0, :2] = 0, largest
    with create_sequence(
        tmp_path / "run",
        format="mraw",
        image_size_px=SIZE,
        num_frames=4,
        bit_depth=bit_depth,
        frame_rate_hz=12500,
        exposure_s=1 / 50000,
        camera_name="left & low",
        date=datetime(2024, 2, 29, 23, 5),
    ) as writer:
        for frame in frames:
            writer.append(frame)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # "Not 12bit image!"
        images, header = pymraw.load_video(str(tmp_path / "run.cihx"))
    np.testing.assert_array_equal(images, frames)
    assert header["Color Bit"] == {8: 8, 10: 16, 12: 12, 16: 16}[bit_depth]
    assert header["EffectiveBit Depth"] == bit_depth
    assert (header["Record Rate(fps)"], header["Shutter Speed(s)"]) == (12500.0, 50000.0)
    assert header["Date"] == "2024/2/29"


@pytest.mark.peer
@pytest.mark.parametrize("bit_depth", [8, 16])
def test_we_read_what_pymraw_writes(tmp_path: Path, bit_depth: int) -> None:
    pymraw = pytest.importorskip("pyMRAW")
    frames = FRAMES12 if bit_depth == 16 else FRAMES12 >> 4
    pymraw.save_mraw(
        frames, str(tmp_path / "a.cih"), bit_depth, info_dict={"Record Rate(fps)": "250"}
    )
    source = open_sequence(tmp_path / "a.mraw")
    assert (len(source), source.frame_rate_hz, source.exposure_s) == (5, 250.0, 1.0)
    np.testing.assert_array_equal([source.read(i) for i in range(5)], frames)


def test_upper_bits_are_shifted_down_where_more_are_stored(tmp_path: Path) -> None:
    """12 of 16 bit "Higher" stand sixteenfold; stored in 8 bit they are the upper ones as is."""
    path = text_recording(tmp_path, ("Side : Lower", "Side : Higher"))
    (tmp_path / "old.mraw").write_bytes((FRAMES12 << 4).astype("<u2").tobytes())
    source = open_sequence(path)
    np.testing.assert_array_equal(source.read(3), FRAMES12[3])
    assert source.bit_depth == 12
    path = text_recording(
        tmp_path, ("Side : Lower", "Side : Higher"), ("Color Bit : 16", "Color Bit : 8")
    )
    upper = (FRAMES12 >> 4).astype(np.uint8)
    (tmp_path / "old.mraw").write_bytes(upper.tobytes())
    source = open_sequence(path)
    np.testing.assert_array_equal(source.read(3), upper[3])
    assert (source.bit_depth, source.read(3).dtype) == (8, np.uint8)
    path = text_recording(
        tmp_path,
        ("Side : Lower", "Side : Higher"),
        ("Color Bit : 16", "Color Bit : 12"),
        ("Depth : 12", "Depth : 10"),
    )
    (tmp_path / "old.mraw").write_bytes(b"".join(pack_12bit(f).tobytes() for f in FRAMES12))
    source = open_sequence(path)
    np.testing.assert_array_equal(source.read(3), FRAMES12[3] >> 2)
    assert source.bit_depth == 10


@pytest.mark.parametrize(
    ("changes", "rate", "exposure"),
    [
        ((), 2000.0, 1 / 4000),
        ((("Save Step : 1", "Save Step : 8"),), 2000.0, 1 / 4000),
        ((("Shutter Speed(s) : 1/4000", "Shutter Type2(nsec) : 2500"),), 2000.0, 2.5e-6),
        ((("Shutter Speed(s) : 1/4000", "Shutter Speed(s) : 0.002"),), 2000.0, 0.002),
        ((("Record Rate(fps) : 2000\nShutter Speed(s) : 1/4000\n", ""),), None, None),
        ((("(fps) : 2000", "(fps) : 0"),), None, 1 / 4000),
    ],
)
def test_text_headers(tmp_path: Path, changes, rate, exposure) -> None:
    source = open_sequence(text_recording(tmp_path, *changes))
    assert (source.frame_rate_hz, source.exposure_s) == (rate, exposure)
    assert source.image_size_px == SIZE
    assert source.sources[0].date == datetime(2020, 2, 3, 4, 5)
    assert source.sources[0].camera_name == "FASTCAM"
    np.testing.assert_array_equal([source.read(i) for i in range(5)], FRAMES12)


def test_frames_of_8_and_16_bit_are_not_copied(tmp_path: Path) -> None:
    for bits in (8, 16):
        source = open_sequence(recording(tmp_path, f"run{bits}", bit_depth=bits))
        frame = source.read(2)
        assert not frame.flags.owndata
        assert not frame.flags.writeable
        assert frame.flags.c_contiguous
        assert type(frame) is np.ndarray
        assert np.shares_memory(frame, source.read(2))


def test_many_threads_read_at_once(tmp_path: Path) -> None:
    source = open_sequence(recording(tmp_path))
    with ThreadPoolExecutor(8) as pool:
        for i, frame in enumerate(pool.map(source.read, [k % 5 for k in range(200)])):
            np.testing.assert_array_equal(frame, FRAMES12[i % 5])


def test_a_recording_is_taken_once(tmp_path: Path) -> None:
    path = recording(tmp_path)
    shutil.copy(path, tmp_path / "copy.cihx")
    shutil.copy(path.with_suffix(".mraw"), tmp_path / "copy.MRAW")
    for spec in (tmp_path, "*", "*.{mraw,MRAW,cihx}", ["copy.MRAW", "run.mraw"]):
        source = open_sequence(spec, tmp_path)
        assert len(source) == 10
        assert {p.stem for p in source.paths} == {"copy", "run"}
        assert len(source.paths) == 4
    # Both kinds of header, as some programs write them: one recording.
    text_recording(tmp_path)
    (tmp_path / "old.mraw").rename(tmp_path / "b.mraw")
    (tmp_path / "old.cih").rename(tmp_path / "b.cih")
    shutil.copy(path, tmp_path / "b.cihx")
    shutil.copy(path.with_suffix(".mraw"), tmp_path / "b.mraw")
    assert open_sequence(tmp_path / "b.mraw").paths[0].name == "b.cihx"
    assert len(open_sequence("b*", tmp_path)) == 5


def smooth_12bit() -> npt.NDArray[np.uint16]:
    """A slope with noise of a few grey values, as a picture has."""
    slope = 100 + 60 * np.arange(32)[None, :] + 20 * np.arange(20)[:, None]
    return (slope + RNG.normal(0, 8, (20, 32))).astype(np.uint16)


@pytest.mark.parametrize("high_first", [True, False])
def test_packed_samples_in_both_orders(tmp_path: Path, high_first: bool) -> None:
    path = recording(tmp_path)
    frames = [smooth_12bit() for _ in range(5)]
    packed = [pack_12bit(f.reshape(-1), high_first=high_first).tobytes() for f in frames]
    path.with_suffix(".mraw").write_bytes(b"".join(packed))
    if high_first:
        source = open_sequence(path)
    else:
        with pytest.warns(SequenceWarning, match="lowest bits first"):
            source = open_sequence(path)
    for k, frame in enumerate(frames):
        np.testing.assert_array_equal(source.read(k), frame)
    packed_picture = source.packed(2)
    assert packed_picture is not None
    assert packed_picture.order == ("high-first" if high_first else "low-first")


def test_the_usual_order_is_never_taken_for_the_other() -> None:
    """Dots on slopes, from black to saturated, with no noise to much."""
    y, x = np.mgrid[:48, :64]
    missed = 0
    for seed in range(300):
        rng = np.random.default_rng(seed)
        light, noise = rng.choice([0, 64, 1000, 3800]), rng.choice([0, 0.5, 10, 150])
        frame = light + noise * rng.normal(size=x.shape) + rng.choice([0, 1, 5]) * x
        for _ in range(rng.integers(1, 6)):
            far = np.hypot(x - rng.uniform(0, 64), y - rng.uniform(0, 48))
            frame += rng.choice([60, 500, 2000]) / (1 + np.exp((far - rng.uniform(3, 9)) / 0.7))
        samples = np.clip(frame, 0, 4095).astype(np.uint16).reshape(-1)
        assert not looks_low_first(pack_12bit(samples), (64, 48)), f"seed {seed}"
        missed += not looks_low_first(pack_12bit(samples, high_first=False), (64, 48))
    # Frames that are even but for a dot may look alike both ways, and stay as is usual.
    assert missed <= 6


def test_start_frame_and_partition_are_read(tmp_path: Path) -> None:
    path = text_recording(
        tmp_path, ("Save Step : 1", "Start Frame : -120\nPartition Number: 2\nSave Step : 1")
    )
    source = open_sequence(path)
    assert source.first_frame == -120
    assert source.sources[0].header.partition == 2


@pytest.mark.parametrize("encoding", ["utf-8-sig", "cp932", "utf-16"])
def test_headers_of_japanese_computers(tmp_path: Path, encoding: str) -> None:
    path = text_recording(tmp_path, ("Save Step : 1", "Comment Text : 落下試験\nSave Step : 1"))
    path.write_bytes(path.read_text().encode(encoding))
    assert len(open_sequence(path)) == 5
