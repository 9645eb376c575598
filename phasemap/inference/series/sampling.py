"""Draws of all unknowns of a series, by sequential Monte Carlo.

Particles of the prior are led to the data in steps, each as large as leaves half of them their weight; between the
steps they are moved by differences of other particles (ter Braak, Stat. Comput. 16, 239 (2006)). That follows several
solutions beside each other, which one descent cannot.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phasemap._shared.errors import SolveError
from phasemap.inference.series.problem import REACH, Problem

Array = NDArray[np.float64]

DRAWS, FIRST = 1500, 20000  # particles, and draws of the prior from which they come
LEAST = 200  # draws of the prior with which anything is known
MOVES, LAST_MOVES = 8, 24  # after each step, and at the end
KEPT = 0.6  # share of the effective particles
MOST_STEPS = 60
JITTER = 0.02  # of a prior's standard deviation, so that all is reached
TURNS = 0.1  # share of the moves that turn the sign, where it is not known

Target = Callable[[Array, Array], Array]


class Draws(NamedTuple):
    """Equally likely combinations."""

    x: Array  # shape (n, p)
    sign: Array  # shape (n,)
    fit: Array  # shape (n,); logarithm of the likelihood
    accepted: float  # share of the last moves that were accepted


def sample(problem: Problem, seed: int) -> Draws:
    """Draw from what prior and data leave possible.

    Raises SolveError if the tip oscillates nowhere within the prior.
    """
    rng = np.random.default_rng(seed)

    def target(x: Array, sign: Array) -> Array:
        state = problem.state(x)
        return problem.likelihood(problem.solved(state), state.zeros, sign)[0]

    x, sign = _prior(problem, rng, FIRST)
    fit = target(x, sign)
    there = np.isfinite(fit)
    if there.sum() < LEAST:
        raise SolveError(
            "No oscillation that the prior allows holds the setpoints: see to lever, amplitude, setpoints."
        )
    return _lead(target, x[there], sign[there], fit[there], rng, problem.settings.sign is None)


def _prior(problem: Problem, rng: np.random.Generator, count: int) -> tuple[Array, Array]:
    from scipy.special import ndtr, ndtri
    from scipy.stats import qmc

    low = ndtr(-REACH)
    size = len(problem.names)
    shares = qmc.LatinHypercube(size, rng=rng).random(count)
    sign = np.full(count, float(problem.settings.sign or 1))
    if problem.settings.sign is None:
        sign[::2] = -1.0
    return ndtri(low + (1 - 2 * low) * shares), sign


def _lead(target: Target, x: Array, sign: Array, fit: Array, rng: np.random.Generator, turns: bool) -> Draws:
    """Lead particles of the prior to the data."""
    done, rate = 0.0, 0.0
    for _ in range(MOST_STEPS):
        step = _step(fit, 1.0 - done)
        done = min(1.0, done + step)
        chosen = _resampled(np.exp(step * (fit - fit.max())), DRAWS, rng)
        x, sign, fit = x[chosen], sign[chosen], fit[chosen]
        times, rate = (LAST_MOVES if done >= 1.0 else MOVES), 0.0
        for _ in range(times):
            rate += _move(target, (x, sign, fit), done, rng, turns) / times
        if done >= 1.0:
            break
    return Draws(x, sign, fit, rate)


def _step(gain: Array, left: float) -> float:
    """The largest step that leaves enough particles their weight."""

    def share(step: float) -> float:
        weights = np.exp(step * (gain - gain.max()))
        return float(weights.sum() ** 2 / (weights**2).sum() / len(gain))

    if share(left) >= KEPT:
        return left
    low, high = 0.0, left
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if share(middle) >= KEPT else (low, middle)
    return max(low, 1e-6)


def _resampled(weights: Array, count: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Systematic resampling."""
    edges = np.cumsum(weights / weights.sum())
    return np.minimum(np.searchsorted(edges, (np.arange(count) + rng.random()) / count), len(weights) - 1)


def _move(
    target: Target, particles: tuple[Array, Array, Array], done: float, rng: np.random.Generator, turns: bool
) -> float:
    """Move all particles in place, half of them at a time; the share that moved."""
    x, sign, fit = particles
    count, size = x.shape
    order, moved = rng.permutation(count), 0
    for movers, others in ((order[: count // 2], order[count // 2 :]), (order[count // 2 :], order[: count // 2])):
        n = len(movers)
        pair = others[rng.integers(0, len(others), (2, n))]
        some = rng.random((n, size)) < rng.choice([0.3, 0.6, 1.0], (n, 1))
        some[np.arange(n), rng.integers(0, size, n)] = True
        length = 2.38 / np.sqrt(2 * some.sum(axis=1)) * rng.choice([0.3, 1.0], n)
        trial = x[movers] + some * (length[:, None] * (x[pair[0]] - x[pair[1]]) + rng.normal(0, JITTER, (n, size)))
        turned = np.where(turns & (rng.random(n) < TURNS), -sign[movers], sign[movers])
        inside = (np.abs(trial) < REACH).all(axis=1)
        new = np.full(n, -np.inf)
        if inside.any():
            new[inside] = target(trial[inside], turned[inside])
        gain = done * (new - fit[movers]) - 0.5 * ((trial**2).sum(axis=1) - (x[movers] ** 2).sum(axis=1))
        won = np.log(rng.random(n)) < gain
        x[movers[won]], sign[movers[won]], fit[movers[won]] = trial[won], turned[won], new[won]
        moved += int(won.sum())
    return float(moved / count)
