"""Evaluation of an atlas: which piece a material lies in, and the Chebyshev sums of that piece.

A material is a point x = (x0, x1, x2). A binary tree leads to its piece: a node compares a coordinate with a value, or
x2 with a border, a surface x2 = s(x0, x1) given by a Chebyshev sum. In a piece, x2 becomes u by the place between the
piece's lower and upper end, which are numbers or borders, and the coordinates (x0, x1, u) are scaled to [-1, 1].
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels.compilation import kernel

CUT, BORDER, LEAF = 0, 1, 2  # kinds of tree nodes
PLAIN, ROOT_LOW, ROOT_HIGH, ROOT_BOTH = 0, 1, 2, 3  # how u goes with the place rho between the ends
KIND, WHICH, BELOW, ABOVE = 0, 1, 2, 3  # columns of nodes
X0, X1, U = 0, 2, 4  # low ends in a box; high ones are next to them
LOW, HIGH, FORM = 0, 1, 2  # columns of ends and forms
LANES = 64  # points whose sums are taken together
MOST = 33  # coefficients along one coordinate
OUTSIDE = -1
SLACK = 1e-9  # of the width of a piece by which rounding may lead a point out of it

_SIGNS = {"contract", "nsz"}


@kernel
def scaled(x: float, low: float, high: float) -> float:
    """Put x of [low, high] into [-1, 1]; 0 where the interval is a point."""
    return (2.0 * x - low - high) / (high - low) if high > low else 0.0


class Tree(NamedTuple):
    """What leads a material to its piece."""

    nodes: np.ndarray  # int, shape (nodes, 4); KIND; WHICH coordinate, border or piece; node BELOW; node ABOVE
    values: np.ndarray  # shape (nodes,); where a coordinate is cut
    boxes: np.ndarray  # shape (borders, 4); of a border: low and high of x0, of x1
    # sizes, starts, coefficients: how many coefficients a border has along x0 and x1, shape (borders, 2), and
    # where they begin in the last
    sizes: np.ndarray
    starts: np.ndarray
    coefficients: np.ndarray
    piece_boxes: np.ndarray  # shape (pieces, 6); low and high of x0, x1, u
    ends: np.ndarray  # shape (pieces, 2); lower and upper end of a piece in x2 where it is a number
    forms: np.ndarray  # int, shape (pieces, 3); its lower border or -1, upper border or -1, form of u


@kernel
def border(tree: Tree, which: int, x0: float, x1: float) -> float:
    """Height x2 of a border at (x0, x1), by Clenshaw's recurrence in both."""
    box, coefficients = tree.boxes[which], tree.coefficients
    a, b = scaled(x0, box[X0], box[X0 + 1]), scaled(x1, box[X1], box[X1 + 1])
    rows, columns, start = tree.sizes[which, 0], tree.sizes[which, 1], tree.starts[which]
    one, two = 0.0, 0.0
    for i in range(rows - 1, -1, -1):
        first, second = 0.0, 0.0
        at = start + i * columns
        for j in range(columns - 1, 0, -1):
            first, second = coefficients[at + j] + 2.0 * b * first - second, first
        value = coefficients[at] + b * first - second
        if i > 0:
            one, two = value + 2.0 * a * one - two, one
        else:
            one = value + a * one - two
    return one


@kernel
def place(rho: float, form: int) -> float:
    """u of the relative place rho between the lower and the upper end of a layer."""
    rho = min(max(rho, 0.0), 1.0)
    if form == ROOT_LOW:
        return math.sqrt(rho)
    if form == ROOT_HIGH:
        return 1.0 - math.sqrt(1.0 - rho)
    if form == ROOT_BOTH:
        return math.asin(math.sqrt(rho)) * (2.0 / math.pi)
    return rho


@kernel
def locate(points: np.ndarray, tree: Tree, piece: np.ndarray, inside: np.ndarray) -> None:
    """Find the piece of every point, and where in it the point is.

    Parameters
    ----------
    points : ndarray, shape (3, n)
    tree : Tree
    piece : ndarray of int32, shape (n,)
        Receives the piece, OUTSIDE where there is none.
    inside : ndarray, shape (3, n)
        Receives the coordinates in [-1, 1].
    """
    nodes, forms = tree.nodes, tree.forms
    for i in range(points.shape[1]):
        x0, x1, x2 = points[0, i], points[1, i], points[2, i]
        piece[i] = OUTSIDE
        if not math.isfinite(x0 + x1 + x2):
            continue
        node, under, over, low, high = 0, -1, -1, 0.0, 0.0  # the borders met last below and above the point
        while nodes[node, KIND] != LEAF:
            which = nodes[node, WHICH]
            if nodes[node, KIND] == CUT:
                above = points[which, i] >= tree.values[node]
            else:
                height = border(tree, which, x0, x1)
                above = x2 >= height
                if above:
                    under, low = which, height
                else:
                    over, high = which, height
            node = nodes[node, ABOVE] if above else nodes[node, BELOW]
        which = nodes[node, WHICH]
        if which == OUTSIDE:
            continue
        lower, upper = forms[which, LOW], forms[which, HIGH]
        if lower < 0:
            low = tree.ends[which, LOW]
        elif lower != under:
            low = border(tree, lower, x0, x1)
        if upper < 0:
            high = tree.ends[which, HIGH]
        elif upper != over:
            high = border(tree, upper, x0, x1)
        u = place((x2 - low) / (high - low), forms[which, FORM]) if high > low else x2 - low
        box = tree.piece_boxes[which]
        flat_0, flat_1 = box[X0] == box[X0 + 1], box[X1] == box[X1 + 1]
        if (flat_0 and x0 != box[X0]) or (flat_1 and x1 != box[X1]) or (high == low and u != 0.0):
            continue
        a, b = scaled(x0, box[X0], box[X0 + 1]), scaled(x1, box[X1], box[X1 + 1])
        c = scaled(u, box[U], box[U + 1])
        if max(abs(a), abs(b), abs(c)) <= 1.0 + SLACK:
            piece[i] = which
            inside[0, i], inside[1, i], inside[2, i] = a, b, c


