"""Levenberg-Marquardt for many least squares at once, each with few unknowns: theory, Eq. (inversion-5)."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels.least_squares import normal_rows
from phasemap._kernels.rows.derivatives import Found

Array = NDArray[np.float64]

MOST_STEPS = 40
CLOSE = 1e-4  # decrease of chi2 still to be expected where a problem is done
LONGEST = 1.0  # of a step, in a logarithm


class Problems(Protocol):
    """Least squares of n problems in p logarithms each."""

    @property
    def prior(self) -> Array:
        """Inverse of the prior's covariance, shape (p, p)."""
        ...

    @property
    def reach(self) -> float:
        """Largest logarithm that is tried."""
        ...

    def part(self, chosen: NDArray[Any]) -> Problems:
        """The same for some of the problems."""
        ...

    def orbits(self, q: Array, places: Array, search: bool = False) -> Found:
        """Averaged orbits of these materials near `places`, which are moved to them."""
        ...

    def apart(self, q: Array) -> Array:
        """Logarithms less what the prior expects, shape (n, p)."""
        ...

    def weigh(self, slopes: Array) -> Array:
        """Derivatives of the residuals, shape (n, residuals, p)."""
        ...

    def rest(self, values: Array, defect: Array) -> Array:
        """Residuals, shape (n, residuals)."""
        ...

    def cost(self, values: Array, defect: Array, q: Array) -> Array:
        """chi2 of data and prior, shape (n,)."""
        ...


def normal_equations(prior: Array, slopes: Array, rest: Array, apart: Array) -> tuple[Array, Array]:
    """N and J^T r - prior (q - q0) of n problems with these derivatives, residuals and q - q0."""
    matrix, pull = np.empty((len(slopes), *prior.shape)), -(apart @ prior)
    matrix[:] = prior
    normal_rows(slopes, rest, matrix, pull)
    return matrix, pull


def descend(problems: Problems, todo: NDArray[np.bool_], q: Array, places: Array, defect: Array) -> tuple[Found, Array]:
    """Go downhill; `q` and `places` are moved, and the orbits there are returned with their costs.

    `todo` (shape (n,)): which have data at all.
    `q` (shape (n, p)).
    `places`, `defect`: where the orbits are, and how much the exact ones differ from the averaged.
    """
    found = problems.orbits(q, places, search=True)
    cost = np.where(found.good, problems.cost(found.values, defect, q), np.inf)
    damping = np.full(len(q), 1e-2)
    active = found.good & todo
    for _ in range(MOST_STEPS):
        some = np.flatnonzero(active)
        if not len(some):
            break
        part = problems.part(some)
        slopes = part.weigh(found.slopes[some])
        rest = part.rest(found.values[some], defect[some])
        matrix, pull = normal_equations(problems.prior, slopes, rest, part.apart(q[some]))
        steep = matrix * (1 + damping[some, None, None] * np.eye(q.shape[1]))
        step = np.linalg.solve(steep, pull[..., None])[..., 0]
        expected = np.einsum("ni,ni->n", step, pull)
        step *= np.minimum(1.0, LONGEST / np.maximum(np.abs(step).max(axis=1), 1e-300))[:, None]
        trial, there = np.clip(q[some] + step, -problems.reach, problems.reach), places[some]
        new = part.orbits(trial, there)
        new_cost = np.where(new.good, part.cost(new.values, defect[some], trial), np.inf)
        better = new_cost <= cost[some]
        won = some[better]
        q[won], places[won], cost[won] = trial[better], there[better], new_cost[better]
        found.values[won], found.slopes[won] = new.values[better], new.slopes[better]
        damping[some] = np.where(better, 0.1 * damping[some], 6.0 * damping[some])
        active[some] = ~((better & (expected < CLOSE)) | (damping[some] > 1e8))
    return found, cost
