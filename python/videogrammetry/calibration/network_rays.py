"""Intersection of rays of which some may belong to other points."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from videogrammetry.types import FloatArray

BoolArray = npt.NDArray[np.bool_]
#: Indices of rows, whatever made them.
RowArray = npt.NDArray[np.integer[Any]]

#: Pairs of rays that are tried: of 12 one is without a wrong ray with 1 - 1e-3
#: even where a third of the rays is wrong.
_MAX_PAIRS = 15


def intersect_rays(
    centre: FloatArray, direction: FloatArray, f_px: FloatArray, gate_px: float, min_angle: float
) -> FloatArray:
    """The points nearest to most of their rays; NaN where none meet well.

    The intersections of pairs of rays are judged by sum min(e, gate)^2 with e =
    f |v - (v.d) d| / (v.d), v from the centre to the point; then the agreeing rays
    together: sum w |(I - d d')(X - C)|^2 = min, w = (f / depth)^2.

    Parameters
    ----------
    centre, direction : (P, K, 3) projection centres and unit directions of each point's
        rays, one frame; NaN where a point has fewer than K.
    f_px : (P, K) principal distances.
    gate_px : a ray further off belongs to another point.
    min_angle : rad; the agreeing rays must span it.

    Returns
    -------
    (P, 3) points.

    Examples
    --------
    >>> centre = np.array([[[-1.0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    >>> direction = np.array([[[1.0, 0, 5], [-1, 0, 5], [0, -1, 5]]]) / np.sqrt(26.0)
    >>> point = intersect_rays(centre, direction, np.full((1, 3), 1000.0), 2.0, 0.03)
    >>> bool(np.allclose(point, [0, 0, 5]))
    True
    """
    result = np.full((len(centre), 3), np.nan)
    there: BoolArray = np.asarray(
        np.isfinite(direction).all(axis=2) & np.isfinite(centre).all(axis=2)
    )
    if centre.shape[1] < 2:
        return result
    direction, centre = np.where(there[..., None], direction, 0.0), np.nan_to_num(centre)
    first, second, chosen = _widest_pairs(direction, there, min_angle)
    rows = np.flatnonzero(chosen.any(axis=1))
    # What has no pair at all is left out of everything that follows.
    centre, direction, f_px, there = centre[rows], direction[rows], f_px[rows], there[rows]
    first, second, chosen = first[rows], second[rows], chosen[rows]
    each = np.arange(len(rows))
    points = _midpoints(centre, direction, first, second)
    distance = _distance_px(points, centre, direction, f_px, there)
    cost = (np.minimum(distance, gate_px) ** 2).sum(axis=2)
    best = np.where(chosen, cost, np.inf).argmin(axis=1)
    near = distance[each, best] < gate_px
    point = points[each, best]
    for _ in range(2):
        good = np.flatnonzero((near.sum(axis=1) >= 2) & _spans(direction, near, min_angle))
        rows, point, near, there = rows[good], point[good], near[good], there[good]
        centre, direction, f_px = centre[good], direction[good], f_px[good]
        if len(rows) == 0:
            return result
        point = _nearest(point, centre, direction, f_px, near)
        near = _distance_px(point[:, None], centre, direction, f_px, there)[:, 0] < gate_px
    met = near.sum(axis=1) >= 2
    result[rows[met]] = point[met]
    return result


def _widest_pairs(
    direction: FloatArray, there: BoolArray, min_angle: float
) -> tuple[RowArray, RowArray, BoolArray]:
    """(P, Q) first and second rays of up to 15 pairs a point, and which are pairs."""
    num_points, num_rays = there.shape
    a, b = np.triu_indices(num_rays, 1)
    if len(a) > 400:  # many rays: every pair is more than is needed
        drawn = np.random.default_rng(1).choice(len(a), 400, replace=False)
        a, b = a[drawn], b[drawn]
    cosine = np.einsum("pmi,pmi->pm", direction[:, a], direction[:, b])
    sine = np.sqrt(np.maximum(1.0 - cosine**2, 0.0))
    sine[~(there[:, a] & there[:, b])] = 0.0
    # The widest first, but no ray in more than a few of them.
    order = np.argsort(-sine, axis=1, kind="stable")
    wide = np.take_along_axis(sine, order, axis=1) > 0.5 * np.sin(min_angle)
    limit = np.maximum(3, 2 * _MAX_PAIRS // np.maximum(there.sum(axis=1), 1))
    each, uses = np.arange(num_points), np.zeros((num_points, num_rays), int)
    size = min(_MAX_PAIRS, len(a))
    kept, count = np.zeros((num_points, size), int), np.zeros(num_points, int)
    for rank in range(int(wide.sum(axis=1).max(initial=0))):
        pair = order[:, rank]
        take = wide[:, rank] & (count < size)
        if not take.any():
            break
        take &= (uses[each, a[pair]] < limit) & (uses[each, b[pair]] < limit)
        rows, pair = each[take], pair[take]
        kept[rows, count[rows]] = pair
        count[rows] += 1
        uses[rows, a[pair]] += 1
        uses[rows, b[pair]] += 1
    return a[kept], b[kept], np.arange(size) < count[:, None]


def _midpoints(
    centre: FloatArray, direction: FloatArray, first: RowArray, second: RowArray
) -> FloatArray:
    """(P, Q, 3) middle of the shortest link of two rays."""
    each = np.arange(len(centre))[:, None]
    u, v = direction[each, first], direction[each, second]
    w = centre[each, second] - centre[each, first]
    b = np.sum(u * v, axis=2)
    d, e = np.sum(u * w, axis=2), np.sum(v * w, axis=2)
    across = np.maximum(1 - b * b, 1e-300)  # (0 of two rays that are none)
    along_u, along_v = (d - b * e) / across, (b * d - e) / across
    result: FloatArray = 0.5 * (
        centre[each, first] + along_u[..., None] * u + centre[each, second] + along_v[..., None] * v
    )
    return result


def _distance_px(
    points: FloatArray,
    centre: FloatArray,
    direction: FloatArray,
    f_px: FloatArray,
    there: BoolArray,
) -> FloatArray:
    """(P, Q, K) distance of Q points from K rays in the picture; inf behind the camera."""
    v = points[:, :, None] - centre[:, None]
    depth = np.einsum("pqki,pki->pqk", v, direction)
    v -= depth[..., None] * direction[:, None]
    across = np.sqrt(np.einsum("pqki,pqki->pqk", v, v))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where((depth > 0) & there[:, None], f_px[:, None] * across / depth, np.inf)


def _spans(direction: FloatArray, near: BoolArray, min_angle: float) -> BoolArray:
    """(P,) whether the near rays of a point span the angle."""
    middle = np.sum(direction * near[..., None], axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    cosine = np.where(near, np.einsum("pki,pi->pk", direction, middle), np.inf)
    widest = direction[np.arange(len(direction)), cosine.argmin(axis=1)]
    apart = np.where(near, np.einsum("pki,pi->pk", direction, widest), np.inf)
    result: BoolArray = apart.min(axis=1) < np.cos(min_angle)
    return result


def _nearest(
    start: FloatArray, centre: FloatArray, direction: FloatArray, f_px: FloatArray, near: BoolArray
) -> FloatArray:
    depth = np.einsum("pki,pki->pk", start[:, None] - centre, direction)
    weight = np.where(near, (f_px / np.maximum(depth, 1e-9)) ** 2, 0.0)
    along = np.einsum("pki,pki->pk", centre, direction)
    normal = np.einsum("pk,ij->pij", weight, np.eye(3))
    normal -= np.einsum("pk,pki,pkj->pij", weight, direction, direction)
    right = np.einsum("pk,pki->pi", weight, centre - along[..., None] * direction)
    result: FloatArray = np.linalg.solve(normal, right[..., None])[..., 0]
    return result


def agreeing(
    point: FloatArray,
    centre: FloatArray,
    direction: FloatArray,
    f_px: FloatArray,
    gate_px: float,
) -> BoolArray:
    """(K,) whether a ray passes the point within the gate."""
    there = np.asarray(np.isfinite(direction).all(axis=1))[None]
    distance = _distance_px(point[None, None], centre[None], direction[None], f_px[None], there)
    result: BoolArray = distance[0, 0] < gate_px
    return result