@kernel(fastmath=_SIGNS)
def polynomials(t: np.ndarray, width: int, count: int, out: np.ndarray) -> None:
    """Chebyshev polynomials 0 ... count - 1 of so many points."""
    for lane in range(width):
        out[0, lane] = 1.0
    if count > 1:
        for lane in range(width):
            out[1, lane] = t[lane]
    for k in range(2, count):
        for lane in range(width):
            out[k, lane] = 2.0 * t[lane] * out[k - 1, lane] - out[k - 2, lane]


@kernel(fastmath=_SIGNS)
def evaluate(
    piece: np.ndarray,
    inside: np.ndarray,
    wanted: np.ndarray,
    piece_sizes: np.ndarray,
    length_starts: np.ndarray,
    lengths: np.ndarray,
    coefficient_starts: np.ndarray,
    coefficients: np.ndarray,
    out: np.ndarray,
) -> None:
    """Sum the Chebyshev series of every point that `locate` found a piece for.

    The points of a piece are taken together, LANES at a time.

    Parameters
    ----------
    piece, inside : ndarray
        From `locate`.
    wanted : ndarray of int
        Which of the functions.
    piece_sizes : ndarray of int, shape (pieces, 3)
        Most coefficients along x0, x1, u.
    length_starts, coefficient_starts : ndarray of int, shape (pieces, functions)
        Where those of a function begin in `lengths`, one for each (i, j), and in `coefficients`, the first of them
        along u for each (i, j).
    out : ndarray, shape (len(wanted), n)
        Filled where a point has a piece.
    """
    count, pieces = len(piece), len(piece_sizes)
    first = np.zeros(pieces + 2, np.int64)
    for i in range(count):
        first[piece[i] + 2] += 1
    for k in range(1, pieces + 2):
        first[k] += first[k - 1]
    at = first.copy()
    order = np.empty(count, np.int64)
    for i in range(count):
        order[at[piece[i] + 1]] = i
        at[piece[i] + 1] += 1
    t = np.zeros((3, LANES))
    p0, p1, p2 = np.empty((MOST, LANES)), np.empty((MOST, LANES)), np.empty((MOST, LANES))
    inner, middle, total = np.empty(LANES), np.empty(LANES), np.empty(LANES)
    for which in range(pieces):
        for begin in range(first[which + 1], first[which + 2], LANES):
            width = min(LANES, first[which + 2] - begin)
            for lane in range(width):
                t[0, lane], t[1, lane] = inside[0, order[begin + lane]], inside[1, order[begin + lane]]
                t[2, lane] = inside[2, order[begin + lane]]
            polynomials(t[0], width, piece_sizes[which, 0], p0)
            polynomials(t[1], width, piece_sizes[which, 1], p1)
            polynomials(t[2], width, piece_sizes[which, 2], p2)
            for f in range(len(wanted)):
                at_length = length_starts[which, wanted[f]]
                at_coefficient = coefficient_starts[which, wanted[f]]
                for lane in range(width):
                    total[lane] = 0.0
                for i in range(piece_sizes[which, 0]):
                    for lane in range(width):
                        middle[lane] = 0.0
                    for j in range(piece_sizes[which, 1]):
                        length = lengths[at_length]
                        at_length += 1
                        if length == 0:
                            continue
                        for lane in range(width):
                            inner[lane] = 0.0
                        for k in range(length):
                            factor = coefficients[at_coefficient + k]
                            for lane in range(width):
                                inner[lane] += factor * p2[k, lane]
                        at_coefficient += length
                        for lane in range(width):
                            middle[lane] += inner[lane] * p1[j, lane]
                    for lane in range(width):
                        total[lane] += middle[lane] * p0[i, lane]
                for lane in range(width):
                    out[f, order[begin + lane]] = total[lane]
