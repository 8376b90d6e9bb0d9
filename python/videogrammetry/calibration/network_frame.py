"""Scale and frame of a block: known points, scale bars, or the first picture."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from videogrammetry.adjustment import principal_extents
from videogrammetry.calibration.network_input import NetworkInput
from videogrammetry.calibration.network_rays import BoolArray
from videogrammetry.errors import CalibrationError
from videogrammetry.geometry import fit_similarity
from videogrammetry.types import FloatArray

#: Triples of points that a fit tries: all of nine points.
_MAX_TRIPLES = 84


@dataclass(frozen=True, kw_only=True)
class Similarity:
    """x_in_a = scale * rotation @ x_in_b + translation; ``rms``: 3-D, of the inliers, in a."""

    scale: float
    rotation: FloatArray
    translation: FloatArray
    rms: float
    inlier: BoolArray

    def points(self, points_in_b: FloatArray) -> FloatArray:
        """Points (N, 3) of b in a."""
        result: FloatArray = self.scale * points_in_b @ self.rotation.T + self.translation
        return result

    def poses(self, rotation: FloatArray, translation: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Poses cam_from_b (I, 3, 3), (I, 3) as cam_from_a, lengths in a's unit."""
        turned = rotation @ self.rotation.T
        return turned, self.scale * translation - turned @ self.translation


def robust_similarity(in_a: FloatArray, in_b: FloatArray, *, mirrored: bool = False) -> Similarity:
    """The similarity of corresponding points (N, 3), robust against a few wrong ones.

    Least squares of the points that the best triple agrees with: within three times the
    median distance and a hundredth of the extent. ``mirrored``: with a reflection, to see
    whether one coordinate's sign is wrong.

    Examples
    --------
    >>> a = np.array([[0.0, 0, 0], [2, 0, 0], [0, 2, 0], [0, 0, 2]])
    >>> round(robust_similarity(a, 0.5 * a).scale, 6)
    2.0
    """
    triples = list(combinations(range(len(in_a)), 3))
    if len(triples) > _MAX_TRIPLES:
        chosen = np.random.default_rng(1).choice(len(triples), _MAX_TRIPLES, replace=False)
        triples = [triples[k] for k in chosen]
    best, best_cost = np.ones(len(in_a), bool), np.inf
    extent = float(np.linalg.norm(np.ptp(in_a, axis=0)))
    for triple in triples:
        index = list(triple)
        if principal_extents(in_b[index])[1] < 0.05:
            continue
        _, distance = _fit(in_a, in_b, np.isin(np.arange(len(in_a)), index), mirrored)
        cost = float(np.median(distance)) if len(in_a) > 3 else float(distance.sum())
        if cost < best_cost:
            best_cost = cost
            best = distance <= max(3.0 * cost, 0.01 * extent)
    if best.sum() < 3:
        best = np.ones(len(in_a), bool)
    fit, distance = _fit(in_a, in_b, best, mirrored)
    return replace(fit, rms=float(np.sqrt(np.mean(distance[best] ** 2))))


def _fit(
    in_a: FloatArray, in_b: FloatArray, used: BoolArray, mirrored: bool
) -> tuple[Similarity, FloatArray]:
    """The least-squares similarity of the points ``used``, and all points' distances from it."""
    scale, rotation, translation, rms = fit_similarity(in_a[used], in_b[used], mirrored=mirrored)
    fit = Similarity(scale=scale, rotation=rotation, translation=translation, rms=rms, inlier=used)
    return fit, np.linalg.norm(fit.points(in_b) - in_a, axis=1)


def frame_on_known(position: FloatArray, network: NetworkInput) -> Similarity | None:
    """known_from_block where three known points off one line are placed, else None.

    Raises
    ------
    CalibrationError : the known points fit mirrored only: they are left-handed.
    """
    points = network.points
    known = (points.kind != "free") & np.isfinite(points.position_mm).all(axis=1)
    known &= np.isfinite(position).all(axis=1)
    if known.sum() < 3 or principal_extents(points.position_mm[known])[1] < 0.01:
        return None
    target, found = points.position_mm[known], position[known]
    fit = robust_similarity(target, found)
    if principal_extents(target)[2] > 0.02:
        mirrored = robust_similarity(target, found, mirrored=True)
        more = int(mirrored.inlier.sum()) - int(fit.inlier.sum())
        # (three points are their own mirror image: what counts is how many agree)
        if more > 0 or (more == 0 and mirrored.rms < fit.rms / 3.0):
            raise CalibrationError(
                f"the mirror image of the known points fits the pictures ({mirrored.rms:.3g} mm), "
                f"the points themselves do not ({fit.rms:.3g} mm): their coordinates are "
                "left-handed, or the pictures are mirrored; change the sign of one coordinate of "
                "all known points, or mirror the pictures back"
            )
    return fit


def scale_from_bars(position: FloatArray, network: NetworkInput) -> float | None:
    """mm per unit of the block, the bars' median; None where no bar has both ends placed."""
    bars = network.scale_bars
    if len(bars) == 0:
        return None
    length = np.linalg.norm(position[bars.point_a] - position[bars.point_b], axis=1)
    ratio = bars.length_mm[length > 0] / length[length > 0]
    return float(np.median(ratio)) if len(ratio) else None
