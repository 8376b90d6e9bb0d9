"""How pictures are turned against the object and against each other: tilts and rolls."""

from __future__ import annotations

import numpy as np

from videogrammetry.types import FloatArray

#: The upright direction is sought among the axes of so many pictures.
_MOST_AXES = 60
#: Looking along it, a picture has no side that is up (cosine).
_ALONG = 0.94


def tilts_and_rolls(cam_from_target: FloatArray, target_mm: FloatArray) -> FloatArray:
    """Tilt and roll of a flat target in pictures.

    R = T Rz(roll): the roll about the camera's axis first, then T, the smallest turn that
    brings the plane's normal, on the side that the camera sees, from the camera's axis to
    where it is. A target seen from behind is first turned by 180 degrees about its y axis.

    Parameters
    ----------
    cam_from_target : (P, 3, 3) rotations.
    target_mm : (N, 3) the target's points; their plane is that of least scatter.

    Returns
    -------
    (P, 2) tilt in [0, pi / 2] and roll in (-pi, pi], rad.

    Examples
    --------
    >>> board = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    >>> c, s = np.cos(0.3), np.sin(0.3)
    >>> tilts_and_rolls(np.array([[[c, -s, 0], [s, c, 0], [0, 0, 1]]]), board).round(6).tolist()
    [[0.0, 0.3]]
    """
    axes = _plane_axes(target_mm)
    turned = np.asarray(cam_from_target) @ axes
    behind = turned[:, 2, 2] < 0
    turned[behind] = turned[behind] @ np.diag([-1.0, 1.0, -1.0])
    tilt = np.arctan2(np.hypot(turned[:, 0, 2], turned[:, 1, 2]), turned[:, 2, 2])
    roll = np.arctan2(turned[:, 1, 0] - turned[:, 0, 1], turned[:, 0, 0] + turned[:, 1, 1])
    return np.stack([tilt, roll], axis=1)


def _plane_axes(points_mm: FloatArray) -> FloatArray:
    """(3, 3) columns: the target's own x and y laid into its plane, and the normal."""
    normal = np.linalg.svd(points_mm - points_mm.mean(axis=0))[2][2]
    normal = normal * np.sign(normal[np.argmax(np.abs(normal))])
    own = np.eye(3)[:, 0 if abs(normal[0]) < 0.9 else 1]
    first = own - (own @ normal) * normal
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(normal, first), normal], axis=1)


def upright(cam_from_object: FloatArray) -> FloatArray:
    """The object's direction that hand-held pictures take for up, as a unit vector (3,).

    A hand holds a camera level or upright: the direction sought is across the x or the y
    axis of as many pictures as can be. Its sign: most pictures show it upwards (-y).

    Parameters
    ----------
    cam_from_object : (P, 3, 3) rotations.

    Examples
    --------
    >>> turned = [[0.0, 0, -1], [0, 1, 0], [1, 0, 0]]  # a walk round the y axis
    >>> upright(np.array([np.eye(3), turned])).tolist()
    [0.0, -1.0, 0.0]
    """
    rotations = np.asarray(cam_from_object, dtype=float)
    some = np.unique(np.linspace(0, len(rotations) - 1, _MOST_AXES).astype(int))
    sides = rotations[some][:, :2].reshape(-1, 3)
    first, second = np.triu_indices(len(sides), 1)
    crosses = np.cross(sides[first], sides[second])
    length = np.linalg.norm(crosses, axis=1)
    candidates = np.concatenate([sides, crosses[length > 0.3] / length[length > 0.3, None]])
    place = np.einsum("pij,cj->cpi", rotations[some], candidates)
    along = np.abs(place[..., 2]) > _ALONG
    across = np.maximum(1.0 - place[..., 2] ** 2, 1e-12)
    # The squared sine of the angle to the next side of the picture, at most a half.
    miss = (place[..., :2] ** 2).min(axis=2) / across
    best = candidates[np.argmin(np.where(along, 0.25, miss).sum(axis=1))]
    downwards = (rotations @ best)[:, 1].sum()
    up = -best if downwards > 0 else best
    return np.asarray(up + 0.0)


def rolls_against(cam_from_object: FloatArray, up: FloatArray) -> FloatArray:
    """(P,) roll of pictures, rad: from the picture's upward direction to ``up`` in it.

    NaN where a picture looks along it.

    Examples
    --------
    >>> rolled = [[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]
    >>> rolls = rolls_against(np.array([np.eye(3), rolled]), np.array([0.0, -1, 0]))
    >>> np.degrees(rolls).round(6).tolist()
    [0.0, 90.0]
    """
    seen = np.asarray(cam_from_object) @ up
    roll = np.arctan2(seen[:, 0], -seen[:, 1])
    return np.where(np.abs(seen[:, 2]) > _ALONG, np.nan, roll)


def span_rad(angles_rad: FloatArray) -> float:
    """The shortest arc that holds all directions; 0 of one or none.

    Examples
    --------
    >>> float(np.degrees(span_rad(np.radians([-170.0, 170.0, 180.0]))).round(6))
    20.0
    """
    known = np.sort(np.mod(angles_rad[np.isfinite(angles_rad)], 2 * np.pi))
    if len(known) < 2:
        return 0.0
    gaps = np.diff(np.append(known, known[0] + 2 * np.pi))
    return float(2 * np.pi - gaps.max())


def largest_angle_rad(directions: FloatArray) -> float:
    """The largest angle between two of some unit vectors (P, 3); 0 of one or none.

    Examples
    --------
    >>> float(np.degrees(largest_angle_rad(np.eye(3))).round(6))
    90.0
    """
    if len(directions) < 2:
        return 0.0
    some = directions[np.unique(np.linspace(0, len(directions) - 1, 600).astype(int))]
    return float(np.arccos(np.clip((some @ some.T).min(), -1.0, 1.0)))
