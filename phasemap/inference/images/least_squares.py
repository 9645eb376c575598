"""Least squares for the materials of pixels or regions.

There are n problems, each of the same regions in the same images; a pixel is one region. Phase and height are those of
orbits (`model`) and, of averaged ones, of a defect, the difference of exact and averaged orbits at the material found
before (theory, Eq. (inversion-2)). A projection takes zeros out (theory, Eq. (inversion-5)). Many are solved at once by
Levenberg-Marquardt steps: theory, Eq. (inversion-4).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels.rows.derivatives import Derivatives
from phasemap._shared.arrays import Array, within_half_a_turn
from phasemap.inference.images.model import Model
from phasemap.inference.images.stack import HEIGHT, PHASE, Projection, Stack, Zeros

Codes = NDArray[np.int8]
Flags = NDArray[np.bool_]

MOST_STEPS = 40
# Decrease of chi2 still to be expected where a problem is done, of averaged orbits and of exact ones, which cost more.
CLOSE, CLOSE_EXACT = 1e-4, 1e-2
LONGEST = 1.0  # of a step, in a logarithm
DEFECTS = 2  # times that the difference of exact and averaged orbits is taken, if not
ENOUGH = 0.01  # of a standard error: by as much, at most, that difference is then expected to change
BESIDE = 1e-3  # of a logarithm, where exact orbits are asked for if those of a material itself are not found


@dataclass(frozen=True, eq=False)
class RegionProblems:
    """n least-squares problems of the same regions and images, with data, branches and prior of their own."""

    model: Model
    unknown: NDArray[np.intp]  # regions whose material is sought, u of r
    data: Array  # shape (n, r, m, 2); phase [rad] and tip offset up to a constant [m]
    weights: Array  # shape (r, m, 2); 1 over their standard errors, 0 without a datum
    sides: Codes  # shape (n, r, m)
    fixed: Array  # shape (n, r, m, 2); of regions of known materials
    projection: Projection
    held: Array  # shape (n, p); what is known of the zeros beforehand, over its standard error
    centre: Array  # shape (n, 3 u); of the prior
    prior: Array  # shape (3 u, 3 u)

    def part(self, chosen: NDArray[Any]) -> RegionProblems:
        """Some of the problems."""
        arrays = {name: getattr(self, name)[chosen] for name in ("data", "sides", "fixed", "held", "centre")}
        return replace(self, **arrays)

    def orbits(self, q: Array, places: Array, search: bool = False) -> Derivatives:
        """Orbits of these materials near `places`, which are moved to them."""
        n, m, u = len(self.sides), self.sides.shape[2], len(self.unknown)
        near = places[:, self.unknown].reshape(n * u, *places.shape[2:])
        derivatives = self.model.orbits(
            q.reshape(n * u, 3), self.sides[:, self.unknown].reshape(n * u, m), near, search
        )
        places[:, self.unknown] = near.reshape(n, u, *places.shape[2:])
        values = self.fixed.copy()
        values[:, self.unknown] = derivatives.values.reshape(n, u, m, 2)
        good = np.asarray(derivatives.good.reshape(n, u).all(axis=1))
        return Derivatives(values, derivatives.slopes.reshape(n, u, m, 2, 3), good)

    def defect(self, q: Array, places: Array, values: Array) -> tuple[Array, Flags]:
        """Differences of exact orbits from these averaged values, and of which problems all of them are known."""
        n, r, m = self.sides.shape
        u, sides = len(self.unknown), self.sides[:, self.unknown].reshape(-1, m)
        exact, good = self.model.exact(q.reshape(n * u, 3), sides, places[:, self.unknown].reshape(n * u, m))
        defect = np.zeros((n, r, m, 2))
        defect[:, self.unknown] = np.nan_to_num(exact.reshape(n, u, m, 2) - values[:, self.unknown])
        return defect, (good | (sides == 0)).reshape(n, u * m).all(axis=1)

    def weigh(self, slopes: Array) -> Array:
        """Derivatives of the residuals, shape (n, data and zeros, 3 u)."""
        n, u = slopes.shape[:2]
        size, zeros = self.weights.size, self.held.shape[1]
        full = np.zeros((n, size + zeros, 3 * u))
        parts = full[:, :size].reshape(n, *self.weights.shape, u, 3)
        for i, region in enumerate(self.unknown):
            parts[:, region, :, :, i] = slopes[:, i] * self.weights[region, ..., None]
        full[:, :size] = parts.reshape(n, size, 3 * u)
        return self.projection.without(full)

    def residuals(self, values: Array, defect: Array) -> Array:
        """Weighted residuals at zeros of 0, shape (n, data and zeros)."""
        apart = (self.data - values - defect) * self.weights
        return np.concatenate([apart.reshape(len(apart), self.weights.size), self.held], axis=1)

    def rest(self, values: Array, defect: Array) -> Array:
        """Weighted residuals less the part that zeros explain."""
        return self.projection.without(self.residuals(values, defect)[..., None])[..., 0]

    def chi2(self, rest: Array, q: Array) -> Array:
        """chi2 of data, of which these residuals are left, and priors, shape (n,)."""
        apart = q - self.centre
        return (rest**2).sum(axis=1) + ((apart @ self.prior) * apart).sum(axis=1)

    def zeros(self, values: Array, defect: Array) -> Array:
        """The zeros that go with these orbits, shape (n, p)."""
        return self.residuals(values, defect) @ self.projection.inverse.T


def problem_of(
    model: Model, stack: Stack, sides: Codes, zeros: Zeros, fixed: dict[int, Array] | None = None
) -> RegionProblems:
    """The problem of a stack of regions, some with orbits `fixed`, from each set of branches, shape (n, r, m)."""
    fixed = fixed or {}
    count, regions, _ = sides.shape
    unknown = np.array([r for r in range(regions) if r not in fixed])
    known = np.zeros((count, *stack.values.shape))
    for r, values in fixed.items():
        known[:, r] = values
    weights = np.where(np.isfinite(stack.errors), 1.0 / stack.errors, 0.0)
    return RegionProblems(
        model, unknown, np.repeat(stack.values[None], count, axis=0), weights, sides, known, zeros.weighted(weights),
        np.zeros((count, len(zeros.widths))), np.zeros((count, 3 * len(unknown))),
        model.width**-2 * np.eye(3 * len(unknown)),
    )  # fmt: skip


def problem_of_pixels(model: Model, stack: Stack) -> RegionProblems:
    """The problem of each pixel, whose topography is the one zero that is unknown; all have the same errors."""
    columns = np.zeros((1, len(stack.setpoints), 2, 1))
    columns[:, :, HEIGHT] = 1.0
    zeros = Zeros(columns, np.array([np.inf]))
    sides = model.sides_of(stack)[:, None]
    data = stack.values[:, None].copy()
    data[..., PHASE] = within_half_a_turn(data[..., PHASE], 2 * np.pi)
    return replace(problem_of(model, stack.part(slice(1)), sides, zeros), data=data)


class Solution(NamedTuple):
    """Materials, orbits and chi2 found for n problems."""

    q: Array  # shape (n, 3 u)
    places: Array  # shape (n, r, m) or (n, r, m, PLACE); where the orbits are, averaged or exact
    defect: Array  # shape (n, r, m, 2); how much exact orbits differ
    values: Array  # shape (n, r, m, 2); phase and tip offset of these orbits
    slopes: Array  # shape (n, u, m, 2, 3)
    # good, exact: shape (n,); whether there is an orbit in every image, and whether the exact ones are known
    good: Flags
    exact: Flags
    chi2: Array  # shape (n,); infinite without orbits

    def part(self, chosen: NDArray[Any]) -> Solution:
        """Solutions of some of the problems."""
        return Solution(*(values[chosen] for values in self))

    def put(self, chosen: NDArray[Any], other: Solution) -> None:
        """Replace the solutions of some of the problems."""
        for whole, part in zip(self, other, strict=True):
            whole[chosen] = part


def information(problem: RegionProblems, slopes: Array) -> Array:
    """N of n problems with these derivatives."""
    return problem.prior + slopes.transpose(0, 2, 1) @ slopes


def normal_equations(problem: RegionProblems, slopes: Array, rest: Array, q: Array) -> tuple[Array, Array]:
    """N and J^T r - prior (q - q0) of n problems with these derivatives and residuals."""
    pull = (slopes.transpose(0, 2, 1) @ rest[..., None])[..., 0]
    return information(problem, slopes), (problem.centre - q) @ problem.prior + pull


def go_downhill(problem: RegionProblems, q: Array, places: Array, defect: Array) -> Solution:
    """Go downhill from these materials and places of their orbits, with this difference of exact and averaged ones."""
    q, places = q.copy(), places.copy()
    orbits = problem.orbits(q, places, search=True)
    exact = np.zeros(len(q), bool)
    return _descend(problem, Solution(q, places, defect.copy(), *orbits, exact, np.zeros(len(q))))


def _descend(problem: RegionProblems, solution: Solution) -> Solution:
    """Go downhill from a solution, whose arrays are changed."""
    q, chi2, reach = solution.q, solution.chi2, problem.model.reach
    chi2[:] = np.where(solution.good, problem.chi2(problem.rest(solution.values, solution.defect), q), np.inf)
    damping = np.full(len(q), 1e-2)
    active = solution.good & (problem.sides != 0).any(axis=(1, 2))
    close = CLOSE if problem.model.averages else CLOSE_EXACT
    for _ in range(MOST_STEPS):
        going = np.flatnonzero(active)
        if not len(going):
            break
        part, last = problem.part(going), solution.part(going)
        rest = part.rest(last.values, last.defect)
        matrix, pull = normal_equations(part, part.weigh(last.slopes), rest, last.q)
        steep = matrix * (1 + damping[going, None, None] * np.eye(q.shape[1]))
        step = np.linalg.solve(steep, pull[..., None])[..., 0]
        expected = (step * pull).sum(axis=1)
        step *= np.minimum(1.0, LONGEST / np.maximum(np.abs(step).max(axis=1), 1e-300))[:, None]
        trial = np.clip(last.q + step, -reach, reach)
        new = part.orbits(trial, last.places)
        new_chi2 = np.where(new.good, part.chi2(part.rest(new.values, last.defect), trial), np.inf)
        better = new_chi2 <= last.chi2
        moved = last._replace(q=trial, values=new.values, slopes=new.slopes, chi2=new_chi2)
        solution.put(going[better], moved.part(better))
        gain = (last.chi2 - new_chi2) / np.maximum(expected, 1e-300)
        less = np.where(problem.model.averages | (gain > 0.7), 0.1, np.where(gain > 0.3, 1.0, 3.0))
        damping[going] = np.where(better, less * damping[going], 6.0 * damping[going])
        active[going] = ~((better & (expected < close)) | (damping[going] > 1e8))
    return solution


def refine(problem: RegionProblems, solution: Solution, times: int = DEFECTS) -> Solution:
    """Go on with the difference of exact and averaged orbits where the last descent ended, until it stays."""
    if not problem.model.averages:
        return solution._replace(exact=solution.good)
    left = np.flatnonzero(solution.good & np.isfinite(solution.chi2))
    for _ in range(times):
        part, last = problem.part(left), solution.part(left)
        defect, known = _defect(part, last)
        start = last._replace(
            q=last.q.copy(), defect=np.where(known[:, None, None, None], defect, last.defect), exact=known
        )
        again = _descend(part, start)
        solution.put(left, again)
        moved = np.abs(again.q - last.q).max(axis=1)  # the defect changes by less than its share of that
        done = moved * np.abs(again.defect * problem.weights).max(axis=(1, 2, 3)) < ENOUGH
        left = left[~(known & done)]
    return solution


def _defect(problem: RegionProblems, solution: Solution) -> tuple[Array, Flags]:
    """Difference of exact and averaged orbits, there or a little beside, and of which problems it is known."""
    defect, known = problem.defect(solution.q, solution.places, solution.values)
    lost = np.flatnonzero(~known)
    part, beside, places = problem.part(lost), solution.q[lost] + BESIDE, solution.places[lost]
    averaged = part.orbits(beside, places)
    defect[lost], known[lost] = part.defect(beside, places, averaged.values)
    return defect, known
