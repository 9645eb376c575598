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

# Kinds of tree nodes.
CUT = 0
BORDER = 1
LEAF = 2

# How u goes with the relative place between the ends of a layer.
EVEN_PLACE = 0
ROOT_LOW = 1
ROOT_HIGH = 2
ROOT_BOTH = 3

LANES = 64  # points whose sums are taken together
MOST_COEFFICIENTS = 33  # along one coordinate
NO_PIECE = -1
SLACK = 1e-9  # of the width of a piece by which rounding may lead a point out of it

_SIGNS = {"contract", "nsz"}


@kernel
def scaled(x: float, ends: np.ndarray) -> float:
    """Coordinate in [-1, 1] of x between two ends; 0 where the interval is a point."""
    low, high = ends[0], ends[1]
    return (2.0 * x - low - high) / (high - low) if high > low else 0.0


class Tree(NamedTuple):
    """Binary tree that leads a material to its piece."""

    # Of each node: its kind, the number of its coordinate, border or piece, the nodes below and above, int, and where
    # a coordinate is cut
    kinds: np.ndarray
    numbers: np.ndarray
    below: np.ndarray
    above: np.ndarray
    cuts: np.ndarray
    boxes: np.ndarray  # shape (borders, 2, 2); of a border: low and high end of x0, of x1
    # sizes, starts, coefficients: how many coefficients a border has along x0 and x1, shape (borders, 2), and
    # where they begin in the last
    sizes: np.ndarray
    starts: np.ndarray
    coefficients: np.ndarray
    piece_boxes: np.ndarray  # shape (pieces, 3, 2); low and high end of x0, x1, u
    ends: np.ndarray  # shape (pieces, 2); lower and upper end of a piece in x2 where it is a number
    end_borders: np.ndarray  # int, shape (pieces, 2); its lower and its upper border, or -1
    forms: np.ndarray  # int, shape (pieces,); form of u


class ChebyshevSeries(NamedTuple):
    """Chebyshev series of every piece."""

    sizes: np.ndarray  # int, shape (pieces, 3); most coefficients along x0, x1, u
    length_starts: np.ndarray  # int, shape (pieces, functions); where a function begins in `lengths`
    lengths: np.ndarray  # int; how many coefficients there are along u, for each (i, j)
    starts: np.ndarray  # int, shape (pieces, functions); where a function begins in `coefficients`
    coefficients: np.ndarray  # those along u, one (i, j) after another


@kernel
def border_height(tree: Tree, which: int, x0: float, x1: float) -> float:
    """Height x2 of a border at (x0, x1), by Clenshaw's recurrence in both."""
    box, coefficients = tree.boxes[which], tree.coefficients
    a, b = scaled(x0, box[0]), scaled(x1, box[1])
    rows, columns, start = tree.sizes[which, 0], tree.sizes[which, 1], tree.starts[which]
    b1, b2 = 0.0, 0.0
    for i in range(rows - 1, -1, -1):
        first, second = 0.0, 0.0
        at = start + i * columns
        for j in range(columns - 1, 0, -1):
            first, second = coefficients[at + j] + 2.0 * b * first - second, first
        value = coefficients[at] + b * first - second
        if i > 0:
            b1, b2 = value + 2.0 * a * b1 - b2, b1
        else:
            b1 = value + a * b1 - b2
    return b1


@kernel
def layer_coordinate(rho: float, form: int) -> float:
    """Coordinate u at a relative place rho between the lower and the upper end of a layer."""
    rho = min(max(rho, 0.0), 1.0)
    if form == ROOT_LOW:
        return math.sqrt(rho)
    if form == ROOT_HIGH:
        return 1.0 - math.sqrt(1.0 - rho)
    if form == ROOT_BOTH:
        return math.asin(math.sqrt(rho)) * (2.0 / math.pi)
    return rho


