"""Materials of several regions and the zeros of phase and height, from all images together.

Zeros are unknowns like the materials (`zeros`). Materials make up for zeros along valleys of chi2, so that the least
squares alone would say too little: its errors come from solving it again for data and priors that are drawn within
their errors (randomised maximum likelihood, theory, Eq. (inversion-7); Oliver, He and Reynolds 1996), which follows
valleys however they bend.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels.rows.derivatives import Found
from phasemap._shared.errors import InputError
from phasemap.inference.images.descent import descend
from phasemap.inference.images.model import Model
from phasemap.inference.images.starts import Starts
from phasemap.inference.images.zeros import Projection

Array = NDArray[np.float64]
Codes = NDArray[np.int8]

DEFECTS = 2  # times that the difference of exact and averaged orbits is taken
DRAWS = 50  # of data, each with its mirror image, so that the mean of the draws is the data
SEED = 20
MODES = 4  # solutions that are kept
AS_GOOD = 9.0  # chi2 above the least within which another solution cannot be ruled out
APART = 3.0  # standard errors between two solutions that are not the same
END = 0.98  # of the range searched: a property beyond has run away


@dataclass(frozen=True, eq=False)
class Joint:
    """The same regions and images in n problems, which differ in where they start or in what was drawn."""

    model: Model
    unknown: NDArray[np.intp]  # int; regions whose material is sought, u of r
    data: Array  # shape (n, r, m, 2); phase [rad] and tip offset up to a constant [m]
    weights: Array  # shape (r, m, 2); 1 over their standard errors, 0 without a datum
    sides: Codes  # shape (n, r, m)
    fixed: Array  # shape (n, r, m, 2); of regions of known materials
    projection: Projection
    held: Array  # shape (n, p); what is known of the zeros beforehand, over its standard error
    centre: Array  # shape (n, 3 u); of the prior
    prior: Array  # shape (3 u, 3 u)

    @property
    def reach(self) -> float:
        """Largest logarithm that is tried."""
        return self.model.reach

    def part(self, chosen: NDArray[Any]) -> Joint:
        """The same for some of the problems."""
        return replace(
            self, data=self.data[chosen], sides=self.sides[chosen], fixed=self.fixed[chosen], held=self.held[chosen],
            centre=self.centre[chosen],
        )  # fmt: skip

    def orbits(self, q: Array, places: Array, search: bool = False) -> Found:
        """Averaged orbits of these materials near `places`, which are moved to them."""
        n, m, u = len(self.sides), self.sides.shape[2], len(self.unknown)
        there = places[:, self.unknown].reshape(n * u, m)
        found = self.model.averaged(q.reshape(n * u, 3), self.sides[:, self.unknown].reshape(n * u, m), there, search)
        places[:, self.unknown] = there.reshape(n, u, m)
        values = self.fixed.copy()
        values[:, self.unknown] = found.values.reshape(n, u, m, 2)
        good = np.asarray(found.good.reshape(n, u).all(axis=1))
        return Found(values, found.slopes.reshape(n, u, m, 2, 3), good)

    def exact(self, q: Array, places: Array, found: Found) -> tuple[Array, NDArray[np.bool_]]:
        """How much exact orbits differ from the averaged ones, and of which problems all are known."""
        n, r, m = self.sides.shape
        u, sides = len(self.unknown), self.sides[:, self.unknown].reshape(-1, m)
        values, good = self.model.exact(q.reshape(n * u, 3), sides, places[:, self.unknown].reshape(n * u, m))
        known: NDArray[np.bool_] = (good | (sides == 0)).reshape(n, u * m).all(axis=1)
        defect = np.zeros((n, r, m, 2))
        defect[:, self.unknown] = values.reshape(n, u, m, 2) - found.values[:, self.unknown]
        return np.where(np.isnan(defect), 0.0, defect), known

    def apart(self, q: Array) -> Array:
        """Logarithms less what the prior expects."""
        return q - self.centre

    def weigh(self, slopes: Array) -> Array:
        """Derivatives of the residuals, shape (n, data and zeros, 3 u)."""
        n, u = slopes.shape[:2]
        full = np.zeros((n, *self.weights.shape, u, 3))
        for i, region in enumerate(self.unknown):
            full[:, region, :, :, i] = slopes[:, i] * self.weights[region, ..., None]
        full = full.reshape(n, self.weights.size, 3 * u)
        return self.projection.without(np.pad(full, ((0, 0), (0, self.held.shape[1]), (0, 0))))

    def residuals(self, values: Array, defect: Array) -> Array:
        """Weighted residuals at zeros of 0, shape (n, data and zeros)."""
        apart = (self.data - values - defect) * self.weights
        return np.concatenate([apart.reshape(len(apart), self.weights.size), self.held], axis=1)

    def rest(self, values: Array, defect: Array) -> Array:
        """Weighted residuals without what zeros explain."""
        return self.projection.without(self.residuals(values, defect)[..., None])[..., 0]

    def cost(self, values: Array, defect: Array, q: Array) -> Array:
        """chi2 of data and priors, shape (n,)."""
        apart = self.apart(q)
        cost: Array = (self.rest(values, defect) ** 2).sum(axis=1) + np.einsum("ni,ij,nj->n", apart, self.prior, apart)
        return cost

    def zeros(self, values: Array, defect: Array) -> Array:
        """The zeros that go with these orbits, shape (n, p)."""
        return self.residuals(values, defect) @ self.projection.inverse.T


class Fitted(NamedTuple):
    """What was found."""

    q: Array  # shape (3 u,); means of the logarithms
    covariance: Array  # shape (3 u, 3 u)
    information: Array  # shape (3 u, 3 u); inverse of the covariance to first order, at the best materials
    zeros: Array  # shape (p,); those of the best materials
    # shape (draws, p); those of the draws, the first of which are around the best solution; NaN at the very end
    # of a branch
    drawn: Array
    weights: Array  # shape (draws,)
    values: Array  # shape (r, m, 2); phase [rad] and tip offset [m] of the best materials, without zeros
    sides: Codes  # shape (r, m)
    slopes: Array  # shape (u, m, 2, 3); derivatives of phase and tip offset
    data: int  # number of data, less those that zeros take up
    chi2: float
    degrees: float
    others: list[Array]  # logarithms of other solutions that fit as well
    exact: bool  # whether the orbits are the exact ones


def fit(joint: Joint, starts: Starts) -> Fitted:
    """Solve from all starts, and draw around the best and what is as good.

    `joint`: of as many problems as there are starts.
    """
    q, places = starts.q.copy(), np.full(joint.sides.shape, np.nan)
    found, cost, defect, exact = _solve(joint, q, places, DEFECTS)
    if not np.isfinite(cost).any():
        allowed = "those on which some material of the range searched has orbits in every image"
        raise InputError("branches", "what was given or what the phases tell", allowed)
    best = int(np.argmin(cost))
    slopes = joint.weigh(found.slopes)
    information = np.einsum("nai,naj->nij", slopes, slopes) + joint.prior
    modes = _modes(q, cost, information[best])
    sizes = np.linalg.slogdet(information[modes])[1]
    mass = np.exp(0.5 * (cost[best] - cost[modes] + sizes[0] - sizes))
    each = np.repeat(modes, 2 * DRAWS)
    at, near = q[each], places[each]
    drawn = _draw(joint.part(each), len(modes))
    seen, costs, near_defect, _ = _solve(drawn, at, near, 1, defect[each])
    weights = np.repeat(mass / mass.sum(), 2 * DRAWS) * np.isfinite(costs)
    mean, others = at[: 2 * DRAWS].mean(axis=0), drawn.zeros(seen.values, near_defect)
    if weights.any():
        covariance = _about(mean, at, weights)
    else:  # at the very end of a branch, where no draw has an orbit: nothing is known but the prior
        covariance, others, weights = np.diag(1 / np.diag(joint.prior)), np.full_like(others, np.nan), weights + 1.0
    pinned = np.abs(q[best]) > END * joint.reach
    covariance[pinned, pinned] += 1 / np.diag(joint.prior)[pinned]
    learnt = np.trace(np.linalg.solve(information[best], information[best] - joint.prior))
    count = int((joint.weights > 0).sum()) + int(joint.projection.is_known.sum()) - joint.projection.basis.shape[1]
    return Fitted(
        q=mean, covariance=covariance, information=information[best],
        zeros=joint.zeros(found.values, defect)[best], drawn=others, weights=weights,
        values=(found.values + defect)[best], sides=joint.sides[best],
        slopes=found.slopes[best], chi2=float((joint.rest(found.values, defect)[best] ** 2).sum()),
        data=count, degrees=float(count - learnt), others=list(q[modes[1:]]), exact=bool(exact[best]),
    )  # fmt: skip


def _about(mean: Array, draws: Array, weights: Array) -> Array:
    """Second moments of weighted draws about the mean of the best solution."""
    apart = draws - mean
    moments: Array = np.einsum("n,ni,nj->ij", weights, apart, apart) / weights.sum()
    return moments


def _solve(
    joint: Joint, q: Array, places: Array, defects: int, defect: Array | None = None
) -> tuple[Found, Array, Array, NDArray[np.bool_]]:
    """Least squares of exact orbits; `q` and `places` are moved."""
    todo, exact = np.ones(len(q), bool), np.zeros(len(q), bool)
    defect = np.zeros_like(joint.data) if defect is None else defect
    for again in range(defects + 1):
        found, cost = descend(joint, todo, q, places, defect)
        if again < defects:
            fresh, exact = joint.exact(q, places, found)
            defect = np.where(exact[:, None, None, None], fresh, defect)
    return found, cost, defect, exact


def _draw(joint: Joint, modes: int) -> Joint:
    """Data, zeros and materials that might as well have been those of the problem, the same for each solution."""
    rng = np.random.default_rng(SEED)

    def mirrored(*shape: int) -> Array:
        half = rng.standard_normal((DRAWS, *shape))
        return np.concatenate([half, -half] * modes)

    sigmas = np.divide(1.0, joint.weights, out=np.zeros_like(joint.weights), where=joint.weights > 0)
    held = mirrored(joint.held.shape[1]) * joint.projection.is_known
    widths = 1 / np.sqrt(np.diag(joint.prior))
    return replace(
        joint, data=joint.data + sigmas * mirrored(*sigmas.shape), held=held,
        centre=joint.centre + widths * mirrored(len(widths)),
    )  # fmt: skip


def _modes(q: Array, cost: Array, information: Array) -> NDArray[np.intp]:
    """The best solution, and those that fit as well and are not the same."""
    chosen: list[int] = []
    for i in np.argsort(cost, kind="stable"):
        apart = [q[i] - q[j] for j in chosen]
        as_good = not chosen or cost[i] < cost[chosen[0]] + AS_GOOD
        if as_good and len(chosen) < MODES and all(one @ information @ one > APART**2 for one in apart):
            chosen.append(int(i))
    return np.array(chosen)
