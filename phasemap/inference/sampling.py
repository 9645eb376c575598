"""Draws from the posterior of unknowns that are standard normal beforehand, by the ensemble sampler emcee.

Walkers are led from the prior to the posterior in steps, each as large as leaves most of them their weight, so that
every solution gets its share; between the steps they are moved by differences of others (ter Braak, Stat. Comput. 16,
239 (2006)).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from emcee import EnsembleSampler, State
from emcee.moves import DEMove
from scipy.optimize import brentq
from scipy.special import ndtr, ndtri
from scipy.stats import qmc

from phasemap._shared.arrays import Array

REACH = 2.25  # standard deviations of the prior within which everything is sought
FIRST = 20000  # draws of the prior
LEAST = 200  # of them with which anything is known
WALKERS = 1000  # at least, and four for each unknown
MOVES = 6  # after each step towards the posterior
STEPS, EVERY = 60, 20  # of the posterior, of which one in so many is kept: that many steps forget where a walker was
KEPT = 0.6  # share of the walkers that a step leaves effective
SPREAD = 0.5  # of the lengths of moves, relative
HOPS = 0.2  # share of the moves by a whole difference, which leads from one solution to another


class Draws(NamedTuple):
    """Equally likely combinations."""

    x: Array  # shape (n, p)
    fit: Array  # shape (n,); logarithm of the density of the posterior, up to a constant


def sample(likelihood: Callable[[Array], Array], size: int, seed: int) -> Draws | None:
    """Draw from the posterior; None if the likelihood is 0 nearly everywhere.

    `likelihood`: its logarithm at n combinations, shape (n, size).
    """
    done = 0.0

    def density(x: Array) -> Array:
        fit, inside = np.full(len(x), -np.inf), (np.abs(x) < REACH).all(axis=1)
        if inside.any():
            fit[inside] = done * likelihood(x[inside]) - 0.5 * (x[inside] ** 2).sum(axis=1)
        return fit

    rng, walkers = np.random.default_rng(seed), max(WALKERS, 4 * size)
    state = State(prior_draws(size, FIRST, seed), random_state=np.random.RandomState(seed).get_state())
    fit = likelihood(state.coords)
    if np.isfinite(fit).sum() < LEAST:
        return None
    moves = [(DEMove(SPREAD), 1 - HOPS), (DEMove(SPREAD, gamma0=1.0), HOPS)]
    sampler = EnsembleSampler(walkers, size, density, moves=moves, vectorize=True)
    while done < 1:
        step = _step(fit, 1 - done)
        done = min(1.0, done + step)
        weights = np.exp(step * (fit - fit.max()))
        edges = np.cumsum(weights / weights.sum())
        chosen = np.searchsorted(edges[:-1], (np.arange(walkers) + rng.random()) / walkers)
        state.coords, state.log_prob = state.coords[chosen], None
        state = sampler.run_mcmc(state, MOVES, skip_initial_state_check=True)
        fit = (state.log_prob + 0.5 * (state.coords**2).sum(axis=1)) / done
    sampler.reset()
    sampler.run_mcmc(state, STEPS)
    x, log = (get(thin=EVERY, flat=True) for get in (sampler.get_chain, sampler.get_log_prob))
    return Draws(x, log)


def _step(fit: Array, left: float) -> float:
    """The largest step that leaves enough of the walkers their weight."""

    def spare(step: float) -> float:
        weights = np.exp(step * (fit - fit.max()))
        return float(weights.sum() ** 2 / (weights**2).sum() / np.isfinite(fit).sum()) - KEPT

    return left if spare(left) >= 0 else float(brentq(spare, 1e-9 * left, left, xtol=1e-6))


def prior_draws(size: int, count: int, seed: int) -> Array:
    """Standard normal numbers within the reach that fill the prior evenly, shape (count, size)."""
    low = ndtr(-REACH)
    shares = qmc.LatinHypercube(size, rng=seed).random(count)
    return ndtri(low + (1 - 2 * low) * shares)
