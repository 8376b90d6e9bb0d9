"""Many small symmetric matrices at once."""

from __future__ import annotations

import numpy as np

from videogrammetry.types import FloatArray

#: What is added to the diagonals, against their mean and in itself: of a picture's motion by
#: pixels that is knowledge of 1000 of them.
_RIDGE, _NOTHING = 1e-9, 1e-6


def quadratic(s: FloatArray, cov: FloatArray) -> FloatArray:
    """s' cov^-1 s (m,) of every row s (m, k); directions of which nothing is known say nothing.

    By Cholesky's factors of all matrices side by side: five times as fast as LAPACK's one
    after the other for k = 6.

    Examples
    --------
    >>> quadratic(np.array([[3.0, 4.0]]), np.diag([1.0, 4.0])[None]).round(3).tolist()
    [13.0]
    """
    size = s.shape[1]
    # Rows of cov and s' below: the last row of the factor is (L^-1 s)'.
    work = np.empty((size + 1, size, len(s)))
    work[:size] = np.moveaxis(cov, 0, -1)
    work[size] = s.T
    mean = np.abs(work[np.arange(size), np.arange(size)]).mean(axis=0)
    ridge = _RIDGE * mean + _NOTHING
    work[np.arange(size), np.arange(size)] += ridge
    for j in range(size):
        below = work[j:, j]
        if j:
            below -= np.einsum("ikm,km->im", work[j:, :j], work[j, :j])
        # Rounding can leave less of a direction without information than was added to it.
        there = below[0] > 0.1 * ridge
        below *= np.where(there, 1 / np.sqrt(np.where(there, below[0], 1.0)), 0.0)
    return np.asarray(np.einsum("km,km->m", work[size], work[size]))
