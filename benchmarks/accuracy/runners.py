"""Running one solver or one peer over the cases of a regime: how long it takes, and what it answers."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np

from benchmarks.accuracy.cases import Field, Known
from benchmarks.accuracy.equation import Equation
from benchmarks.accuracy.methods import Method
from benchmarks.accuracy.peers import Peer
from benchmarks.accuracy.peers.shooting import BEGIN, constants
from benchmarks.accuracy.periods import march_period_time
from benchmarks.timing import best_of
from phasemap._kernels import columns as col
from phasemap.experiment.accuracy import Accuracy
from phasemap.solvers.run import run
from phasemap.solvers.solver import Solver

Array = np.ndarray

SHORT = 1e-3
"""[s] A single pixel is timed again and again for this long; a slow peer's once."""


@dataclass(frozen=True)
class Answer:
    """What a solver or peer says of a case."""

    # phase, tip_offset: [degree, m]; NaN where it found no orbit
    phase: float = math.nan
    tip_offset: float = math.nan
    # phase_bound, height_bound: errors that it states [degree, m]; NaN where it states none
    phase_bound: float = math.nan
    height_bound: float = math.nan


class Runner(Protocol):
    """What is measured, ready to run."""

    def solve(self, field: Field) -> tuple[Array, list[Answer | None]]:
        """Seconds of each piece of work, and an answer for each known case; None where it was not asked."""
        ...

    def per_pixel(self, field: Field, seconds: Array) -> float:
        """Seconds per distinct pixel, from the shortest seconds of each piece of work."""
        ...

    def periods(self, field: Field) -> Array:
        """Seconds per period of the oscillation, one for each known case; NaN where there is none."""
        ...


def runner_of(method: Method, budget: float) -> Runner:
    """Make a method ready to run; a peer is compiled by this.

    `budget`: seconds for which the timing of a solver is repeated in each regime.
    """
    if method.peer is not None:
        return PeerRunner(method.peer, method.tolerance)
    assert method.solver is not None
    return SolverRunner(method.solver, method.accuracy, budget, method.tolerance)


class SolverRunner:
    """A solver of phasemap: all pixels of a microscope at once, as in an image; `eta` is that of the march, or 0."""

    def __init__(self, solver: Solver, accuracy: Accuracy, budget: float, eta: float) -> None:
        self.solver, self.accuracy, self.budget, self.eta = solver, accuracy, budget, eta

    def solve(self, field: Field) -> tuple[Array, list[Answer | None]]:
        """See `Runner`."""
        share = self.budget / len(field.works)
        timed = [best_of(partial(run, self.solver, work, self.accuracy, threads=1), share) for work in field.works]
        answers: list[Answer | None] = []
        for known in field.known:
            rows, status, _ = timed[known.batch][1]
            row = rows[known.index]
            answers.append(_answer(row) if status[known.index] == col.GOOD else Answer())
        return np.array([seconds for seconds, _ in timed]), answers

    def per_pixel(self, field: Field, seconds: Array) -> float:
        """See `Runner`."""
        return float(seconds.sum()) / sum(len(work) for work in field.works)

    def periods(self, field: Field) -> Array:
        """See `Runner`."""
        if not self.eta:
            return np.full(len(field.known), math.nan)
        return _of_each(field, lambda known: march_period_time(field.works[known.batch], known, self.eta))


class PeerRunner:
    """A general integrator with shooting around it: one pixel after the other."""

    def __init__(self, peer: Peer, tolerance: float) -> None:
        self.peer, self.tolerance = peer, tolerance
        self.shoot, self.period = peer.prepare(tolerance)

    def solve(self, field: Field) -> tuple[Array, list[Answer | None]]:
        """See `Runner`."""
        seconds, answers = np.full(len(field.known), math.nan), list[Answer | None]()
        for c, known in enumerate(field.known):
            if not self._is_asked(c, known):
                answers.append(None)
                continue
            seconds[c], (tip_offset, phase, converged) = best_of(partial(self.shoot, *problem(known)), SHORT)
            found = Answer(math.degrees(phase), float(tip_offset) * known.case.amplitude)
            answers.append(found if converged else Answer())
        return seconds, answers

    def per_pixel(self, field: Field, seconds: Array) -> float:
        """See `Runner`."""
        return float(np.nanmean(seconds)) if np.isfinite(seconds).any() else math.nan

    def periods(self, field: Field) -> Array:
        """See `Runner`."""
        asked = {id(known) for c, known in enumerate(field.known) if self._is_asked(c, known)}
        return _of_each(field, lambda known: self._period_time(known) if id(known) in asked else math.nan)

    def _is_asked(self, c: int, known: Known) -> bool:
        return known.start is not None and c % self.peer.share == 0

    def _period_time(self, known: Known) -> float:
        assert known.reference is not None
        p, _ = problem(known)
        p[BEGIN] = known.reference.instant
        x = np.array([*known.reference.state, known.reference.tip_offset / known.case.amplitude])
        return best_of(partial(self.period, x, p, self.tolerance), SHORT)[0]


def problem(known: Known) -> tuple[Array, Array]:
    """Constants and start of a peer: mean and first harmonic where the tip is farthest away."""
    assert known.start is not None
    a = known.case.amplitude
    p = constants(Equation.of(known.case), math.radians(known.start.phase))
    return p, np.array([known.start.mean_deflection / a - 1, 0.0, known.start.tip_offset / a])


def _answer(row: Array) -> Answer:
    return Answer(
        math.degrees(row[col.PHASE]),
        float(row[col.TIP_OFFSET]),
        math.degrees(row[col.ERROR_PHASE]),
        float(row[col.ERROR_HEIGHT]),
    )


def _of_each(field: Field, seconds: Callable[[Known], float]) -> Array:
    return np.array([math.nan if known.reference is None else seconds(known) for known in field.known])
