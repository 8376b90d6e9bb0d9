"""The falling tyre: free fall, impact, flattening, ringing, rebound.

The tyre's axis is level and points at the pairs of cameras: one side wall is
seen by cameras 1-2, the other by 3-4. In contact the tyre flattens: points
near the ground are pushed up and bulge sideways; after it, the ring swings in
its first mode (two lobes) and dies away.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

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
from videogrammetry.rendering.scenes.drop import Drop
from videogrammetry.rendering.scenes.paper_rig import LabFrame, lab_frame, paper_rig
from videogrammetry.types import FloatArray, RigData

#: Points on the side towards cameras 1-2 and on the other, as in the paper.
FRONT_POINTS, BACK_POINTS = tuple(range(4, 12)), tuple(range(21, 31))
_FLAT_ANGLE = 0.6  # rad: how far from the lowest point the ground is felt
_BULGE = 0.35  # sideways, over the compression
_LOBES = 0.25  # amplitude of the two-lobed mode, over the compression
_RING_HZ, _RING_FADE_PER_S = 30.0, 6.0


@dataclass(frozen=True, kw_only=True)
class Tyre:
    """The tyre and its way.

    ``radius_mm`` outer radius, ``width_mm`` between the side walls, ``points_mm``
    radius of the circle on which the targets stand, ``spin_rad_s`` about the axis.
    The middle's velocity is continuous; that of points near the ground changes
    suddenly at a touch and a release, as where a real tyre meets the ground.
    """

    drop: Drop
    radius_mm: float = 325.0
    width_mm: float = 190.0
    points_mm: float = 255.0
    spin_rad_s: float = 0.0

    def place(
        self, radius: FloatArray, angle: FloatArray, side: FloatArray, t: float
    ) -> FloatArray:
        """Places (N, 3) in the laboratory, about the middle at the touch.

        ``radius`` and ``angle`` (from the right, towards up, at time 0) are those
        of the unloaded tyre; ``side`` is -1 (towards cameras 1-2), 0 or 1.
        """
        turned = angle + self.spin_rad_s * t
        low = np.angle(np.exp(1j * (turned + 0.5 * np.pi)))  # 0 at the lowest point
        pressed = self.drop.compression_mm(t)
        near = (radius / self.radius_mm) ** 4 * np.exp(-((low / _FLAT_ANGLE) ** 2))
        lobes = self._lobes(t) * (radius / self.radius_mm) ** 2 * np.cos(2 * low)
        r = radius + lobes
        return np.column_stack(
            [
                r * np.cos(turned),
                side * (0.5 * self.width_mm + _BULGE * pressed * near),
                self.drop.height_mm(t) + r * np.sin(turned) + pressed * near,
            ]
        )

    def _lobes(self, t: float) -> float:
        """Amplitude of the two-lobed mode: with the load, and ringing after every contact.

        Continuous; its velocity is, too, but for the blow of a touch.
        """
        omega = 2 * math.pi * _RING_HZ
        ringing = sum(
            speed / omega * math.exp(-_RING_FADE_PER_S * past) * math.sin(omega * past)
            for past, speed in self.drop.releases(t)
        )
        return _LOBES * (ringing - self.drop.compression_mm(t))

    def on_surface(
        self, radius: FloatArray, angle: FloatArray, side: FloatArray, t: float
    ) -> Placement:
        """Marks on the deformed side wall: centre, normal and direction of growing radius."""
        dr, da = 0.5, 0.5 / self.points_mm
        out = self.place(radius + dr, angle, side, t) - self.place(radius - dr, angle, side, t)
        round_ = self.place(radius, angle + da, side, t) - self.place(radius, angle - da, side, t)
        normal = np.cross(out, round_)
        facing = np.sign((normal * [0, 1, 0]).sum(axis=1)) * np.where(side == 0, -1.0, side)
        return placement(self.place(radius, angle, side, t), normal * facing[:, None], out)


def tyre_scene(
    family: CodeFamily,
    *,
    num_stages: int = 200,
    frame_rate_hz: float = 250.0,
    exposure_s: float = 200e-6,
    rig: RigData | None = None,
    height_mm: float = 1038.0,
    gravity_m_s2: float = 9.80665,
    speed_mm_s: float = 0.0,
    drag_per_m: float = 0.0,
    spin_deg_s: float = 5.0,
    dot_mm: float = 40.0,
    uncoded: bool = False,
) -> Scene:
    """A tyre of 0.65 m with points 4-11 and 21-30 falls, hits the ground, rebounds.

    With the default height the tyre is released at stage 1, touches the ground
    near stage 116 and is most deformed at stage 120, as in the paper's Fig. 14.

    Parameters
    ----------
    height_mm : of the fall. speed_mm_s : downwards at stage 1.
    gravity_m_s2 : the local g. drag_per_m : k of the drag k v^2, from rest only.
    spin_deg_s : about the axis. dot_mm : diameter of the dots.
    uncoded : plain dots without rings; the points have the same numbers in the truth.

    Raises
    ------
    ValueError
        An option is impossible.
    """
    if not math.isfinite(spin_deg_s):
        raise ValueError(f"spin: expected a number, got {spin_deg_s:g} degrees per second")
    rig = rig or paper_rig()
    lab = lab_frame(rig, tuple(rig.cameras)[:2])
    drop = Drop(
        height_mm,
        gravity_mm_s2=1000 * gravity_m_s2,
        speed_mm_s=speed_mm_s,
        drag_per_mm=drag_per_m / 1000,
    )
    tyre = Tyre(drop=drop, spin_rad_s=math.radians(spin_deg_s))
    marks, radius, angle, side = _marks(family, tyre, dot_mm, uncoded)
    # The middle of the fall stands in the middle of the picture.
    ground = lab.origin_mm - lab.up * 0.5 * height_mm

    def place(time_s: float) -> Placement:
        own = tyre.on_surface(radius, angle, side, time_s)
        both = join_placements(_body(tyre, time_s), own)
        return both.moved(lab.rotation, ground)

    return Scene(
        name="tyre",
        rig=rig,
        marks=marks,
        place=place,
        num_stages=num_stages,
        frame_rate_hz=frame_rate_hz,
        exposure_s=exposure_s,
        facts=_facts(tyre, lab, ground, num_stages, frame_rate_hz, gravity_m_s2, drag_per_m),
    )


def _marks(
    family: CodeFamily, tyre: Tyre, dot_mm: float, uncoded: bool
) -> tuple[Marks, FloatArray, FloatArray, FloatArray]:
    points = [*FRONT_POINTS, *BACK_POINTS]
    coded = [not uncoded] * len(points)
    marks = targets(family, points, coded, 0.5 * dot_mm)
    fits = 2 * tyre.points_mm * math.sin(math.pi / len(BACK_POINTS))
    sticker = float(marks.sticker_mm.max())
    if 2 * sticker > fits or tyre.points_mm + sticker > tyre.radius_mm:
        raise ValueError(
            f"dot: {len(BACK_POINTS)} targets with dots of {dot_mm:g} mm do not fit on a side "
            "wall of this tyre; choose a smaller dot"
        )
    sides = [(FRONT_POINTS, -1.0), (BACK_POINTS, 1.0)]
    angle = np.concatenate([2 * np.pi * (np.arange(len(p)) + 0.25) / len(p) for p, _ in sides])
    side = np.concatenate([np.full(len(p), s) for p, s in sides])
    # A disc for the tyre and one for its rim, each seen from either side.
    size = [tyre.radius_mm, tyre.radius_mm, 0.56 * tyre.radius_mm, 0.56 * tyre.radius_mm]
    body = bodies(marks, size, [0.05, 0.05, 0.3, 0.3], square=False)
    round_ = replace(marks, square=np.zeros(len(marks), dtype=bool))
    return join(body, round_), np.full(len(points), tyre.points_mm), angle, side


def _body(tyre: Tyre, t: float) -> Placement:
    """Discs in the tyre's middle plane: behind all targets, whatever the direction of view."""
    middle = np.array([0.0, 0.0, tyre.drop.height_mm(t)])
    depth = np.array([0.0, 0.0, -0.5, 0.5])  # the rim before the tyre, from either side
    sign = np.array([-1.0, 1.0, -1.0, 1.0])
    centre = middle + np.column_stack([0 * depth, depth, 0 * depth])
    normal = np.column_stack([0 * sign, sign, 0 * sign])
    return placement(centre, normal, np.array([[1.0, 0.0, 0.0]]))


def _facts(
    tyre: Tyre,
    lab: LabFrame,
    ground: FloatArray,
    num_stages: int,
    rate: float,
    gravity_m_s2: float,
    drag_per_m: float,
) -> dict[str, object]:
    last_free = 1 + int(min(num_stages - 1, tyre.drop.touch_s * rate))
    return {
        "up": lab.up.tolist(),
        "ground_mm": (ground - tyre.radius_mm * lab.up).tolist(),
        "radius_mm": tyre.radius_mm,
        "touch_s": tyre.drop.touch_s,
        "free_fall_stages": [1, last_free],
        "gravity_m_s2": gravity_m_s2,
        "drag_per_m": drag_per_m,
        "front_points": list(FRONT_POINTS),
        "back_points": list(BACK_POINTS),
    }
