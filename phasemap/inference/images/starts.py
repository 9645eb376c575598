"""Starts of the search: materials all over the range, those nearest to a pixel, and those that regions agree with.

What one region's material leaves of its data are the zeros; with these, every other region stands alone like a pixel.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from phasemap._shared.arrays import Array
from phasemap.inference.images.least_squares import (
    LONGEST,
    RegionProblems,
    Solution,
    go_downhill,
    information,
    problem_of_pixels,
)
from phasemap.inference.images.model import SIDES, Model
from phasemap.inference.images.stack import FREE, HEIGHT, PHASE, SHARED, Stack, ZeroPlan

Codes = NDArray[np.int8]

GRID = (7, 4, 7)  # materials, over SHARE_OF_GRID
# Adhesions where tips are attracted: where that branch begins, chi2 has a narrow minimum, which coarser ones step over.
ADHESIONS = 13
SHARE_OF_GRID = 0.43  # of the largest logarithm that is tried
STARTS = 3  # materials that are tried
AT_ONCE = 512  # pixels for which all materials of the grid are looked at
DOUBTFUL = 2.0  # chi2 above which the next one is, whatever is expected: above its mean, in standard deviations
MOST = 24  # starts
OF_A_KIND = 4  # of them with the same branches
SEPARATE = 1.5  # in a logarithm, between starts with the same branches
WORTH = 9.0  # chi2 above the least found, at which another start is expected to end that is tried
BEYOND = 5.0  # standard errors from a solution, within which no start leads elsewhere
STRIDE = 0.5  # in a logarithm, from an exact orbit to the next
COARSE = np.array([np.radians(2.0), 0.5e-9])  # by which a grid of materials misses the data


@dataclass(frozen=True, eq=False)
class Grid:
    """Orbits of materials, averaged or exact, for each image and branch."""

    q: Array  # shape (g, 3)
    values: Array  # shape (2, g, m, 2); on the attractive and the repulsive branch; NaN without an orbit
    places: Array  # shape (2, g, m) or (2, g, m, PLACE)
    defects: Array  # shape (2, g, m, 2); how much exact orbits differ; 0 where they are not known
    slopes: Array  # shape (2, g, m, 2, 3); derivatives by the logarithms

    def on(self, branches: NDArray[np.int8]) -> tuple[NDArray[np.intp], Array]:
        """Materials with orbits on these branches, shape (m,), in every image, and their values, shape (k, m, 2)."""
        at = (branches > 0).astype(int), slice(None), np.arange(len(branches))
        values = (self.values[at] + self.defects[at]).transpose(1, 0, 2)
        values = np.where((branches == 0)[:, None], 0.0, values)
        usable = np.flatnonzero(np.isfinite(values).all(axis=(1, 2)))
        return usable, values[usable]


def make_grid(model: Model, attractive: bool = False) -> Grid:
    """Orbits of materials that fill the range searched; with more adhesions where tips are attracted."""
    counts = (GRID[0], ADHESIONS, GRID[2]) if attractive else GRID
    axes = [np.linspace(-1, 1, count) * SHARE_OF_GRID * model.reach for count in counts]
    q = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    if not model.averages:
        return _grid_of_exact_orbits(model, q)
    count = len(model.amplitudes)
    values, places = np.full((2, len(q), count, 2), np.nan), model.nowhere(2, len(q), count)
    defects, slopes = np.zeros_like(values), np.zeros((*values.shape, 3))
    for branch, side in enumerate(SIDES):
        sides = np.repeat(side[None], len(q), axis=0)
        for j in range(count):
            place, image = model.nowhere(len(q), 1), model.image(j)
            orbits = image.orbits(q, sides, place, search=True)
            good = orbits.good
            values[branch, good, j], places[branch, :, j] = orbits.values[good, 0], place[:, 0]
            slopes[branch, good, j] = orbits.slopes[good, 0]
            exact, _ = image.exact(q[good], sides[good], place[good], engage=False)
            defects[branch, good, j] = np.nan_to_num(exact - orbits.values[good])[:, 0]
    return Grid(q, values, places, defects, slopes)


def _grid_of_exact_orbits(model: Model, q: Array) -> Grid:
    """Grid of exact orbits, where averaging is no guide: each from that of a neighbour, alike on both branches.

    Those that curves lead to at one amplitude lead to the other amplitudes, and from there to the next materials.
    """
    count, number = len(model.amplitudes), np.arange(len(q)).reshape(GRID)
    values, places = np.full((len(q), count, 2), np.nan), model.nowhere(len(q), count)
    slopes = np.zeros((*values.shape, 3))

    def carry_orbits(known: tuple[NDArray[np.intp], int], to: tuple[NDArray[np.intp], int]) -> None:
        """Go from known orbits of some materials in an image to those of others that are not known, in another."""
        (first, i), (last, j) = known, to
        wanted = np.isnan(values[last, j, 0]) & np.isfinite(places[first, i, 0])
        fill_orbits(first[wanted], last[wanted], places[first[wanted], i][:, None], j)

    def fill_orbits(first: NDArray[np.intp], last: NDArray[np.intp], near: Array, j: int, search: bool = False) -> None:
        """Fill in orbits of the last materials in image j, by steps from orbits of the first at the places `near`."""
        image, sides, way = model.image(j), np.ones((len(first), 1), np.int8), q[last] - q[first]
        steps = max(1, int(np.ceil(np.abs(way).max(initial=0.0) / STRIDE)))
        for step in range(1, steps + 1):
            orbits = image.orbits(q[first] + step / steps * way, sides, near, search)
            near[~orbits.good] = np.nan
        here = last[orbits.good], j
        values[here], slopes[here] = orbits.values[orbits.good, 0], orbits.slopes[orbits.good, 0]
        places[last, j] = near[:, 0]

    order, every = np.argsort(model.amplitudes, kind="stable"), number.reshape(-1)
    for i, j in pairwise([order[0], *order]):
        carry_orbits((every, i), (every, j))
        if np.isnan(values[:, j, 0]).all():  # the first, and one whose drive is too different
            fill_orbits(every, every, model.nowhere(len(q), 1), j, search=True)
    for j, (axis, size) in product(order, enumerate(GRID)):
        for k in [*range(1, size), *range(-2, -size - 1, -1)]:
            before = k - 1 if k > 0 else k + 1
            carry_orbits((number.take(before, axis).ravel(), j), (number.take(k, axis).ravel(), j))
    values, places, slopes = (np.stack([one, one]) for one in (values, places, slopes))
    return Grid(q, values, places, np.zeros_like(values), slopes)


def nearest(problem: RegionProblems, grid: Grid) -> tuple[NDArray[np.intp], Array]:
    """The material of the grid that is nearest to the data of n pixels, -1 if there is none, and chi2 with it."""
    which, chi2 = np.full(len(problem.data), -1), np.full(len(problem.data), np.inf)
    nothing = np.zeros(problem.data.shape[1:])
    patterns, pattern_of = np.unique(problem.sides[:, 0], axis=0, return_inverse=True)
    for k, pattern in enumerate(patterns):
        pixels = np.flatnonzero(pattern_of.reshape(-1) == k)
        usable, values = grid.on(pattern)
        if not len(usable):
            continue
        data = problem.part(pixels).rest(nothing, nothing)
        weighed = np.pad((values * problem.weights[0]).reshape(len(usable), -1), ((0, 0), (0, problem.held.shape[1])))
        total = cdist(data, problem.projection.without(weighed[..., None])[..., 0], "sqeuclidean")
        total += _prior(problem.model, grid)[usable]
        which[pixels], chi2[pixels] = usable[total.argmin(axis=1)], total.min(axis=1)
    return which, chi2


def descend_from_grid(problem: RegionProblems, grid: Grid) -> list[Solution]:
    """Materials of each pixel that may be as good, with the defect of the grid; of infinite chi2 where none was sought.

    Averaged search starts where the grid is nearest, and goes on elsewhere where that ends in doubt. Where the tip is
    attracted in all images, that is in a finer grid: one that never touches knows no modulus to follow to a touch.
    """
    sides = problem.sides[:, 0]
    if not problem.model.averages:
        return _descend_apart(problem, grid, [])
    first = go_downhill(problem, *_start_at_node(problem, grid, nearest(problem, grid)[0]))
    more = (sides != 0).any(axis=1) & (first.chi2 > _doubtful(problem))
    solutions = [first, *(_without_solution(first) for _ in range(1, STARTS) if more.any())]
    for pattern in np.unique(sides[more], axis=0):
        fine = make_grid(problem.model, attractive=True) if (pattern <= 0).all() else grid
        alike = np.flatnonzero(more & (sides == pattern).all(axis=1))
        for pixels in np.array_split(alike, 1 + len(alike) // AT_ONCE):
            apart = _descend_apart(problem.part(pixels), fine, [first.part(pixels)])
            for whole, solution in zip(solutions, apart, strict=False):
                whole.put(pixels, solution)
    return solutions


def _doubtful(problem: RegionProblems) -> float:
    """Largest chi2 at which a solution is taken for the best without further starts."""
    data = int((problem.weights > 0).sum())
    return float(data + DOUBTFUL * np.sqrt(2 * data))


def _without_solution(like: Solution) -> Solution:
    """Solution of infinite chi2 for as many problems, which any other replaces."""
    every = np.arange(len(like.q))
    return like.part(every)._replace(chi2=np.full(len(every), np.inf))


def _descend_apart(problem: RegionProblems, grid: Grid, solutions: list[Solution]) -> list[Solution]:
    """Further solutions, from materials of the grid that one step of least squares brings near the data, far apart.

    `solutions`: those that are known. All problems have the same branches.
    """
    sides, every = problem.sides[0, 0], np.arange(len(problem.data))
    usable, values = grid.on(sides)
    if not len(usable):
        return solutions or [go_downhill(problem, *_start_at_node(problem, grid, np.full(len(every), -1)))]
    branch, images, count = (sides > 0).astype(int), np.arange(len(sides)), len(usable)
    slopes = grid.slopes[branch, usable[:, None], images]
    at = replace(problem.part(np.zeros(count, int)), data=values[:, None])
    steep, nothing = at.weigh(slopes[:, None]), np.zeros(problem.data.shape[1:])
    rest = problem.rest(nothing, nothing)[:, None] - at.rest(nothing, nothing)
    matrix = steep.transpose(0, 2, 1) @ steep + problem.prior
    pull = np.einsum("gdk,ngd->ngk", steep, rest) - grid.q[usable] @ problem.prior
    step = np.einsum("gkl,ngl->ngk", np.linalg.inv(matrix), pull)
    share = np.minimum(1.0, LONGEST / np.abs(step).max(axis=-1))
    chi2 = (rest**2).sum(axis=-1) + _prior(problem.model, grid)[usable] - (2 * share - share**2) * (step * pull).sum(-1)
    q = grid.q[usable] + share[..., None] * step
    for _ in range(len(solutions), STARTS):
        for last in solutions[-1:]:
            apart = q - last.q[:, None]
            matrix = information(problem, problem.weigh(last.slopes))
            chi2[(np.einsum("ngi,nij,ngj->ng", apart, matrix, apart) < BEYOND**2) & last.good[:, None]] = np.inf
        best = chi2.argmin(axis=1)
        least = np.min([one.chi2 for one in solutions], axis=0, initial=np.inf)
        expected = chi2[every, best]
        worth = np.flatnonzero((expected < least + WORTH) | (least > _doubtful(problem)) & (expected < np.inf))
        if not len(worth):
            break
        part, begin = problem.part(worth), q[worth, best[worth]]
        node, *near = _start_at_node(part, grid, usable[best[worth]])
        again = go_downhill(part, begin, *near)
        lost = np.flatnonzero(~again.good)
        again.put(lost, go_downhill(part.part(lost), node[lost], *(one[lost] for one in near)))
        if len(worth) < len(every):
            whole = _without_solution(solutions[0])
            whole.put(worth, again)
            again = whole
        solutions = [*solutions, again]
        chi2[np.abs(q - q[every, best][:, None]).max(axis=-1) < SEPARATE] = np.inf
    return solutions


def _start_at_node(problem: RegionProblems, grid: Grid, start: NDArray[np.intp]) -> tuple[Array, Array, Array]:
    """Start from materials of the grid: logarithms, places of orbits and defects; for -1 the prior, without orbits."""
    sides = problem.sides[:, 0]
    branch, images, none = (sides > 0).astype(int), np.arange(sides.shape[1]), start < 0
    q, places = grid.q[start], grid.places[branch, start[:, None], images]
    defect = grid.defects[branch, start[:, None], images]
    q[none], places[none], defect[none[:, None] | (sides == 0)] = 0.0, np.nan, 0.0
    return q, places[:, None], defect[:, None]


def grid_of_one(model: Model) -> Grid:
    """The reference of the model alone, with its exact orbits on both branches."""
    count = len(model.amplitudes)
    places = model.nowhere(2, count)
    values, good = model.exact(np.zeros((2, 3)), np.repeat(SIDES, count, axis=1), places)
    values = np.where(good[..., None], values, np.nan)[:, None]
    return Grid(np.zeros((1, 3)), values, places[:, None], np.zeros_like(values), np.zeros((*values.shape, 3)))


def make_starts(
    model: Model, stack: Stack, grids: list[Grid], known: list[int], plan: ZeroPlan, sides: Codes | None
) -> tuple[Array, Codes, Array]:
    """Logarithms of the unknown regions, shape (n, 3 u), branches, shape (n, r, m), and places of their orbits.

    The stack is of regions, without zeros that are known; `grids` are materials that each may be of, one where it is
    known; `sides` are branches, if known.
    """
    regions, first = len(stack), known[0] if known else 0
    seen = np.isfinite(stack.errors)
    coarse = replace(stack, errors=np.where(seen, COARSE, np.inf))
    patterns = _patterns(stack) if sides is None else sides[first : first + 1]
    parts = [grids[first].on(pattern) for pattern in patterns]
    which = {first: np.concatenate([usable for usable, _ in parts])}
    branches = {first: np.repeat(patterns, [len(usable) for usable, _ in parts], axis=0)}
    apart = np.where(seen[first], stack.values[first] - np.concatenate([values for _, values in parts]), np.nan)
    zeros = np.stack([_zeros(apart[..., c], kind) for c, kind in ((PHASE, plan.phase), (HEIGHT, plan.height))], axis=-1)
    rest = np.nan_to_num(apart - zeros)
    rest[..., HEIGHT] = np.where(seen[first][:, HEIGHT], rest[..., HEIGHT] - _mean((apart - zeros)[..., HEIGHT]), 0.0)
    chi2 = ((rest / COARSE) ** 2).sum(axis=(1, 2)) + _prior(model, grids[first])[which[first]]
    for region in range(regions):
        if region == first:
            continue
        values = np.where(seen[region], coarse.values[region] - zeros, 0.0)
        errors = np.repeat(coarse.errors[region : region + 1], len(zeros), axis=0)
        pixels = problem_of_pixels(model, replace(coarse, values=values, errors=errors))
        if sides is not None:
            pixels = replace(pixels, sides=np.repeat(sides[None, region : region + 1], len(zeros), axis=0))
        best, more = nearest(pixels, grids[region])
        which[region], branches[region] = best, pixels.sides[:, 0]
        chi2 = chi2 + more
    q = np.concatenate([grids[r].q[which[r]] for r in range(regions) if r not in known], axis=1)
    both = np.stack([np.where(seen[r].any(axis=-1), branches[r], 0) for r in range(regions)], axis=1).astype(np.int8)
    taken = _apart_among_best(q, both, chi2)
    places, images = model.nowhere(*both[taken].shape), np.arange(both.shape[2])
    for r in set(range(regions)) - set(known):
        places[:, r] = grids[r].places[(both[taken, r] > 0).astype(int), which[r][taken][:, None], images]
    return q[taken], both[taken], places


def _patterns(stack: Stack) -> Codes:
    """Branches that a region may be on, shape (patterns, images).

    The amplitude that is taken away, free less setpoint, makes a tip repulsive: from some value on, it is.
    """
    drop = [(1 - ratio) * one.driven_amplitude for ratio, one in zip(stack.setpoints, stack.scopes, strict=True)]
    order = np.argsort(np.argsort(drop, kind="stable"), kind="stable")
    return np.array([np.where(order < first, -1, 1) for first in range(len(drop) + 1)], np.int8)


def _prior(model: Model, grid: Grid) -> Array:
    """chi2 of the prior, shape (g,)."""
    return ((grid.q / model.width) ** 2).sum(axis=1)


def _zeros(apart: Array, kind: str | None) -> Array:
    """Zeros of each image by the data of the first region, shape (candidates, images)."""
    if kind == FREE:
        return np.nan_to_num(apart)
    return np.repeat(np.nan_to_num(_mean(apart)), apart.shape[1], axis=1) if kind == SHARED else np.zeros_like(apart)


def _mean(values: Array) -> Array:
    """Mean over the images that have data, kept as an axis."""
    known = np.isfinite(values)
    return np.where(known, values, 0.0).sum(axis=-1, keepdims=True) / np.maximum(known.sum(-1, keepdims=True), 1)


def _apart_among_best(q: Array, sides: Codes, chi2: Array) -> list[int]:
    """Indices of the best few candidates that are not all alike."""
    taken: list[int] = []
    alike: dict[bytes, list[int]] = {}
    for i in np.argsort(chi2, kind="stable"):
        if len(taken) == MOST or not np.isfinite(chi2[i]):
            break
        near = alike.setdefault(sides[i].tobytes(), [])
        if len(near) < OF_A_KIND and all(np.abs(q[i] - q[j]).max() > SEPARATE for j in near):
            near.append(int(i))
            taken.append(int(i))
    return taken
