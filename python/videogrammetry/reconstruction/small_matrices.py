"""Many small symmetric matrices at once."""

from __future__ import annotations

import numpy as np

from videogrammetry.types import FloatArray

_RIDGE = 1e-9


def quadratic(s: FloatArray, cov: FloatArray) -> FloatArray:
    """s' cov^-1 s (m,) of every row s (m, k); directions of which nothing is known say nothing.

    By Cholesky's factors of all matrices side by side: five times as fast as LAPACK's one
    after the other for k = 6.

    Examples
    --------
    >>> quadratic(np.array([[3.0, 4.0]]), np.diag([1.0, 4.0])[None]).round(6).tolist()
    [13.0]
    """
    size = s.shape[1]
    # Rows of cov and s' below: the last row of the factor is (L^-1 s)'.
    work = np.empty((size + 1, size, len(s)))
    work[:size] = np.moveaxis(cov, 0, -1)
    work[size] = s.T
    diagonal = work[np.arange(size), np.arange(size)]
    work[np.arange(size), np.arange(size)] += _RIDGE * diagonal.mean(axis=0) + 1e-12
    # What rounding has made of a direction without information is not divided by.
    least = _RIDGE * 1e-3 * diagonal.mean(axis=0) + 1e-15
    for j in range(size):
        below = work[j:, j]
        if j:
            below -= np.einsum("ikm,km->im", work[j:, :j], work[j, :j])
        below /= np.sqrt(np.maximum(below[0], least))
    return np.asarray(np.einsum("km,km->m", work[size], work[size]))
