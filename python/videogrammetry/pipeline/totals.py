"""What can be said of all stages of a measurement together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from videogrammetry.errors import MeasurementError
from videogrammetry.matching import TARGET_STATUS
from videogrammetry.pipeline.chunk_record import ChunkRecord
from videogrammetry.pipeline.circle_size import size_remark
from videogrammetry.types import IntArray

#: Fewer coded targets than this with a partner by ID say nothing of the rig.
_MIN_CODED = 8
#: Stages with a remark of their own that are named one by one.
_MOST_NAMED = 20


class Totals:
    """Counts over the records of a measurement, added in the order of the stages.

    ``targets`` (S, C) seen and ``coded_ends`` (S, C, 2), see :class:`ChunkRecord`.
    """

    def __init__(self) -> None:
        self._stage: list[IntArray] = []
        self._targets: list[IntArray] = []
        self._ends: list[IntArray] = []
        self._sizes: list[Any] = []
        self.status = np.zeros(len(TARGET_STATUS), dtype=np.int64)
        self.size_checked = self.without_normal = 0
        self.circles_asked = False
        self.corrected = self.not_corrected = 0
        self.largest_px = 0.0

    def add(self, record: ChunkRecord) -> None:
        """Counts the next stages."""
        self._stage.append(record.stage)
        self._targets.append(record.target_count)
        self._ends.append(record.coded_ends)
        self._sizes.append(record.size_mm)
        self.status += np.bincount(record.match_status, minlength=len(self.status))
        self.size_checked += record.size_checked
        self.without_normal += record.without_normal
        eccentricity = record.eccentricity_px
        self.circles_asked |= len(eccentricity) > 0
        known = np.isfinite(eccentricity)
        self.corrected += int(known.sum())
        self.not_corrected += int((~known).sum())
        self.largest_px = max(self.largest_px, float(eccentricity[known].max(initial=0.0)))

    @property
    def stage(self) -> IntArray:
        """(S,) numbers of the stages."""
        return np.concatenate(self._stage)

    @property
    def targets(self) -> IntArray:
        """(S, C) targets seen."""
        return np.concatenate(self._targets)

    @property
    def coded_ends(self) -> IntArray:
        """(S, C, 2) coded targets that met the rays of their ID, and that did not."""
        return np.concatenate(self._ends)

    def status_counts(self) -> dict[str, int]:
        """How many targets of all stages came to which end."""
        counts = zip(TARGET_STATUS, self.status.tolist(), strict=True)
        return {name: count for name, count in counts if count}

    def circles(self) -> dict[str, Any] | None:
        """Counts of corrected points and the largest eccentricity; None: none was asked for."""
        if not self.circles_asked:
            return None
        return {
            "corrected": self.corrected,
            "not_corrected": self.not_corrected,
            "largest_px": self.largest_px,
        }

    def size_remark(self, diameter_mm: float | None) -> str | None:
        """What to say if many sightings were left out for their size."""
        if diameter_mm is None:
            return None
        return size_remark(self.size_checked, np.concatenate(self._sizes), diameter_mm)


def refuse_senseless(totals: Totals) -> None:
    """MeasurementError if the rays of equal IDs do not meet: rig and pictures do not fit."""
    met, missed = totals.coded_ends.sum(axis=(0, 1)).tolist()
    if missed >= _MIN_CODED and missed > met:
        raise MeasurementError(
            f"of {met + missed} coded targets seen by several cameras, the rays of {missed} do not "
            "meet those of the same ID: the rig is not that of these sequences, the cameras are "
            "not synchronous (a frame missing at the start?) or stand in another order"
        )


def stage_warnings(
    totals: Totals, cameras: Sequence[str], diameter_mm: float | None = None
) -> list[str]:
    """Stages, cameras whose coded targets do not meet, though those of the others do; empty
    pictures; many targets of another size than ``diameter_mm``; circles not corrected.
    """
    warnings = _empty_pictures(totals, cameras) + _strangers(totals, cameras)
    remark = totals.size_remark(diameter_mm)
    if remark is not None:
        warnings.append(remark)
    return warnings + _circle_remarks(totals, diameter_mm) + _odd_stages(totals)


def _odd_stages(totals: Totals) -> list[str]:
    met, missed = np.moveaxis(totals.coded_ends.sum(axis=1), 1, 0)
    odd = np.flatnonzero((missed >= _MIN_CODED) & (missed > met))
    warnings = [
        f"stage {totals.stage[row]}: the rays of {missed[row]} coded targets do not meet those of "
        f"the same ID, {met[row]} do: is a frame of a camera missing or late here?"
        for row in odd[:_MOST_NAMED].tolist()
    ]
    if len(odd) > _MOST_NAMED:
        warnings.append(
            f"{len(odd) - _MOST_NAMED} further stages are like these, the last of them stage "
            f"{totals.stage[odd[-1]]}"
        )
    return warnings


def _strangers(totals: Totals, cameras: Sequence[str]) -> list[str]:
    """Cameras most of whose coded targets do not meet the others', though the rest do."""
    ends = totals.coded_ends.sum(axis=0)
    strange = [
        (name, met, missed)
        for name, (met, missed) in zip(cameras, ends.tolist(), strict=True)
        if missed >= _MIN_CODED and missed > met
    ]
    if not strange:
        return []
    said = ", ".join(f"{name!r} ({missed} of {met + missed})" for name, met, missed in strange)
    return [
        f"the rays of most coded targets of the cameras {said} do not meet those of the same ID in "
        "other cameras: do these cameras stand in another order than in the rig, were they moved, "
        "or are they not synchronous?"
    ]


