"""Every format gives back the very numbers that were written, or an error; never half a picture."""

from __future__ import annotations

import io
import struct
import tracemalloc
import warnings
import zlib
from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image

from videogrammetry.errors import SequenceError
from videogrammetry.sequence import grey_from_rgb, open_sequence

RNG = np.random.default_rng(7)
GREY8 = RNG.integers(0, 256, (12, 17), dtype=np.uint8)
GREY12 = RNG.integers(0, 4096, (12, 17), dtype=np.uint16)
GREY16 = RNG.integers(0, 65536, (12, 17), dtype=np.uint16)
RGB8 = RNG.integers(0, 256, (12, 17, 3), dtype=np.uint8)


def read_one(path: Path) -> np.ndarray:
    source = open_sequence(path)
    assert len(source) == 1
    frame = source.read(0)
    assert source.image_size_px == (frame.shape[1], frame.shape[0])
    assert frame.flags.c_contiguous
    return frame


def png(values: np.ndarray) -> bytes:
    data = io.BytesIO()
    Image.fromarray(values).save(data, "PNG")
    return data.getvalue()


def tiff(values: np.ndarray, **options: object) -> bytes:
    data = io.BytesIO()
    tifffile.imwrite(data, values, metadata=None, **options)
    return data.getvalue()


def pillow_tiff(values: np.ndarray, compression: str) -> bytes:
    data = io.BytesIO()
    Image.fromarray(values).save(data, "TIFF", compression=compression)
    return data.getvalue()


def bmp(values: np.ndarray) -> bytes:
    data = io.BytesIO()
    Image.fromarray(values).save(data, "BMP")
    return data.getvalue()


def pgm(values: np.ndarray, maxval: int) -> bytes:
    samples = values.astype(">u2" if maxval > 255 else np.uint8).tobytes()
    return b"P5\n# a comment\n17 12\n%d\n" % maxval + samples


def plain_pgm(values: np.ndarray, maxval: int) -> bytes:
    rows = "\n".join(" ".join(map(str, row)) for row in values)
    return f"P2\n17 12\n{maxval}\n{rows}\n".encode()


LOSSLESS = {
    "png8.png": (png(GREY8), GREY8),
    "png16.PNG": (png(GREY16), GREY16),
    "tiff8.tif": (tiff(GREY8), GREY8),
    "tiff16.tiff": (tiff(GREY16), GREY16),
    "big-endian.tif": (tiff(GREY16, byteorder=">"), GREY16),
    "bigtiff.tif": (tiff(GREY16, bigtiff=True), GREY16),
    "strips.tif": (tiff(GREY16, rowsperstrip=5), GREY16),
    "tiles.tif": (tiff(GREY16, tile=(16, 16)), GREY16),
    "zlib.tif": (tiff(GREY16, compression="zlib", predictor=True), GREY16),
    "lzw.tif": (pillow_tiff(GREY8, "tiff_lzw"), GREY8),
    "lzw16.tif": (pillow_tiff(GREY16, "tiff_lzw"), GREY16),
    "packbits.tif": (pillow_tiff(GREY8, "packbits"), GREY8),
    "white-is-zero.tif": (tiff(255 - GREY8, photometric="miniswhite"), GREY8),
    "white-is-zero16.tif": (tiff(65535 - GREY16, photometric="miniswhite"), GREY16),
    "rgb.tif": (tiff(RGB8, photometric="rgb"), grey_from_rgb(RGB8)),
    "planar.tif": (
        tiff(np.moveaxis(RGB8, -1, 0), photometric="rgb", planarconfig="separate"),
        grey_from_rgb(RGB8),
    ),
    "rgb.png": (png(RGB8), grey_from_rgb(RGB8)),
    "grey.bmp": (bmp(GREY8), GREY8),
    "rgb.bmp": (bmp(RGB8), grey_from_rgb(RGB8)),
    "grey8.pgm": (pgm(GREY8, 255), GREY8),
    "grey12.pgm": (pgm(GREY12, 4095), GREY12),
    "grey16.pgm": (pgm(GREY16, 65535), GREY16),
    "plain.pgm": (plain_pgm(GREY12, 4095), GREY12),
}


@pytest.mark.parametrize("name", LOSSLESS)
def test_reads_exactly_what_was_written(tmp_path: Path, name: str) -> None:
    data, expected = LOSSLESS[name]
    path = tmp_path / name
    path.write_bytes(data)
    frame = read_one(path)
    assert frame.dtype == expected.dtype
    np.testing.assert_array_equal(frame, expected)


