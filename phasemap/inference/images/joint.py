"""Materials of several regions and the zeros of phase and height, from all images together.

Materials make up for zeros along valleys of chi2, so that the least squares alone would say too little: its errors come
from solving it again for data and priors that are drawn within their errors (randomised maximum likelihood, theory,
Eq. (inversion-6); Oliver, He and Reynolds 1996), which follows valleys however they bend.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasemap._shared.errors import InputError
from phasemap.inference.images.problem import Problem, Solution, descend, refine
from phasemap.inference.verdict import END

Array = NDArray[np.float64]

DRAWS = 50  # of data, each with its mirror image, so that the mean of the draws is the data
SEED = 20
MODES = 4  # solutions that are kept
AS_GOOD = 9.0  # chi2 above the least within which another solution cannot be ruled out
APART = 3.0  # standard errors between two solutions that are not the same


class Fitted(NamedTuple):
    """What was found."""

    best: Solution  # of one problem
    q: Array  # shape (3 u,); means of the logarithms
    covariance: Array  # shape (3 u, 3 u)
    information: Array  # shape (3 u, 3 u); inverse of the covariance to first order, at the best materials
    sides: NDArray[np.int8]  # shape (r, m)
    zeros: Array  # shape (p,); those of the best materials
    # shape (draws, p); those of the draws, the first of which are around the best solution; NaN at the very end
    # of a branch
    drawn: Array
    weights: Array  # shape (draws,)
    data: int  # number of data, less those that zeros take up
    chi2: float
    degrees: float
    others: list[Array]  # logarithms of other solutions that fit as well


def fit(problem: Problem, q: Array) -> Fitted:
    """Solve from all these materials, and draw around the best and what is as good."""
    nowhere = np.full(problem.sides.shape, np.nan)
    found = refine(problem, descend(problem, q, nowhere, np.zeros_like(problem.data)))
    if not np.isfinite(found.cost).any():
        allowed = "those on which some material of the range searched has orbits in every image"
        raise InputError("branches", "what was given or what the phases tell", allowed)
    best = int(np.argmin(found.cost))
    slopes = problem.weigh(found.slopes)
    information = np.einsum("nai,naj->nij", slopes, slopes) + problem.prior
    modes = _modes(found, information[best])
    sizes = np.linalg.slogdet(information[modes])[1]
    mass = np.exp(0.5 * (found.cost[best] - found.cost[modes] + sizes[0] - sizes))
    each = np.repeat(modes, 2 * DRAWS)
    drawn, from_here = _draw(problem.part(each), len(modes)), found.part(each)
    near = refine(drawn, descend(drawn, from_here.q, from_here.places, from_here.defect), 1)
    weights = np.repeat(mass / mass.sum(), 2 * DRAWS) * np.isfinite(near.cost)
    mean, zeros = near.q[: 2 * DRAWS].mean(axis=0), drawn.zeros(near.values, near.defect)
    if weights.any():
        apart = near.q - mean
        covariance = np.einsum("n,ni,nj->ij", weights, apart, apart) / weights.sum()
    else:  # at the very end of a branch, where no draw has an orbit: nothing is known but the prior
        covariance, zeros, weights = np.diag(1 / np.diag(problem.prior)), np.full_like(zeros, np.nan), weights + 1.0
    pinned = np.abs(found.q[best]) > END * problem.model.reach
    covariance[pinned, pinned] += 1 / np.diag(problem.prior)[pinned]
    learnt = np.trace(np.linalg.solve(information[best], information[best] - problem.prior))
    projection = problem.projection
    data = int((problem.weights > 0).sum() + projection.is_known.sum()) - projection.basis.shape[1]
    one = found.part(np.array([best]))
    return Fitted(
        one, mean, covariance, information[best], problem.sides[best],
        problem.zeros(found.values, found.defect)[best], zeros, weights, data,
        float((problem.rest(found.values, found.defect)[best] ** 2).sum()), float(data - learnt),
        list(found.q[modes[1:]]),
    )  # fmt: skip


def moments_of_zeros(found: Fitted, drawn: Array) -> tuple[Array, Array]:
    """Mean of zeros that were drawn around the best solution, and standard errors with all others."""
    mean = drawn[: 2 * DRAWS].mean(axis=0)
    return mean, np.sqrt(found.weights @ (drawn - mean) ** 2 / found.weights.sum())


def _draw(problem: Problem, modes: int) -> Problem:
    """Data, zeros and materials that might as well have been those of the problem, the same for each solution."""
    rng = np.random.default_rng(SEED)

    def mirrored(*shape: int) -> Array:
        half = rng.standard_normal((DRAWS, *shape))
        return np.concatenate([half, -half] * modes)

    sigmas = np.divide(1.0, problem.weights, out=np.zeros_like(problem.weights), where=problem.weights > 0)
    held = mirrored(problem.held.shape[1]) * problem.projection.is_known
    widths = 1 / np.sqrt(np.diag(problem.prior))
    return replace(
        problem, data=problem.data + sigmas * mirrored(*sigmas.shape), held=held,
        centre=problem.centre + widths * mirrored(len(widths)),
    )  # fmt: skip


def _modes(found: Solution, information: Array) -> NDArray[np.intp]:
    """The best solution, and those that fit as well and are not the same."""
    chosen: list[int] = []
    for i in np.argsort(found.cost, kind="stable"):
        apart = [found.q[i] - found.q[j] for j in chosen]
        as_good = not chosen or found.cost[i] < found.cost[chosen[0]] + AS_GOOD
        if as_good and len(chosen) < MODES and all(one @ information @ one > APART**2 for one in apart):
            chosen.append(int(i))
    return np.array(chosen)
