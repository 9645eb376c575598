"""Least squares of many problems at once, each with few data and fewer unknowns: theory, Eq. (inversion-4)."""

from __future__ import annotations

import numpy as np

from phasemap._kernels.compilation import kernel


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
