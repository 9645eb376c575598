"""Cells of the coordinates, and the interpolants fitted in them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial.chebyshev import chebval3d

from phasemap._kernels.materials.interpolate import EVEN_PLACE, ROOT_BOTH, ROOT_HIGH, ROOT_LOW
from phasemap._shared.arrays import Array
from phasemap.imaging.interpolation import chebyshev
from phasemap.imaging.interpolation.borders import Border
from phasemap.imaging.interpolation.chebyshev import coordinates, unscaled
from phasemap.imaging.interpolation.exact_orbits import HEIGHT, PHASE, ExactOrbits

End = float | Border

FIRST = 5  # nodes along a coordinate to begin with
MOST = 17  # before a cell is split
SHARE = 0.3  # of the tolerance that the last coefficients along one coordinate may have
STUCK = 20.0  # last coefficients over the tolerance above which more nodes must help at once
NEGLIGIBLE = 0.005  # of the tolerance: coefficients left out
SAFETY = 3.0  # of the largest error found by trial, in the estimate
FLOOR = 0.01  # of the tolerance, in the estimate: the error of the orbits themselves
TRIALS = (24, 192)  # least and most materials of the image on which a cell is tried
TRIED = 1 / 40  # share of them


@dataclass(frozen=True, eq=False)
class Cell:
    """A box in (x0, x1, u), with u the place between the lower and the upper end of a layer."""

    box: tuple[float, float, float, float, float, float]  # low and high of x0, x1 and u
    # lower, upper: ends of the layer in x2
    lower: End
    upper: End
    # How u goes with the relative place (`phasemap._kernels.materials.interpolate`): evenly, or with roots at borders
    form: int = EVEN_PLACE

    def side(self, axis: int) -> tuple[float, float]:
        """Low and high of one coordinate."""
        return self.box[2 * axis], self.box[2 * axis + 1]

    def points(self, x0: Array, x1: Array, u: Array) -> Array:
        """Points (n, 3) of places in the layer."""
        low, high = _height(self.lower, x0, x1), _height(self.upper, x0, x1)
        return np.column_stack([x0, x1, np.maximum(low + (high - low) * _share(u, self.form), 0.0)])

    def inside(self, points: Array) -> Array:
        """Coordinates in [-1, 1] of points (n, 3); beyond where they lie outside."""
        low, high = _height(self.lower, points[:, 0], points[:, 1]), _height(self.upper, points[:, 0], points[:, 1])
        thickness = np.where(high > low, high - low, 1.0)
        places = (points[:, 0], points[:, 1], _place((points[:, 2] - low) / thickness, self.form))
        return np.column_stack([coordinates(place, *self.side(axis)) for axis, place in enumerate(places)])

    @classmethod
    def between(
        cls,
        box: tuple[float, float, float, float],
        lower: End,
        upper: End,
        thickness: float,
        least_margin: float,
        grazes: bool,
    ) -> Cell:
        """A layer less a margin at each border: as wide as its error, at a jump at least `least_margin` of the layer.

        There orbits change with the root of the distance, and where the tip grazes integrals over contacts do, which
        are among the functions if `grazes`.
        """
        margins, roots = [0.0, 0.0], [False, False]
        for i, end in enumerate((lower, upper)):
            if isinstance(end, Border) and (end.sudden or grazes):
                roots[i], margins[i] = True, max(least_margin if end.sudden else 0.0, 4 * end.error / thickness)
        form = ((EVEN_PLACE, ROOT_HIGH), (ROOT_LOW, ROOT_BOTH))[roots[0]][roots[1]]
        low, high = (float(_place(np.array(share), form)) for share in (margins[0], 1 - margins[1]))
        return cls((*box, low, high), lower, upper, form)

    def level(self, u: float) -> End:
        """The surface of one u in x2: a height, or a level between ends that vary, which is no border of orbits."""
        share = float(_share(np.array(u), self.form))
        if not isinstance(self.lower, Border) and not isinstance(self.upper, Border):
            return self.lower + (self.upper - self.lower) * share
        border = self.lower if isinstance(self.lower, Border) else self.upper
        assert isinstance(border, Border)
        low, high = (
            end.coefficients if isinstance(end, Border) else np.array([[end]]) for end in (self.lower, self.upper)
        )
        mixed = np.zeros(np.maximum(low.shape, high.shape))
        mixed[: low.shape[0], : low.shape[1]] += (1 - share) * low
        mixed[: high.shape[0], : high.shape[1]] += share * high
        return Border(border.box, mixed, error=0.0, sudden=False)

    def halves(self, axis: int, at: float) -> tuple[Cell, Cell]:
        """The cell cut in two across a coordinate."""
        low, high = list(self.box), list(self.box)
        low[2 * axis + 1] = high[2 * axis] = at
        a, b, c, d, e, f = low
        g, h, i, j, k, m = high
        return replace(self, box=(a, b, c, d, e, f)), replace(self, box=(g, h, i, j, k, m))


@dataclass(frozen=True, eq=False)
class FilledCell:
    """A cell with its interpolant."""

    cell: Cell
    coefficients: Array  # shape (n0, n1, n2, functions)
    errors: Array  # shape (2,); Estimated, of height [m] and phase [rad]


@dataclass(frozen=True, eq=False)
class Rough:
    """A cell in which no interpolant was accepted, and the coordinate across which it changes most."""

    axis: int
    hopeless: bool = False


def _height(end: End, x0: Array, x1: Array) -> Array:
    """Height in x2 of an end of a layer, above (x0, x1)."""
    return end.height(x0, x1) if isinstance(end, Border) else np.full(len(x0), end)


def _share(u: Array, form: int) -> Array:
    """Relative place in a layer of u; the reverse of `_place`, and of `layer_coordinate` in `_kernels`."""
    if form == ROOT_LOW:
        return u * u
    if form == ROOT_HIGH:
        return 1 - (1 - u) ** 2
    return np.asarray(np.sin(0.5 * np.pi * u) ** 2) if form == ROOT_BOTH else u


def _place(share: Array, form: int) -> Array:
    """u of a relative place in a layer: the reverse of `_share`."""
    share = np.clip(share, 0, 1)
    if form == ROOT_LOW:
        return np.sqrt(share)
    if form == ROOT_HIGH:
        return 1 - np.sqrt(1 - share)
    return np.arcsin(np.sqrt(share)) * (2 / np.pi) if form == ROOT_BOTH else share


def evaluate(coefs: Array, inside: Array) -> Array:
    """Interpolant at coordinates in [-1, 1], shape (n, functions)."""
    t0, t1, t2 = np.clip(inside, -1, 1).T
    return np.asarray(chebval3d(t0, t1, t2, coefs)).T


class Refinement:
    """An interpolant in the making: exact orbits on a grid that grows along the coordinate that needs it."""

    def __init__(self, exact: ExactOrbits, cell: Cell) -> None:
        self.exact, self.cell = exact, cell
        sizes = [FIRST if high > low else 1 for low, high in map(cell.side, range(3))]
        self.values = self._solve([chebyshev.nodes(size) for size in sizes])

    def _solve(self, nodes: list[Array]) -> Array:
        """Exact orbits on a grid."""
        grid = np.meshgrid(*nodes, indexing="ij")
        points = self.cell.points(*(unscaled(t.reshape(-1), *self.cell.side(axis)) for axis, t in enumerate(grid)))
        return self.exact(points).reshape(*grid[0].shape, -1)

    @property
    def sizes(self) -> tuple[int, ...]:
        """Nodes along each coordinate."""
        return self.values.shape[:3]

    def growth(self, axis: int) -> int:
        """Number of further exact orbits that `grow` asks for."""
        size = self.sizes[axis]
        return (size - 1) * int(np.prod(self.sizes)) // size

    def grow(self, axis: int) -> None:
        """Put a node between each two along a coordinate."""
        nodes = [chebyshev.nodes(size) for size in self.sizes]
        nodes[axis] = chebyshev.nodes(2 * self.sizes[axis] - 1)[1::2]
        shape = list(self.values.shape)
        shape[axis] = 2 * shape[axis] - 1
        values = np.empty(shape)
        at: list[slice] = [slice(None)] * 4
        at[axis] = slice(None, None, 2)
        values[tuple(at)] = self.values
        at[axis] = slice(1, None, 2)
        values[tuple(at)] = self._solve(nodes)
        self.values = values

    def coefficients(self) -> Array:
        """Chebyshev coefficients, shape (n0, n1, n2, functions)."""
        return chebyshev.coefficients(self.values, [0, 1, 2])

    def tails(self, tolerances: Array) -> Array:
        """Last coefficients along each coordinate over the tolerance, the largest of all functions."""
        coefs = self.coefficients()
        return np.array([float((chebyshev.tail(coefs, axis, 3) / tolerances).max()) for axis in range(3)])


def fill_cell(exact: ExactOrbits, cell: Cell, tolerances: Array, materials: Array, budget: int) -> FilledCell | Rough:
    """Interpolate in a cell, with at most `budget` exact orbits, and try the interpolant on some of its `materials`."""
    asked = exact.asked
    if FIRST ** sum(low < high for low, high in map(cell.side, range(3))) > budget:
        return Rough(0, hopeless=True)
    making = Refinement(exact, cell)
    trial = _Trial(exact, cell, materials, tolerances)
    grown, before = -1, np.full(3, np.inf)
    while True:
        if not np.isfinite(making.values).all():
            return Rough(_bad_axis(making.values))
        tails = making.tails(tolerances)
        if grown >= 0 and tails[grown] > max(STUCK, 0.5 * before[grown]):
            return Rough(grown)
        if (tails < SHARE).all():
            piece = trial.passed(making.coefficients())
            if piece is not None:
                return piece
        order = [int(axis) for axis in np.argsort(-tails) if 1 < making.sizes[axis]]
        if not order:
            return Rough(0, hopeless=True)
        growing = [axis for axis in order if making.sizes[axis] < MOST]
        axis = order[0]
        if axis not in growing or exact.asked - asked + making.growth(axis) > budget:
            return Rough(axis)
        grown, before = axis, tails
        making.grow(axis)


def _bad_axis(values: Array) -> int:
    """The coordinate along which being held or not changes most often."""
    held = np.isfinite(values).all(axis=-1)
    changes = [np.count_nonzero(np.diff(held, axis=axis)) / max(1, held.shape[axis] - 1) for axis in range(3)]
    return int(np.argmax(changes))


class _Trial:
    """Exact orbits at materials of the image, to measure an interpolant by; solved when first asked for."""

    def __init__(self, exact: ExactOrbits, cell: Cell, materials: Array, tolerances: Array) -> None:
        """Choose from the `materials` in the cell, shape (n, 3), a share TRIED that is evenly spaced in their order."""
        self.exact, self.cell, self.tolerances = exact, cell, tolerances
        count = int(np.clip(len(materials) * TRIED, *TRIALS))
        chosen = np.unique(np.linspace(0, len(materials) - 1, count).astype(np.intp))
        self.points = materials[chosen]
        self.inside = cell.inside(self.points)
        self.values: Array | None = None

    def passed(self, coefs: Array) -> FilledCell | None:
        """Return the piece if its estimated errors are within the tolerances."""
        if self.values is None:
            self.values = self.exact(self.points)
        coefs = np.where(abs(coefs) < NEGLIGIBLE * self.tolerances, 0.0, coefs)
        errors = abs(evaluate(coefs, self.inside) - self.values)
        if not np.isfinite(errors).all():
            return None
        estimates = SAFETY * errors.max(axis=0)
        if (estimates > self.tolerances).any():
            return None
        least = FLOOR * self.tolerances[[HEIGHT, PHASE]]
        return FilledCell(self.cell, coefs, estimates[[HEIGHT, PHASE]] + np.maximum(least, self.exact.errors))
