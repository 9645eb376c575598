"""The best parameters, and what the data say about them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from phasemap.inference.curves.problem import STEP, Problem, Ruler
from phasemap.inference.verdict import chance

UNLIKELY = 1e-3  # chance of a chi2 as large, below which a fit is not believed
AROUND = 5.0  # factor to either side of the start within which other starts lie
LOOKS = 24  # places looked at for each batch of other starts
RESOLVED = 3.0  # times the error of the derivatives: a combination that does less is not determined
ROUGH = 0.1  # relative error of the derivatives of a datum that is left out of them
ROUNDS = 2  # of secants
FARTHEST = 0.3  # that secants go, of the scaled parameters
SHARE = 0.1  # of a combination that is not determined: a parameter with less of it is not touched
EVALUATIONS = 60  # of the optimiser, per stage


class Solution(NamedTuple):
    """Best scaled parameters of one start."""

    q: np.ndarray  # shape (parameters,)
    chi2: float  # of the data alone
    cost: float  # with the gaps


class Knowledge(NamedTuple):
    """What the data say about the scaled parameters around a solution."""

    errors: np.ndarray  # shape (parameters,); standard errors; infinite where the data do not determine the parameter
    correlation: np.ndarray  # shape (parameters, parameters); NaN beside the diagonal for these
    null: np.ndarray  # shape (combinations, parameters); directions in which the data hardly change


def search(problem: Problem, starts: int) -> tuple[Solution, int]:
    """The best solution from the start given, and from others as long as none is good.

    Returns `tried`: starts that were used.
    """
    degrees = problem.data.size - len(problem.parameters)
    best, tried = None, 0
    for q in _starts(problem, starts):
        found = _refine(problem, q)
        tried += 1
        if best is None or found.cost < best.cost:
            best = found
        if chance(best.chi2, degrees) > UNLIKELY:
            break
    assert best is not None
    return best, tried


def _starts(problem: Problem, count: int) -> Iterator[np.ndarray]:
    """The start itself, then the most promising places around it."""
    n = len(problem.parameters)
    yield np.zeros(n)
    if count < 2:
        return
    from scipy.stats import qmc

    share = qmc.Halton(n, scramble=False).fast_forward(1).random(LOOKS)
    around = np.array(
        [min(np.log(AROUND), p.reach) if p.logarithmic and p.size == 1 else 0.1 for p in problem.parameters]
    )
    places = (2 * share - 1) * around
    ruler = Ruler.coarse(problem.data)
    costs = [float(np.log1p(problem.residuals(q, ruler) ** 2).sum()) for q in places]
    yield from places[np.argsort(costs)[: count - 1]]


def _refine(problem: Problem, q: np.ndarray) -> Solution:
    """Go down from q: coarsely and without regard for outliers, then by the data's own errors."""
    from scipy.optimize import least_squares

    ruler = Ruler.strict(problem.data)
    reach = np.array([p.reach for p in problem.parameters])
    for measure, loss, tolerance in (
        (Ruler.coarse(problem.data), "soft_l1", 1e-2),
        (ruler, "linear", 1e-8),
    ):
        q = least_squares(
            problem.residuals, q, problem.jacobian, (-reach, reach), x_scale=1.0, loss=loss, args=(measure,),
            ftol=tolerance, xtol=tolerance, gtol=1e-9, max_nfev=EVALUATIONS,
        ).x  # fmt: skip
    squares = problem.residuals(q, ruler) ** 2
    return Solution(q, float(squares[: problem.data.size].sum()), float(squares.sum()))


def knowledge(problem: Problem, q: np.ndarray) -> Knowledge:
    """Errors and correlations around a solution, and what the data cannot say.

    A combination of parameters is determined if what it does to the data stands out of the error of the derivatives,
    estimated from a second step. Errors come from J^T J, in the end with the secants over one standard error to either
    side in place of derivatives: just before the end of a branch the latter are far too steep.
    """
    slopes = _slopes(problem, q, np.eye(len(q)), STEP)
    wrong = _slopes(problem, q, np.eye(len(q)), 3 * STEP) - slopes
    rough = np.linalg.norm(wrong, axis=1) > ROUGH * np.linalg.norm(slopes, axis=1)
    slopes[rough] = wrong[rough] = 0
    _, sizes, axes = np.linalg.svd(slopes, full_matrices=False)
    good = sizes > np.maximum(RESOLVED * np.linalg.norm(wrong @ axes.T, axis=0), np.finfo(float).tiny)
    null, axes, sizes = axes[~good], axes[good], sizes[good]
    for _ in range(ROUNDS):
        _, sizes, turn = np.linalg.svd(_slopes(problem, q, axes, np.minimum(1 / sizes, FARTHEST)), full_matrices=False)
        axes = turn @ axes
    covariance = (axes.T / sizes**2) @ axes
    errors = np.sqrt(np.diag(covariance))
    lost = (np.abs(null) > SHARE).any(axis=0)
    correlation = np.full(covariance.shape, np.nan)
    known = np.flatnonzero(~lost)
    correlation[np.ix_(known, known)] = covariance[np.ix_(known, known)] / np.outer(errors[known], errors[known])
    np.fill_diagonal(correlation, 1.0)
    errors[lost] = np.inf
    return Knowledge(errors, correlation, null)


def _slopes(problem: Problem, q: np.ndarray, axes: np.ndarray, steps: float | np.ndarray) -> np.ndarray:
    """Central differences of the data's residuals along these directions, one column each."""
    return problem.jacobian(q, Ruler.strict(problem.data), axes, steps)[: problem.data.size]
