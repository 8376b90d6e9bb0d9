"""What views of space share: their axes, the cameras' pyramids, a stage's row."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from videogrammetry.types import FloatArray, IntArray, RigData


@dataclass(frozen=True, kw_only=True)
class Scene:
    """How the measured space is looked at, and what stands in it besides the points.

    Attributes
    ----------
    up : (3,) direction against gravity in the measurement's frame. The default
        is that of a level camera (y down).
    away : (3,) direction of view of the front view: from camera 1 to the
        object. What of it is along ``up`` is left out.
    ground_mm : (3,) any point of the ground, a plane across ``up``; None = none.
    outline_mm : lines (N, 3) of the object at the reference stage, such as the
        two circles of a tyre. Drawn at other stages moved with the centroid and
        pressed flat where they would be below the ground; not measured.
    """

    up: Sequence[float] = (0.0, -1.0, 0.0)
    away: Sequence[float] = (0.0, 0.0, 1.0)
    ground_mm: Sequence[float] | FloatArray | None = None
    outline_mm: Sequence[FloatArray] = ()

    def axes(self) -> FloatArray:
        """(3, 3): rows right, up and away as unit vectors of the measurement's frame.

        Raises
        ------
        ValueError
            If ``up`` is zero or ``away`` is along it.

        Examples
        --------
        >>> (Scene().axes() + 0.0).tolist()
        [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]]
        """
        up = np.asarray(self.up, dtype=float)
        if not np.linalg.norm(up) > 0:
            raise ValueError(f"up: expected a direction, got {list(self.up)}")
        up = up / np.linalg.norm(up)
        away = np.asarray(self.away, dtype=float)
        away = away - (away @ up) * up
        if not np.linalg.norm(away) > 1e-9:
            raise ValueError(f"away: {list(self.away)} is along up, {list(self.up)}")
        away = away / np.linalg.norm(away)
        return np.stack([np.cross(away, up), up, away])

    def side_axes(self, view: str) -> FloatArray:
        """(3, 3): rows to the right, upwards and away from the viewer of a view.

        ``front`` is seen from camera 1's side; ``right`` from its right: what is
        away from camera 1 is then on the right.

        Raises
        ------
        ValueError
            If there is no such view.
        """
        right, up, away = self.axes()
        if view == "front":
            return np.stack([right, up, away])
        if view == "right":
            return np.stack([away, up, -right])
        raise ValueError(f"view: expected 'front' or 'right', got {view!r}")

    def ground_height_mm(self) -> float | None:
        """Height of the ground, along ``up`` from the frame's origin."""
        if self.ground_mm is None:
            return None
        return float(self.axes()[1] @ np.asarray(self.ground_mm, dtype=float))

    def outline_at(self, moved_mm: FloatArray) -> list[FloatArray]:
        """The outline after the centroid's displacement, pressed flat on the ground."""
        up, ground = self.axes()[1], self.ground_height_mm()
        lines = []
        for line in self.outline_mm:
            there = np.asarray(line, dtype=float) + moved_mm
            if ground is not None:
                there = there + np.maximum(0.0, ground - there @ up)[:, None] * up
            lines.append(there)
        return lines


def row_of_stage(stages: IntArray, stage: int) -> int:
    """The row of a stage.

    Raises
    ------
    ValueError
        If it was not measured.
    """
    rows = np.flatnonzero(stages == stage)
    if not len(rows):
        raise ValueError(f"stage: {stage} was not measured; it has {stages[0]} to {stages[-1]}")
    return int(rows[0])


_CORNERS = ((-1, -1), (1, -1), (1, 1), (-1, 1))


def camera_pyramids(rig: RigData, points: FloatArray) -> list[tuple[str, FloatArray]]:
    """Apex and four corners of each camera's field, a tenth of the way to the object."""
    pyramids = []
    middle = points.mean(axis=0)
    for name, camera in rig.cameras.items():
        centre = camera.centre_mm
        reach = 0.12 * float(np.linalg.norm(middle - centre))
        width, height = camera.image_size_px
        f = camera.interior[0]
        corners = np.array([[sx * width / 2 / f, sy * height / 2 / f, 1.0] for sx, sy in _CORNERS])
        pyramids.append((name, np.vstack([centre, centre + reach * corners @ camera.rotation])))
    return pyramids
