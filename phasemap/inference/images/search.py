"""The material of each pixel: Levenberg-Marquardt for all pixels of a block at once.

Phase and height are those of averaged orbits and of a defect, the difference of exact and averaged orbits at the
material found before: repeated, that leads to the least squares of the exact model, at the price of the averaged one
(theory, Eq. (inversion-3)). The pixel's own topography is an unknown of its own, which a projection takes out of its
heights.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels.least_squares import weighed_rows
from phasemap._kernels.rows.derivatives import Found
from phasemap.inference.images.descent import descend, normal_equations
from phasemap.inference.images.model import Model, sides_of
from phasemap.inference.images.stack import HEIGHT, PHASE, Stack

Array = NDArray[np.float64]

GRID = (7, 4, 7)  # materials among which the search starts, over SHARE_OF_GRID
SHARE_OF_GRID = 0.43  # of the largest logarithm that is tried
DEFECTS = 2  # times that the difference of exact and averaged orbits is taken, if not
ENOUGH = 0.01  # of a standard error: by as much, at most, that difference is then expected to change
BESIDE = 1e-3  # of a logarithm, where exact orbits are asked for if those of a material itself are not found
STARTS, ASTRAY = 3, 50.0  # materials of the grid that are tried, and chi2 above which the next one is
ONE_THREAD = 200_000  # products of a matrix product that linear algebra does not share out to threads


@dataclass(frozen=True, eq=False)
class Grid:
    """Averaged orbits of materials all over the range, for each image and branch."""

    q: Array  # shape (g, 3)
    values: Array  # shape (2, g, m, 2); on the attractive and the repulsive branch; NaN without an orbit
    places: Array  # shape (2, g, m)
    defects: Array  # shape (2, g, m, 2); how much exact orbits differ; 0 where they are not known


class Solution(NamedTuple):
    """What was found for n pixels."""

    q: Array  # shape (n, 3)
    information: Array  # shape (n, 3, 3); inverse of the covariance, prior included
    slopes: Array  # shape (n, 2 m, 3); derivatives of the weighted data
    rest: Array  # shape (n, 2 m); weighted residuals
    values: Array  # shape (n, m, 2); phase and tip offset of the model
    # places, defect: shape (n, m), (n, m, 2); where the averaged orbits are, and how much the exact ones differ
    places: Array
    defect: Array
    # good, corrected: bool, shape (n,); whether there is an orbit in every image, and whether the exact ones are
    # known
    good: NDArray[np.bool_]
    corrected: NDArray[np.bool_]

    def part(self, chosen: NDArray[Any]) -> Solution:
        """The same for some of the pixels."""
        parts: Any = (values[chosen] for values in self)
        return Solution(*parts)


def make_grid(model: Model) -> Grid:
    """Orbits of materials that fill the range searched."""
    axes = [np.linspace(-1, 1, count) * SHARE_OF_GRID * model.reach for count in GRID]
    q = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    count = len(model.amplitudes)
    values, places = np.full((2, len(q), count, 2), np.nan), np.full((2, len(q), count), np.nan)
    defects = np.zeros_like(values)
    for branch, side in enumerate((-1, 1)):
        sides = np.full((len(q), 1), side, np.int8)
        for j in range(count):
            place, image = np.full((len(q), 1), np.nan), model.image(j)
            found = image.averaged(q, sides, place, search=True)
            good = found.good
            values[branch, good, j], places[branch, :, j] = found.values[good, 0], place[:, 0]
            exact, _ = image.exact(q[good], sides[good], place[good])
            defects[branch, good, j] = np.nan_to_num(exact - found.values[good])[:, 0]
    return Grid(q, values, places, defects)


class Block:
    """Pixels that are solved together."""

    def __init__(self, model: Model, grid: Grid, stack: Stack) -> None:
        self.model, self.grid = model, grid
        self.data = stack.values
        self.weights = 1.0 / stack.errors
        self.sides = sides_of(stack)
        size = np.linalg.norm(self.weights[:, :, HEIGHT], axis=1, keepdims=True)
        self.level = self.weights[:, :, HEIGHT] / np.where(size > 0, size, 1.0)
        self.prior, self.reach = np.diag(model.widths**-2), model.reach

    def solve(self) -> Solution:
        """Material of each pixel."""
        active = (self.sides != 0).any(axis=1)
        q, places, defect, found = self._descend_from_grid(active)
        corrected: NDArray[np.bool_] = np.zeros(len(q), np.bool_)
        todo = np.arange(len(q))
        for _ in range(DEFECTS):
            part, there, near, taken = self.part(todo), q[todo], places[todo], defect[todo]
            fresh, known = part._defect(there, near, found.values[todo])
            lost = np.flatnonzero(~known)
            beside, others = there[lost] + BESIDE, near[lost]
            averaged = part.part(lost).orbits(beside, others)
            fresh[lost], known[lost] = part.part(lost)._defect(beside, others, averaged.values)
            corrected[todo] = known
            taken = np.where(known[:, None, None], fresh, taken)
            again, _ = descend(part, active[todo], there, near, taken)
            moved = np.abs(there - q[todo]).max(axis=1)  # the defect changes by less than its share of that
            for whole, some in zip((q, places, defect, *found), (there, near, taken, *again), strict=True):
                whole[todo] = some
            done = moved * np.abs(taken * part.weights).max(axis=(1, 2)) < ENOUGH
            todo = todo[~(known & done)]
        slopes = self.weigh(found.slopes)
        rest = self.rest(found.values, defect)
        information, _ = normal_equations(self.prior, slopes, rest, self.apart(q))
        return Solution(
            q, information, slopes, rest,
            found.values + defect, places, defect, found.good, corrected,
        )  # fmt: skip

    def _defect(self, q: Array, places: Array, averaged: Array) -> tuple[Array, NDArray[np.bool_]]:
        """How much exact orbits differ from these averaged ones, and of which pixels all are known."""
        exact, good = self.model.exact(q, self.sides, places)
        known: NDArray[np.bool_] = (good | (self.sides == 0)).all(axis=1)
        return np.where(np.isnan(exact), 0.0, exact - averaged), known

    def _descend_from_grid(self, active: NDArray[np.bool_]) -> tuple[Array, Array, Array, Found]:
        """Best material with the defect of the grid, from where the grid is nearest to the data or else next to that.

        Returns materials, places of their orbits, defects and orbits.
        """
        starts = self._nearest()
        q, places, defect = self._at(starts[:, 0])
        found, cost = descend(self, active, q, places, defect)
        for start in starts[:, 1:].T:
            astray = np.flatnonzero(active & (cost > ASTRAY) & (start >= 0))
            part = self.part(astray)
            others = part._at(start[astray])
            again, costs = descend(part, active[astray], *others)
            better = costs < cost[astray]
            won = astray[better]
            for whole, some in zip((q, places, defect, cost, *found), (*others, costs, *again), strict=True):
                whole[won] = some[better]
        return q, places, defect, found

    def _nearest(self) -> NDArray[np.intp]:
        """Which materials of the grid are nearest to the data, shape (n, STARTS); -1 if there are none."""
        nearest = np.full((len(self.data), STARTS), -1)
        cost_of_prior = self.cost_of_prior(self.grid.q)
        patterns, which = np.unique(self.sides, axis=0, return_inverse=True)
        which = which.reshape(-1)
        images = np.arange(self.sides.shape[1])
        for k, pattern in enumerate(patterns):
            pixels = np.flatnonzero(which == k)
            values = self.grid.values[(pattern > 0).astype(int), :, images].transpose(1, 0, 2)  # (g, m, 2)
            values = np.where((pattern == 0)[None, :, None], 0.0, values)
            usable = np.flatnonzero(np.isfinite(values).all(axis=(1, 2)))
            count = min(STARTS, len(usable))
            for some in np.array_split(pixels, -(-len(pixels) * values.size // ONE_THREAD)):
                misfits = self._misfits(some, values[usable]) + cost_of_prior[usable]
                nearest[some, :count] = usable[np.argsort(misfits, axis=1, kind="stable")[:, :count]]
        return nearest

    def _at(self, start: NDArray[np.intp]) -> tuple[Array, Array, Array]:
        """Materials of the grid, places of their orbits and defects; the prior's material without orbits for -1."""
        branch, images, none = (self.sides > 0).astype(int), np.arange(self.sides.shape[1]), start < 0
        q, places = self.grid.q[start], self.grid.places[branch, start[:, None], images]
        defect = self.grid.defects[branch, start[:, None], images]
        q[none], places[none], defect[none[:, None] | (self.sides == 0)] = 0.0, np.nan, 0.0
        return q, places, defect

    def _misfits(self, some: NDArray[np.intp], values: Array) -> Array:
        """chi2 of some pixels with each of g materials, up to what is the same for all of them, shape (n, g)."""
        centre = values.mean(axis=0)  # taken off, so that little is lost in the differences of squares
        data, values, weights = self.data[some] - centre, values - centre, self.weights[some]
        n, g = len(some), len(values)
        squares = (weights**2).reshape(n, -1)
        misfits = squares @ (values**2).reshape(g, -1).T
        misfits -= 2.0 * (squares * data.reshape(n, -1)) @ values.reshape(g, -1).T
        level = self.level[some] * weights[:, :, HEIGHT]
        misfits -= ((level * data[:, :, HEIGHT]).sum(axis=1, keepdims=True) - level @ values[:, :, HEIGHT].T) ** 2
        return np.asarray(misfits)

    def orbits(self, q: Array, places: Array, search: bool = False) -> Found:
        """Averaged orbits of these materials near `places`, which are moved to them."""
        return self.model.averaged(q, self.sides, places, search)

    def apart(self, q: Array) -> Array:
        """Logarithms less what the prior expects."""
        return q - self.model.centre

    def part(self, chosen: NDArray[Any]) -> Block:
        """The same for some of the pixels."""
        part = object.__new__(Block)
        part.model, part.grid, part.prior, part.reach = self.model, self.grid, self.prior, self.reach
        part.data, part.weights = self.data[chosen], self.weights[chosen]
        part.sides, part.level = self.sides[chosen], self.level[chosen]
        return part

    def cost(self, values: Array, defect: Array, q: Array) -> Array:
        """chi2 of data and prior, shape (n,)."""
        cost: Array = (self.rest(values, defect) ** 2).sum(axis=1) + self.cost_of_prior(q)
        return cost

    def cost_of_prior(self, q: Array) -> Array:
        """chi2 of the prior, shape (n,)."""
        cost: Array = ((self.apart(q) / self.model.widths) ** 2).sum(axis=1)
        return cost

    def rest(self, values: Array, defect: Array) -> Array:
        """Weighted residuals without what topography explains, shape (n, 2 m)."""
        apart = self.data - values - defect
        apart[:, :, PHASE] = (apart[:, :, PHASE] + np.pi) % (2 * np.pi) - np.pi
        return self.weigh(apart[..., None])[..., 0]

    def weigh(self, slopes: Array) -> Array:
        """Derivatives of phase and height, shape (n, m, 2, k), as those of `rest`, shape (n, 2 m, k)."""
        n, m, _, unknowns = slopes.shape
        weighed = np.empty((n, 2 * m, unknowns))
        weighed_rows(slopes, self.weights, self.level, weighed)
        return weighed
