"""Damaged, cut and wrong Photron recordings: named, and never half a frame."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mraw_recordings import FRAMES12, SIZE, UTF8, edit, recording, text_recording

from videogrammetry.errors import SequenceError, SequenceWarning
from videogrammetry.sequence import create_sequence, open_sequence


def test_a_header_beside_pictures_is_passed_over(tmp_path: Path) -> None:
    with create_sequence(
        tmp_path / "run", format="tiff", image_size_px=SIZE, num_frames=1, bit_depth=12
    ) as writer:
        writer.append(FRAMES12[0])
    text_recording(tmp_path, ("Format : MRaw", "Format : Tiff")).rename(tmp_path / "run/x.cih")
    assert len(open_sequence(tmp_path / "run")) == 1
    with pytest.raises(SequenceError, match=r"saved as Tiff, not as MRaw; open those pictures"):
        open_sequence(tmp_path / "run/x.cih")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("Image Width : 32\n", "", "does not state 'Image Width'"),
        ("Width : 32", "Width : 0", r"'Image Width|Image Width = '0', expected a whole number"),
        ("Width : 32", "Width : -5", r"Image Width = '-5'"),
        ("Width : 32", "Width : 1e3", r"Image Width = '1e3'"),
        ("Height : 20", "Height : 99999999", r"Image Height = '99999999'.* to 65536"),
        ("Frame : 5", "Frame : 0", r"Total Frame = '0'"),
        ("Color Bit : 16", "Color Bit : 10", "samples of 10 bit are not read here; save"),
        ("Type : Mono", "Type : Color", r"in colour \(Color, 16 bit\).*monochrome"),
        ("Type : Mono", "Type : Bayer", "in colour"),
        ("Side : Lower", "Side : Left", "EffectiveBit Side = 'Left', expected Lower or Higher"),
        ("Depth : 12", "Depth : 40", "EffectiveBit Depth = '40'"),
        ("(fps) : 2000", "(fps) : fast", "Record Rate.*'fast', expected a number"),
        ("(fps) : 2000", "(fps) : -1", "Record Rate.*'-1'"),
        ("(fps) : 2000", "(fps) : nan", "Record Rate.*'nan'"),
        ("1/4000", "1/0", "Shutter Speed.*'1/0', expected seconds"),
        ("1/4000", "-2", "Shutter Speed.*'-2', expected an exposure"),
        ("Step : 1", "Step : x", "Save Step = 'x'"),
        ("Frame : 5", "Frame : 4", r"6400 bytes, but 4 frames .* are 5120: .*different"),
    ],
)
def test_wrong_headers_say_what_and_where(tmp_path: Path, old, new, message) -> None:
    path = text_recording(tmp_path, (old, new))
    with pytest.raises(SequenceError, match=message) as caught:
        open_sequence(path)
    assert str(tmp_path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_halves_are_named(tmp_path: Path) -> None:
    path = recording(tmp_path)
    samples = path.with_suffix(".mraw")
    kept = path.read_bytes()
    path.unlink()
    with pytest.raises(SequenceError, match=r"run\.mraw: its header is missing.*run\.cihx or"):
        open_sequence(samples)
    path.write_bytes(b"")
    for file in (samples, path):
        with pytest.raises(SequenceError, match=r"run\.cihx: the file is empty"):
            open_sequence(file)
    path.write_bytes(kept)
    samples.unlink()
    with pytest.raises(SequenceError, match=r"frames are missing: there is no run\.mraw"):
        open_sequence(path)


def test_a_header_cut_anywhere_is_an_error_or_still_whole(tmp_path: Path) -> None:
    path = recording(tmp_path)
    whole = path.read_bytes()
    errors = 0
    for length in range(len(whole)):
        path.write_bytes(whole[:length])
        try:
            source = open_sequence(path)
        except SequenceError as error:
            assert "run.cihx" in str(error)
            errors += 1
        else:  # only what follows </cih> may be gone
            np.testing.assert_array_equal(source.read(4), FRAMES12[4])
    assert errors >= len(whole) - 2


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("<width>", "<wi&th>", "XML of the Photron header is damaged"),
        ("</frameInfo>", "", "XML of the Photron header is damaged"),
        ("<cih>", "<cix>", "no Photron header, or cut short"),
        ("<totalFrame>5", "<totalFrame>five", "Total Frame = 'five'"),
    ],
)
def test_damaged_xml(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = recording(tmp_path)
    edit(path, old, new)
    with pytest.raises(SequenceError, match=message):
        open_sequence(path)


def test_of_a_recording_cut_anywhere_the_whole_frames_are_read(tmp_path: Path) -> None:
    path = recording(tmp_path)
    samples = path.with_suffix(".mraw")
    whole = samples.read_bytes()
    frame = 20 * 32 * 3 // 2
    for length in [*range(frame, 5 * frame, frame), 5 * frame - 1]:
        samples.write_bytes(whole[:length])
        count = length // frame
        with pytest.warns(SequenceWarning, match=f"cut short: {count} whole frames .*are used"):
            source = open_sequence(path)
        assert len(source) == count
        np.testing.assert_array_equal(source.read(count - 1), FRAMES12[count - 1])
        assert len(source.remarks) == 1
    for length in range(1, frame, 37):
        samples.write_bytes(whole[:length])
        with pytest.raises(SequenceError, match="cut short: 0 whole frames"):
            open_sequence(path)
    samples.write_bytes(b"")
    with pytest.raises(SequenceError, match=r"run\.mraw: .*0 whole frames|empty"):
        open_sequence(path)


def test_a_file_that_shrinks_while_it_is_read_is_an_error_and_no_crash(tmp_path: Path) -> None:
    path = recording(tmp_path)
    samples = path.with_suffix(".mraw")
    source = open_sequence(path)
    frame = 20 * 32 * 3 // 2
    os.truncate(samples, 2 * frame)
    np.testing.assert_array_equal(source.read(1), FRAMES12[1])
    with pytest.raises(SequenceError, match=r"frame 3 .* has 1920 \(it had 4800"):
        source.read(2)
    assert source.packed(0) is not None
    with pytest.raises(SequenceError, match="frame 5"):
        source.packed(4)


def test_a_name_that_is_no_text(tmp_path: Path) -> None:
    folder = tmp_path / os.fsdecode(b"caf\xe9")
    try:
        folder.mkdir()
    except OSError:
        pytest.skip("this file system takes text alone")
    path = recording(folder)
    np.testing.assert_array_equal(open_sequence(folder).read(0), FRAMES12[0])
    run = [sys.executable, "-m", "videogrammetry", "info", str(path)]
    done = subprocess.run(run, capture_output=True, check=False, env={**os.environ, **UTF8})
    assert done.returncode == 0, done.stderr
    path.with_suffix(".mraw").unlink()
    with pytest.raises(SequenceError, match="frames are missing"):
        open_sequence(path)
    done = subprocess.run(run, capture_output=True, check=False, env={**os.environ, **UTF8})
    assert done.returncode == 1
    assert b"frames are missing" in done.stderr
    assert b"Traceback" not in done.stderr


def test_bytes_that_are_no_header(tmp_path: Path) -> None:
    recording(tmp_path)
    random = np.random.default_rng(5)
    for name in ("run.cihx", "run.cih"):
        for size in (1, 10, 1000):
            (tmp_path / name).write_bytes(random.bytes(size))
            with pytest.raises(SequenceError, match=name):
                open_sequence(tmp_path / name)


def test_an_odd_frame_of_packed_samples_is_refused(tmp_path: Path) -> None:
    path = text_recording(
        tmp_path,
        ("Width : 32", "Width : 31"),
        ("Height : 20", "Height : 3"),
        ("Bit : 16", "Bit : 12"),
    )
    with pytest.raises(SequenceError, match="odd number of samples of 12 bit"):
        open_sequence(path)


def test_a_frame_that_is_not_there(tmp_path: Path) -> None:
    source = open_sequence(recording(tmp_path))
    for index in (-1, 5):
        with pytest.raises(IndexError, match="frames 0 to 4"):
            source.read(index)
