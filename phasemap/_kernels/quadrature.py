"""Constant tables: Gauss nodes, and the elements on which an exact orbit is collocated.

An element maps xi in [0, 1] to the angle theta = origin + scale * S(xi) (theory, Eq. (collocation-3)). Three families
of S make every function that occurs analytic in xi, so that eight Gauss nodes an element suffice:

* contact: S = sin(psi), psi uniform over [-pi/2, pi/2]; d^(1/2) and d^(3/2) vanish like powers of cos(psi);
* straight: S = xi, where higher modes ring on in flight;
* graded: S = sinh(x), x uniform from 0; the long-range force has its pole next to the point where grading starts,
  and elements grow geometrically away from it. A mirrored copy runs towards that point.

`TABLES` holds them all, shape (n, ROWS, NODES), and after them, from `HALVES` on, the two halves of each; its rows are
numbered below. Python passes it to kernels as an argument: as a constant it would be in the code of each that uses it.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

Map = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]

NODES = 8
CONTACT_COUNTS = np.array([2, 3, 4, 6, 8, 12, 16, 24])  # elements that a contact may be split into
GRADED_WIDTHS = np.array([1.2, 0.8, 0.5])  # of a graded element in x, by level of refinement
GRADED_REACH = 14.0  # graded elements run to x = 14: lengths over five decades

# Rows of an element, NODES numbers each.
T_S = 0  # S at the nodes
T_END1 = 1  # weights that integrate once to the element's end
T_BARY = 2  # barycentric weights in S
T_NUMBERS = 3  # numbers of the element, in the columns below
T_UPTO = 4  # NODES rows: row k integrates the polynomial of node k from the element's start to the nodes
T_ROWS = 12

T_FIRST = 0  # S at xi = 0
T_LAST = 1  # S at xi = 1
T_BARY_FIRST = 2  # barycentric weights of both ends
T_BARY_LAST = 3


def gauss(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre nodes and weights on [0, 1]."""
    x, w = np.polynomial.legendre.leggauss(n)
    return (x + 1) / 2, w / 2


def gauss_on_half_line(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes x / (1 - x) from 0 to infinity for Gauss nodes x, and twice their weights."""
    x, w = gauss(n)
    return x / (1 - x), 2 * w / (1 - x) ** 2


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


_ELEMENT_X, _ELEMENT_WEIGHT = gauss(NODES)
_MATRIX = integration_matrix(_ELEMENT_X)


def _map_of_contact(first: float, width: float) -> Map:
    """Map of [0, 1] to S = sin(psi), and its derivative."""
    return lambda y: (np.sin(first + width * y), width * np.cos(first + width * y))


def _outgoing(e: int, width: float) -> Map:
    """Map of [0, 1] to S = sinh(x) on graded element e after the contact, where x = 0, and its derivative."""
    return lambda y: (np.sinh(width * (e + y)), width * np.cosh(width * (e + y)))


def _incoming(e: int, width: float) -> Map:
    """Map of [0, 1] to S = -sinh(x) on graded element e before the contact, where x = 0, and its derivative."""
    return lambda y: (-np.sinh(width * (e + 1 - y)), width * np.cosh(width * (e + 1 - y)))


def _straight(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Map of [0, 1] to itself, and its derivative."""
    return y, np.ones_like(y)


def _element(mapped: Map, low: float, high: float) -> np.ndarray:
    """Rows of the part of an element between two values of xi."""
    s, t = mapped(low + (high - low) * _ELEMENT_X)
    t = (high - low) * t
    ends = mapped(np.array([low, high]))[0]
    row = np.zeros((T_ROWS, NODES))
    m1 = _MATRIX * t
    row[T_S], row[T_END1] = s, _ELEMENT_WEIGHT * t
    bary = barycentric(np.concatenate([ends[:1], s, ends[1:]]) / (ends[1] - ends[0]))
    row[T_BARY] = bary[1:-1]
    row[T_NUMBERS, :4] = *ends, bary[0], bary[-1]
    row[T_UPTO : T_UPTO + NODES] = m1.T
    return row


def _build() -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """Tables of all elements, whole and halved; where those of contacts and graded ones begin; how many are whole."""
    maps: list[Map] = []
    contact_start = []
    for count in CONTACT_COUNTS:
        contact_start.append(len(maps))
        width = np.pi / count
        maps += [_map_of_contact(-np.pi / 2 + e * width, width) for e in range(count)]
    graded_start = []
    for width in GRADED_WIDTHS:
        most = math.ceil(GRADED_REACH / width)
        graded_start.append((len(maps), len(maps) + most))
        maps += [_outgoing(e, width) for e in range(most)] + [_incoming(e, width) for e in range(most)]
    maps.append(_straight)
    whole = [_element(mapped, 0.0, 1.0) for mapped in maps]
    halves = [_element(mapped, *part) for mapped in maps for part in ((0.0, 0.5), (0.5, 1.0))]
    return np.array(whole + halves), np.array(contact_start), np.array(graded_start), len(whole)


def _into_halves() -> np.ndarray:
    """Polynomials of xi that are 1 at an element's start, a node, or its end, at the nodes of its halves."""
    given, at = np.concatenate([[0], _ELEMENT_X, [1]]), np.concatenate([_ELEMENT_X, 1 + _ELEMENT_X]) / 2
    shares = barycentric(given) / (at[:, None] - given)
    return np.asarray(shares / shares.sum(axis=1, keepdims=True))


TABLES, CONTACT_START, GRADED_START, HALVES = _build()
STRAIGHT = HALVES - 1
INTO_HALVES = _into_halves()