def _empty_pictures(totals: Totals, cameras: Sequence[str]) -> list[str]:
    """Cameras that see nothing at single stages, or at all."""
    count, stage = totals.targets, totals.stage
    warnings = []
    for c, name in enumerate(cameras):
        empty = stage[count[:, c] == 0].tolist()
        if len(empty) == len(stage):
            warnings.append(
                f"camera {name!r}: no target at all at any of the {len(stage)} stages: look at its "
                "pictures with `videogrammetry recognize --overlay DIR`"
            )
        elif empty:
            some = ", ".join(map(str, empty[:10])) + (", ..." if len(empty) > 10 else "")
            warnings.append(
                f"camera {name!r}: no target at all at {len(empty)} of {len(stage)} stages "
                f"({some}): are its pictures empty there?"
            )
    return warnings


def _circle_remarks(totals: Totals, diameter_mm: float | None) -> list[str]:
    """A sentence for points that could not be corrected, or not be moved by the thickness."""
    remarks = []
    if diameter_mm is not None and totals.not_corrected:
        remarks.append(
            f"{totals.not_corrected} of {totals.corrected + totals.not_corrected} positions are "
            "not corrected for the eccentricity of their ellipses: no ellipse said how the circle "
            "is turned"
        )
    if totals.without_normal:
        remarks.append(
            f"{totals.without_normal} positions are left out: [targets] thickness_mm moves points "
            "along their normals, and no ellipse said how the circle is turned"
        )
    return remarks


def nothing_measured(totals: Totals, diameter_mm: float | None = None) -> str:
    """Why a measurement has no point, and what to do."""
    counts = totals.status_counts()
    if not counts:
        return (
            f"no target was recognised in any of the {len(totals.stage)} stages: look at the "
            "pictures with `videogrammetry recognize --overlay DIR`, and check polarity and "
            "diameter_px in [targets]"
        )
    remark = totals.size_remark(diameter_mm)
    if remark is not None:
        return f"no point is left: {remark}"
    found = ", ".join(f"{count} {name}" for name, count in counts.items())
    return (
        f"targets were recognised but none could be matched between cameras ({found}): is the rig "
        "that of these sequences, are the cameras synchronous and in the right order?"
    )
