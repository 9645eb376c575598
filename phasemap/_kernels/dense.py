"""Small dense systems of equations: solved for right sides that are known, or factored for those to come."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels.compilation import kernel
from phasemap._kernels.quadrature import NODES

MOST_SQUARINGS = 48  # of a monodromy matrix, which leave an error of 1e-14 of its radius


@kernel
def pivot(m: np.ndarray, k: int, n: int, width: int) -> int:
    """Bring up the row with the largest entry of column k, its first `width` columns; which it was, -1 if all are 0."""
    best, size = k, abs(m[k, k])
    for i in range(k + 1, n):
        if abs(m[i, k]) > size:
            best, size = i, abs(m[i, k])
    if not size > 0.0:
        return -1
    if best != k:
        up, down = m[best], m[k]
        for j in range(width):
            down[j], up[j] = up[j], down[j]
    return best


@kernel
def eliminate(m: np.ndarray, n: int) -> bool:
    """Solve for the first n columns in place (Gauss-Jordan); the other columns become solutions, False without any."""
    width = m.shape[1]
    for k in range(n):
        if pivot(m, k, n, width) < 0:
            return False
        inverse = 1.0 / m[k, k]
        for j in range(width):
            m[k, j] *= inverse
        for i in range(n):
            if i != k:
                factor = m[i, k]
                for j in range(width):
                    m[i, j] -= factor * m[k, j]
    return True


@kernel
def eliminate_columns(m: np.ndarray, count: int) -> bool:
    """`eliminate` for NODES equations with column j in m[j], in all `count` of them.

    Each step adds a multiple of one column to the others.
    """
    for k in range(NODES):
        column = m[k]
        best, size = k, abs(column[k])
        for i in range(k + 1, NODES):
            if abs(column[i]) > size:
                best, size = i, abs(column[i])
        if not size > 0.0:
            return False
        if best != k:
            for j in range(k, count):
                m[j, k], m[j, best] = m[j, best], m[j, k]
        inverse = 1.0 / column[k]
        # Written out, and all read before any is written: so it becomes vector instructions.
        a, b, c, d, e, f, g, h = (
            column[0] * inverse, column[1] * inverse, column[2] * inverse, column[3] * inverse,
            column[4] * inverse, column[5] * inverse, column[6] * inverse, column[7] * inverse,
        )  # fmt: skip
        for j in range(k + 1, count):
            x = m[j]
            y = x[k]
            x[0], x[1], x[2], x[3], x[4], x[5], x[6], x[7] = (
                x[0] - y * a, x[1] - y * b, x[2] - y * c, x[3] - y * d,
                x[4] - y * e, x[5] - y * f, x[6] - y * g, x[7] - y * h,
            )  # fmt: skip
            x[k] = y * inverse
    return True


@kernel
def spectral_radius(m: np.ndarray) -> float:
    """Largest modulus of the eigenvalues of a matrix, which is used up, by squaring it again and again.

    After k squarings |M^(2^k)|^(2^-k) is off by a factor that depends on how its eigenvectors lie, to the power 2^-k.
    """
    n, found, power = len(m), 0.0, 1.0
    square = np.empty((n, n))
    for _ in range(MOST_SQUARINGS):
        size = 0.0
        for i in range(n):
            for j in range(n):
                size += m[i, j] * m[i, j]
        size = math.sqrt(size)
        if not 0.0 < size < math.inf:
            return size
        found += power * math.log(size)
        power *= 0.5
        for i in range(n):
            for j in range(n):
                total = 0.0
                for k in range(n):
                    total += m[i, k] * m[k, j]
                square[i, j] = total / (size * size)
        m, square = square, m
    return math.exp(found)


@kernel
def factor(m: np.ndarray, n: int, order: np.ndarray) -> bool:
    """Gauss's triangles in place of the first n columns, rows exchanged as `order` says; False if there are none."""
    for k in range(n):
        order[k] = pivot(m, k, n, n)
        if order[k] < 0:
            return False
        up = m[k]
        inverse = 1.0 / up[k]
        for i in range(k + 1, n):
            row = m[i]
            factor = row[k] * inverse
            row[k] = factor
            for j in range(k + 1, n):
                row[j] -= factor * up[j]
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
