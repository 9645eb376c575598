"""Least squares of many problems at once, each with few data and fewer unknowns: theory, Eq. (inversion-5)."""

from __future__ import annotations

import numpy as np

from phasemap._kernels.compilation import kernel


@kernel
def weighed_rows(values: np.ndarray, weights: np.ndarray, level: np.ndarray, out: np.ndarray) -> None:
    """Weigh data or their derivatives, and take out of every second datum what those have in common.

    Parameters
    ----------
    values : ndarray, shape (n, m, 2, k)
    weights : ndarray, shape (n, m, 2)
        1 over standard errors, 0 without a datum.
    level : ndarray, shape (n, m)
        What is in common, of weighed data, as a unit vector.
    out : ndarray, shape (n, 2 m, k)
    """
    for i in range(len(values)):
        for k in range(values.shape[3]):
            common = 0.0
            for j in range(values.shape[1]):
                out[i, 2 * j, k] = values[i, j, 0, k] * weights[i, j, 0]
                out[i, 2 * j + 1, k] = values[i, j, 1, k] * weights[i, j, 1]
                common += level[i, j] * out[i, 2 * j + 1, k]
            for j in range(values.shape[1]):
                out[i, 2 * j + 1, k] -= level[i, j] * common


@kernel
def normal_rows(slopes: np.ndarray, rest: np.ndarray, matrix: np.ndarray, pull: np.ndarray) -> None:
    """Add the products J^T J and J^T r of n problems to what is there.

    Parameters
    ----------
    slopes, rest : ndarray, shape (n, a, p), (n, a)
        J and r.
    matrix, pull : ndarray, shape (n, p, p), (n, p)
    """
    unknowns = slopes.shape[2]
    for i in range(len(slopes)):
        for a in range(slopes.shape[1]):
            for k in range(unknowns):
                slope = slopes[i, a, k]
                pull[i, k] += slope * rest[i, a]
                for other in range(unknowns):
                    matrix[i, k, other] += slope * slopes[i, a, other]
