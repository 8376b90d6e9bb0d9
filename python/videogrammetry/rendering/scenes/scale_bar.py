"""The moving scale bar: 1100.057 mm between targets, on either side of a bar.

The bar goes round the volume on a closed smooth curve while it turns, faster
and slower. Two targets an end: 1 and 2 towards cameras 1-2, 3 and 4 towards
cameras 3-4. With ``cross_pair`` one end has a target for one pair only and
the other end for the other: a length that no pair sees, which proves that
both pairs measure in one frame.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from videogrammetry.geometry import rotation_from_vector
from videogrammetry.recognition import CodeFamily
from videogrammetry.rendering.scenes.base import (
    Marks,
    Placement,
    Scene,
    bodies,
    join,
    join_placements,
    placement,
    targets,
)
from videogrammetry.rendering.scenes.paper_rig import lab_frame, paper_rig
from videogrammetry.types import FloatArray, RigData

#: The paper's invar bar and its standard deviation, mm.
LENGTH_MM, SIGMA_MM = 1100.057, 0.003
#: Half extents of the curve that the bar's middle follows: x, y (depth), z, mm.
VOLUME_MM = (1100.0, 700.0, 1100.0)
_BEAM_PARTS, _THICKNESS_MM = 12, 30.0
_SHORTEST = 8  # dots a bar is long at least, or its two stickers leave no room for a beam


def scale_bar_scene(
    family: CodeFamily,
    *,
    num_stages: int = 44,
    speeds_mm_s: Sequence[float] = (200.0, 500.0, 1000.0, 2000.0),
    exposure_s: float = 200e-6,
    rig: RigData | None = None,
    length_mm: float = LENGTH_MM,
    cross_pair: bool = False,
    dot_mm: float = 40.0,
    tilt_deg: float = 20.0,
    seed: int = 0,
) -> Scene:
    """A bar on its way once round the volume, at the chosen speeds one after the other.

    The speed goes evenly from each of ``speeds_mm_s`` to the next; the frame
    rate is the one at which ``num_stages`` stages cover the way.

    Raises
    ------
    ValueError
        An option is impossible.
    """
    speeds = np.asarray(speeds_mm_s, dtype=float)
    if speeds.ndim != 1 or not len(speeds) or not ((speeds > 0) & (speeds < np.inf)).all():
        raise ValueError(f"speeds: expected numbers over 0 mm/s, got {list(speeds_mm_s)}")
    if num_stages < 2:
        raise ValueError(f"stages: a moving bar needs 2 or more, got {num_stages}")
    _check_length(length_mm, dot_mm)
    if not 0 <= tilt_deg < 70:
        raise ValueError(f"tilt: expected 0 ... 70 degrees, got {tilt_deg:g}")
    rig = rig or paper_rig()
    lab = lab_frame(rig, tuple(rig.cameras)[:2])
    way = _Way(speeds, tilt_deg, seed)
    bar = _bar(family, length_mm, dot_mm, cross_pair)

    def place(time_s: float) -> Placement:
        rotation, middle = way.pose(time_s)
        in_lab = bar[1].moved(rotation, middle)
        return in_lab.moved(lab.rotation, lab.origin_mm)

    pairs = [(1, 4)] if cross_pair else [(1, 2), (3, 4)]
    return Scene(
        name="scale-bar",
        rig=rig,
        marks=bar[0],
        place=place,
        num_stages=num_stages,
        # Rounded up, as a recording states it: the last millimetres of the way stay out.
        frame_rate_hz=math.ceil(1000 * (num_stages - 1) / way.duration_s) / 1000,
        exposure_s=exposure_s,
        facts={
            "length_mm": length_mm,
            "sigma_mm": SIGMA_MM,
            "bars": pairs,
            "speeds_mm_s": speeds.tolist(),
        },
    )


def _check_length(length_mm: float, dot_mm: float) -> None:
    if not 0 < _SHORTEST * dot_mm <= length_mm < np.inf or length_mm <= 2 * _THICKNESS_MM:
        raise ValueError(
            f"length: a bar of {length_mm:g} mm is too short for dots of {dot_mm:g} mm; expected "
            f"{_SHORTEST} dots or more, and more than {2 * _THICKNESS_MM:g} mm"
        )


def _bar(
    family: CodeFamily, length_mm: float, dot_mm: float, cross_pair: bool
) -> tuple[Marks, Placement]:
    """Marks and places in the bar's frame: x along it, -y towards cameras 1-2."""
    half = 0.5 * length_mm
    across = 0.5 * _THICKNESS_MM
    if cross_pair:  # the distance runs through the bar
        points, ends = [1, 4], [-1.0, 1.0]
        sides = np.array([-1.0, 1.0])
        half = 0.5 * np.sqrt(length_mm**2 - _THICKNESS_MM**2)
    else:
        points, ends = [1, 2, 3, 4], [-1.0, 1.0, -1.0, 1.0]
        sides = np.array([-1.0, -1.0, 1.0, 1.0])
    zero = np.zeros(len(points))
    own = placement(
        np.column_stack([half * np.array(ends), across * sides, zero]),
        np.column_stack([zero, sides, zero]),
        np.array([[1.0, 0.0, 0.0]]),
    )
    marks = targets(family, points, [True] * len(points), 0.5 * dot_mm)
    inner = half - 3.5 * dot_mm  # the beam ends where the targets' stickers begin
    x = np.linspace(-inner, inner, _BEAM_PARTS)
    size = 0.5 * (x[1] - x[0])
    beam, places = [], []
    for side in (-1.0, 1.0):
        beam.append(bodies(marks, [size] * len(x), [0.55] * len(x), square=True))
        normal = np.tile([0.0, side, 0.0], (len(x), 1))
        centre = np.column_stack([x, 0 * x + across * side, 0 * x])
        places.append(placement(centre, normal, np.array([[1.0, 0.0, 0.0]])))
    return join(*beam, marks), join_placements(*places, own)


