"""The material of each pixel: Levenberg-Marquardt for all pixels of a block at once.

Phase and height are those of averaged orbits and of a defect, the difference of exact and averaged orbits at the
material found before: repeated, that leads to the least squares of the exact model, at the price of the averaged one
(theory, Eq. (inversion-2)). The pixel's own topography is an unknown of its own, which a projection takes out of its
heights.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels.rows.derivatives import Found
from phasemap.inference.images.descent import descend
from phasemap.inference.images.model import Model, sides_of
from phasemap.inference.images.stack import HEIGHT, PHASE, Stack

Array = NDArray[np.float64]

GRID = (7, 4, 7)  # materials among which the search starts, over SHARE_OF_GRID
SHARE_OF_GRID = 0.43  # of the largest logarithm that is tried
DEFECTS = 2  # times that the difference of exact and averaged orbits is taken


@dataclass(frozen=True, eq=False)
class Grid:
    """Averaged orbits of materials all over the range, for each image and branch."""

    q: Array  # shape (g, 3)
    values: Array  # shape (2, g, m, 2); on the attractive and the repulsive branch; NaN without an orbit
    places: Array  # shape (2, g, m)


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
    for branch, side in enumerate((-1, 1)):
        for j in range(count):
            place = np.full((len(q), 1), np.nan)
            found = model.image(j).averaged(q, np.full((len(q), 1), side, np.int8), place, search=True)
            values[branch, found.good, j] = found.values[found.good, 0]
            places[branch, :, j] = place[:, 0]
    return Grid(q, values, places)


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
        n = len(self.data)
        q, places = self._start()
        defect = np.zeros_like(self.data)
        corrected: NDArray[np.bool_] = np.zeros(n, np.bool_)
        for again in range(DEFECTS + 1):
            found, _ = descend(self, (self.sides != 0).any(axis=1), q, places, defect)
            if again < DEFECTS:
                exact, known = self.model.exact(q, self.sides, places)
                known |= self.sides == 0
                corrected = np.asarray(known.all(axis=1))
                fresh = np.where(np.isnan(exact), 0.0, exact - found.values)
                defect = np.where(corrected[:, None, None], fresh, defect)
        slopes = self.weigh(found.slopes)
        rest = self.rest(found.values, defect)
        return Solution(
            q, np.einsum("nai,naj->nij", slopes, slopes) + self.prior, slopes, rest,
            found.values + defect, places, defect, found.good, corrected,
        )  # fmt: skip

    def _start(self) -> tuple[Array, Array]:
        """The material of the grid that is nearest to the data."""
        q, places = np.zeros((len(self.data), 3)), np.full(self.sides.shape, np.nan)
        cost_of_prior = self._cost_of_prior(self.grid.q)
        patterns, which = np.unique(self.sides, axis=0, return_inverse=True)
        which = which.reshape(-1)
        images = np.arange(self.sides.shape[1])
        for k, pattern in enumerate(patterns):
            pixels = np.flatnonzero(which == k)
            branch = (pattern > 0).astype(int)
            values = self.grid.values[branch, :, images].transpose(1, 0, 2)  # (g, m, 2)
            at = self.grid.places[branch, :, images].T
            values = np.where((pattern == 0)[None, :, None], 0.0, values)
            usable = np.flatnonzero(np.isfinite(values).all(axis=(1, 2)))
            if not len(usable):
                continue
            for some in np.array_split(pixels, -(-len(pixels) // 512)):
                apart = (self.data[some, None] - values[None, usable]) * self.weights[some, None]
                apart[..., HEIGHT] -= self.level[some, None] * (self.level[some, None] * apart[..., HEIGHT]).sum(
                    -1, keepdims=True
                )
                best = usable[np.argmin((apart**2).sum(axis=(2, 3)) + cost_of_prior[usable], axis=1)]
                q[some], places[some] = self.grid.q[best], at[best]
        return q, places

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
        cost: Array = (self.rest(values, defect) ** 2).sum(axis=1) + self._cost_of_prior(q)
        return cost

    def _cost_of_prior(self, q: Array) -> Array:
        cost: Array = ((self.apart(q) / self.model.widths) ** 2).sum(axis=1)
        return cost

    def rest(self, values: Array, defect: Array) -> Array:
        """Weighted residuals without what topography explains, shape (n, 2 m)."""
        apart = self.data - values - defect
        apart[:, :, PHASE] = (apart[:, :, PHASE] + np.pi) % (2 * np.pi) - np.pi
        return self.weigh(apart[..., None])[..., 0]

    def weigh(self, slopes: Array) -> Array:
        """Derivatives of phase and height, shape (n, m, 2, k), as those of `rest`, shape (n, 2 m, k)."""
        weighed = slopes * self.weights[..., None]
        height = weighed[:, :, HEIGHT]
        height -= self.level[..., None] * (self.level[..., None] * height).sum(axis=1, keepdims=True)
        return weighed.reshape(len(weighed), 2 * weighed.shape[1], weighed.shape[-1])
