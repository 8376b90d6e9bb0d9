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
) -> FloatArray | None:
    """The point nearest to most rays; None where none meet well.

    The intersections of pairs of rays are judged by sum min(e, gate)^2 with e =
    f |v - (v.d) d| / (v.d), v from the centre to the point; then the agreeing rays
    together: sum w |(I - d d')(X - C)|^2 = min, w = (f / depth)^2.

    Parameters
    ----------
    centre, direction : (K, 3) projection centres and unit directions, one frame.
    f_px : (K,) principal distances.
    gate_px : a ray further off belongs to another point.
    min_angle : rad; the agreeing rays must span it.

    Examples
    --------
    >>> centre = np.array([[-1.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    >>> direction = np.array([[1.0, 0, 5], [-1, 0, 5], [0, -1, 5]]) / np.sqrt(26.0)
    >>> point = intersect_rays(centre, direction, np.full(3, 1000.0), 2.0, 0.03)
    >>> bool(np.allclose(point, [0, 0, 5]))
    True
    """
    finite = np.isfinite(direction).all(axis=1)
    centre, direction, f_px = centre[finite], direction[finite], f_px[finite]
    if len(centre) < 2:
        return None
    first, second = _widest_pairs(direction, min_angle)
    if len(first) == 0:
        return None
    points = _midpoints(centre, direction, first, second)
    distance = _distance_px(points, centre, direction, f_px)
    best = int(np.minimum(distance, gate_px).__pow__(2).sum(axis=1).argmin())
    near = distance[best] < gate_px
    point = points[best]
    for _ in range(2):
        if near.sum() < 2 or not _spans(direction[near], min_angle):
            return None
        point = _nearest(point, centre[near], direction[near], f_px[near])
        near = _distance_px(point[None], centre, direction, f_px)[0] < gate_px
    return point if near.sum() >= 2 else None


def _widest_pairs(direction: FloatArray, min_angle: float) -> tuple[RowArray, RowArray]:
    first, second = np.triu_indices(len(direction), 1)
    if len(first) > 400:  # many rays: every pair is more than is needed
        chosen = np.random.default_rng(1).choice(len(first), 400, replace=False)
        first, second = first[chosen], second[chosen]
    sine = np.linalg.norm(np.cross(direction[first], direction[second]), axis=1)
    # The widest first, but no ray in more than a few of them.
    order = [k for k in np.argsort(-sine, kind="stable") if sine[k] > 0.5 * np.sin(min_angle)]
    uses, kept = np.zeros(len(direction), int), []
    limit = max(3, 2 * _MAX_PAIRS // len(direction))
    for k in order:
        if uses[first[k]] < limit and uses[second[k]] < limit:
            kept.append(k)
            uses[[first[k], second[k]]] += 1
        if len(kept) == _MAX_PAIRS:
            break
    return first[kept], second[kept]


def _midpoints(
    centre: FloatArray, direction: FloatArray, first: RowArray, second: RowArray
) -> FloatArray:
    """Middle of the shortest link of two rays."""
    u, v, w = direction[first], direction[second], centre[second] - centre[first]
    b = np.sum(u * v, axis=1)
    d, e = np.sum(u * w, axis=1), np.sum(v * w, axis=1)
    along_u = (d - b * e) / (1 - b * b)
    along_v = (b * d - e) / (1 - b * b)
    result: FloatArray = 0.5 * (
        centre[first] + along_u[:, None] * u + centre[second] + along_v[:, None] * v
    )
    return result


def _distance_px(
    points: FloatArray, centre: FloatArray, direction: FloatArray, f_px: FloatArray
) -> FloatArray:
    """(P, K) distance of points from rays in the picture; inf behind the camera."""
    v = points[:, None] - centre[None]
    depth = np.einsum("pki,ki->pk", v, direction)
    across = np.linalg.norm(v - depth[..., None] * direction[None], axis=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(depth > 0, f_px * across / depth, np.inf)


def _spans(direction: FloatArray, min_angle: float) -> bool:
    middle = direction.mean(axis=0)
    cosine = direction @ (middle / np.linalg.norm(middle))
    widest = int(cosine.argmin())
    return bool((direction @ direction[widest]).min() < np.cos(min_angle))


def _nearest(
    start: FloatArray, centre: FloatArray, direction: FloatArray, f_px: FloatArray
) -> FloatArray:
    depth = np.sum((start - centre) * direction, axis=1)
    weight = (f_px / np.maximum(depth, 1e-9)) ** 2
    across = np.eye(3) - direction[:, :, None] * direction[:, None, :]
    normal = np.einsum("k,kij->ij", weight, across)
    result: FloatArray = np.linalg.solve(normal, np.einsum("k,kij,kj->i", weight, across, centre))
    return result


def agreeing(
    point: FloatArray,
    centre: FloatArray,
    direction: FloatArray,
    f_px: FloatArray,
    gate_px: float,
) -> BoolArray:
    """(K,) whether a ray passes the point within the gate."""
    result: BoolArray = _distance_px(point[None], centre, direction, f_px)[0] < gate_px
    return result
