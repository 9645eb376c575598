"""Materials all over the range, among which the search starts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from phasemap.inference.images.descent import Solution, descend
from phasemap.inference.images.model import Model
from phasemap.inference.images.problem import Problem

Array = NDArray[np.float64]

GRID = (7, 4, 7)  # materials, over SHARE_OF_GRID
SHARE_OF_GRID = 0.43  # of the largest logarithm that is tried
STARTS, ASTRAY = 3, 50.0  # materials that are tried, and chi2 above which the next one is


@dataclass(frozen=True, eq=False)
class Grid:
    """Averaged orbits of materials, for each image and branch."""

    q: Array  # shape (g, 3)
    values: Array  # shape (2, g, m, 2); on the attractive and the repulsive branch; NaN without an orbit
    places: Array  # shape (2, g, m)
    defects: Array  # shape (2, g, m, 2); how much exact orbits differ; 0 where they are not known

    def on(self, branches: NDArray[np.int8]) -> tuple[NDArray[np.intp], Array]:
        """Materials with orbits on these branches, shape (m,), in every image, and their values, shape (k, m, 2)."""
        values = self.values[(branches > 0).astype(int), :, np.arange(len(branches))].transpose(1, 0, 2)
        values = np.where((branches == 0)[:, None], 0.0, values)
        usable = np.flatnonzero(np.isfinite(values).all(axis=(1, 2)))
        return usable, values[usable]


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


def nearest(problem: Problem, grid: Grid, count: int) -> tuple[NDArray[np.intp], Array]:
    """The materials of the grid that are nearest to the data of n pixels, -1 if there are none, and chi2 with them."""
    from scipy.spatial.distance import cdist

    which, cost = np.full((len(problem.data), count), -1), np.full((len(problem.data), count), np.inf)
    nothing = np.zeros(problem.data.shape[1:])
    patterns, pattern_of = np.unique(problem.sides[:, 0], axis=0, return_inverse=True)
    for k, pattern in enumerate(patterns):
        some = np.flatnonzero(pattern_of.reshape(-1) == k)
        usable, values = grid.on(pattern)
        if not len(usable):
            continue
        data = problem.part(some).rest(nothing, nothing)
        weighed = np.pad((values * problem.weights[0]).reshape(len(usable), -1), ((0, 0), (0, problem.held.shape[1])))
        total = cdist(data, problem.projection.without(weighed[..., None])[..., 0], "sqeuclidean")
        total += (((grid.q[usable] - problem.model.centre) / problem.model.widths) ** 2).sum(axis=1)
        best = np.argsort(total, axis=1, kind="stable")[:, :count]
        which[some, : best.shape[1]] = usable[best]
        cost[some, : best.shape[1]] = np.take_along_axis(total, best, axis=1)
    return which, cost


def descend_from_grid(problem: Problem, grid: Grid) -> Solution:
    """Best material of each pixel with the defect of the grid, from where that is nearest to the data or next to it."""
    starts, _ = nearest(problem, grid, STARTS)
    found = descend(problem, *_at(problem, grid, starts[:, 0]))
    for start in starts[:, 1:].T:
        astray = np.flatnonzero((problem.sides != 0).any(axis=(1, 2)) & (found.cost > ASTRAY) & (start >= 0))
        part = problem.part(astray)
        again = descend(part, *_at(part, grid, start[astray]))
        better = again.cost < found.cost[astray]
        found.put(astray[better], again.part(better))
    return found


def _at(problem: Problem, grid: Grid, start: NDArray[np.intp]) -> tuple[Array, Array, Array]:
    """Materials of the grid, places of their orbits and defects; the prior's material without orbits for -1."""
    sides = problem.sides[:, 0]
    branch, images, none = (sides > 0).astype(int), np.arange(sides.shape[1]), start < 0
    q, places = grid.q[start], grid.places[branch, start[:, None], images]
    defect = grid.defects[branch, start[:, None], images]
    q[none], places[none], defect[none[:, None] | (sides == 0)] = 0.0, np.nan, 0.0
    return q, places[:, None], defect[:, None]
