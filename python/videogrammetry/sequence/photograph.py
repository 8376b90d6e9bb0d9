"""What a photograph's file says about the camera that took it (EXIF)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import SupportsFloat

import numpy as np
from PIL import Image

#: Diagonal of the 36 x 24 mm picture that "35 mm equivalent" refers to.
_DIAGONAL_35MM = float(np.hypot(36.0, 24.0))
_EXIF_IFD = 0x8769
_MAKE, _MODEL, _SERIAL = 0x010F, 0x0110, 0xA431
_FOCAL, _FOCAL_35MM, _LENS = 0x920A, 0xA405, 0xA434


@dataclass(frozen=True, kw_only=True)
class PhotoFacts:
    """What EXIF states, None where it does not.

    ``body``: maker, model and serial number; ``lens`` its model; ``focal_mm`` as set;
    ``focal_35mm`` the principal distance of a 36 x 24 mm picture of the same angle.
    """

    body: str | None = None
    lens: str | None = None
    focal_mm: float | None = None
    focal_35mm: float | None = None

    def f_px(self, image_size_px: tuple[int, int]) -> float | None:
        """Principal distance in pixels that ``focal_35mm`` stands for; good to some 10 %.

        Examples
        --------
        >>> round(PhotoFacts(focal_35mm=36.0).f_px((6000, 4000)))
        6000
        """
        if not self.focal_35mm:
            return None
        return self.focal_35mm / _DIAGONAL_35MM * float(np.hypot(*image_size_px))


def photo_facts(path: Path) -> PhotoFacts:
    """EXIF's facts of a picture; empty where the file has none or cannot be opened."""
    try:
        with Image.open(path) as image:
            exif = image.getexif()
            detail = exif.get_ifd(_EXIF_IFD)
    except (OSError, SyntaxError, ValueError):
        return PhotoFacts()
    body = " ".join(
        str(part).strip("\x00 ")
        for part in (exif.get(_MAKE), exif.get(_MODEL), detail.get(_SERIAL))
        if part
    )
    return PhotoFacts(
        body=body or None,
        lens=str(detail[_LENS]).strip("\x00 ") if detail.get(_LENS) else None,
        focal_mm=_number(detail.get(_FOCAL)),
        focal_35mm=_number(detail.get(_FOCAL_35MM)),
    )


def _number(value: object) -> float | None:
    if not isinstance(value, SupportsFloat | str):  # EXIF's rationals know how
        return None
    try:
        number = float(value)
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if np.isfinite(number) and number > 0 else None
