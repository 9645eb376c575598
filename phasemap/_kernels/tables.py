"""Constant tables: Gauss nodes, and the elements on which an exact orbit is collocated.

An element maps xi in [0, 1] to the angle theta = origin + scale * S(xi). Two families of S make every function that
occurs analytic in xi, so that eight Gauss nodes an element suffice:

* contact: S = sin(psi), psi uniform over [-pi/2, pi/2]; d^(1/2) and d^(3/2) vanish like powers of cos(psi);
* graded: S = sinh(x), x uniform from 0; the long-range force has its pole next to the point where grading starts,
  and elements grow geometrically away from it. A mirrored copy runs towards that point.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

NODES = 8
CONTACT_COUNTS = (2, 3, 4, 6, 8, 12, 16)
GRADED_WIDTHS = (1.2, 0.8, 0.5, 0.3)
GRADED_REACH = 14.0  # graded elements run to x = 14: lengths over five decades


class Tables(NamedTuple):
    """Elements, stacked; the first index is the element's number.

    s, t : nodes S and dS/dxi, shape (n, NODES). first, last : S at xi = 0 and 1, shape (n,).
    m1, m2 : integration once and twice from the element's start to its nodes, shape (n, NODES, NODES).
    e1, e2 : the same to the element's end, shape (n, NODES). r1, f1 : sums over the last axis of m1 and e1.
    contact_start : number of the first contact element of each count in `CONTACT_COUNTS`.
    graded_start : number of the first outgoing and of the first incoming element of each width, shape (widths, 2).
    bary_x, bary_w : interpolation nodes in S (both ends and the Gauss nodes) and barycentric weights, (n, NODES + 2).
    """

    s: np.ndarray
    t: np.ndarray
    first: np.ndarray
    last: np.ndarray
    m1: np.ndarray
    m2: np.ndarray
    e1: np.ndarray
    e2: np.ndarray
    r1: np.ndarray
    f1: np.ndarray
    contact_start: np.ndarray
    graded_start: np.ndarray
    bary_x: np.ndarray
    bary_w: np.ndarray


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


def _barycentric(x: np.ndarray) -> np.ndarray:
    difference = x[:, None] - x[None, :]
    np.fill_diagonal(difference, 1)
    return 1 / difference.prod(axis=1)


def _build() -> Tables:
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

    s = np.array([e[0] for e in elements])
    t = np.array([e[1] for e in elements])
    m1 = matrix[None] * t[:, None, :]
    m2 = m1 @ m1
    e1 = weight * t
    e2 = np.einsum("nk,nkj->nj", e1, m1)
    first, last = np.array([e[2] for e in elements]), np.array([e[3] for e in elements])
    every = np.concatenate([first[:, None], s, last[:, None]], axis=1)
    weights = np.array([_barycentric(row / (row[-1] - row[0])) for row in every])
    return Tables(
        s, t, first, last, m1, m2, e1, e2,
        m1.sum(axis=2), e1.sum(axis=1), np.array(contact_start), np.array(graded_start), every, weights,
    )  # fmt: skip


TABLES = _build()
