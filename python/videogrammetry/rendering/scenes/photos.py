"""Photographs of the standing cross: a hand-held camera goes round it.

Stations every 45 degrees (or another step) at several heights, every third
picture rolled by 90 degrees. Coded
targets on tilted boards and on the floor are seen from neighbouring stations
and so tie the cross's two sides together; two scale bars stand beside it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from videogrammetry.geometry import default_r0_px
from videogrammetry.recognition import CodeFamily
from videogrammetry.rendering.scene import SceneTargets
from videogrammetry.rendering.scenes.base import (
    Marks,
    Placement,
    Scene,
    join,
    join_placements,
    placement,
    targets,
)
from videogrammetry.rendering.scenes.cross import NUM_CODED, CrossTarget, cross_target
from videogrammetry.types import FloatArray, RigCamera, RigData

#: f, x0, y0, A1, A2, A3, B1, B2, E1, E2 of the hand-held camera, px.
INTERIOR = (2600.0, 14.0, -9.0, -2.4e-8, 2.5e-15, 0.0, 3.0e-7, -2.0e-7, 0.0, 0.0)
IMAGE_SIZE_PX = (2592, 1728)
HEIGHTS_MM = (500.0, 1400.0, 2400.0)
_CROSS_HEIGHT_MM = 1050.0
_BOARDS, _BOARD_RADIUS_MM, _FLOOR_RADIUS_MM = 8, 1150.0, 800.0
#: Lengths of the two bars and their standard deviation, mm.
BARS_MM, BAR_SIGMA_MM = (1000.214, 1000.087), 0.01
_FARTHEST_MM = 50000.0


@dataclass(frozen=True, kw_only=True)
class PhotoScene:
    """Photographs: one camera at many stations before a still object.

    Attributes
    ----------
    cameras : picture's name -> interior and exterior orientation; the world is
        the cross's own frame.
    marks, place : what stands there. cross : the target to be measured.
    bars : (point, point, length_mm) of the scale bars.
    """

    cameras: Mapping[str, RigCamera]
    marks: Marks
    place: Placement
    cross: CrossTarget
    bars: Sequence[tuple[int, int, float]]
    facts: Mapping[str, Any] = field(default_factory=dict)

    def targets(self) -> SceneTargets:
        """What is photographed."""
        return self.as_scene().targets(0.0)

    def as_scene(self) -> Scene:
        """The same as one stage of as many cameras as there are pictures."""
        return Scene(
            name="target-photos",
            rig=RigData(cameras=self.cameras, reference="the cross's own frame"),
            marks=self.marks,
            place=lambda _: self.place,
            num_stages=1,
            frame_rate_hz=1.0,
            still=True,
            facts=self.facts,
        )


def photos_scene(
    family: CodeFamily,
    *,
    cross: CrossTarget | None = None,
    heights_mm: Sequence[float] = HEIGHTS_MM,
    step_deg: float = 45.0,
    distance_mm: float = 3200.0,
    image_size_px: tuple[int, int] = IMAGE_SIZE_PX,
    seed: int = 0,
) -> PhotoScene:
    """The cross, boards, floor targets and bars, and stations all round at several heights.

    Raises
    ------
    ValueError
        An option is impossible.
    """
    if not 5 <= step_deg <= 180:
        raise ValueError(f"step: expected 5 ... 180 degrees between stations, got {step_deg:g}")
    if not 2000 <= distance_mm <= _FARTHEST_MM:
        raise ValueError(
            f"distance: expected 2000 mm (nearer, the camera would stand among the boards) to "
            f"{_FARTHEST_MM:g} mm, got {distance_mm:g} mm"
        )
    if not heights_mm or not all(0 < height <= _FARTHEST_MM for height in heights_mm):
        raise ValueError(
            f"heights: expected numbers over 0 mm (the floor) to {_FARTHEST_MM:g} mm, got "
            f"{[float(h) for h in heights_mm]}"
        )
    if min(image_size_px) < 100 or max(image_size_px) > 20000:
        raise ValueError(
            f"size: expected pictures of 100 to 20000 px a side, got {tuple(image_size_px)}"
        )
    cross = cross or cross_target(family)
    extra, places, bars = _surroundings(family, cross)
    cameras = _stations(heights_mm, step_deg, distance_mm, image_size_px, seed)
    count = len(cameras) // len(heights_mm)
    return PhotoScene(
        cameras=cameras,
        marks=join(cross.marks, extra),
        place=join_placements(cross.place, places),
        cross=cross,
        bars=bars,
        facts={"stations": count, "heights_mm": list(heights_mm), "bars_mm": list(BARS_MM)},
    )


def _stations(
    heights_mm: Sequence[float],
    step_deg: float,
    distance_mm: float,
    image_size_px: tuple[int, int],
    seed: int,
) -> dict[str, RigCamera]:
    """A hand's cameras: nearly at the heights and directions asked for, nearly upright or rolled.

    The world is the cross's frame: x right, y down, z away from the front.
    """
    down = _CROSS_HEIGHT_MM
    rng = np.random.default_rng([seed, 11])
    cameras = {}
    count = round(360 / step_deg)
    for h, height in enumerate(heights_mm):
        for k in range(count):
            name = f"photos_{h * count + k + 1:06d}"
            azimuth = np.radians(k * step_deg + 7.0 * h) + rng.normal(0, 0.04)
            stand = np.array(
                [distance_mm * np.sin(azimuth), down - height, -distance_mm * np.cos(azimuth)]
            ) + rng.normal(0, 40.0, 3)
            aim = np.array([0.0, 0.25 * (down - 600.0), 0.0]) + rng.normal(0, 50.0, 3)
            roll = 0.5 * np.pi * ((k + h) % 3 == 0) + rng.normal(0, 0.05)
            cameras[name] = _camera(stand, aim, roll, image_size_px)
    return cameras


def _surroundings(
    family: CodeFamily, cross: CrossTarget
) -> tuple[Marks, Placement, list[tuple[int, int, float]]]:
    """Boards round the cross, targets on the floor, two bars; in the cross's frame."""
    floor, up = _CROSS_HEIGHT_MM, np.array([0.0, -1.0, 0.0])
    centres, normals = [], []
    for k in range(_BOARDS):  # boards lean back by 45 degrees, two targets each
        azimuth = 2 * np.pi * (k + 0.5) / _BOARDS
        out = np.array([np.sin(azimuth), 0.0, -np.cos(azimuth)])
        along = np.array([np.cos(azimuth), 0.0, np.sin(azimuth)])
        for step in (-90.0, 90.0):
            centres.append(_BOARD_RADIUS_MM * out + step * along + [0, floor - 80.0, 0])
            normals.append(out + up)
    for k in range(_BOARDS):
        azimuth = 2 * np.pi * k / _BOARDS
        out = np.array([np.sin(azimuth), 0.0, -np.cos(azimuth)])
        centres.append(_FLOOR_RADIUS_MM * out + [0, floor, 0])
        normals.append(up)
    bars = []
    first = 2 * NUM_CODED + 1
    for k, length in enumerate(BARS_MM):  # one faces the front, one the back, both aslant
        side = -1.0 if k == 0 else 1.0
        middle = np.array([-side * 1000.0, 150.0, side * 150.0])
        lean = np.array([0.25 * side, -1.0, 0.0]) / np.hypot(0.25, 1.0)
        a = first + len(centres)
        centres += [middle - 0.5 * length * lean, middle + 0.5 * length * lean]
        normals += [np.array([0.0, 0.0, side])] * 2
        bars.append((a, a + 1, length))
    ids = list(range(first, first + len(centres)))
    radius = 0.75 * float(cross.marks.radius_mm[0])
    marks = targets(family, ids, [True] * len(ids), radius)
    normal = np.array(normals)
    along = np.cross(normal, [0.3, 0.2, 0.9])
    return marks, placement(np.array(centres), normal, along), bars


def _camera(
    stand_mm: FloatArray, aim_mm: FloatArray, roll: float, size: tuple[int, int]
) -> RigCamera:
    """A camera at ``stand_mm`` that looks at ``aim_mm``, rolled about its axis."""
    forward = aim_mm - stand_mm
    forward = forward / np.linalg.norm(forward)
    right = np.cross([0.0, 1.0, 0.0], forward)  # y is down
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    c, s = np.cos(roll), np.sin(roll)
    rotation = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ rotation
    scale = size[0] / IMAGE_SIZE_PX[0]
    powers = np.array([1, 1, 1, -2, -4, -6, -1, -1, 0, 0])
    return RigCamera(
        image_size_px=size,
        interior=np.array(INTERIOR) * scale**powers,
        r0_px=default_r0_px(size),
        rotation=rotation,
        translation_mm=-rotation @ stand_mm,
    )
