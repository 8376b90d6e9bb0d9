"""Best-fit rigid motions and similarities of corresponding points."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from videogrammetry.types import FloatArray


def fit_rigid(
    a: FloatArray, b: FloatArray, weight: FloatArray | None = None
) -> tuple[FloatArray, FloatArray, float]:
    """Best-fit motion a_from_b of corresponding points.

    Minimises sum_i w_i |a_i - (R b_i + t)|^2 over rotations R and translations t: R from
    the singular values of the points' correlation about their weighted means [1]_, with
    det R = +1 enforced [2]_, so that points in a plane are turned and never mirrored.
    Points on one line leave the turn about it open: one of the best is returned.

    Parameters
    ----------
    a, b : (N, 3) in one unit. Two or one determine less than a motion; one of the best
        is returned.
    weight : (N,) >= 0, not all 0, only their ratios count; None: equal ones. A weight is
        that of the three coordinates, proportional to 1 / sigma^2.

    Returns
    -------
    rotation : (3, 3). translation : (3,).
    rms : of the residuals per coordinate, weights scaled to a mean of 1, redundancy
        3 N - 6 (at least 1): estimates one coordinate's sigma in a - R b, of weight 1.

    Raises
    ------
    ValueError : other shapes, numbers that are not finite, or weights that are no weights.

    References
    ----------
    .. [1] Arun, Huang, Blostein, Least-squares fitting of two 3-D point sets, IEEE PAMI 9
       (1987).
    .. [2] Kabsch, A discussion of the solution for the best rotation to relate two sets
       of vectors, Acta Cryst. A34 (1978).

    Examples
    --------
    >>> b = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    >>> rotation, translation, rms = fit_rigid(b + [1, 2, 3], b)
    >>> translation.round(9).tolist(), round(rms, 9)
    ([1.0, 2.0, 3.0], 0.0)
    """
    centred = _centred(a, b, weight)
    rotation, _ = _turn(centred)
    translation = centred.mean_a - rotation @ centred.mean_b
    return rotation, translation, _rms(centred, rotation, 1.0, 6)


def fit_similarity(
    a: FloatArray, b: FloatArray, weight: FloatArray | None = None, *, mirrored: bool = False
) -> tuple[float, FloatArray, FloatArray, float]:
    """Best-fit similarity a = s R b + t of corresponding points.

    As :func:`fit_rigid` with the scale s > 0 that leaves the least in a ([1]_, Eqs. 40-42).
    Noise in b makes it too small by the noise's share of b's extent.

    Parameters
    ----------
    a, b : (N, 3), b not all in one place. weight : as in :func:`fit_rigid`.
    mirrored : with a reflection, det R = -1, to see whether one of the frames is
        left-handed. Points in a plane fit both ways.

    Returns
    -------
    scale : s. rotation : (3, 3). translation : (3,), in a's unit.
    rms : as in :func:`fit_rigid`, in a's unit, redundancy 3 N - 7.

    Raises
    ------
    ValueError : as :func:`fit_rigid`; or all points of b in one place.

    References
    ----------
    .. [1] Umeyama, Least-squares estimation of transformation parameters between two point
       patterns, IEEE PAMI 13 (1991).

    Examples
    --------
    >>> b = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    >>> scale, rotation, translation, rms = fit_similarity(2 * b + [1.0, 0, 0], b)
    >>> round(scale, 9), translation.round(9).tolist(), round(rms, 9)
    (2.0, [1.0, 0.0, 0.0], 0.0)
    """
    centred = _centred(a, b, weight)
    spread = float((centred.weight[:, None] * centred.b**2).sum())
    if spread == 0:
        raise ValueError("b: all points are in one place, which says nothing about a scale")
    rotation, correlation = _turn(centred, -1.0 if mirrored else 1.0)
    scale = correlation / spread
    translation = centred.mean_a - scale * rotation @ centred.mean_b
    return scale, rotation, translation, _rms(centred, rotation, scale, 7)


class _Centred(NamedTuple):
    """Points about their weighted means; weights of mean 1."""

    a: FloatArray
    b: FloatArray
    mean_a: FloatArray
    mean_b: FloatArray
    weight: FloatArray


def _centred(a: FloatArray, b: FloatArray, weight: FloatArray | None) -> _Centred:
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    if a.ndim != 2 or a.shape[1] != 3 or a.shape != b.shape or not len(a):
        raise ValueError(f"a, b: expected equal shapes (N, 3), N > 0, got {a.shape} and {b.shape}")
    w = np.ones(len(a)) if weight is None else np.asarray(weight, dtype=float)
    if w.shape != (len(a),) or not ((w >= 0).all() and 0 < w.sum() < np.inf):
        raise ValueError(f"weight: expected {len(a)} numbers >= 0, not all 0, got {w}")
    w = w / w.mean()
    mean_a, mean_b = (w @ a) / w.sum(), (w @ b) / w.sum()
    if not np.isfinite(mean_a + mean_b).all():
        raise ValueError("a, b: expected finite coordinates; leave out points without a position")
    return _Centred(a - mean_a, b - mean_b, mean_a, mean_b, w)


def _turn(centred: _Centred, sign: float = 1.0) -> tuple[FloatArray, float]:
    """The R of determinant ``sign`` nearest to the correlation, and trace(R^T correlation)."""
    u, s, vt = np.linalg.svd(centred.a.T @ (centred.weight[:, None] * centred.b))
    # The last singular direction, which the points determine least, takes the reflection.
    d = np.array([1.0, 1.0, sign * np.sign(np.linalg.det(u @ vt))])
    rotation: FloatArray = (u * d) @ vt
    return rotation, float(s @ d)


def _rms(centred: _Centred, rotation: FloatArray, scale: float, unknowns: int) -> float:
    residual = centred.a - scale * centred.b @ rotation.T
    redundancy = max(3 * len(residual) - unknowns, 1)
    return float(np.sqrt((centred.weight[:, None] * residual**2).sum() / redundancy))
