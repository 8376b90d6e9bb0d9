"""What a plan is asked and what it says."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from videogrammetry.accuracy import (
    DistancesPrediction,
    NeededPositions,
    PairGeometry,
    PlacesPrediction,
    Spread,
)
from videogrammetry.calibration import CalibrationDesign
from videogrammetry.geometry import MeasuringVolume
from videogrammetry.reconstruction import Rig
from videogrammetry.types import INTERIOR_NAMES, FloatArray

WANTED_OF = ("distance", "position")


@dataclass(frozen=True, kw_only=True)
class PlanOptions:
    """What is planned; fields as in ``plan.toml``.

    Attributes
    ----------
    positions : of the target; None: the rig's own covariance where it has one, else 16.
    sigma_px : of an image coordinate; None: the rig's largest floor, else 0.05.
    target_sigma_mm : of a coordinate of the target's points.
    target_part, target_tilt_rad, target_whole : how far from the volume's middle and how
        tilted the target is put, and whether it is always whole in the pictures
        (``DesignOptions``).
    free : interior parameters estimated; None: those that the rig has a sigma of,
        else f, x0, y0, A1, B1, B2.
    frame : "volume" or "rig" of a position's uncertainty (``Triangulator``).
    groups : cameras that see a place together; none: all cameras do.
    length_mm : of the distances; None: 1000, or half the largest extent where that is too long.
    wanted_mm, wanted_of : find the positions that reach this at 95 % of the volume, of
        the "distance" or the "position".
    counts : numbers of positions to compare.
    places, section : points along every edge of the volume, and of a section.
    """

    positions: int | None = None
    sigma_px: float | None = None
    target_sigma_mm: float = 0.1
    target_part: float = 1.0
    target_tilt_rad: float = math.radians(45.0)
    target_whole: bool = False
    free: tuple[str, ...] | None = None
    frame: str = "volume"
    groups: tuple[tuple[str, ...], ...] = ()
    length_mm: float | None = None
    wanted_mm: float | None = None
    wanted_of: str = "distance"
    counts: tuple[int, ...] = (8, 16, 24, 32, 48)
    places: int = 11
    section: int = 101

    def __post_init__(self) -> None:
        if self.wanted_of not in WANTED_OF:
            raise ValueError(f"wanted_of: expected {' or '.join(WANTED_OF)}, got {self.wanted_of}")
        for name in ("sigma_px", "target_sigma_mm", "length_mm", "wanted_mm"):
            value = getattr(self, name)
            if value is not None and not 0 < value < math.inf:
                raise ValueError(f"{name}: expected a number above 0, got {value}")
        if self.positions is not None and self.positions < 1:
            raise ValueError(f"positions: expected 1 or more, got {self.positions}")
        unknown = [n for n in self.free or () if n not in INTERIOR_NAMES]
        if unknown:
            raise ValueError(
                f"free: {unknown[0]!r} is no interior parameter: {', '.join(INTERIOR_NAMES)}"
            )


@dataclass(frozen=True, kw_only=True)
class Section:
    """A cut through the volume's middle.

    Attributes
    ----------
    axes : coordinates (0 x, 1 y, 2 z) across, up, and held.
    across_mm, up_mm : (W,), (H,) ascending. inside : (H, W). places : H W of them, by rows.
    """

    axes: tuple[int, int, int]
    across_mm: FloatArray
    up_mm: FloatArray
    inside: np.ndarray[Any, np.dtype[np.bool_]]
    places: PlacesPrediction


@dataclass(frozen=True, kw_only=True)
class CountRow:
    """What some number of positions gives, mm at 95 % of the volume; NaN: not determined.

    ``distance_near_mm``: a distance, calibration alone, if the target is kept near the middle,
    whole in the pictures and hardly tilted.
    """

    count: int
    distance_calibration_mm: float = math.nan
    distance_mm: float = math.nan
    position_calibration_mm: float = math.nan
    position_mm: float = math.nan
    distance_near_mm: float = math.nan

    def columns_mm(self) -> tuple[float, ...]:
        """As tables show them: the distance by the calibration alone, together, near the
        middle; the position by the calibration alone, together.
        """
        return (
            self.distance_calibration_mm,
            self.distance_mm,
            self.distance_near_mm,
            self.position_calibration_mm,
            self.position_mm,
        )


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What was predicted.

    Attributes
    ----------
    rig : with the covariance used. calibrated : whether that is the rig's own.
    design : the simulated calibration, None if the rig's own covariance was used.
    options : with what was chosen where they said nothing.
    statistics : quantity -> source -> spread over the volume.
    part_seen : of the volume, by two cameras or more.
    """

    rig: Rig
    calibrated: bool
    volume: MeasuringVolume
    options: PlanOptions
    target_points: int
    design: CalibrationDesign | None
    places: PlacesPrediction
    distances: DistancesPrediction
    sections: tuple[Section, ...]
    statistics: dict[str, dict[str, Spread]]
    pairs: tuple[PairGeometry, ...]
    counts: tuple[CountRow, ...]
    needed: NeededPositions | None
    part_seen: float
    warnings: tuple[str, ...] = field(default=())
