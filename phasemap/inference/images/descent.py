"""Levenberg-Marquardt for many least squares at once, each with few unknowns: theory, Eq. (inversion-5)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels.least_squares import normal_rows
from phasemap.inference.images.problem import Problem

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

MOST_STEPS = 40
CLOSE = 1e-4  # decrease of chi2 still to be expected where a problem is done
LONGEST = 1.0  # of a step, in a logarithm
DEFECTS = 2  # times that the difference of exact and averaged orbits is taken, if not
ENOUGH = 0.01  # of a standard error: by as much, at most, that difference is then expected to change
BESIDE = 1e-3  # of a logarithm, where exact orbits are asked for if those of a material itself are not found


class Solution(NamedTuple):
    """What was found for n problems."""

    q: Array  # shape (n, 3 u)
    # places, defect: shape (n, r, m), (n, r, m, 2); where the averaged orbits are, and how much the exact ones differ
    places: Array
    defect: Array
    values: Array  # shape (n, r, m, 2); phase and tip offset of averaged orbits
    slopes: Array  # shape (n, u, m, 2, 3)
    # good, exact: shape (n,); whether there is an orbit in every image, and whether the exact ones are known
    good: Flags
    exact: Flags
    cost: Array  # shape (n,); infinite without orbits

    def part(self, chosen: NDArray[Any]) -> Solution:
        """The same for some of the problems."""
        return Solution(*(values[chosen] for values in self))

    def put(self, chosen: NDArray[Any], other: Solution) -> None:
        """Replace some of the problems."""
        for whole, part in zip(self, other, strict=True):
            whole[chosen] = part


def normal_equations(problem: Problem, slopes: Array, rest: Array, q: Array) -> tuple[Array, Array]:
    """N and J^T r - prior (q - q0) of n problems with these derivatives and residuals."""
    matrix, pull = np.empty((len(slopes), *problem.prior.shape)), (problem.centre - q) @ problem.prior
    matrix[:] = problem.prior
    normal_rows(slopes, rest, matrix, pull)
    return matrix, pull


def descend(problem: Problem, q: Array, places: Array, defect: Array) -> Solution:
    """Go downhill from these materials and places of their orbits, with this difference of exact and averaged ones."""
    q, places, reach = q.copy(), places.copy(), problem.model.reach
    found = problem.orbits(q, places, search=True)
    cost = np.where(found.good, problem.cost(found.values, defect, q), np.inf)
    damping = np.full(len(q), 1e-2)
    active = found.good & (problem.sides != 0).any(axis=(1, 2))
    for _ in range(MOST_STEPS):
        some = np.flatnonzero(active)
        if not len(some):
            break
        part = problem.part(some)
        matrix, pull = normal_equations(
            part, part.weigh(found.slopes[some]), part.rest(found.values[some], defect[some]), q[some]
        )
        steep = matrix * (1 + damping[some, None, None] * np.eye(q.shape[1]))
        step = np.linalg.solve(steep, pull[..., None])[..., 0]
        expected = (step * pull).sum(axis=1)
        step *= np.minimum(1.0, LONGEST / np.maximum(np.abs(step).max(axis=1), 1e-300))[:, None]
        trial, there = np.clip(q[some] + step, -reach, reach), places[some]
        new = part.orbits(trial, there)
        new_cost = np.where(new.good, part.cost(new.values, defect[some], trial), np.inf)
        better = new_cost <= cost[some]
        won = some[better]
        q[won], places[won], cost[won] = trial[better], there[better], new_cost[better]
        found.values[won], found.slopes[won] = new.values[better], new.slopes[better]
        damping[some] = np.where(better, 0.1 * damping[some], 6.0 * damping[some])
        active[some] = ~((better & (expected < CLOSE)) | (damping[some] > 1e8))
    return Solution(q, places, defect.copy(), *found, np.zeros(len(q), bool), cost)


def refine(problem: Problem, found: Solution, times: int = DEFECTS) -> Solution:
    """Go on with the difference of exact and averaged orbits where the last descent ended, until it stays."""
    left = np.arange(len(found.q))
    for _ in range(times):
        part, last = problem.part(left), found.part(left)
        defect, known = _defect(part, last)
        again = descend(part, last.q, last.places, np.where(known[:, None, None, None], defect, last.defect))
        again = again._replace(exact=known)
        found.put(left, again)
        moved = np.abs(again.q - last.q).max(axis=1)  # the defect changes by less than its share of that
        done = moved * np.abs(again.defect * problem.weights).max(axis=(1, 2, 3)) < ENOUGH
        left = left[~(known & done)]
    return found


def _defect(problem: Problem, found: Solution) -> tuple[Array, Flags]:
    """Difference of exact and averaged orbits, there or a little beside, and of which problems it is known."""
    defect, known = problem.defect(found.q, found.places, found.values)
    lost = np.flatnonzero(~known)
    part, beside, places = problem.part(lost), found.q[lost] + BESIDE, found.places[lost]
    averaged = part.orbits(beside, places)
    defect[lost], known[lost] = part.defect(beside, places, averaged.values)
    return defect, known
