"""Small valid files of every format, by the project's own writers where it has them."""

from __future__ import annotations

import io
import struct
import tempfile
from pathlib import Path

import numpy as np
import tifffile
from PIL import Image

from videogrammetry.sequence import create_sequence, picture_bytes
from videogrammetry.sequence.packing import pack_12bit

SHAPE = (12, 16)
RNG = np.random.default_rng(0)

#: Suffix of the file that is opened, and its bytes; of a recording its ``.mraw`` too.
Seed = tuple[str, bytes, bytes]

TEXT_HEADER = """#Camera Information Header
Date : 2024/2/29
Time : 23:05
Camera Type : FASTCAM
Record Rate(fps) : 2000
Shutter Speed(s) : 1/4000
Total Frame : 3
Start Frame : -2
Save Step : 1
Image Width : 16
Image Height : 12
Color Type : Mono
Color Bit : 16
File Format : MRaw
EffectiveBit Depth : 12
EffectiveBit Side : Higher
"""


def picture(bits: int = 8) -> np.ndarray:
    """Random samples."""
    kind = np.uint8 if bits == 8 else np.uint16
    return RNG.integers(0, 2**bits, SHAPE).astype(kind)


def photron(bits: int) -> Seed:
    """A recording of three frames."""
    with tempfile.TemporaryDirectory() as folder:
        with create_sequence(
            Path(folder, "a"), format="mraw", image_size_px=SHAPE[::-1], num_frames=3,
            bit_depth=bits, frame_rate_hz=1000.0, exposure_s=1e-5,
        ) as writer:  # fmt: skip
            for _ in range(3):
                writer.append(picture(bits))
        return (".cihx", Path(folder, "a.cihx").read_bytes(), Path(folder, "a.mraw").read_bytes())


def cine(bits: int, stored: int) -> Seed:
    """A Phantom recording of three frames with time stamps; no reader of ours writes it."""
    setup = bytearray(1700)
    setup[140:142] = b"ST"
    for at, value in ((768, 5000), (772, 100), (896, bits), (1568, 99_500)):
        struct.pack_into("<I", setup, at, value)
    struct.pack_into("<H", setup, 142, len(setup))
    blocks = struct.pack("<IHH", 8 + 8 * 3, 1002, 0) + struct.pack("<6I", 4, 9, 8, 9, 12, 9)
    frames = [
        pack_12bit(picture(12)).tobytes()
        if stored == 1024
        else RNG.bytes(5 * SHAPE[0] * SHAPE[1] // 4)
        if stored == 256
        else picture(bits).tobytes()
        for _ in range(3)
    ]
    offsets_at = 84 + len(setup) + len(blocks)
    head = struct.pack(
        "<2s3HiIiI3I2I", b"CI", 44, 0, 1, -1, 3, -1, 3, 44, 84, offsets_at, 1 << 31, 9
    )
    head += struct.pack("<IiiHHIIiiII", 40, SHAPE[1], SHAPE[0], 1, 8 if bits == 8 else 16, stored,
                        len(frames[0]), 0, 0, 0, 0)  # fmt: skip
    place, table, body = offsets_at + 24, b"", b""
    for samples in frames:
        table += struct.pack("<Q", place)
        body += struct.pack("<II", 8, len(samples)) + samples
        place += 8 + len(samples)
    return (".cine", head + bytes(setup) + blocks + table + body, b"")


def tiff(frames: np.ndarray, **options: object) -> Seed:
    """A TIFF file by tifffile."""
    data = io.BytesIO()
    tifffile.imwrite(data, frames, metadata=None, **options)
    return (".tif", data.getvalue(), b"")


def by_pillow(suffix: str, frame: np.ndarray, kind: str, **options: object) -> Seed:
    """A picture by Pillow."""
    data = io.BytesIO()
    Image.fromarray(frame).save(data, kind, **options)
    return (suffix, data.getvalue(), b"")


def video(suffix: str, codec: str, pix_fmt: str) -> list[Seed]:
    """A film of six frames; none where PyAV or the codec is missing."""
    try:
        import av
    except ImportError:
        return []
    if codec not in av.codecs_available:
        return []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "a" + suffix)
        with av.open(str(path), "w") as container:
            stream = container.add_stream(codec, rate=50, options={"g": "3"})
            stream.height, stream.width, stream.pix_fmt = 32, 32, pix_fmt
            for _ in range(6):
                samples = RNG.integers(0, 256, (32, 32)).astype(np.uint8)
                container.mux(stream.encode(av.VideoFrame.from_ndarray(samples, format="gray")))
            container.mux(stream.encode(None))
        return [(suffix, path.read_bytes(), b"")]


def all_seeds() -> list[Seed]:
    """One or more of every format."""
    rgb = RNG.integers(0, 256, (*SHAPE, 3)).astype(np.uint8)
    stack = np.stack([picture(16), picture(16)])
    plain = "\n".join(" ".join(map(str, row)) for row in picture().tolist())
    return [
        photron(8), photron(12), photron(16),
        (".cih", TEXT_HEADER.encode(), b"".join(picture(12).tobytes() for _ in range(3))),
        cine(8, 0), cine(16, 0), cine(10, 256), cine(12, 1024),
        (".tif", picture_bytes(picture(16), "tiff"), b""),
        tiff(stack), tiff(stack, bigtiff=True), tiff(stack, byteorder=">"),
        tiff(picture(), compression="zlib"), tiff(picture(), tile=(16, 16)),
        tiff(picture(), photometric="miniswhite"), tiff(rgb, photometric="rgb"),
        by_pillow(".tif", picture(), "TIFF", compression="tiff_lzw"),
        by_pillow(".tif", picture(), "TIFF", compression="packbits"),
        (".png", picture_bytes(picture(), "png"), b""),
        (".png", picture_bytes(picture(16), "png"), b""),
        by_pillow(".bmp", picture(), "BMP"), by_pillow(".bmp", rgb, "BMP"),
        by_pillow(".jpg", picture(), "JPEG"),
        (".pgm", b"P5\n# note\n16 12\n255\n" + picture().tobytes(), b""),
        (".pgm", b"P2 16 12 255\n" + plain.encode() + b"\n", b""),
        *video(".avi", "rawvideo", "gray"), *video(".mkv", "ffv1", "gray"),
        *video(".mp4", "mpeg4", "yuv420p"), *video(".mov", "libx264", "yuv420p"),
    ]  # fmt: skip