@pytest.mark.parametrize("name", LOSSLESS)
def test_a_file_cut_anywhere_is_an_error_or_still_whole(tmp_path: Path, name: str) -> None:
    data, expected = LOSSLESS[name]
    path = tmp_path / name
    errors = 0
    for length in range(len(data)):
        path.write_bytes(data[:length])
        try:
            frame = read_one(path)
        except SequenceError as error:
            assert name in str(error)
            errors += 1
        else:
            np.testing.assert_array_equal(frame, expected, err_msg=f"cut at {length}")
    # What follows the samples (padding, notes) may go; the samples' own bytes may not.
    assert errors >= 0.5 * expected.size


@pytest.mark.parametrize("values", [RGB8, GREY8], ids=["colour", "grey"])
def test_jpeg_is_read_as_luminance_and_a_cut_one_refused(tmp_path: Path, values) -> None:
    path = tmp_path / "photo.JPG"
    thumbnail = io.BytesIO()
    Image.fromarray(GREY8).save(thumbnail, "JPEG")
    Image.fromarray(values).save(path, quality=95, exif=b"Exif\0\0" + thumbnail.getvalue())
    data = path.read_bytes()
    frame = read_one(path)
    with Image.open(path) as image:
        expected = np.asarray(image.convert("L")).astype(int)
    # Pillow goes YCbCr -> RGB -> L: each step rounds, so that 2 grey levels may be lost.
    assert frame.dtype == np.uint8
    assert np.abs(frame - expected).max() <= 2 or values is RGB8
    for length in range(len(data)):
        path.write_bytes(data[:length])
        with pytest.raises(SequenceError, match=r"photo\.JPG"):
            read_one(path)


def packed(values: np.ndarray, bits: int) -> bytes:
    shifts = np.arange(bits - 1, -1, -1)
    return np.packbits((values[..., None] >> shifts & 1).reshape(len(values), -1), axis=1).tobytes()


@pytest.mark.parametrize("bits", [10, 12, 14])
def test_packed_tiff(tmp_path: Path, bits: int) -> None:
    values = (GREY16 >> (16 - bits)).astype(np.uint16)
    samples = packed(values, bits)
    base = tiff(np.zeros((12, 17), np.uint16))
    path = tmp_path / "packed.tif"
    path.write_bytes(base)
    with tifffile.TiffFile(path, mode="r+b") as tif:
        page = tif.pages[0]
        offset = page.dataoffsets[0]
        page.tags["BitsPerSample"].overwrite(bits)
        page.tags["StripByteCounts"].overwrite(len(samples))
    data = bytearray(path.read_bytes())
    data[offset : offset + len(samples)] = samples
    path.write_bytes(data)
    np.testing.assert_array_equal(read_one(path), values)


