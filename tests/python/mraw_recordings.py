"""Photron recordings written by hand and by the library, for tests of their reading."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path

import numpy as np

from videogrammetry.sequence import create_sequence

RNG = np.random.default_rng(11)
SIZE = (32, 20)
FRAMES12 = RNG.integers(0, 4096, (5, 20, 32)).astype(np.uint16)
UTF8 = {"PYTHONUTF8": "1", "PYTHONIOENCODING": "utf-8:strict"}
CIH = """#Camera Information Header
Date : 2020/2/3
Time : 4:05
Camera Type : FASTCAM
Record Rate(fps) : 2000
Shutter Speed(s) : 1/4000
Total Frame : 5
Save Step : 1
Image Width : 32
Image Height : 20
Color Type : Mono
Color Bit : 16
File Format : MRaw
EffectiveBit Depth : 12
EffectiveBit Side : Lower

#Another program's notes
Image Width : 99
"""


def recording(folder: Path, name: str = "run", *, bit_depth: int = 12) -> Path:
    frames = FRAMES12 if bit_depth >= 12 else FRAMES12 >> 4
    with create_sequence(
        folder / name,
        format="mraw",
        image_size_px=SIZE,
        num_frames=5,
        bit_depth=bit_depth,
        frame_rate_hz=5000.0,
        exposure_s=20e-6,
        camera_name="left & low",
        date=datetime(2024, 2, 29, 23, 5),
    ) as writer:
        for frame in frames:
            writer.append(frame)
    return folder / writer.spec


def text_recording(folder: Path, *changes: tuple[str, str]) -> Path:
    """A .cih of 16 bit with FRAMES12 beside it, and lines of the header changed."""
    header = CIH
    for old, new in changes:
        assert old in header
        header = header.replace(old, new, 1)
    (folder / "old.cih").write_text(header)
    (folder / "old.mraw").write_bytes(FRAMES12.astype("<u2").tobytes())
    return folder / "old.cih"


def edit(path: Path, old: str, new: str) -> None:
    data = path.read_bytes()
    assert old.encode() in data
    path.write_bytes(data.replace(old.encode(), new.encode(), 1))
