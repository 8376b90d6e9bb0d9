"""The two sides of a target that was measured from all round, and what ties them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from videogrammetry.calibration.network_result import NetworkAdjustment
from videogrammetry.geometry import vector_from_rotation
from videogrammetry.types import FloatArray, IntArray

BoolArray = npt.NDArray[np.bool_]
#: A point belongs to a side if its mean line of sight is within 60 degrees of the side's.
_FACING = 0.5
#: Fewer points span no side.
_MIN_POINTS = 4
#: With fewer points between the sides their relative place is hardly checked.
MIN_TIES = 6


@dataclass(frozen=True, kw_only=True)
class TwoSides:
    """A two-sided target's sides and the transform between them.

    A side's frame: origin at the mean of its points, z along the outward normal of
    their plane, x along their longest extent (towards the point that is later in the
    table), y = z cross x.

    Attributes
    ----------
    front, back : rows of the points of either side; the front has the first point.
    ties : rows of the points that pictures of both sides see.
    front_from_back : (4, 4); ``cov`` (6, 6): rotation vector on the left (rad), shift (mm).
    """

    front: IntArray
    back: IntArray
    ties: IntArray
    front_from_back: FloatArray
    cov: FloatArray

    @property
    def sigma(self) -> FloatArray:
        """(6,) standard deviations of rotation (rad) and shift (mm)."""
        return np.sqrt(np.diag(self.cov))


def two_sides(result: NetworkAdjustment) -> TwoSides | None:
    """The sides of a network's points by the directions that they were seen from.

    None where the points do not face two opposite ways, or a side has fewer than four.
    """
    sight, seen = _sight(result)
    axis = np.linalg.svd(sight[seen])[2][0] if seen.sum() >= 2 * _MIN_POINTS else np.zeros(3)
    along = sight @ axis
    first = np.flatnonzero(np.abs(along) > _FACING)
    if not len(first):
        return None
    along = along * np.sign(along[first[0]])
    front = np.flatnonzero(along > _FACING).astype(np.int32)
    back = np.flatnonzero(along < -_FACING).astype(np.int32)
    if min(len(front), len(back)) < _MIN_POINTS:
        return None
    positions = result.points.position_mm
    transform = _relative(positions, front, back, sight)
    return TwoSides(
        front=front,
        back=back,
        ties=_ties(result, front, back),
        front_from_back=transform,
        cov=_covariance(result, front, back, sight, transform),
    )


def _sight(result: NetworkAdjustment) -> tuple[FloatArray, BoolArray]:
    """(N, 3) mean unit vectors from points to the centres that see them; (N,) whether any do."""
    o, count = result.observations, len(result.points)
    to_camera = result.images.centre_mm[o.image] - result.points.position_mm[o.point]
    unit = to_camera / np.linalg.norm(to_camera, axis=1)[:, None]
    total = np.zeros((count, 3))
    np.add.at(total, o.point[o.used], unit[o.used])
    number = np.bincount(o.point[o.used], minlength=count)
    return total / np.maximum(number, 1)[:, None], number > 0


def _ties(result: NetworkAdjustment, front: IntArray, back: IntArray) -> IntArray:
    """Points seen both in pictures that see the front and in pictures that see the back."""
    o = result.observations
    sees = {}
    for name, side in (("front", front), ("back", back)):
        mine = o.used & np.isin(o.point, side)
        images = np.flatnonzero(np.bincount(o.image[mine], minlength=len(result.images)) >= 3)
        sees[name] = np.unique(o.point[o.used & np.isin(o.image, images)])
    both: IntArray = np.intersect1d(sees["front"], sees["back"]).astype(np.int32)
    return both


def _side_frame(positions: FloatArray, rows: IntArray, sight: FloatArray) -> FloatArray:
    """(4, 4) world_from_side."""
    points = positions[rows]
    centre = points.mean(axis=0)
    axes = np.linalg.svd(points - centre)[2]
    z = axes[2] * np.sign(axes[2] @ sight[rows].mean(axis=0))
    x = axes[0]
    # Towards later points; a symmetrical row has no such side, its last point decides.
    order = np.arange(len(rows)) - 0.5 * (len(rows) - 1)
    lean = order @ ((points - centre) @ x)
    reach = np.linalg.norm(points - centre, axis=1).max() * np.abs(order).sum()
    x = x * np.sign(lean if abs(lean) > 1e-3 * reach else (points[-1] - centre) @ x)
    frame = np.eye(4)
    frame[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    frame[:3, 3] = centre
    return frame


def _relative(
    positions: FloatArray, front: IntArray, back: IntArray, sight: FloatArray
) -> FloatArray:
    a, b = _side_frame(positions, front, sight), _side_frame(positions, back, sight)
    result: FloatArray = np.linalg.inv(a) @ b
    return result


def _covariance(
    result: NetworkAdjustment,
    front: IntArray,
    back: IntArray,
    sight: FloatArray,
    transform: FloatArray,
) -> FloatArray:
    """Propagated from the points' covariance by differences of the transform."""
    rows = np.concatenate([front, back])
    positions = result.points.position_mm
    extent = np.linalg.norm(np.ptp(positions[rows], axis=0))
    step = 1e-6 * extent
    jacobian = np.empty((6, 3 * len(rows)))
    for k, row in enumerate(rows):
        for axis in range(3):
            change = np.zeros_like(positions)
            change[row, axis] = step
            ahead = _relative(positions + change, front, back, sight)
            behind = _relative(positions - change, front, back, sight)
            turn = vector_from_rotation(ahead[:3, :3] @ behind[:3, :3].T)
            jacobian[:3, 3 * k + axis] = turn / (2 * step)
            jacobian[3:, 3 * k + axis] = (ahead[:3, 3] - behind[:3, 3]) / (2 * step)
    places = (3 * rows[:, None] + np.arange(3)).ravel()
    if result.points.full_cov_mm2 is not None:
        cov = result.points.full_cov_mm2[np.ix_(places, places)]
    else:  # without the correlations it is an estimate on the safe side
        cov = np.zeros((len(places),) * 2)
        for k, row in enumerate(rows):
            cov[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = result.points.cov_mm2[row]
    propagated: FloatArray = jacobian @ cov @ jacobian.T
    return propagated


def two_sides_remark(sides: TwoSides, names: tuple[str, ...]) -> str | None:
    """A warning where little or nothing ties the sides together."""
    inner = np.concatenate([sides.front, sides.back])
    between = np.setdiff1d(sides.ties, inner)
    count = len(sides.ties)
    if count >= MIN_TIES:
        return None
    which = ", ".join(names[i] for i in sides.ties[:8]) or "none"
    return (
        f"the target's two sides ({len(sides.front)} and {len(sides.back)} points) are tied "
        f"together by {count} points only that pictures of both see ({which}; {len(between)} of "
        "them beside the target): their relative place is hardly checked; put coded targets on "
        "tilted boards or on the floor round the target, and photograph it from its edges too"
    )


__all__ = ["MIN_TIES", "TwoSides", "two_sides", "two_sides_remark"]
