"""One picture to its targets."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from videogrammetry._core import recognition as _core
from videogrammetry.recognition.codes import CODE_FAMILIES, CodeFamily, code_family, to_core
from videogrammetry.recognition.options import RecognitionOptions
from videogrammetry.types import Targets

_DIRECTIONS = ("clockwise", "counter-clockwise")
_POLARITIES = ("white-on-black", "black-on-white")
_METHODS = ("edge-pair", "local-canny")
_ESTIMATORS = ("mean-gradient", "dual-conic", "model")


def recognize(
    image: npt.NDArray[Any],
    options: RecognitionOptions | None = None,
    *,
    family: CodeFamily | None = None,
) -> Targets:
    """Find the circular targets of a picture and read their codes.

    The local Canny detector of the videogrammetry paper [1]_: candidates from
    the grey-level gradient, Canny's edges in each candidate with thresholds of
    its own, sub-pixel edges by the mean gradient, a least-squares ellipse, and
    the code ring. The ellipse's covariance follows from its edge residuals. With
    ``estimator="dual-conic"`` the dots found are measured anew by the tangents of
    their gradients, with ``"model"`` by least squares on their grey values.

    The interpreter's lock is released: several pictures may be recognised in
    threads. Nothing is random.

    Parameters
    ----------
    image : (H, W) array of uint8 or uint16
        Grey values, linear; the range in use is found from the picture (10, 12
        or 14 bits in 16 are fine). Views of rows of a larger array pass
        without a copy.
    options : RecognitionOptions, optional
    family : CodeFamily, optional
        Instead of the family that ``options.codes`` names.

    Returns
    -------
    Targets
        Empty arrays if there are none. Dots that the picture's border cuts are
        not measured.

    Raises
    ------
    ValueError
        The array or an option is not what is expected.

    References
    ----------
    .. [1] A four-camera videogrammetric system for 3-D motion measurement of
       deformable object, Optics and Lasers in Engineering 50 (2012) 800-811.

    Examples
    --------
    >>> y, x = np.mgrid[:60, :80]
    >>> distance = np.hypot(x - 40.3, y - 30.5)
    >>> image = np.uint8(20 + 200 * np.clip(10.5 - distance, 0, 1))
    >>> targets = recognize(image)
    >>> targets.centre_px.round(1).tolist(), targets.id.tolist()
    ([[40.3, 30.5]], [-1])
    """
    options = options or RecognitionOptions()
    image = _checked_image(image)
    core_options = _core_options(options)
    core_family = _named_family(options.codes) if family is None else to_core(family)
    return Targets(**_core.recognize(image, core_options, core_family))


def _checked_image(image: npt.NDArray[Any]) -> npt.NDArray[Any]:
    image = np.asarray(image)
    if image.ndim != 2:
        raise ValueError(f"image: expected 2 dimensions (height, width), got shape {image.shape}")
    if image.dtype.kind != "u" or image.dtype.itemsize > 2:
        raise ValueError(f"image: expected uint8 or uint16, got {image.dtype}")
    if not image.dtype.isnative:
        image = image.astype(image.dtype.newbyteorder("="))
    if max(image.shape) > 1 << 16:
        raise ValueError(f"image: expected at most 65536 rows and columns, got {image.shape}")
    rows_apart = image.strides[0] >= image.strides[1] * image.shape[1]
    aligned = image.strides[0] % image.itemsize == 0
    if image.strides[1] != image.itemsize or not rows_apart or not aligned:
        image = np.ascontiguousarray(image)
    return image


def _core_options(options: RecognitionOptions) -> _core.RecognitionOptions:
    for name, value, known in (
        ("direction", options.direction, _DIRECTIONS),
        ("polarity", options.polarity, _POLARITIES),
        ("method", options.method, _METHODS),
        ("estimator", options.estimator, _ESTIMATORS),
    ):
        if value not in known:
            raise ValueError(f"{name}: expected {' or '.join(map(repr, known))}, got {value!r}")
    try:
        smallest, largest = (float(d) for d in options.diameter_px)
    except (TypeError, ValueError):
        raise ValueError(
            f"diameter_px: expected (smallest, largest), got {options.diameter_px!r}"
        ) from None
    return _core.RecognitionOptions(
        codes=str(options.codes),
        clockwise=options.direction == _DIRECTIONS[0],
        white_on_black=options.polarity == _POLARITIES[0],
        diameter_px=(smallest, largest),
        method=options.method,
        estimator=options.estimator,
    )


@lru_cache(maxsize=len(CODE_FAMILIES))
def _built_in_family(name: str) -> _core.CodeFamily:
    return _core.named_code_family(name)


def _named_family(codes: str) -> _core.CodeFamily:
    # Files are read anew each time: they may have changed.
    return _built_in_family(codes) if codes in CODE_FAMILIES else to_core(code_family(codes))
