"""Constant tables: Gauss nodes, and the elements on which an exact orbit is collocated.

An element maps xi in [0, 1] to the angle theta = origin + scale * S(xi). Two families of S make every function that
occurs analytic in xi, so that eight Gauss nodes an element suffice:

* contact: S = sin(psi), psi uniform over [-pi/2, pi/2]; d^(1/2) and d^(3/2) vanish like powers of cos(psi);
* graded: S = sinh(x), x uniform from 0; the long-range force has its pole next to the point where grading starts,
  and elements grow geometrically away from it. A mirrored copy runs towards that point.

`TABLES` holds them all, shape (n, ROWS, NODES); its rows are numbered below.
"""

from __future__ import annotations

import math

import numpy as np

NODES = 8
CONTACT_COUNTS = np.array([2, 3, 4, 6, 8, 12, 16])  # elements that a contact may be split into
GRADED_WIDTHS = np.array([1.2, 0.8, 0.5])  # of a graded element in x, by level of refinement
GRADED_REACH = 14.0  # graded elements run to x = 14: lengths over five decades

# Rows of an element. At the nodes: S, the weights that integrate once and twice to the element's end, the row sums of
# M1, barycentric weights in S. NUMBERS: S at xi = 0 and 1, sum of END1, barycentric weights of both ends.
# M1, M2: eight rows each, integration once and twice from the element's start to the nodes.
T_S, T_END1, T_END2, T_SUM1, T_BARY, T_NUMBERS, T_M1, T_M2, T_ROWS = 0, 1, 2, 3, 4, 5, 6, 14, 22
T_FIRST, T_LAST, T_TOTAL, T_BARY_FIRST, T_BARY_LAST = 0, 1, 2, 3, 4


def gauss(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre nodes and weights on [0, 1]."""
    x, w = np.polynomial.legendre.leggauss(n)
    return (x + 1) / 2, w / 2


def integration_matrix(x: np.ndarray) -> np.ndarray:
    """B[j, k], the integral from 0 to x[j] of the k-th Lagrange polynomial on the nodes x in [0, 1]."""
    n = len(x)
    legendre = np.polynomial.legendre
    values = legendre.legvander(2 * x - 1, n - 1)
    integrals = np.stack([legendre.legval(2 * x - 1, legendre.legint(row, lbnd=-1)) / 2 for row in np.eye(n)], axis=1)
    return integrals @ np.linalg.inv(values)


def barycentric(x: np.ndarray) -> np.ndarray:
    """Barycentric weights of nodes x."""
    difference = x[:, None] - x[None, :]
    np.fill_diagonal(difference, 1)
    return 1 / difference.prod(axis=1)


def _build() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    x, weight = gauss(NODES)
    matrix = integration_matrix(x)
    elements: list[tuple[np.ndarray, np.ndarray, float, float]] = []

    def add(position: np.ndarray, ends: tuple[float, float], slope: np.ndarray) -> None:
        elements.append((position, slope, *ends))

    contact_start = []
    for count in CONTACT_COUNTS:
        contact_start.append(len(elements))
        width = np.pi / count
        for e in range(count):
            start = -np.pi / 2 + e * width
            psi = start + width * x
            ends = (-1.0 if e == 0 else np.sin(start), 1.0 if e == count - 1 else np.sin(start + width))
            add(np.sin(psi), ends, width * np.cos(psi))
    graded_start = []
    for width in GRADED_WIDTHS:
        most = math.ceil(GRADED_REACH / width)
        outgoing = len(elements)
        for e in range(most):
            at = width * (e + x)
            add(np.sinh(at), (np.sinh(width * e), np.sinh(width * (e + 1))), width * np.cosh(at))
        incoming = len(elements)
        for e in range(most):
            at = width * (e + 1 - x)
            add(-np.sinh(at), (-np.sinh(width * (e + 1)), -np.sinh(width * e)), width * np.cosh(at))
        graded_start.append((outgoing, incoming))

    table = np.zeros((len(elements), T_ROWS, NODES))
    for row, (s, t, first, last) in zip(table, elements, strict=True):
        m1 = matrix * t
        row[T_S], row[T_END1], row[T_END2], row[T_SUM1] = s, weight * t, (weight * t) @ m1, m1.sum(axis=1)
        every = np.concatenate([[first], s, [last]])
        bary = barycentric(every / (last - first))
        row[T_BARY] = bary[1:-1]
        row[T_NUMBERS, :5] = first, last, row[T_END1].sum(), bary[0], bary[-1]
        row[T_M1 : T_M1 + NODES], row[T_M2 : T_M2 + NODES] = m1, m1 @ m1
    return table, np.array(contact_start), np.array(graded_start)


TABLES, CONTACT_START, GRADED_START = _build()
