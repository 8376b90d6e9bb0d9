"""What users give to a network, checked and brought into the arrays of the extension."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from videogrammetry._core import adjustment as _adjustment
from videogrammetry.adjustment.results import CAMERA_UNKNOWNS, INTERFACE_UNKNOWNS
from videogrammetry.adjustment.start import rows
from videogrammetry.types import FloatArray

POINT_KINDS = ("fixed", "weighted", "free")


def mask(names: Sequence[str]) -> list[bool]:
    """(12,) which of ``CAMERA_UNKNOWNS`` are named."""
    return [name in names for name in CAMERA_UNKNOWNS]


def interface_names(argument: str, names: Iterable[str]) -> list[str]:
    """Those of ``INTERFACE_UNKNOWNS`` that are named, "normal" being both tilts."""
    wanted: list[str] = []
    for name in names:
        if name not in (*INTERFACE_UNKNOWNS, "normal"):
            raise ValueError(
                f"{argument}: expected names of {', '.join(INTERFACE_UNKNOWNS)} or normal, "
                f"got {name!r}"
            )
        wanted += INTERFACE_UNKNOWNS[:2] if name == "normal" else [name]
    return wanted


def check_names(argument: str, names: Iterable[str]) -> None:
    """ValueError for a name that is none of ``CAMERA_UNKNOWNS``."""
    for name in names:
        if name not in CAMERA_UNKNOWNS:
            raise ValueError(
                f"{argument}: expected names of {', '.join(CAMERA_UNKNOWNS)}, got {name!r}"
            )


def point_kinds(kind: str | Sequence[str], count: int) -> list[Any]:
    """The extension's kinds of ``count`` points."""
    kinds = [kind] * count if isinstance(kind, str) else [str(k) for k in kind]
    if len(kinds) != count:
        raise ValueError(f"kind: expected one a point ({count}), got {len(kinds)}")
    for each in kinds:
        if each not in POINT_KINDS:
            raise ValueError(f"kind: expected one of {', '.join(POINT_KINDS)}, got {each!r}")
    return [getattr(_adjustment.PointKind, each.upper()) for each in kinds]


def bar_arrays(
    a: npt.ArrayLike, b: npt.ArrayLike, length_mm: npt.ArrayLike, sigma_mm: npt.ArrayLike
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32], FloatArray, FloatArray]:
    """Ends, lengths and sigmas of scale bars, (B,) each."""
    first, second = (
        np.atleast_1d(np.asarray(a, np.int32)),
        np.atleast_1d(np.asarray(b, np.int32)),
    )
    lengths = np.atleast_1d(np.asarray(length_mm, float))
    sigmas = np.broadcast_to(np.asarray(sigma_mm, float), lengths.shape)
    if not len(first) == len(second) == len(lengths):
        raise ValueError(
            "scale bars: expected as many points a and b as lengths, got "
            f"{len(first)}, {len(second)} and {len(lengths)}"
        )
    return first, second, lengths, np.ascontiguousarray(sigmas)


def circle_arrays(
    normal: npt.ArrayLike, diameter_mm: npt.ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Unit normals (N, 3) and radii (N,) mm, 0 where a point is no circle."""
    normals, diameters = rows(normal, 3, "normal"), np.asarray(diameter_mm, dtype=float)
    if diameters.shape != (len(normals),):
        raise ValueError(f"diameter_mm: expected ({len(normals)},), got {diameters.shape}")
    known = np.isfinite(normals).all(axis=1) & np.isfinite(diameters)
    if (diameters[known] <= 0).any():
        raise ValueError(
            f"diameter_mm: expected > 0, got {diameters[known][diameters[known] <= 0][0]:g}"
        )
    return (
        np.where(known[:, None], normals, [0.0, 0.0, 1.0]),
        np.where(known, 0.5 * diameters, 0.0),
    )
