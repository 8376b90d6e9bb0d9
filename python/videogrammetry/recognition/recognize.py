"""One picture to its targets."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from videogrammetry._core import recognition as _core
from videogrammetry.recognition.camera_model import CameraModel
from videogrammetry.recognition.codes import CODE_FAMILIES, CodeFamily, code_family, to_core
from videogrammetry.recognition.options import RecognitionOptions
from videogrammetry.recognition.packed import as_packed, is_packed
from videogrammetry.types import PackedSamples, Targets

#: A picture as the core takes it: an array, or its own packed frame.
CoreFrame = Any

_DIRECTIONS = ("clockwise", "counter-clockwise")
_POLARITIES = ("white-on-black", "black-on-white")
_METHODS = ("edge-pair", "local-canny")
_ESTIMATORS = ("auto", "mean-gradient", "dual-conic", "model")
#: The method that reads packed samples in place and has a model of the camera.
IN_PLACE = "edge-pair"
_DEFAULTS = RecognitionOptions()
_NATIVE = frozenset((np.dtype(np.uint8), np.dtype(np.uint16)))
_LARGEST_SIDE = 1 << 16


def recognize(
    image: npt.NDArray[Any] | PackedSamples,
    options: RecognitionOptions | None = None,
    *,
    family: CodeFamily | None = None,
    camera: CameraModel | None = None,
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
    image : (H, W) array of uint8 or uint16, or PackedFrame
        Grey values, linear; the range in use is found from the picture (10, 12
        or 14 bits in 16 are fine). Views of rows of a larger array pass
        without a copy; so do packed samples with the method ``edge-pair``.
    options : RecognitionOptions, optional
    family : CodeFamily, optional
        Instead of the family that ``options.codes`` names.
    camera : CameraModel, optional
        Noise, blur and light as :func:`learn_camera` found them, for the method
        ``edge-pair`` (others have no use for it). None: of this picture by itself.

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
    recognizer = core_recognizer(_DEFAULTS if options is None else options, family)
    model = None if camera is None else core_camera(camera)
    return Targets(**recognizer.recognize(checked_frame(image), model))


def core_recognizer(
    options: RecognitionOptions, family: CodeFamily | None = None
) -> _core.Recognizer:
    """Options and codes as the core takes them; those of the last calls are kept.

    Raises
    ------
    ValueError
        An option or the family is not what is expected.
    """
    codes = core_family(options, family)
    if family is None and options.codes not in CODE_FAMILIES:
        return _made_recognizer(options, codes)
    try:
        return _kept_recognizer(options, codes)
    except TypeError:  # options with a list in them cannot be looked up
        return _made_recognizer(options, codes)


def core_family(options: RecognitionOptions, family: CodeFamily | None = None) -> _core.CodeFamily:
    """The codes as the core takes them; ValueError if there are no such codes."""
    if family is not None:
        return to_core(family)
    if options.codes in CODE_FAMILIES:
        return _built_in_family(options.codes)
    # Files are read anew each time: they may have changed.
    return to_core(code_family(options.codes))


def core_camera(camera: CameraModel) -> _core.CameraModel:
    """The model as the core takes it; ValueError if it is something else."""
    if not isinstance(camera, CameraModel):
        raise ValueError(f"camera: expected a CameraModel or None, got {camera!r}")
    return camera.core


def checked_frame(image: Any) -> CoreFrame:
    """The picture as the core takes it, copied only where its memory is of another kind.

    Raises
    ------
    ValueError
        It is no picture.
    """
    if (
        isinstance(image, np.ndarray)
        and image.ndim == 2
        and image.dtype in _NATIVE
        and image.strides == (image.shape[1] * image.itemsize, image.itemsize)
        and max(image.shape) <= _LARGEST_SIDE
    ):
        return image
    if not isinstance(image, np.ndarray) and is_packed(image):
        return as_packed(image).core
    return _checked_image(image)


def _checked_image(given: Any) -> npt.NDArray[Any]:
    image: npt.NDArray[Any] = np.asarray(given)
    if image.ndim != 2:
        raise ValueError(f"image: expected 2 dimensions (height, width), got shape {image.shape}")
    if image.dtype.kind != "u" or image.dtype.itemsize > 2:
        raise ValueError(f"image: expected uint8 or uint16, got {image.dtype}")
    if not image.dtype.isnative:
        image = image.astype(image.dtype.newbyteorder("="))
    if max(image.shape) > _LARGEST_SIDE:
        raise ValueError(f"image: expected at most 65536 rows and columns, got {image.shape}")
    rows_apart = image.strides[0] >= image.strides[1] * image.shape[1]
    aligned = image.strides[0] % image.itemsize == 0
    if image.strides[1] != image.itemsize or not rows_apart or not aligned:
        image = np.ascontiguousarray(image)
    return image


def core_options(options: RecognitionOptions) -> _core.RecognitionOptions:
    """The options as the core takes them; ValueError names the one that is wrong."""
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


def _made_recognizer(options: RecognitionOptions, codes: _core.CodeFamily) -> _core.Recognizer:
    return _core.Recognizer(core_options(options), codes)


# By the options' values and the family's identity, which stays while it is kept here.
_kept_recognizer = lru_cache(maxsize=16)(_made_recognizer)
