"""Videos: every frame under its number whatever the codec; rate; damage; colour."""

from __future__ import annotations

import shutil
import sys
import warnings
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from videogrammetry.cli.main import main
from videogrammetry.errors import SequenceError, SequenceWarning
from videogrammetry.sequence import open_sequence

av = pytest.importorskip("av")

SHAPE = (64, 96)
COUNT = 40
#: What a codec with loss may change at a marker of 8 px by: its number stays readable.
BLOCK = 16


def numbered(index: int, shape: tuple[int, int] = SHAPE) -> npt.NDArray[np.uint8]:
    """A picture that bears its number: eight black or white blocks are its bits."""
    frame = np.full(shape, 128, np.uint8)
    for bit in range(8):
        row, column = divmod(bit, 4)
        value = 220 if index >> bit & 1 else 30
        frame[row * BLOCK : (row + 1) * BLOCK, column * BLOCK : (column + 1) * BLOCK] = value
    return frame


def number_of(frame: npt.NDArray[np.generic]) -> int:
    largest = 220 / 255 * (255 if frame.dtype == np.uint8 else 65535)
    middle = [
        frame[row * BLOCK + 4 : row * BLOCK + 12, col * BLOCK + 4 : col * BLOCK + 12].mean()
        for row in range(2)
        for col in range(4)
    ]
    return sum(1 << bit for bit, value in enumerate(middle) if value > largest / 2)


def write_video(
    path: Path,
    codec: str,
    pix_fmt: str,
    *,
    frames: list[npt.NDArray[np.uint8]] | None = None,
    options: dict[str, str] | None = None,
    stamps: list[int] | None = None,
    rate: int = 50,
) -> Path:
    frames = frames or [numbered(i) for i in range(COUNT)]
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=rate, options=options or {})
        stream.height, stream.width = frames[0].shape[:2]
        stream.pix_fmt = pix_fmt
        if stamps is not None:
            stream.codec_context.time_base = Fraction(1, 1000)
        for i, picture in enumerate(frames):
            kind = "gray" if picture.ndim == 2 else "rgb24"
            frame = av.VideoFrame.from_ndarray(picture, format=kind)
            if stamps is not None:
                frame.pts, frame.time_base = stamps[i], Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


CODECS = [
    ("a.avi", "rawvideo", "gray", {}),
    ("a.avi", "ffv1", "gray", {}),
    ("a.avi", "mjpeg", "yuvj420p", {}),
    ("a.avi", "mpeg4", "yuv420p", {"g": "12"}),
    ("a.avi", "libx264", "yuv420p", {"g": "12", "bf": "3"}),
    ("a.mp4", "mpeg4", "yuv420p", {"g": "12", "bf": "2"}),
    ("a.mp4", "libx264", "yuv420p", {"g": "12", "bf": "3"}),
    ("a.mp4", "libx264", "yuv420p", {"g": "250", "bf": "3", "x264-params": "open-gop=1"}),
    ("a.mp4", "libx265", "yuv420p", {"x265-params": "keyint=12:bframes=3:log-level=none"}),
    ("a.mov", "libx264", "yuv444p", {"g": "12", "bf": "3"}),
    ("a.mkv", "libx264", "yuv420p", {"g": "12", "bf": "3"}),
    ("a.mkv", "ffv1", "gray16le", {}),
    ("a.mkv", "libvpx-vp9", "yuv420p", {"g": "12", "auto-alt-ref": "1", "lag-in-frames": "16"}),
]


@pytest.mark.parametrize(("name", "codec", "pix_fmt", "options"), CODECS)
def test_every_frame_is_found_from_everywhere(tmp_path, name, codec, pix_fmt, options):
    if codec not in av.codecs_available:
        pytest.skip(f"this FFmpeg has no {codec}")
    source = open_sequence(write_video(tmp_path / name, codec, pix_fmt, options=options))
    assert len(source) == COUNT
    assert not source.remarks
    assert source.frame_rate_hz == pytest.approx(50.0, rel=1e-9)
    order = [*range(COUNT), *np.random.default_rng(1).permutation(COUNT), COUNT - 1, 0]
    wrong = [int(i) for i in order if number_of(source.read(int(i))) != i]
    assert not wrong
    assert source.name(3) == f"{name}#4"


@pytest.mark.parametrize(("name", "codec"), [("a.avi", "rawvideo"), ("a.mkv", "ffv1")])
def test_grey_without_loss_is_exact(tmp_path, name, codec):
    rng = np.random.default_rng(2)
    frames = [rng.integers(0, 256, (50, 70)).astype(np.uint8) for _ in range(5)]
    source = open_sequence(write_video(tmp_path / name, codec, "gray", frames=frames))
    for i, frame in enumerate(frames):
        np.testing.assert_array_equal(source.read(i), frame)
    assert source.image_size_px == (70, 50)
    assert source.bit_depth == 8
    assert not source.remarks


def test_colour_is_its_luminance(tmp_path):
    rng = np.random.default_rng(3)
    frames = [rng.integers(0, 256, (50, 70, 3)).astype(np.uint8) for _ in range(2)]
    source = open_sequence(write_video(tmp_path / "a.avi", "rawvideo", "bgr24", frames=frames))
    wanted = frames[1] @ np.array([0.299, 0.587, 0.114])
    np.testing.assert_allclose(source.read(1), wanted, rtol=0, atol=0.51)


