"""Arrays, and covariances kept as six numbers."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int32]

#: Order of a symmetric 3x3 covariance stored as six numbers.
COV6_ORDER = ("xx", "xy", "xz", "yy", "yz", "zz")
_COV6_ROWS = np.array([0, 0, 0, 1, 1, 2])
_COV6_COLS = np.array([0, 1, 2, 1, 2, 2])
_COV6_PLACES = 3 * _COV6_ROWS + _COV6_COLS


def cov6_from_matrix(matrix: FloatArray) -> FloatArray:
    """Six numbers (xx, xy, xz, yy, yz, zz) of symmetric matrices (..., 3, 3).

    Examples
    --------
    >>> cov6_from_matrix(np.diag([1.0, 2.0, 3.0])).tolist()
    [1.0, 0.0, 0.0, 2.0, 0.0, 3.0]
    """
    matrix = np.asarray(matrix)
    flat = matrix.reshape(*matrix.shape[:-2], 9)
    return np.ascontiguousarray(flat.take(_COV6_PLACES, axis=-1))


def matrix_from_cov6(cov6: FloatArray) -> FloatArray:
    """Symmetric matrices (..., 3, 3) of the six numbers (..., 6).

    Examples
    --------
    >>> matrix_from_cov6(np.array([1.0, 0.5, 0.0, 2.0, 0.0, 3.0]))[0].tolist()
    [1.0, 0.5, 0.0]
    """
    cov6 = np.asarray(cov6, dtype=float)
    matrix = np.empty((*cov6.shape[:-1], 3, 3))
    matrix[..., _COV6_ROWS, _COV6_COLS] = cov6
    matrix[..., _COV6_COLS, _COV6_ROWS] = cov6
    return matrix
