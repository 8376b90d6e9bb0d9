"""What every scene is made of: marks, and their places as a function of time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from videogrammetry.recognition import CodeFamily
from videogrammetry.rendering.scene import SceneTargets
from videogrammetry.types import FloatArray, IntArray, RigData

#: Sticker of a coded target over its ring's outer radius, and of an un-coded one over its dot's.
CODED_STICKER, UNCODED_STICKER = 1.1, 2.0
_MAX_RATE_HZ = 1e7


@dataclass(frozen=True, kw_only=True)
class Marks:
    """What is printed; a row a mark, the same at all times.

    Attributes
    ----------
    point : (N,) number of the point in the truth; -1 = a body that is no target.
    id : (N,) code number, -1 = un-coded. code : (N,) its sectors, 0 = none.
    radius_mm : (N,) of the dot. sticker_mm : (N,) half side or radius.
    square : (N,). white, black : (N,) reflectances.
    num_bits, ring : of the family of codes.
    """

    point: IntArray
    id: IntArray
    code: IntArray
    radius_mm: FloatArray
    sticker_mm: FloatArray
    square: np.ndarray[Any, np.dtype[np.bool_]]
    white: FloatArray
    black: FloatArray
    num_bits: int
    ring: tuple[float, float]

    def __len__(self) -> int:
        return len(self.point)

    @property
    def is_target(self) -> np.ndarray[Any, np.dtype[np.bool_]]:
        """(N,) whether the mark is a target."""
        return self.point >= 0


def targets(
    family: CodeFamily, points: Sequence[int], coded: Sequence[bool], radius_mm: float
) -> Marks:
    """Marks of targets: coded points carry the code of their number.

    Raises
    ------
    ValueError
        A number is beyond the family's codes, or the dots have no size.
    """
    if not 0 < radius_mm < np.inf:
        raise ValueError(f"dot: expected a diameter over 0 mm, got {2 * radius_mm:g} mm")
    number = np.asarray(points, dtype=np.int32)
    is_coded = np.asarray(coded, dtype=bool)
    wrong = number[is_coded & ((number < 1) | (number > len(family)))]
    if len(wrong):
        raise ValueError(
            f"code {wrong[0]}: the family {family.name} has the numbers 1 ... {len(family)}; "
            "choose another family or fewer coded points"
        )
    n = len(number)
    ring = family.ring
    return Marks(
        point=number,
        id=np.where(is_coded, number, -1).astype(np.int32),
        code=np.array(
            [family.codes[p - 1] if c else 0 for p, c in zip(number, is_coded, strict=True)],
            dtype=np.int32,
        ),
        radius_mm=np.full(n, radius_mm),
        sticker_mm=radius_mm * np.where(is_coded, CODED_STICKER * ring[1], UNCODED_STICKER),
        square=np.ones(n, dtype=bool),
        white=np.full(n, 0.8),
        black=np.full(n, 0.06),
        num_bits=family.bits,
        ring=ring,
    )


def bodies(like: Marks, radius_mm: Sequence[float], level: Sequence[float], square: bool) -> Marks:
    """Marks of plain discs or squares: parts of the object that carry nothing."""
    n = len(radius_mm)
    size, grey = np.asarray(radius_mm, dtype=float), np.asarray(level, dtype=float)
    return replace(
        like,
        point=np.full(n, -1, dtype=np.int32),
        id=np.full(n, -1, dtype=np.int32),
        code=np.zeros(n, dtype=np.int32),
        radius_mm=0.5 * size,
        sticker_mm=size,
        square=np.full(n, square),
        white=grey,
        black=grey,
    )


def join(*parts: Marks) -> Marks:
    """Several marks as one table."""
    names = [f.name for f in fields(Marks) if f.name not in ("num_bits", "ring")]
    columns: dict[str, Any] = {n: np.concatenate([getattr(p, n) for p in parts]) for n in names}
    return replace(parts[0], **columns)


@dataclass(frozen=True, kw_only=True)
class Placement:
    """Where the marks are: (N, 3) centres in mm, unit normals, unit x axes in the plane."""

    centre_mm: FloatArray
    normal: FloatArray
    x_axis: FloatArray

    def moved(self, rotation: FloatArray, translation_mm: FloatArray) -> Placement:
        """The same after the motion b_from_a, given in a, wanted in b."""
        return Placement(
            centre_mm=self.centre_mm @ rotation.T + translation_mm,
            normal=self.normal @ rotation.T,
            x_axis=self.x_axis @ rotation.T,
        )


def join_placements(*parts: Placement) -> Placement:
    """Several placements as one table."""
    return Placement(
        **{f.name: np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Placement)}
    )


def placement(centre_mm: FloatArray, normal: FloatArray, along: FloatArray) -> Placement:
    """A placement from normals of any length and directions that need not be at right angles.

    Examples
    --------
    >>> p = placement(np.zeros((1, 3)), np.array([[0.0, 0, 2]]), np.array([[1.0, 0, 5]]))
    >>> p.normal.tolist(), p.x_axis.tolist()
    ([[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    """
    centre, normal, along = np.broadcast_arrays(centre_mm, normal, along)
    n = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    x = along - (along * n).sum(axis=1, keepdims=True) * n
    return Placement(
        centre_mm=np.array(centre, dtype=float),
        normal=n,
        x_axis=x / np.linalg.norm(x, axis=1, keepdims=True),
    )


@dataclass(frozen=True, kw_only=True)
class Scene:
    """An experiment: cameras, marks, and their places in the rig's frame at any time.

    Attributes
    ----------
    name : what kind of scene. rig : the true cameras.
    marks : what is printed. place : time in s -> Placement, in the rig's frame.
    num_stages, frame_rate_hz : stage i (from 1) is taken at (i - 1) / rate; where
        the object stands still at every stage, the rate says only how they count.
    exposure_s : the targets move during it, straight and evenly; times are those
        of its middle.
    still : whether the object stands still at each stage (no motion blur).
    facts : numbers of the scene that a reader of the results may want.
    """

    name: str
    rig: RigData
    marks: Marks
    place: Callable[[float], Placement]
    num_stages: int
    frame_rate_hz: float
    exposure_s: float = 0.0
    still: bool = False
    facts: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.num_stages < 1:
            raise ValueError(f"stages: expected 1 or more, got {self.num_stages}")
        if not 0 < self.frame_rate_hz <= _MAX_RATE_HZ:
            raise ValueError(
                f"frame rate: expected more than 0 Hz, to {_MAX_RATE_HZ:g} Hz, got "
                f"{self.frame_rate_hz:g}"
            )
        if not self.exposure_s >= 0:
            raise ValueError(f"exposure: expected 0 s or more, got {self.exposure_s:g} s")
        if self.exposure_s > 1 / self.frame_rate_hz:
            raise ValueError(
                f"exposure: {self.exposure_s:g} s is longer than a frame, which lasts "
                f"{1 / self.frame_rate_hz:g} s at {self.frame_rate_hz:g} Hz: shorten it or lower "
                "the frame rate"
            )

    def time_s(self, stage: int) -> float:
        """Time of a stage, counted from 1."""
        return (stage - 1) / self.frame_rate_hz

    def targets(self, time_s: float) -> SceneTargets:
        """What the cameras photograph at a time: one exposure.

        The way during the exposure is straight and even, through the place at
        its middle: the acceleration within it, a T^2 / 24, is left out.
        """
        marks = self.marks
        return SceneTargets(
            **self._poses(time_s),
            radius_mm=marks.radius_mm,
            id=marks.point,
            num_bits=np.where(marks.code > 0, marks.num_bits, 0),
            code=marks.code,
            ring=marks.ring,
            sticker_mm=marks.sticker_mm,
            square=marks.square,
            white=marks.white,
            black=marks.black,
        )

    def _poses(self, time_s: float) -> dict[str, Any]:
        """Where the exposure finds the marks, at its begin and at its end."""
        middle = self.place(time_s)
        if self.still or self.exposure_s == 0:
            return {f.name: getattr(middle, f.name) for f in fields(Placement)}
        # A hair less than a frame at most, so that no exposure reaches into the next stage.
        half = min(0.5 * self.exposure_s, 0.499999 / self.frame_rate_hz)
        begin, end = self.place(time_s - half), self.place(time_s + half)
        # A straight way through the true place at the stage's time: what is true of
        # the picture is true of the trajectory.
        way = 0.5 * (end.centre_mm - begin.centre_mm)
        return {
            "centre_mm": middle.centre_mm - way,
            "normal": begin.normal,
            "x_axis": begin.x_axis,
            "end_centre_mm": middle.centre_mm + way,
            "end_normal": end.normal,
            "end_x_axis": end.x_axis,
        }