def test_many_threads_read_at_once(tmp_path):
    path = write_video(tmp_path / "a.mp4", "libx264", "yuv420p", options={"g": "10", "bf": "2"})
    source = open_sequence(path)
    wanted = [int(i) for i in np.random.default_rng(4).integers(0, COUNT, 60)]
    with ThreadPoolExecutor(4) as pool:
        assert [number_of(f) for f in pool.map(source.read, wanted)] == wanted


def test_a_variable_frame_rate_is_said_and_no_rate_is_taken(tmp_path):
    stamps = np.cumsum(np.where(np.arange(COUNT) % 3, 20, 45)).tolist()
    path = write_video(tmp_path / "a.mkv", "libx264", "yuv420p", stamps=stamps, rate=1000)
    with pytest.warns(SequenceWarning, match=r"variable frame rate: .*0\.02 to 0\.045 s apart"):
        source = open_sequence(path)
    assert source.frame_rate_hz is None
    # Matroska's ticks are milliseconds, as these stamps are.
    np.testing.assert_allclose(source.times_s(), (np.array(stamps) - stamps[0]) / 1000, atol=1e-9)
    assert [number_of(source.read(i)) for i in (17, 3, 39)] == [17, 3, 39]


def test_rates_that_ticks_round_are_constant(tmp_path):
    source = open_sequence(write_video(tmp_path / "a.mkv", "ffv1", "gray", rate=30))
    assert source.frame_rate_hz == pytest.approx(30.0, rel=1e-9)


@pytest.mark.parametrize("part", [0.3, 0.6, 0.9])
@pytest.mark.parametrize(("name", "codec"), [("a.avi", "rawvideo"), ("a.mkv", "ffv1")])
def test_of_a_video_cut_short_the_whole_frames_are_read(tmp_path, name, codec, part):
    path = write_video(tmp_path / name, codec, "gray")
    data = path.read_bytes()
    path.write_bytes(data[: int(part * len(data))])
    with pytest.warns(SequenceWarning, match="are whole"):
        source = open_sequence(path)
    assert 0 < len(source) < COUNT
    assert [number_of(source.read(i)) for i in range(len(source))] == list(range(len(source)))


def test_an_mp4_that_was_never_finished_is_refused(tmp_path):
    path = write_video(tmp_path / "a.mp4", "libx264", "yuv420p")
    path.write_bytes(path.read_bytes()[:-1500])
    with pytest.raises(SequenceError, match=r"a\.mp4: .*never finished"):
        open_sequence(path)


def test_damage_within_is_an_error_and_never_a_wrong_frame(tmp_path):
    options = {"slicecrc": "1", "level": "3", "g": "1"}
    path = write_video(tmp_path / "a.mkv", "ffv1", "gray", options=options)
    whole = path.read_bytes()
    rng = np.random.default_rng(5)
    for _ in range(10):
        data = bytearray(whole)
        at = int(rng.integers(len(data) // 3, len(data) * 2 // 3))
        data[at] ^= 0xFF
        path.write_bytes(data)
        with warnings.catch_warnings(action="ignore", category=SequenceWarning):
            source = open_sequence(path)
        failed = 0
        for i in range(len(source)):
            try:
                frame = source.read(i)
            except SequenceError:
                failed += 1
            else:
                np.testing.assert_array_equal(frame, numbered(number_of(frame)))
        assert failed + (COUNT - len(source)) <= 2


def test_missing_frames_are_said_with_their_place(tmp_path):
    stamps = [20 * i for i in range(COUNT + 2) if i not in (11, 12)]
    path = write_video(tmp_path / "a.mkv", "libx264", "yuv420p", stamps=stamps, rate=1000)
    with pytest.warns(SequenceWarning, match="2 frames are missing, the first after frame 11:"):
        open_sequence(path)


def test_bytes_that_are_no_video_and_sound_alone(tmp_path):
    path = tmp_path / "a.mp4"
    path.write_bytes(np.random.default_rng(6).bytes(5000))
    with pytest.raises(SequenceError, match="not a video"):
        open_sequence(path)
    sound = tmp_path / "b.mkv"
    with av.open(str(sound), "w") as container:
        stream = container.add_stream("pcm_s16le", rate=8000)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 800), np.int16), "s16", "mono")
        frame.sample_rate = 8000
        container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    with pytest.raises(SequenceError, match="no video in it"):
        open_sequence(sound)


def test_without_pyav_it_is_said_how_to_get_it(tmp_path, monkeypatch):
    path = write_video(tmp_path / "a.avi", "rawvideo", "gray")
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(SequenceError, match=r"pip install 'videogrammetry\[video\]'"):
        open_sequence(path)


def test_a_film_beside_pictures_is_passed_over_in_a_folder(tmp_path, capsys):
    from videogrammetry.sequence import create_sequence

    with create_sequence(
        tmp_path / "cam", format="png", image_size_px=(96, 64), num_frames=2, bit_depth=8
    ) as writer:
        for i in range(2):
            writer.append(numbered(i))
    film = write_video(tmp_path / "film.avi", "rawvideo", "gray")
    shutil.copy(film, tmp_path / "cam" / "film.avi")
    assert len(open_sequence(tmp_path / "cam")) == 2
    assert len(open_sequence(tmp_path / "cam" / "*.avi")) == COUNT
    assert main(["info", str(film)]) == 0
    assert "40 frames, 96x64 px, 8 bit, 50 Hz" in capsys.readouterr().out
