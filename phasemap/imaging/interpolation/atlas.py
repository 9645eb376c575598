"""An atlas, all interpolants over the materials of an image and where each holds: how it is built, and its evaluation.

Borders come first, then cells between them, cut where they are too rough.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels.materials.interpolate import (
    BORDER,
    CUT,
    LEAF,
    NO_PIECE,
    ChebyshevSeries,
    Tree,
    locate_pieces,
    sum_series,
)
from phasemap._shared.arrays import Array
from phasemap.imaging.interpolation.borders import Border, Undecided, find_borders
from phasemap.imaging.interpolation.cells import Cell, FilledCell, fill_cell
from phasemap.imaging.interpolation.chebyshev import unscaled
from phasemap.imaging.interpolation.exact_orbits import ExactOrbits

Ints = NDArray[np.int64]

REST = 1e-8  # coefficients of a border that are left out, over the largest


@dataclass(frozen=True, eq=False)
class Atlas:
    """Interpolants over materials, as `phasemap._kernels.materials.interpolate` reads them."""

    tree: Tree
    series: ChebyshevSeries
    errors: Array  # shape (pieces, 2); estimated in each piece, of height [m] and phase [rad]

    @classmethod
    def of(
        cls,
        nodes: Sequence[Sequence[int]],
        values: Sequence[float],
        borders: Sequence[Border],
        pieces: Sequence[FilledCell],
    ) -> Atlas:
        """Pack the parts of an atlas."""
        number = {id(border): i for i, border in enumerate(borders)}
        ends = np.zeros((len(pieces), 2))
        end_borders = np.full((len(pieces), 2), -1, np.int64)
        for i, piece in enumerate(pieces):
            for j, end in enumerate((piece.cell.lower, piece.cell.upper)):
                if isinstance(end, Border):
                    end_borders[i, j] = number[id(end)]
                else:
                    ends[i, j] = end
        tables = [_without_rest(border.coefficients) for border in borders]
        kinds, numbers, below, above = np.array(nodes, np.int64).reshape(-1, 4).T.copy()
        tree = Tree(
            kinds, numbers, below, above, np.array(values, np.float64),
            np.array([border.box for border in borders], np.float64).reshape(-1, 2, 2),
            np.array([table.shape for table in tables], np.int64).reshape(-1, 2),
            np.cumsum([0, *(table.size for table in tables)]).astype(np.int64),
            _joined([table.reshape(-1) for table in tables], np.float64),
            np.array([piece.cell.box for piece in pieces], np.float64).reshape(-1, 3, 2), ends, end_borders,
            np.array([piece.cell.form for piece in pieces], np.int64),
        )  # fmt: skip
        errors = np.array([piece.errors for piece in pieces], np.float64).reshape(-1, 2)
        return cls(tree, _packed(pieces), errors)

    @property
    def pieces(self) -> int:
        """Number of interpolants."""
        return len(self.errors)

    def __call__(self, points: Array, wanted: Ints) -> tuple[NDArray[np.int32], Array]:
        """Piece of every point, shape (3, n), -1 where there is none, and functions `wanted`, shape (wanted, n)."""
        count = points.shape[1]
        piece, inside = np.empty(count, np.int32), np.empty((3, count))
        out = np.full((len(wanted), count), np.nan)
        locate_pieces(points, self.tree, piece, inside)
        sum_series(piece, inside, wanted, self.series, out)
        return piece, out


def _without_rest(table: Array) -> Array:
    """Coefficients of a border without negligible ones at the end of either coordinate."""
    rows, columns = (np.flatnonzero((abs(table) > REST * abs(table).max()).any(axis=1 - axis)) for axis in (0, 1))
    return table[: rows[-1] + 1, : columns[-1] + 1] if len(rows) else table[:1, :1]


def _packed(pieces: Sequence[FilledCell]) -> ChebyshevSeries:
    """Series of each piece, without the negligible coefficients at the end along u."""
    count = pieces[0].coefficients.shape[-1] if pieces else 0
    sizes = np.array([piece.coefficients.shape[:3] for piece in pieces], np.int64).reshape(-1, 3)
    length_starts, starts = np.zeros((len(pieces), count), np.int64), np.zeros((len(pieces), count), np.int64)
    lengths: list[Array] = []
    kept: list[Array] = []
    at_length = at = 0
    for i, piece in enumerate(pieces):
        for f in range(count):
            table = piece.coefficients[..., f].reshape(-1, sizes[i, 2])
            length = np.where(table != 0, np.arange(1, sizes[i, 2] + 1), 0).max(axis=1)
            part = table[np.arange(sizes[i, 2]) < length[:, None]]
            length_starts[i, f], starts[i, f] = at_length, at
            lengths.append(length)
            kept.append(part)
            at_length, at = at_length + len(length), at + len(part)
    return ChebyshevSeries(sizes, length_starts, _joined(lengths, np.int64), starts, _joined(kept, np.float64))


def _joined(parts: Sequence[Array], dtype: type) -> Array:
    """Parts one after the other; an empty array of this type if there are none."""
    return np.concatenate([np.zeros(0), *parts]).astype(dtype)


Box = tuple[float, float, float, float, float, float]  # low and high of x0, x1, x2

WORTH = 0.2  # exact orbits that a cell may take, over those it saves, which take a third to a sixth of the time
LEAST = 100  # materials for which a cell is tried at all
LOOK = 100  # exact orbits that it takes to see whether there are borders,
LOCATE = 3000  # and to locate them, 2,000 to 6,000 as measured; a quarter where one of (x0, x1) does not vary
ROOM = 0.01  # by which the box of the sample is widened
MARGIN, WIDEST = 2e-4, 2e-3  # least and largest share of a layer next to a jump that is left to exact orbits
LEFT = 50.0  # pixels in it, for orbits beside a jump cost more: nodes of an interpolant should not be nearer
DEEPEST = 14  # cuts one after another


def build(exact: ExactOrbits, sample: Array, count: int, tolerances: Array) -> Atlas:
    """Make an atlas for `count` materials of an image, of which `sample` are some, with tolerances of each function."""
    if not len(sample):
        return Atlas.of([[LEAF, NO_PIECE, -1, -1]], [0.0], [], [])
    extent = np.ptp(sample, axis=0)
    builder = _Builder(exact, tolerances, count / len(sample), np.where(extent > 0, extent, 1.0))
    builder.column(_box_of(sample, exact.axes.lowest), sample, 0)
    return Atlas.of(builder.nodes, builder.values, builder.borders, builder.pieces)


def _box_of(points: Array, lowest: Array) -> Box:
    """Box of the points with some room, but not below the `lowest` coordinates."""
    low, high = points.min(axis=0), points.max(axis=0)
    room = ROOM * (high - low)
    low, high = np.maximum(low - room, np.minimum(lowest, low)), high + room
    (a, b, c), (d, e, f) = low.tolist(), high.tolist()
    return a, d, b, e, c, f


class _Builder:
    """Grows the tree of an atlas."""

    def __init__(self, exact: ExactOrbits, tolerances: Array, weight: float, extent: Array) -> None:
        self.exact, self.tolerances, self.weight = exact, tolerances, weight
        self.extent = extent
        self.nodes: list[list[int]] = []
        self.values: list[float] = []
        self.borders: list[Border] = []
        self.pieces: list[FilledCell] = []

    def _node(self, kind: int, which: int, value: float = 0.0) -> int:
        """Add a node of this kind with the number of its border or piece, its two children open; returns its number."""
        self.nodes.append([kind, which, -1, -1])
        self.values.append(value)
        return len(self.nodes) - 1

    def _budget(self, materials: Array) -> int:
        """Exact orbits that a cell with these materials may take: fewer than it saves; 0 if too few lie in it."""
        return int(WORTH * self.weight * len(materials)) if len(materials) * self.weight >= LEAST else 0

    def _few_above(self, box: Box, materials: Array) -> float:
        """Adhesion above which so few materials lie that it does not pay to locate borders; -inf if it is so of all."""
        # What locating takes, in exact orbits, over what a material is worth.
        taken = LOCATE / 4.0 ** sum(box[side] == box[side + 1] for side in (0, 2))
        few = max(1, int(taken / (WORTH * self.weight)))
        return float(np.partition(materials[:, 2], -few)[-few]) if few <= len(materials) else -np.inf

    def column(self, box: Box, materials: Array, depth: int) -> int:
        """Everything above a box of (x0, x1): its layers, or the two halves of it."""
        low, high = box[4], box[5]
        whole = Cell((*box[:4], 0.0, 1.0 if high > low else 0.0), low, high)
        if self.exact.marched:  # borders are folds of static forces: here cells are cut where orbits jump
            return self.cell(whole, materials, depth)
        if self._budget(materials) < LOOK or depth > DEEPEST:
            return self._node(LEAF, NO_PIECE)
        try:
            few = self._few_above(box, materials)
            borders = find_borders(self.exact.bare, (box[0], box[1], box[2], box[3]), low, high, few)
        except Undecided as undecided:
            if undecided.below is not None:
                return self._cut_lines(box, undecided.below, materials, depth)
            return self._cut_column(box, materials, depth) if undecided.worth else self._node(LEAF, NO_PIECE)
        if borders:
            return self._layers(box, materials, depth, borders)
        return self.cell(whole, materials, depth)

    def _cut_column(self, box: Box, materials: Array, depth: int) -> int:
        """Two halves of a box of (x0, x1), cut across its longer side."""
        sides = [(box[2 * axis + 1] - box[2 * axis]) / self.extent[axis] for axis in (0, 1)]
        axis = int(np.argmax(sides))
        if sides[axis] == 0:
            return self._node(LEAF, NO_PIECE)
        at = 0.5 * (box[2 * axis] + box[2 * axis + 1])
        node = self._node(CUT, axis, at)
        above = materials[:, axis] >= at
        for side, part in ((2, materials[~above]), (3, materials[above])):
            half = list(box)
            half[2 * axis + (side == 2)] = at
            a, b, c, d, e, f = half
            self.nodes[node][side] = self.column((a, b, c, d, e, f), part, depth + 1)
        return node

    def _cut_lines(self, box: Box, at: float, materials: Array, depth: int) -> int:
        """Two columns, below and above one adhesion."""
        node = self._node(CUT, 2, at)
        above = materials[:, 2] >= at
        self.nodes[node][2] = self.column((*box[:4], box[4], at), materials[~above], depth + 1)
        self.nodes[node][3] = self.column((*box[:4], at, box[5]), materials[above], depth + 1)
        return node

    def _layers(self, box: Box, materials: Array, depth: int, borders: list[Border]) -> int:
        """Chain of borders, with the layer below each."""
        lowest = min(box[4], 0.8 * _extremes(borders[0])[0])
        highest = max(box[5], 1.25 * _extremes(borders[-1])[1])
        ends: list[float | Border] = [lowest, *borders, highest]
        chain = [self._node(BORDER, self._number(border)) for border in borders]
        for i, node in enumerate(chain):
            inside = materials[:, 2] < borders[i].height(materials[:, 0], materials[:, 1])
            self.nodes[node][2] = self._layer(box, ends[i], ends[i + 1], materials[inside], depth)
            materials = materials[~inside]
            if i + 1 < len(chain):
                self.nodes[node][3] = chain[i + 1]
        self.nodes[chain[-1]][3] = self._layer(box, ends[-2], ends[-1], materials, depth)
        return chain[0]

    def _layer(self, box: Box, lower: float | Border, upper: float | Border, materials: Array, depth: int) -> int:
        """The cells between two borders, or a leaf without interpolant: its materials get exact orbits."""
        if not self._budget(materials):
            return self._node(LEAF, NO_PIECE)
        x0, x1 = materials[:, 0], materials[:, 1]
        low = lower.height(x0, x1) if isinstance(lower, Border) else lower
        high = upper.height(x0, x1) if isinstance(upper, Border) else upper
        share = min(max(MARGIN, LEFT / (self.weight * len(materials))), WIDEST)
        cell = Cell.between(box[:4], lower, upper, float(np.min(high - low)), share, self.exact is not self.exact.bare)
        outside = (abs(cell.inside(materials)) > 1).any(axis=1)  # in the margins, where orbits stay exact
        return self.cell(cell, materials[~outside], depth)

    def cell(self, cell: Cell, materials: Array, depth: int) -> int:
        """A leaf with the interpolant of a cell, or the two halves of it."""
        budget = self._budget(materials)
        new = fill_cell(self.exact, cell, self.tolerances, materials, budget) if budget else None
        if isinstance(new, FilledCell):
            self.pieces.append(new)
            return self._node(LEAF, len(self.pieces) - 1)
        if new is None or new.hopeless or depth > DEEPEST:
            return self._node(LEAF, NO_PIECE)
        at = 0.5 * sum(cell.side(new.axis))
        level = cell.level(at) if new.axis == 2 else at
        node = (
            self._node(BORDER, self._number(level)) if isinstance(level, Border) else self._node(CUT, new.axis, level)
        )
        above = cell.inside(materials)[:, new.axis] >= 0.0
        for side, half, part in zip(
            (2, 3), cell.halves(new.axis, at), (materials[~above], materials[above]), strict=True
        ):
            self.nodes[node][side] = self._half_cell(half, part, depth + 1)
        return node

    def _half_cell(self, cell: Cell, materials: Array, depth: int) -> int:
        """Half of a cell as a new cell: where no border was known, there may be one in it."""
        if isinstance(cell.lower, Border) or isinstance(cell.upper, Border):
            return self.cell(cell, materials, depth)
        low, high = (cell.level(u) for u in cell.side(2))
        assert isinstance(low, float) and isinstance(high, float)
        return self.column((*cell.box[:4], low, high), materials, depth)

    def _number(self, border: Border) -> int:
        """Add a border; returns its number."""
        self.borders.append(border)
        return len(self.borders) - 1


def _extremes(border: Border) -> tuple[float, float]:
    """Lowest and highest adhesion of a border over its box, nearly."""
    t = np.linspace(-1, 1, 9)
    x0, x1 = np.meshgrid(unscaled(t, *border.box[:2]), unscaled(t, *border.box[2:]))
    heights = border.height(x0.ravel(), x1.ravel())
    return float(heights.min()), float(heights.max())
