"""Colour pictures as grey ones, with stated weights."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

#: Weights of red, green and blue in 1/65536: 0.299, 0.587, 0.114 (Rec. 601),
#: what JPEG stores as its luminance. They add up to one, so that a picture with
#: equal channels keeps its values exactly.
RGB_WEIGHTS = (19595, 38470, 7471)


def grey_from_rgb(rgb: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Grey values (height, width) of a colour picture (height, width, 3), same type.

    Parameters
    ----------
    rgb : uint8 or uint16; further channels (transparency) are left out.

    Examples
    --------
    >>> grey_from_rgb(np.array([[[200, 200, 200], [255, 0, 0]]], dtype=np.uint8)).tolist()
    [[200, 76]]
    """
    if rgb.ndim != 3 or rgb.shape[2] < 3 or rgb.dtype not in (np.uint8, np.uint16):
        raise ValueError(
            f"rgb: expected (height, width, 3) of uint8 or uint16, got {rgb.shape} of {rgb.dtype}"
        )
    total = np.full(rgb.shape[:2], 0x8000, dtype=np.uint64)
    for channel, weight in enumerate(RGB_WEIGHTS):
        total += rgb[:, :, channel].astype(np.uint64) * np.uint64(weight)
    return (total >> np.uint64(16)).astype(rgb.dtype)
