"""Sightings of another size than the stated circles: sectors of rings, dots hidden in part."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from videogrammetry.matching import TARGET_STATUS
from videogrammetry.types import FloatArray, IntArray, Matches, RigData, StagePoints, Targets

#: By how much a circle's measured diameter may differ from the stated one, and how many sigmas.
_TOLERANCE, _SIGMAS = 0.15, 4.0
_ANOTHER_SIZE = TARGET_STATUS.index("another size")
_NO_PARTNER = TARGET_STATUS.index("no partner")


@dataclass(frozen=True, kw_only=True)
class SizeCheck:
    """The size of every sighting of one stage against the circles' diameter.

    Attributes
    ----------
    matches : without the sightings of another size; the given ones where all fit.
    num_checked : sightings whose size could be told.
    measured_mm : (N,) diameters in the object of those left out.
    """

    matches: Matches
    num_checked: int
    measured_mm: FloatArray


def check_size(
    rig: RigData,
    targets: Sequence[Targets],
    matches: Matches,
    points: StagePoints,
    diameter_mm: float,
) -> SizeCheck:
    """Leave out the sightings that are no circles of that diameter at their place.

    In a circle of diameter d at depth z there is always a direction parallel to
    the picture, so its longest diameter there is f d / z at least; and f d / (z
    cos a) at most, the picture of a sphere, at the angle a off the axis. Both to
    second order in d / z.
    """
    target = matches.target.copy()
    status = [s.copy() for s in matches.status]
    rows = _rows_of(matches.target, points.target)
    checked, measured = 0, [np.empty(0)]
    for c, camera in enumerate(rig.cameras.values()):
        seen = np.flatnonzero(points.target[:, c] >= 0)
        index = points.target[seen, c]
        in_cam = points.position_mm[seen] @ camera.rotation.T + camera.translation_mm
        least = 0.5 * camera.interior[0] * diameter_mm / in_cam[:, 2]
        most = least * np.linalg.norm(in_cam, axis=1) / in_cam[:, 2]
        axis = targets[c].semi_axes_px[index, 0]
        off = np.maximum(least - axis, axis - most)
        sigma = np.sqrt(targets[c].cov[index, 2, 2])
        bad = off > _TOLERANCE * least + _SIGMAS * sigma
        target[rows[seen[bad]], c] = -1
        status[c][index[bad]] = _ANOTHER_SIZE
        checked += len(seen)
        measured.append((2 * diameter_mm * axis / (least + most))[bad])
    sizes = np.concatenate(measured)
    if not len(sizes):
        return SizeCheck(matches=matches, num_checked=checked, measured_mm=sizes)
    # A target that has lost its partner has none.
    for row in np.flatnonzero((target >= 0).sum(axis=1) == 1):
        c = int(np.argmax(target[row] >= 0))
        status[c][target[row, c]] = _NO_PARTNER
        target[row, c] = -1
    left = matches.with_targets(target, matches.id, tuple(status))
    return SizeCheck(matches=left, num_checked=checked, measured_mm=sizes)


def _rows_of(matched: IntArray, reconstructed: IntArray) -> npt.NDArray[np.intp]:
    """Where the points' rows of targets stand among the matches', whose order they keep.

    Examples
    --------
    >>> _rows_of(np.array([[0, -1], [1, 0], [-1, 2]]), np.array([[1, 0], [-1, 2]])).tolist()
    [1, 2]
    """
    rows = np.full(len(reconstructed), -1, dtype=np.intp)
    for c in range(matched.shape[1]):
        of_target = np.full(matched[:, c].max(initial=-1) + 1, -1, dtype=np.intp)
        seen = np.flatnonzero(matched[:, c] >= 0)
        of_target[matched[seen, c]] = seen
        here = np.flatnonzero(reconstructed[:, c] >= 0)
        rows[here] = of_target[reconstructed[here, c]]
    return rows


#: From which share of sightings left out on the stated diameter itself is doubted.
_MANY = 0.2


def size_remark(checked: int, sizes: FloatArray, diameter_mm: float) -> str | None:
    """What to say if many of the sightings checked were left out for their sizes (mm)."""
    if len(sizes) <= _MANY * checked:
        return None
    advice = (
        "correct diameter_mm, or leave it out to take targets of every size"
        if len(sizes) > checked / 2
        else "are dots hidden in part, or have the targets several sizes? (then leave it out)"
    )
    return (
        f"{len(sizes)} of {checked} sightings of matched targets were left out, for they have "
        f"another size than circles of [targets] diameter_mm = {diameter_mm:g}: in the middle "
        f"(median) theirs is {np.median(sizes):.3g} mm; {advice}"
    )
