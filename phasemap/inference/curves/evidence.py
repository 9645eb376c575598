"""The parameters that explain a measured curve best, with their errors, and how likely their law makes the data."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from phasemap.inference.curves.residuals import STEP, CurveProblem, Ruler
from phasemap.inference.determined import REACH, UNLIKELY, chance
from phasemap.inference.sampling import prior_draws

LOOKS = 100  # places of the prior looked at for other starts
EVALUATIONS = 60  # of the optimiser, per stage
ROUGH = 0.1  # relative error of the derivatives of a datum that is left out of them
ROUNDS = 2  # of secants
FARTHEST = 0.15  # that secants go, in standard deviations of the prior


class Estimate(NamedTuple):
    """The likeliest parameters, with covariance and evidence around them."""

    q: np.ndarray  # shape (parameters,); in standard deviations of the prior
    chi2: float  # of the data, by their errors as stated
    growth: float  # factor by which the errors have to be larger for the model to describe the data, 1 at least
    covariance: np.ndarray  # shape (parameters, parameters)
    evidence: float  # logarithm of how likely the data are, whatever the parameters (Laplace's approximation)
    tried: int  # starts


def search(problem: CurveProblem, starts: int, first: Sequence[np.ndarray] = ()) -> Estimate:
    """The best solution from q given first and from the start, and from others as long as none is good."""
    degrees = problem.data.size - len(problem.parameters)
    minima: list[tuple[float, np.ndarray]] = []
    for q in chain(first, _starts(problem, starts)):
        at = _descend(problem, q, Ruler.coarse(problem.data), "soft_l1", 1e-2)  # without regard for outliers
        at = _descend(problem, at, Ruler.strict(problem.data), "linear", 1e-8)
        chi2 = problem.chi2_and_growth(at)[0]
        minima.append((chi2 + float(at @ at), at))
        if chance(chi2, degrees) > UNLIKELY:
            break
    best = min(minima, key=lambda one: one[0])[1]
    growth = problem.chi2_and_growth(best)[1]
    if growth > 1:  # the prior counts for more where the data are not described to within their errors
        larger = {name: growth * errors for name, errors in problem.data.errors.items()}
        weaker = CurveProblem(replace(problem.data, errors=larger), problem.setup, problem.parameters)
        best = _descend(weaker, best, Ruler.strict(weaker.data), "linear", 1e-8)
        problem.evaluations += weaker.evaluations
    return _gaussian_around(problem, best, len(minima))


def _starts(problem: CurveProblem, count: int) -> Iterator[np.ndarray]:
    """The start itself, then the most promising places of the prior."""
    n = len(problem.parameters)
    yield np.zeros(n)
    if count > 1:
        places, ruler = prior_draws(n, LOOKS, 0), Ruler.coarse(problem.data)
        costs = [float(np.log1p(problem.residuals(q, ruler) ** 2).sum()) for q in places]
        yield from places[np.argsort(costs)[: count - 1]]


def _descend(problem: CurveProblem, q: np.ndarray, ruler: Ruler, loss: str, tolerance: float) -> np.ndarray:
    """Nearest minimum of the residuals from q, within what is searched."""
    minimum: np.ndarray = least_squares(
        problem.residuals, np.clip(q, -REACH, REACH), problem.jacobian, (-REACH, REACH), loss=loss, args=(ruler,),
        ftol=tolerance, xtol=tolerance, gtol=1e-9, max_nfev=EVALUATIONS,
    ).x  # fmt: skip
    return minimum


def _gaussian_around(problem: CurveProblem, q: np.ndarray, tried: int) -> Estimate:
    """Gaussian approximation of the posterior around the best parameters: covariance, evidence, factor on the errors.

    The information is J^T J and the prior's, in the end with the secants over one standard error to either side in
    place of derivatives: just before the end of a branch the latter are far too steep.
    """
    data, n, (chi2, growth) = problem.data.size, len(q), problem.chi2_and_growth(q)
    slopes = _slopes(problem, q, np.eye(n), STEP)
    wrong = _slopes(problem, q, np.eye(n), 3 * STEP) - slopes
    slopes[np.linalg.norm(wrong, axis=1) > ROUGH * np.linalg.norm(slopes, axis=1)] = 0
    axes = np.eye(n)
    for _ in range(ROUNDS):
        sizes, turn = np.linalg.eigh(slopes.T @ slopes / growth**2 + np.eye(n))
        axes = turn.T @ axes
        slopes = _slopes(problem, q, axes, np.minimum(sizes**-0.5, FARTHEST))
    information = slopes.T @ slopes / growth**2 + np.eye(n)
    covariance = axes.T @ np.linalg.inv(information) @ axes
    evidence = -data * math.log(growth) - 0.5 * (chi2 / growth**2 + q @ q + np.linalg.slogdet(information)[1])
    return Estimate(q, chi2, growth, covariance, float(evidence), tried)


def _slopes(problem: CurveProblem, q: np.ndarray, axes: np.ndarray, steps: float | np.ndarray) -> np.ndarray:
    """Central differences of the data's residuals along these directions, one column each."""
    return problem.jacobian(q, Ruler.strict(problem.data), axes, steps)[: problem.data.size]
