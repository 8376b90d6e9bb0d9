"""Targets in space and what is true of their pictures."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from videogrammetry._core import rendering as _core
from videogrammetry.types import FloatArray, IntArray

#: Why a target can or cannot be measured in a picture, by ``TargetTruth.visibility``.
VISIBILITY = (
    "behind",  # 0: it reaches behind the camera
    "facing away",  # 1: the camera sees its back
    "outside",  # 2: nothing of what is printed lies in the picture
    "cut",  # 3: the picture's border cuts what is printed
    "occluded",  # 4: another target hides a part of what is printed
    "visible",  # 5
)

_COLUMNS = {
    "radius_mm": (),
    "ring": (2,),
    "sticker_mm": (),
    "white": (),
    "black": (),
    "gradient": (2,),
}
_INTEGERS = ("id", "num_bits", "code", "square", "white_on_black")


@dataclass(frozen=True, kw_only=True)
class SceneTargets:
    """Printed targets: a dot, a ring of code sectors or none, on a sticker.

    One value for all targets or one for each; (N, 3) arrays may be given as one
    vector too, except the centres.

    Attributes
    ----------
    centre_mm : (N, 3) in the world's frame.
    normal : (N, 3) unit vectors towards the viewer.
    x_axis : (N, 3) unit vectors in the plane: where the first sector begins. Sectors
        run clockwise for the viewer, towards y = x_axis x normal.
    end_centre_mm, end_normal, end_x_axis : the pose at the end of the exposure
        (motion blur), or None; missing parts are those of the beginning.
    radius_mm : of the dot. id : for the truth, -1 = none.
    num_bits : sectors of the ring, 0 = un-coded. code : the most significant bit
        is the first sector. ring : its inner and outer radius over ``radius_mm``.
    sticker_mm : radius of its disc or half a side of its square (``square``); None:
        1.25 times the printed radius, and the dot's twice where there is no ring.
    white, black : reflectances 0 ... 1. white_on_black : or the reverse.
    gradient : (2,) relative change of the light over one radius along the axes.

    Raises
    ------
    ValueError
        An array does not fit, or a target is impossible (radius <= 0, axes not of
        unit length or not at right angles, ...): the message names the field.

    Examples
    --------
    >>> targets = SceneTargets(centre_mm=[[0, 0, 1000], [50, 0, 1000]], radius_mm=4.0,
    ...                        id=[7, -1], num_bits=[14, 0], code=[0b10011100111, 0])
    >>> len(targets), targets.sticker_mm.tolist()
    (2, [15.0, 8.0])
    """

    centre_mm: npt.ArrayLike
    normal: npt.ArrayLike = (0.0, 0.0, -1.0)
    x_axis: npt.ArrayLike = (1.0, 0.0, 0.0)
    end_centre_mm: npt.ArrayLike | None = None
    end_normal: npt.ArrayLike | None = None
    end_x_axis: npt.ArrayLike | None = None
    radius_mm: Any = 5.0
    id: Any = -1
    num_bits: Any = 0
    code: Any = 0
    ring: Any = (2.0, 3.0)
    sticker_mm: Any = None
    square: Any = True
    white: Any = 0.8
    black: Any = 0.06
    white_on_black: Any = True
    gradient: Any = (0.0, 0.0)

    def __post_init__(self) -> None:
        centres = np.asarray(self.centre_mm, dtype=float)
        if centres.ndim != 2 or centres.shape[1] != 3:
            raise ValueError(f"centre_mm: expected shape (N, 3), got {centres.shape}")
        n = len(centres)
        self._set("centre_mm", (3,), n)
        for name in ("normal", "x_axis"):
            self._set(name, (3,), n)
        moving = any(getattr(self, f"end_{p}") is not None for p in _POSE)
        for name in _POSE if moving else ():
            if getattr(self, f"end_{name}") is None:
                object.__setattr__(self, f"end_{name}", getattr(self, name))
            self._set(f"end_{name}", (3,), n)
        for name in _INTEGERS:
            self._set(name, (), n, np.int64)
        for name, shape in _COLUMNS.items():
            if name != "sticker_mm":
                self._set(name, shape, n)
        if self.sticker_mm is None:
            times = np.where(self.num_bits > 0, 1.25 * self.ring[:, 1], 2.0)
            object.__setattr__(self, "sticker_mm", times * self.radius_mm)
        self._set("sticker_mm", (), n)
        object.__setattr__(self, "_model", self._make_model())

    def _set(self, name: str, shape: tuple[int, ...], n: int, kind: Any = float) -> None:
        value = np.asarray(getattr(self, name))
        if kind is np.int64 and value.dtype.kind not in "iub":
            raise ValueError(f"{name}: expected whole numbers, got {value.dtype}")
        try:
            rows = np.ascontiguousarray(np.broadcast_to(value.astype(kind), (n, *shape)))
        except ValueError:
            raise ValueError(
                f"{name}: expected shape {shape} or {(n, *shape)}, got {value.shape}"
            ) from None
        if not np.isfinite(rows).all():
            raise ValueError(f"{name}: expected finite numbers, got {value.tolist()}")
        object.__setattr__(self, name, rows)

    def _make_model(self) -> Any:
        end = [getattr(self, f"end_{name}") for name in _POSE]
        if end[0] is None:
            end = [np.empty((0, 3))] * 3
        numbers = [
            getattr(self, name).reshape(len(self), 2 if shape else 1)
            for name, shape in _COLUMNS.items()
        ]
        integers = [getattr(self, name) for name in _INTEGERS]
        for name, low, high in (("num_bits", 0, 32), ("code", 0, 2**32 - 1)):
            value = getattr(self, name)
            if value.size and not (low <= value.min() and value.max() <= high):
                raise ValueError(f"{name}: expected {low} ... {high}, got {value.tolist()}")
        return _core.Targets(
            *(getattr(self, name) for name in _POSE),
            *end,
            np.ascontiguousarray(np.hstack(numbers)),
            np.ascontiguousarray(np.stack(integers, axis=1)),
        )

    @property
    def model(self) -> Any:
        """The targets as the C++ core holds them."""
        return self.__dict__["_model"]

    def __len__(self) -> int:
        return len(np.asarray(self.centre_mm))

    def select(self, index: Any) -> SceneTargets:
        """The targets of an index array or mask, in its order."""
        values: dict[str, Any] = {field.name: getattr(self, field.name) for field in fields(self)}
        kept: dict[str, Any] = {k: None if v is None else v[index] for k, v in values.items()}
        return SceneTargets(**kept)


_POSE = ("centre_mm", "normal", "x_axis")


@dataclass(frozen=True, kw_only=True)
class TargetTruth:
    """What is true of the targets in one picture, at the middle of the exposure.

    NaN where a target is behind the camera, faces away, or lies where the
    distortion folds over.

    Attributes
    ----------
    id : (N,) as in the scene. visibility : (N,) index into ``VISIBILITY``.
    circle_px : (N, 2) picture of the circle's centre.
    centre_px, semi_axes_px, angle_rad : (N, 2), (N, 2), (N,) ellipse of the circle's picture.
    ellipse_error_px : (N,) largest distance of the circle's picture from that ellipse
        (distortion; 0 for a pinhole).
    """

    id: IntArray
    visibility: npt.NDArray[np.uint8]
    circle_px: FloatArray
    centre_px: FloatArray
    semi_axes_px: FloatArray
    angle_rad: FloatArray
    ellipse_error_px: FloatArray

    def __len__(self) -> int:
        return len(self.id)

    @property
    def visible(self) -> npt.NDArray[np.bool_]:
        """(N,) whole in the picture, from the front, and hidden by nothing."""
        result: npt.NDArray[np.bool_] = self.visibility == VISIBILITY.index("visible")
        return result