@kernel
def locate_pieces(points: np.ndarray, tree: Tree, piece: np.ndarray, inside: np.ndarray) -> None:
    """Fill in the piece of every point (shape (3, n)), or NO_PIECE, and its coordinates in [-1, 1] `inside` it."""
    for i in range(points.shape[1]):
        x0, x1, x2 = points[0, i], points[1, i], points[2, i]
        piece[i] = NO_PIECE
        if not math.isfinite(x0 + x1 + x2):
            continue
        node, under, over, low, high = 0, -1, -1, 0.0, 0.0  # the borders met last below and above the point
        while tree.kinds[node] != LEAF:
            which = tree.numbers[node]
            if tree.kinds[node] == CUT:
                above = points[which, i] >= tree.cuts[node]
            else:
                height = border_height(tree, which, x0, x1)
                above = x2 >= height
                if above:
                    under, low = which, height
                else:
                    over, high = which, height
            node = tree.above[node] if above else tree.below[node]
        which = tree.numbers[node]
        if which == NO_PIECE:
            continue
        lower, upper = tree.end_borders[which, 0], tree.end_borders[which, 1]
        if lower < 0:
            low = tree.ends[which, 0]
        elif lower != under:
            low = border_height(tree, lower, x0, x1)
        if upper < 0:
            high = tree.ends[which, 1]
        elif upper != over:
            high = border_height(tree, upper, x0, x1)
        u = layer_coordinate((x2 - low) / (high - low), tree.forms[which]) if high > low else x2 - low
        box = tree.piece_boxes[which]
        flat_0, flat_1 = box[0, 0] == box[0, 1], box[1, 0] == box[1, 1]
        if (flat_0 and x0 != box[0, 0]) or (flat_1 and x1 != box[1, 0]) or (high == low and u != 0.0):
            continue
        a, b, c = scaled(x0, box[0]), scaled(x1, box[1]), scaled(u, box[2])
        if max(abs(a), abs(b), abs(c)) <= 1.0 + SLACK:
            piece[i] = which
            inside[0, i], inside[1, i], inside[2, i] = a, b, c


@kernel(fastmath=_SIGNS)
def chebyshev_polynomials(t: np.ndarray, width: int, count: int, out: np.ndarray) -> None:
    """Fill in the Chebyshev polynomials 0 ... count - 1 at the first `width` points."""
    for lane in range(width):
        out[0, lane] = 1.0
    if count > 1:
        for lane in range(width):
            out[1, lane] = t[lane]
    for k in range(2, count):
        for lane in range(width):
            out[k, lane] = 2.0 * t[lane] * out[k - 1, lane] - out[k - 2, lane]


@kernel
def _by_piece(piece: np.ndarray, pieces: int) -> tuple[np.ndarray, np.ndarray]:
    """Points in the order of their pieces, those without one first, and where each piece begins among them.

    The latter are shifted by one: the points of a piece k are from `first[k + 1]` to `first[k + 2]`.
    """
    count = len(piece)
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
    return order, first


@kernel(fastmath=_SIGNS)
def sum_series(
    piece: np.ndarray, inside: np.ndarray, wanted: np.ndarray, series: ChebyshevSeries, out: np.ndarray
) -> None:
    """Sum the Chebyshev series of the functions `wanted` at every point that `locate_pieces` found a piece for.

    The points of a piece are taken together, LANES at a time. `out` has the shape (len(wanted), n).
    """
    sizes, length_starts, lengths, starts, coefficients = series
    pieces = len(sizes)
    order, first = _by_piece(piece, pieces)
    t = np.zeros((3, LANES))
    p0, p1, p2 = (
        np.empty((MOST_COEFFICIENTS, LANES)),
        np.empty((MOST_COEFFICIENTS, LANES)),
        np.empty((MOST_COEFFICIENTS, LANES)),
    )
    inner, middle, total = np.empty(LANES), np.empty(LANES), np.empty(LANES)
    for which in range(pieces):
        for begin in range(first[which + 1], first[which + 2], LANES):
            width = min(LANES, first[which + 2] - begin)
            for lane in range(width):
                t[0, lane], t[1, lane] = inside[0, order[begin + lane]], inside[1, order[begin + lane]]
                t[2, lane] = inside[2, order[begin + lane]]
            chebyshev_polynomials(t[0], width, sizes[which, 0], p0)
            chebyshev_polynomials(t[1], width, sizes[which, 1], p1)
            chebyshev_polynomials(t[2], width, sizes[which, 2], p2)
            for f in range(len(wanted)):
                at_length = length_starts[which, wanted[f]]
                at_coefficient = starts[which, wanted[f]]
                for lane in range(width):
                    total[lane] = 0.0
                for i in range(sizes[which, 0]):
                    for lane in range(width):
                        middle[lane] = 0.0
                    for j in range(sizes[which, 1]):
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
