"""Writes a folder of single pictures, TIFF or PNG."""

from __future__ import annotations

import glob
import io
import os
import re
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import tifffile
from PIL import Image

from videogrammetry.sequence.parts import check_outputs, flush_folder, part_of

_SUFFIX = {"tiff": ".tif", "png": ".png"}
#: Room for a picture's own header, and what a file system allots at once.
_HEADER_BYTES, _BLOCK_BYTES = 1024, 4096


def picture_bytes(frame: npt.NDArray[Any], format: str) -> bytes:
    """A picture's file: ``tiff`` (uncompressed) or ``png``, of the frame's type.

    Examples
    --------
    >>> picture_bytes(np.zeros((4, 6), np.uint8), "png")[1:4]
    b'PNG'
    """
    # In memory: a library that writes to the disk itself may not say why it fails.
    data = io.BytesIO()
    if format == "tiff":
        tifffile.imwrite(
            data, frame, photometric="minisblack", metadata=None, software="videogrammetry"
        )
    else:
        Image.fromarray(np.ascontiguousarray(frame)).save(data, "PNG", compress_level=1)
    return data.getvalue()


class PictureOutput:
    """``FOLDER/NAME_000001.tif`` and so on, in a hidden folder until all are there."""

    def __init__(
        self,
        folder: Path,
        *,
        format: str,
        image_size_px: tuple[int, int],
        num_frames: int,
        bit_depth: int,
        names: Sequence[str] | None = None,
    ) -> None:
        suffix = _SUFFIX[format]
        self._format = format
        self.target = folder
        self._part = part_of(folder)
        self._suffix = suffix
        digits = max(6, len(str(num_frames)))
        self._names = names or [f"{folder.name}_{i:0{digits}d}" for i in range(1, num_frames + 1)]
        samples = image_size_px[0] * image_size_px[1] * (1 if bit_depth == 8 else 2)
        blocks = -(-(samples + _HEADER_BYTES) // _BLOCK_BYTES)
        #: For PNG the most that it can be: how well pictures compress is not known before.
        self.needed_bytes = num_frames * blocks * _BLOCK_BYTES
        special = glob.escape(folder.name) != folder.name or re.search("[{}]", folder.name)
        self.spec = folder.name if special else f"{folder.name}/*{suffix}"

    def check(self) -> None:
        """Raises if the place cannot be written to, or is taken."""
        check_outputs((self.target,))

    def begin(self) -> None:
        """Makes the hidden folder."""
        self._part.mkdir()

    def write(self, index: int, frame: npt.NDArray[Any]) -> None:
        """Writes one picture of the writer's type."""
        name = f"{self._names[index]}{self._suffix}"
        with (self._part / name).open("xb") as file:
            file.write(picture_bytes(frame, self._format))
            file.flush()
            os.fsync(file.fileno())

    def finish(self) -> None:
        """Gives the folder its name."""
        flush_folder(self._part)
        self.check()  # nobody has been quicker
        self._part.rename(self.target)
        flush_folder(self.target.parent)

    def discard(self) -> None:
        """Removes what was written."""
        shutil.rmtree(self._part, ignore_errors=True)
