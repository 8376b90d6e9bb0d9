"""Phantom recordings: samples, orientation, headers, and files that are not whole."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from videogrammetry.errors import SequenceError, SequenceWarning
from videogrammetry.recognition import RecognitionOptions, recognize
from videogrammetry.sequence import open_sequence
from videogrammetry.sequence.cine import unpack_10bit
from videogrammetry.sequence.cine_table import LINEAR_12BIT
from videogrammetry.sequence.packing import pack_12bit

SETUP_BYTES = 1700


def write_cine(path, frames, bits, *, packing=0, first=-3, cfa=0, compression=0, height=None,
               times=None, old=False, note=8):  # fmt: skip
    """A cine file of samples that are already stored bytes, one array a frame.

    ``times``: (seconds since the trigger) of every frame; ``old``: version 0, places of four
    bytes; ``note``: bytes before a frame's samples.
    """
    shape = frames[0][1]
    blocks = b""
    if times is not None:
        ticks = [round(t * 2**32) + 1_700_000_000 * 2**32 + 2**31 for t in times]
        stamps = b"".join(struct.pack("<II", t & 0xFFFFFFFC, t >> 32) for t in ticks)
        blocks = struct.pack("<IHH", 12, 1001, 0) + bytes(4)  # a block that is passed over
        blocks += struct.pack("<IHH", 8 + len(stamps), 1002, 0) + stamps
    setup = bytearray(SETUP_BYTES)
    setup[140:142] = b"ST"
    for at, value in ((743, 4711), (768, 5000), (772, 100), (780, 50), (808, cfa), (896, bits),
                      (1568, 99_500)):  # fmt: skip
        struct.pack_into("<I", setup, at, value)
    struct.pack_into("<H", setup, 142, SETUP_BYTES)
    at_bitmap = 44
    at_setup = at_bitmap + 40
    at_offsets = at_setup + SETUP_BYTES + len(blocks)
    stored = 8 if bits <= 8 else 16
    data = bytearray(
        struct.pack("<2s3HiIiI3I2I", b"CI", 44, compression, 0 if old else 1, first, len(frames),
                    first, len(frames), at_bitmap, at_setup, at_offsets, 1 << 31, 1_700_000_000)
    )  # fmt: skip
    size = len(frames[0][0])
    data += struct.pack("<IiiHHIIiiII", 40, shape[1], height or shape[0], 1, stored, packing, size,
                        0, 0, 0, 0)  # fmt: skip
    data += setup + blocks
    place = at_offsets + (4 if old else 8) * len(frames)
    for samples, _ in frames:
        data += struct.pack("<I" if old else "<Q", place)
        place += note + len(samples)
    for samples, _ in frames:
        data += struct.pack("<I", note) + bytes(note - 8) + struct.pack("<I", len(samples))
        data += samples
    path.write_bytes(data)
    return path


def pictures(bits, count=3, shape=(24, 32)):
    rng = np.random.default_rng(bits)
    kind = np.uint8 if bits == 8 else np.uint16
    return [rng.integers(0, 2**bits, shape).astype(kind) for _ in range(count)]


def pack_10bit(samples):
    bits = np.unpackbits(samples.astype(">u2").view(np.uint8).reshape(-1, 2), axis=1)[:, 6:]
    return np.packbits(bits.reshape(-1)).tobytes()


@pytest.mark.parametrize("bits", [8, 16])
def test_plain_samples_stand_upright(tmp_path, bits):
    wanted = pictures(bits)
    path = write_cine(
        tmp_path / "a.cine", [(p[::-1].tobytes(), p.shape) for p in wanted], min(bits, 12)
    )
    source = open_sequence([path])
    for k, picture in enumerate(wanted):
        np.testing.assert_array_equal(source.read(k), picture)
    assert source.read(0).flags.c_contiguous


def test_a_negative_height_means_from_the_top_down(tmp_path):
    wanted = pictures(8, 1)[0]
    path = write_cine(tmp_path / "a.cine", [(wanted.tobytes(), wanted.shape)], 8, height=-24)
    frame = open_sequence([path]).read(0)
    np.testing.assert_array_equal(frame, wanted)
    assert not frame.flags.owndata  # and is a view of the mapped file


def test_packed_12_bit_is_read_and_recognised_where_it_stands(tmp_path):
    wanted = pictures(12)
    stored = [(pack_12bit(p.reshape(-1)).tobytes(), p.shape) for p in wanted]
    source = open_sequence([write_cine(tmp_path / "a.cine", stored, 12, packing=1024)])
    for k, picture in enumerate(wanted):
        np.testing.assert_array_equal(source.read(k), picture)
    packed = source.packed(1)
    assert packed is not None
    assert packed.shape == (24, 32)
    assert bytes(packed.data) == stored[1][0]
    recognize(source.read(0), RecognitionOptions(codes="none"))


def test_packed_10_bit_goes_through_the_cameras_table(tmp_path):
    wanted = pictures(10)
    stored = [(pack_10bit(p), p.shape) for p in wanted]
    source = open_sequence([write_cine(tmp_path / "a.cine", stored, 10, packing=256)])
    np.testing.assert_array_equal(source.read(2), LINEAR_12BIT[wanted[2]])
    assert source.bit_depth == 12
    np.testing.assert_array_equal(
        unpack_10bit(np.frombuffer(stored[0][0], np.uint8), (24, 32)), wanted[0]
    )


def test_the_table_rises_and_reaches_all_of_twelve_bits():
    assert len(LINEAR_12BIT) == 1024
    assert (np.diff(LINEAR_12BIT.astype(int)) >= 0).all()
    assert (LINEAR_12BIT[0], LINEAR_12BIT[-1]) == (2, 4095)


def test_rate_exposure_trigger_and_serial_come_out_of_the_file(tmp_path):
    picture = pictures(8, 1)[0]
    source = open_sequence([write_cine(tmp_path / "a.cine", [(picture.tobytes(), (24, 32))], 8)])
    assert source.frame_rate_hz == 5000.0
    assert source.exposure_s == pytest.approx(99.5e-6)
    assert "serial 4711" in source.origin
    assert "2023-11-14 22:13:20.500000" in source.origin
    assert "frames -3 to -3 from the trigger" in source.origin


def test_time_stamps_are_from_the_trigger(tmp_path):
    stored = [(p.tobytes(), p.shape) for p in pictures(8)]
    times = [-0.75, 0.0002, 3.25]
    source = open_sequence([write_cine(tmp_path / "a.cine", stored, 8, times=times)])
    # Stored in 2**-32 s, of which the two lowest bits are flags.
    np.testing.assert_allclose(source.times_s(), times, rtol=0, atol=4 * 2.0**-32)
    assert source.first_frame == -3
    without = open_sequence([write_cine(tmp_path / "b.cine", stored, 8)])
    assert without.times_s() is None


@pytest.mark.parametrize("note", [8, 9, 24])
def test_old_tables_and_notes_before_frames(tmp_path, note):
    wanted = pictures(16)
    stored = [(p.tobytes(), p.shape) for p in wanted]
    path = write_cine(tmp_path / "a.cine", stored, 16, height=-24, old=True, note=note)
    for k, picture in enumerate(wanted):
        frame = open_sequence([path]).read(k)
        np.testing.assert_array_equal(frame, picture)
        assert frame.flags.aligned


def test_of_a_file_cut_short_the_whole_frames_are_read(tmp_path):
    wanted = pictures(8)
    stored = [(p.tobytes(), p.shape) for p in wanted]
    path = write_cine(tmp_path / "a.cine", stored, 8, times=[0.0, 0.1, 0.2])
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.warns(SequenceWarning, match=r"promises 3 frames, but frame 3 .* the 2 frames"):
        source = open_sequence([path])
    assert len(source) == len(source.times_s()) == 2
    np.testing.assert_array_equal(source.read(1), wanted[1][::-1])
    assert "the 2 frames before are used" in source.remarks[0]


def test_a_last_frame_whose_note_pushes_it_over_the_end_is_left_out(tmp_path):
    stored = [(p.tobytes(), p.shape) for p in pictures(8)]
    path = write_cine(tmp_path / "a.cine", stored, 8, note=24)
    path.write_bytes(path.read_bytes()[:-10])
    with pytest.warns(SequenceWarning, match="the 2 frames before are used"):
        assert len(open_sequence([path])) == 2


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d[:30], "does not begin with CI"),
        (lambda d: b"XX" + d[2:], "does not begin with CI"),
        (lambda d: d[:1000], "cut short|cut off"),
        (lambda d: d[: len(d) // 2], "frame 1 begins or reaches beyond"),
    ],
)
def test_a_file_that_is_not_whole_is_refused(tmp_path, change, message):
    stored = [(p.tobytes(), p.shape) for p in pictures(8)]
    path = write_cine(tmp_path / "a.cine", stored, 8)
    path.write_bytes(change(path.read_bytes()))
    with pytest.raises(SequenceError, match=message):
        open_sequence([path])


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ({"cfa": 3}, "colour recording"),
        ({"compression": 2}, "colour recording"),
        ({"compression": 1}, "JPEG"),
        ({"packing": 7}, "biCompression 7"),
    ],
)
def test_what_cannot_be_measured_in_is_refused_with_a_reason(tmp_path, kind, message):
    stored = [(p.tobytes(), p.shape) for p in pictures(8)]
    with pytest.raises(SequenceError, match=message):
        open_sequence([write_cine(tmp_path / "a.cine", stored, 8, **kind)])


@pytest.mark.filterwarnings("ignore::videogrammetry.errors.SequenceWarning")
def test_damaged_headers_never_end_in_anything_but_a_message(tmp_path):
    stored = [(p.tobytes(), p.shape) for p in pictures(16)]
    whole = bytearray(write_cine(tmp_path / "a.cine", stored, 12).read_bytes())
    rng = np.random.default_rng(0)
    for trial in range(300):
        damaged = bytearray(whole)
        for at in rng.integers(0, 1810, 4):
            damaged[at] = rng.integers(256)
        path = tmp_path / f"d{trial}.cine"
        path.write_bytes(damaged)
        try:
            source = open_sequence([path])
            for k in range(min(len(source), 4)):
                source.read(k)
        except SequenceError:
            pass
        path.unlink()


@pytest.mark.data
@pytest.mark.parametrize("name", ["packed_12bpp", "phantom_v1610", "phantom_v7_raw_16bpp"])
@pytest.mark.parametrize("frame", [0, 5])
def test_real_recordings_equal_another_programs_frames(data, name, frame):
    folder = data / "high-speed"
    gold = folder / "gold" / f"{name}_{frame}.rawi"
    width, height, _ = np.fromfile(gold, "<u4", 3)
    other = np.fromfile(gold, "<f4", offset=12).reshape(height, width)
    source = open_sequence([folder / f"{name}.cine"])
    # The other program scales to 255 in single precision, whose 24 bits hold the 12 of a sample.
    scale = 255.0 / (2**source.bit_depth - 1)
    np.testing.assert_array_equal(np.rint(other / scale), source.read(frame))
    np.testing.assert_allclose(scale * source.read(frame), other, rtol=3e-7)


@pytest.mark.data
def test_a_colour_recording_is_refused(data):
    with pytest.raises(SequenceError, match="colour recording"):
        open_sequence([data / "high-speed" / "invalid_color.cine"])
