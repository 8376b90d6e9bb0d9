"""What the pictures of one camera have in common: learned from some, used for all."""

from __future__ import annotations

import dataclasses
import math
import operator
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from videogrammetry._core import recognition as _core

_MOST_GREY = 65535
#: Scale of the median absolute deviation to a normal distribution's standard deviation.
_MAD_TO_SIGMA = 1.4826


@dataclass(frozen=True, kw_only=True)
class CameraModel:
    """Noise, blur and light of a camera's pictures while light and focus stay as they are.

    The method ``edge-pair`` learns it anew of every picture; with a model given
    it need not, and all pictures are measured by the same rule. It belongs to
    pictures of one depth (8 bit, or what the 16 bit hold) and one polarity. It is
    of the grey values as they are for bright targets, and of their negatives for
    dark ones: there ``noise_per_grey`` is not positive.

    Attributes
    ----------
    gradient_threshold : of the search, on \\|I(x+1) - I(x-1)\\| in grey values; 1 to 65535.
    second_threshold : of a second search, for dots whose own texture breaks the first
        one's chords; 0 to 65535, 0: there were none.
    blur_px : standard deviation of the blur, the pixel's extent included; 0 < b <= 100.
    blur_sigma_px : how much it differs from dot to dot and picture to picture;
        0 < s <= 100.
    noise_at_zero, noise_per_grey, noise_least : the variance of a grey value g is
        ``max(noise_least, noise_at_zero + noise_per_grey g)``, in grey values squared;
        finite, noise_least > 0.
    light_gradient : standard deviation of what light changes over a radius, in units
        of the contrast; 0 < g <= 1.
    flare : the same of light that is added (a lamp's gleam, a lens' flare) rather than
        multiplied; 0 < f <= 1. Where it is more than usual the dots are measured by the
        slower model that has it.

    Raises
    ------
    ValueError
        A number is out of its range; it is named.

    Examples
    --------
    >>> model = CameraModel(
    ...     gradient_threshold=40, blur_px=0.8, blur_sigma_px=0.02, noise_at_zero=2.0,
    ...     noise_per_grey=0.03, noise_least=0.5, light_gradient=0.01,
    ... )
    >>> model.noise_variance(100.0), CameraModel.from_dict(model.to_dict()) == model
    (5.0, True)
    """

    gradient_threshold: int
    blur_px: float
    blur_sigma_px: float
    noise_at_zero: float
    noise_per_grey: float
    noise_least: float
    light_gradient: float
    second_threshold: int = 0
    flare: float = 0.004

    def __post_init__(self) -> None:
        for name, least in (("gradient_threshold", 1), ("second_threshold", 0)):
            whole = _whole_number(getattr(self, name))
            if whole is None or not least <= whole <= _MOST_GREY:
                raise ValueError(
                    f"{name}: expected a whole number from {least} to {_MOST_GREY}, "
                    f"got {getattr(self, name)!r}"
                )
            object.__setattr__(self, name, whole)
        for name, low, high in _RANGES:
            value = _number(name, getattr(self, name))
            if not low < value <= high:
                expected = "a finite number" if low == -math.inf else f"{low:g} < x <= {high:g}"
                raise ValueError(f"{name}: expected {expected}, got {value!r}")
            object.__setattr__(self, name, value)

    def noise_variance(self, grey: float) -> float:
        """Variance of a grey value (of its negative, for dark targets), grey values squared."""
        return max(self.noise_least, self.noise_at_zero + self.noise_per_grey * grey)

    def to_dict(self) -> dict[str, int | float]:
        """Plain numbers by name, as project files and HDF5 attributes take them."""
        return {name: getattr(self, name) for name in CAMERA_FIELDS}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> CameraModel:
        """The inverse of :meth:`to_dict`; numpy's numbers will do.

        Raises
        ------
        ValueError
            A name is missing or unknown, or a number is not what is expected.
        """
        missing = [name for name in CAMERA_FIELDS[:-2] if name not in values]
        unknown = sorted(str(name) for name in values if name not in CAMERA_FIELDS)
        if missing or unknown:
            raise ValueError(
                f"camera model: expected {', '.join(CAMERA_FIELDS)}; "
                f"missing: {', '.join(missing) or 'none'}, unknown: {', '.join(unknown) or 'none'}"
            )
        return cls(**values)

    def __reduce__(self) -> tuple[Any, ...]:
        # What the core made of it stays here when it goes to another process.
        return CameraModel.from_dict, (self.to_dict(),)

    @cached_property
    def core(self) -> _core.CameraModel:
        """The model as the C++ core takes it."""
        return _core.CameraModel(**self.to_dict())


#: The fields, in order; the last two have defaults.
CAMERA_FIELDS = tuple(field.name for field in dataclasses.fields(CameraModel))

#: Name, and what it must be more than and at most.
_RANGES = (
    ("blur_px", 0.0, 100.0),
    ("blur_sigma_px", 0.0, 100.0),
    ("noise_at_zero", -math.inf, float(np.finfo(float).max)),
    ("noise_per_grey", -math.inf, float(np.finfo(float).max)),
    ("noise_least", 0.0, float(_MOST_GREY) ** 2),
    ("light_gradient", 0.0, 1.0),
    ("flare", 0.0, 1.0),
)


def from_core(model: _core.CameraModel) -> CameraModel:
    """The model that the C++ core has learned."""
    return CameraModel(**{name: getattr(model, name) for name in CAMERA_FIELDS})


def pool_models(models: Sequence[CameraModel]) -> CameraModel | None:
    """One model of those of several pictures; None of none.

    The medians of the numbers, for thresholds the lower of the two in the middle.
    The second search is made if any picture had need of it, at the median of those.
    The blur's spread contains what it differs between the pictures, their median
    absolute deviation: focus and motion change it.
    """
    if len(models) < 2:
        return models[0] if models else None
    median = {name: float(np.median([getattr(m, name) for m in models])) for name in CAMERA_FIELDS}
    second = [m.second_threshold for m in models if m.second_threshold]
    off = np.abs(np.array([m.blur_px for m in models]) - median["blur_px"])
    between_px = _MAD_TO_SIGMA * float(np.median(off))
    return CameraModel.from_dict(
        {
            **median,
            "gradient_threshold": statistics.median_low(m.gradient_threshold for m in models),
            "second_threshold": statistics.median_low(second) if second else 0,
            "blur_sigma_px": math.hypot(median["blur_sigma_px"], between_px),
        }
    )


def _whole_number(value: Any) -> int | None:
    try:
        return None if isinstance(value, bool) else operator.index(value)
    except TypeError:
        return None


def _number(name: str, value: Any) -> float:
    try:
        if isinstance(value, str | bytes | bool):
            raise TypeError
        return float(value)
    except (TypeError, ValueError):
        raise ValueError(f"{name}: expected a number, got {value!r}") from None
