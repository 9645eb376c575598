"""Rows of numbers copied and searched, powers of a decay, brackets of roots narrowed, small systems solved."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels.compilation import ANY_ORDER, kernel
from phasemap._kernels.quadrature import NODES

MOST_SQUARINGS = 48  # of a monodromy matrix, which leave an error of 1e-14 of its radius
SLOW_TURN = 2.0  # of an angle, up to which its sine need not take whole turns off
SLOW_GROWTH = 0.1  # over an angle, up to which a series for an eighth of it will do


@kernel
def copy(source: np.ndarray, to: np.ndarray) -> None:
    """Copy the entries of one row into the first of another."""
    for j in range(len(source)):
        to[j] = source[j]


@kernel
def copy_rows(source: np.ndarray, to: np.ndarray) -> None:
    """Copy the rows of one array, shape (n, m), into the first of another."""
    for i in range(source.shape[0]):
        for j in range(source.shape[1]):
            to[i, j] = source[i, j]


@kernel
def count_smaller(row: np.ndarray, x: float, or_equal: bool) -> int:
    """Number of entries of a sorted row below x, or up to x with `or_equal`; `searchsorted` takes 0.7 s to compile."""
    low, high = 0, len(row)
    while low < high:
        middle = (low + high) // 2
        if row[middle] < x or (or_equal and row[middle] == x):
            low = middle + 1
        else:
            high = middle
    return low


@kernel(fastmath=ANY_ORDER)
def fill_turn(angle: np.ndarray, factor: float, sine: np.ndarray, cosine: np.ndarray) -> None:
    """Sine and cosine of factor * angle, to rounding up to 3 rad and to 1e-11 up to 2 pi.

    By polynomials at an eighth, doubled three times: in vectors.
    """
    for j in range(len(angle)):
        sine[j] = 0.125 * factor * angle[j]
    if factor > SLOW_TURN:
        for j in range(len(angle)):
            sine[j] -= 0.25 * math.pi * np.floor(sine[j] / (0.25 * math.pi) + 0.5)
    for j in range(len(angle)):
        x = sine[j]
        q = x * x
        s = x * (1.0 + q * (-1 / 6 + q * (1 / 120 + q * (-1 / 5040 + q * (1 / 362880 - q / 39916800)))))
        less = q * (-0.5 + q * (1 / 24 + q * (-1 / 720 + q * (1 / 40320 + q * (-1 / 3628800 + q / 479001600)))))
        s, less = 2.0 * s * (1.0 + less), 2.0 * less * (2.0 + less)
        s, less = 2.0 * s * (1.0 + less), 2.0 * less * (2.0 + less)
        sine[j], cosine[j] = 2.0 * s * (1.0 + less), 1.0 + 2.0 * less * (2.0 + less)


@kernel(fastmath=ANY_ORDER)
def fill_growth(angle: np.ndarray, rate: float, growth: np.ndarray) -> None:
    """Exponential of rate * angle, by a polynomial at an eighth or a 64th, squared; `growth` may be `angle` itself."""
    slow = abs(rate) < SLOW_GROWTH
    step = 0.125 * rate if slow else rate / 64.0
    for j in range(len(angle)):
        x = step * angle[j]
        grow = 1.0 + x * (1.0 + x * (1 / 2 + x * (1 / 6 + x * (1 / 24 + x * (1 / 120 + x * (1 / 720 + x / 5040))))))
        grow *= grow
        grow *= grow
        growth[j] = grow * grow
    for _ in range(0 if slow else 3):
        for j in range(len(angle)):
            growth[j] *= growth[j]


@kernel
def narrow_bracket(a: float, f_a: float, b: float, f_b: float, x: float, f: float) -> tuple[float, float, float, float]:
    """Bracket (a, f(a), b, f(b)) of a root, narrowed by the point x of its chord, which becomes b.

    Where the sign at x is that at the last point, b, the end that stays counts less: by as much as a parabola through
    all three says (Anderson and Bjoerck 1973, BIT 13, 253). Plain chords would leave that end where it is for ever;
    to halve it each time costs 20 evaluations where this takes 5.
    """
    if (f > 0.0) != (f_b > 0.0):
        return b, f_b, x, f
    less = 1.0 - f / f_b
    return a, f_a * (less if less > 0.0 else 0.5), x, f


@kernel(light=True)
def parabola(
    first: tuple[float, float], second: tuple[float, float], third: tuple[float, float]
) -> tuple[float, float, float]:
    """Vertex of the parabola through three points (x, f), as x and f, and its second derivative."""
    (x0, f0), (x1, f1), (x2, f2) = first, second, third
    rise = (f1 - f0) / (x1 - x0)
    bend = ((f2 - f1) / (x2 - x1) - rise) / (x2 - x0)
    x = 0.5 * (x0 + x1) - 0.5 * rise / bend
    return x, f0 + (x - x0) * (rise + bend * (x - x1)), 2.0 * bend


@kernel(inline=True)
def newton_in_bracket(
    x: float, f: float, slope: float, low: float, high: float, rising: bool
) -> tuple[float, float, float]:
    """Next x of Newton's method for a root, or the middle of the bracket where it leads out, and the narrowed bracket.

    `rising`: whether f is positive at `high`.
    """
    if (f > 0.0) == rising:
        high = x
    else:
        low = x
    following = x - f / slope if slope != 0.0 else math.nan
    return following if low <= following <= high else 0.5 * (low + high), low, high


@kernel
def pivot(m: np.ndarray, k: int, n: int) -> int:
    """Exchange row k, up to n, with the row of largest entry below in column k; its index, -1 if all are 0."""
    best, size = k, abs(m[k, k])
    for i in range(k + 1, n):
        if abs(m[i, k]) > size:
            best, size = i, abs(m[i, k])
    if not size > 0.0:
        return -1
    if best != k:
        up, down = m[best], m[k]
        for j in range(n):
            down[j], up[j] = up[j], down[j]
    return best


@kernel
def eliminate_columns(m: np.ndarray, count: int) -> bool:
    """Solve NODES equations whose column j is m[j], for the right sides m[NODES:count]; False if they are singular.

    The right sides become the solutions. Each step adds a multiple of one column to the others.
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
def spectral_radius(m: np.ndarray, squarings: int) -> float:
    """Largest modulus of the eigenvalues of a matrix, by squaring it so many times, in place.

    After k squarings |M^(2^k)|^(2^-k) is off by a factor that depends on how its eigenvectors lie, to the power 2^-k.
    """
    n, log_radius, power = len(m), 0.0, 1.0
    square = np.empty((n, n))
    for _ in range(squarings):
        size = 0.0
        for i in range(n):
            for j in range(n):
                size += m[i, j] * m[i, j]
        size = math.sqrt(size)
        if not 0.0 < size < math.inf:
            return size
        log_radius += power * math.log(size)
        power *= 0.5
        for i in range(n):
            for j in range(n):
                total = 0.0
                for k in range(n):
                    total += m[i, k] * m[k, j]
                square[i, j] = total / (size * size)
        m, square = square, m
    return math.exp(log_radius)


@kernel
def factor(m: np.ndarray, n: int, order: np.ndarray) -> bool:
    """Factor the first n columns into triangular matrices in place, rows exchanged as in `order`; False if singular."""
    for k in range(n):
        order[k] = pivot(m, k, n)
        if order[k] < 0:
            return False
        up = m[k]
        inverse = 1.0 / up[k]
        for i in range(k + 1, n):
            row = m[i]
            multiple = row[k] * inverse
            row[k] = multiple
            for j in range(k + 1, n):
                row[j] -= multiple * up[j]
    return True


@kernel
def substitute(m: np.ndarray, n: int, order: np.ndarray, x: np.ndarray) -> None:
    """Solve for one right side, in place, with the triangular matrices of `factor`."""
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


@kernel
def solve_equations(m: np.ndarray) -> bool:
    """Solve n equations for as many unknowns, which replace the right sides in the last column; False if singular.

    `m` (shape (n, n + 1)): coefficients and right sides.
    """
    n = len(m)
    order, x = np.empty(n, np.int64), m[:, n].copy()
    if not factor(m, n, order):
        return False
    substitute(m, n, order, x)
    m[:, n] = x
    return True
