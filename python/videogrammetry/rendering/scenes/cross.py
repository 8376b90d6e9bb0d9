"""The two-sided cross target: 16 coded and 33 un-coded points on either side.

The arms are bent (a saddle), because the direct linear transformation needs
points that do not lie in one plane; the two sides lie ``thickness_mm`` apart.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from videogrammetry.recognition import CodeFamily
from videogrammetry.rendering.scenes.base import Marks, Placement, join, placement, targets
from videogrammetry.types import FloatArray, PointSet

NUM_CODED, NUM_UNCODED = 16, 33
_SPAN_MM = 1400.0  # the layout below is for this span


@dataclass(frozen=True, kw_only=True)
class CrossTarget:
    """The target: marks, their places in its own frame, side 0 or 1 of each.

    Side 0 faces -z, side 1 +z of the target's frame; x and y span the cross.
    """

    marks: Marks
    place: Placement
    side: FloatArray

    def points(self) -> PointSet:
        """The points as a table for a project, exact."""
        return PointSet(
            id=self.marks.point,
            position_mm=self.place.centre_mm,
            normal=self.place.normal,
            diameter_mm=2 * self.marks.radius_mm,
        )


def _layout() -> tuple[FloatArray, FloatArray]:
    """Places of the coded and the un-coded points of one side, mm, for the nominal span."""
    coded: list[FloatArray] = []
    plain = [np.zeros(2)]
    for arm in range(4):
        c, s = np.cos(arm * np.pi / 2), np.sin(arm * np.pi / 2)
        turn = np.array([[c, -s], [s, c]])
        coded += [turn @ (r, across) for r in (630.0, 380.0) for across in (-130.0, 130.0)]
        plain += [turn @ (r, 0.0) for r in (120.0, 220.0, 320.0, 420.0, 520.0, 620.0)]
        plain += [turn @ (505.0, across) for across in (-130.0, 130.0)]
    return np.array(coded).round(9), np.array(plain).round(9)


def cross_target(
    family: CodeFamily,
    *,
    span_mm: float = _SPAN_MM,
    dot_mm: float = 40.0,
    depth_mm: float = 120.0,
    thickness_mm: float = 60.0,
) -> CrossTarget:
    """The cross: coded 1 ... 32, un-coded from the family's size + 1 on.

    Parameters
    ----------
    span_mm : from end to end. dot_mm : diameter of the dots.
    depth_mm : how far the arms' ends are bent out of the plane.
    thickness_mm : between the two sides.

    Raises
    ------
    ValueError
        A length is not above 0 mm, the dots do not fit on the cross, or the family
        has too few codes.

    Examples
    --------
    >>> from videogrammetry.recognition import code_family
    >>> cross = cross_target(code_family("schneider-14"))
    >>> len(cross.marks), int((cross.marks.id > 0).sum()), cross.marks.point.max().item()
    (98, 32, 582)
    """
    for name, value in (("span", span_mm), ("dot", dot_mm), ("thickness", thickness_mm)):
        if not 0 < value < np.inf:
            raise ValueError(f"{name}: expected more than 0 mm, got {value:g} mm")
    scale = span_mm / _SPAN_MM
    if dot_mm > 40.0 * scale:
        raise ValueError(
            f"dot: targets of {dot_mm:g} mm overlap on a cross of {span_mm:g} mm, which holds dots "
            f"of up to {40 * scale:g} mm"
        )
    if len(family) < 2 * NUM_CODED:
        raise ValueError(
            f"codes: the cross carries {2 * NUM_CODED} coded targets, {family.name} has only "
            f"{len(family)} codes"
        )
    coded, plain = _layout()
    sides = []
    for side in (0, 1):
        ids = [*range(1 + side * NUM_CODED, 1 + (side + 1) * NUM_CODED)]
        free = len(family) + 1 + side * NUM_UNCODED
        ids += range(free, free + NUM_UNCODED)
        marks = targets(family, ids, [True] * NUM_CODED + [False] * NUM_UNCODED, 0.5 * dot_mm)
        xy = scale * np.concatenate([coded, plain])
        sides.append((marks, _on_saddle(xy, side, 0.5 * span_mm, depth_mm, thickness_mm)))
    return CrossTarget(
        marks=join(*(m for m, _ in sides)),
        place=Placement(
            centre_mm=np.concatenate([p.centre_mm for _, p in sides]),
            normal=np.concatenate([p.normal for _, p in sides]),
            x_axis=np.concatenate([p.x_axis for _, p in sides]),
        ),
        side=np.repeat([0.0, 1.0], NUM_CODED + NUM_UNCODED),
    )


def _on_saddle(
    xy: FloatArray, side: int, half_mm: float, depth_mm: float, thickness_mm: float
) -> Placement:
    """One side's places: z = depth (x^2 - y^2) / half^2, half the thickness to its side."""
    sign = 1.0 if side else -1.0
    x, y = xy.T
    curve = depth_mm / half_mm**2
    centre = np.column_stack([x, y, curve * (x**2 - y**2) + 0.5 * sign * thickness_mm])
    normal = sign * np.column_stack([-2 * curve * x, 2 * curve * y, np.ones(len(x))])
    return placement(centre, normal, np.array([[sign, 0.0, 0.0]]))