class _Way:
    """A closed smooth curve through the volume, travelled at the chosen speeds."""

    def __init__(self, speeds: FloatArray, tilt_deg: float, seed: int) -> None:
        self._phase = np.random.default_rng([seed, 7]).uniform(0, 2 * np.pi, 4)
        self._tilt = np.radians(tilt_deg)
        u = np.linspace(0, 1, 4001)
        step = np.linalg.norm(np.diff(self._middle(u), axis=0), axis=1)
        way = np.concatenate([[0], np.cumsum(step)])
        # Speed over the way: from one chosen speed to the next, evenly.
        speed = np.interp(
            way / way[-1],
            np.linspace(0, 1, max(len(speeds), 2)),
            speeds if len(speeds) > 1 else np.repeat(speeds, 2),
        )
        time = np.concatenate([[0], np.cumsum(step * 0.5 * (1 / speed[1:] + 1 / speed[:-1]))])
        self._u, self._time = u, time
        self.duration_s = float(time[-1])

    def _middle(self, u: FloatArray) -> FloatArray:
        a = 2 * np.pi * u[:, None]
        turns = np.array([[2.0, 3.0, 1.0]])
        return np.array(VOLUME_MM) * np.sin(turns * a + self._phase[:3])

    def pose(self, time_s: float) -> tuple[FloatArray, FloatArray]:
        """lab_from_bar."""
        u = np.interp(time_s, self._time, self._u)
        # The derivative carries the motion beyond both ends (half an exposure).
        outside = time_s - float(np.clip(time_s, 0.0, self.duration_s))
        if outside:
            k = 0 if outside < 0 else -2
            rate = (self._u[k + 1] - self._u[k]) / (self._time[k + 1] - self._time[k])
            u = u + outside * rate
        a = 2 * np.pi * u
        roll = a + self._phase[3]
        tip = self._tilt * np.array([np.sin(3 * a), 0.0, np.cos(2 * a)])
        rotation = rotation_from_vector(tip) @ rotation_from_vector(np.array([0.0, roll, 0.0]))
        return rotation, self._middle(np.array([u]))[0]
