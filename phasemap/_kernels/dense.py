"""Small dense systems of equations, solved more than once for the same left side."""

from __future__ import annotations

import numpy as np

from phasemap._kernels.compilation import kernel


@kernel
def factor(m: np.ndarray, n: int, order: np.ndarray) -> bool:
    """Gauss's triangles in place of the first n columns, rows exchanged as `order` says; False if there are none."""
    for k in range(n):
        best, size = k, abs(m[k, k])
        for i in range(k + 1, n):
            if abs(m[i, k]) > size:
                best, size = i, abs(m[i, k])
        if not size > 0.0:
            return False
        order[k] = best
        pivot = m[k]
        if best != k:
            other = m[best]
            for j in range(n):
                pivot[j], other[j] = other[j], pivot[j]
        inverse = 1.0 / pivot[k]
        for i in range(k + 1, n):
            row = m[i]
            factor = row[k] * inverse
            row[k] = factor
            for j in range(k + 1, n):
                row[j] -= factor * pivot[j]
    return True


@kernel
def substitute(m: np.ndarray, n: int, order: np.ndarray, x: np.ndarray) -> None:
    """Solve for one right side, in place."""
    for k in range(n):
        x[k], x[order[k]] = x[order[k]], x[k]
    for i in range(1, n):
        total = x[i]
        for j in range(i):
            total -= m[i, j] * x[j]
        x[i] = total
    for back in range(n):
        i = n - 1 - back
        total = x[i]
        for j in range(i + 1, n):
            total -= m[i, j] * x[j]
        x[i] = total / m[i, i]