def test_stack_names_its_pages_from_one(tmp_path: Path) -> None:
    stack = np.stack([GREY16, GREY16 // 2, GREY16 // 3])
    path = tmp_path / "stack.tif"
    tifffile.imwrite(path, stack, photometric="minisblack")
    source = open_sequence(path)
    assert [source.name(i) for i in range(3)] == ["stack.tif#1", "stack.tif#2", "stack.tif#3"]
    for i in range(3):
        np.testing.assert_array_equal(source.read(i), stack[i])
    with pytest.raises(IndexError, match="frame 3"):
        source.read(3)


@pytest.mark.parametrize("compression", [None, "zlib"])
def test_of_a_cut_stack_the_whole_pages_are_read_and_it_is_said(
    tmp_path: Path, compression
) -> None:
    path = tmp_path / "stack.tif"
    with tifffile.TiffWriter(path) as writer:
        for i in range(3):
            writer.write(GREY8 // (i + 1), contiguous=False, compression=compression, metadata=None)
    data = path.read_bytes()
    lengths = set()
    for length in range(1, len(data)):
        path.write_bytes(data[:length])
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            try:
                source = open_sequence(path)
            except SequenceError:
                continue
        assert (len(source) == 3) == (not said)
        if said:
            assert f"its first {len(source)} pages are whole" in str(said[0].message)
        lengths.add(len(source))
        for i in range(len(source)):
            np.testing.assert_array_equal(source.read(i), GREY8 // (i + 1))


def test_a_stacks_plain_pages_are_not_copied(tmp_path: Path) -> None:
    stack = np.stack([GREY16, GREY16 // 2])
    tifffile.imwrite(tmp_path / "s.tif", stack, photometric="minisblack", byteorder="<")
    frame = open_sequence(tmp_path / "s.tif").read(1)
    np.testing.assert_array_equal(frame, stack[1])
    assert not frame.flags.owndata


@pytest.mark.parametrize("suffix", [".pgm", ".tif", ".bmp", ".png"])
def test_absurd_sizes_take_no_memory(tmp_path: Path, suffix: str) -> None:
    side = 999_999_999
    path = tmp_path / f"a{suffix}"
    if suffix == ".pgm":
        path.write_bytes(b"P5 %d %d 255\n" % (side, side) + bytes(100))
    elif suffix == ".tif":
        tifffile.imwrite(path, GREY8, compression="zlib", metadata=None)
        data = path.read_bytes()
        for tag in (256, 257):
            at = next(
                k for k in range(8, len(data)) if data[k : k + 4] in
                (struct.pack("<HH", tag, 3), struct.pack("<HH", tag, 4))
            )  # fmt: skip
            data = data[:at] + struct.pack("<HHII", tag, 4, 1, side) + data[at + 12 :]
        path.write_bytes(data)
    else:
        Image.fromarray(GREY8).save(path)
        data = bytearray(path.read_bytes())
        if suffix == ".bmp":
            struct.pack_into("<ii", data, 18, side, side)
        else:
            struct.pack_into(">II", data, 16, side, side)
            struct.pack_into(">I", data, 29, zlib.crc32(data[12:29]))
        path.write_bytes(data)
    tracemalloc.start()
    with pytest.raises(SequenceError, match=rf"a\{suffix}.*(999999999|larger than any)"):
        open_sequence(path).read(0)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 20e6


def test_places_beyond_any_file_and_sizes_that_are_no_whole_numbers(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    for place in (2**63, 2**64 - 1, 2**63 - 1):
        path.write_bytes(struct.pack("<2sHHHQ", b"II", 43, 8, 0, place) + bytes(64))
        with pytest.raises(SequenceError, match=r"a\.tif: TIFF picture is damaged"):
            open_sequence(path)
    tifffile.imwrite(path, GREY8, metadata=None)
    data = bytearray(path.read_bytes())
    at = data.index(struct.pack("<HHI", 257, 4, 1)) if struct.pack(
        "<HHI", 257, 4, 1
    ) in data else data.index(struct.pack("<HHI", 257, 3, 1))  # fmt: skip
    data[at : at + 12] = struct.pack("<HHII", 257, 12, 1, len(data))
    path.write_bytes(data + struct.pack("<d", 11.5))
    with pytest.raises(SequenceError, match=r"a\.tif.*(whole numbers|damaged)"):
        open_sequence(path).read(0)


NOT_PICTURES = {
    "text.tif": b"this is no picture\n",
    "text.png": b"this is no picture\n",
    "text.jpg": b"this is no picture\n",
    "text.bmp": b"this is no picture\n",
    "text.pgm": b"this is no picture\n",
    "really-a-png.jpg": png(GREY8),
    "colour.pgm": b"P6\n1 1\n255\nabc",
    "float.tif": tiff(GREY8.astype(np.float32)),
    "long.tif": tiff(GREY16.astype(np.uint32)),
    "signed.tif": tiff(GREY8.astype(np.int16)),
    "notes.txt": b"hello",
}


@pytest.mark.parametrize("name", NOT_PICTURES)
def test_what_is_no_picture_is_named(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(NOT_PICTURES[name])
    with pytest.raises(SequenceError) as caught:
        open_sequence(name, tmp_path)
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("dtype", [np.float32, np.int16, np.uint32])
def test_samples_of_another_kind_are_no_damage(tmp_path: Path, dtype: type) -> None:
    path = tmp_path / "kind.tif"
    path.write_bytes(tiff(GREY8.astype(dtype)))
    bits = np.dtype(dtype).itemsize * 8
    with pytest.raises(SequenceError) as caught:
        open_sequence(path)
    assert str(caught.value) == (
        f"{path}: page 1 has {bits}-bit samples of type {np.dtype(dtype)}; "
        "save it as 8- or 16-bit grey"
    )


@pytest.mark.parametrize("suffix", [".tif", ".png", ".bmp", ".jpg", ".pgm"])
def test_an_empty_file_is_named(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"empty{suffix}"
    path.touch()
    with pytest.raises(SequenceError, match=r"empty\..*0 bytes"):
        open_sequence(path)


def test_a_flipped_bit_in_a_png_is_found(tmp_path: Path) -> None:
    data = bytearray(png(GREY16))
    data[len(data) // 2] ^= 1
    path = tmp_path / "flipped.png"
    path.write_bytes(data)
    with pytest.raises(SequenceError, match=r"flipped\.png.*damaged"):
        read_one(path)


def test_16_bit_colour_png_is_refused(tmp_path: Path) -> None:
    cv2 = pytest.importorskip("cv2")
    path = tmp_path / "deep.png"
    cv2.imwrite(str(path), np.zeros((4, 5, 3), np.uint16))
    with pytest.raises(SequenceError, match="16-bit colour PNG"):
        read_one(path)


def test_equal_channels_keep_their_value() -> None:
    for dtype, top in ((np.uint8, 256), (np.uint16, 65536)):
        values = np.arange(top, dtype=dtype).reshape(-1, 1)
        np.testing.assert_array_equal(grey_from_rgb(np.stack([values] * 3, axis=-1)), values)
