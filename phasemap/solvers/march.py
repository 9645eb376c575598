"""The solver "march": the full equation of motion in time, until its motion is steady."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.rows.answers import Answers
from phasemap._shared.errors import InputError
from phasemap.experiment.accuracy import MOST_PERIODS, Accuracy
from phasemap.solvers.problem import Work

if TYPE_CHECKING:
    from phasemap.solvers.solver import Solver

ENOUGH = 500.0  # quality factor up to which the steps need not be shorter
ETA = 0.25  # size of the steps, of which the following are the errors
MISSING = 2.0  # [rad] of phase, at most, for each part of the energy that is missing: 1.3 in draws of lasting dents
ERROR_PHASE, ERROR_HEIGHT = math.radians(5e-5), 1e-14  # [rad, m], found against independent orbits


class March:
    """Time integration with Runge-Kutta steps of order 8 and the contact located, until the motion is known.

    Slow, and independent of the other solvers from the equation on: it is what they are checked against. Only motion
    that time leads to is found, so that an orbit that settles is stable. Motion that does not repeat itself is held on
    the amplitude that a slow lock-in shows.

    Parameters
    ----------
    eta : float
        Size of the steps up to Q = 500, shorter above; the error goes with its 8th power and is below 5e-5 degree and
        0.01 pm at the default. That is what a row states; smaller steps state no less, for the orbit is followed
        until it repeats itself to about as much.
    """

    name = "march"
    rows_per_chunk = 8

    def __init__(self, eta: float = ETA) -> None:
        self.eta = eta

    def solve(self, work: Work, accuracy: Accuracy, first: int, last: int, answers: Answers) -> None:
        """See `phasemap.solvers.solver.Solver`."""
        from phasemap._kernels.engagement.resonance import near_resonance
        from phasemap.solvers.averaging import engage_averaged
        from phasemap.solvers.orbit import LENGTH, PHASE, solve_from_far

        if not near_resonance(work.lever):
            pressed = solve_from_far(work, (PHASE, LENGTH), False, accuracy.periods, first, last, answers, self)
            self.settle(work, pressed, answers, accuracy.periods)
            return
        engage_averaged(work, accuracy.periods, first, last, answers)
        _, status, solver = answers
        decided = np.isin(status[first:last], (col.GOOD, col.NO_STABLE_ORBIT))
        in_time = solver[first:last] == col.MARCH  # engaged from far, with the steps of the default
        again = first + np.flatnonzero(~decided | (status[first:last] == col.GOOD))
        if self.eta == ETA:
            again = again[~in_time[again - first]]
        self.settle(work, again, answers, accuracy.periods)

    def engage(self, work: Work, chosen: np.ndarray, answers: Answers, periods: int) -> np.ndarray:
        """March the chosen rows, an array of numbers, from far; returns as `settle`."""
        answers.status[chosen] = col.PENDING  # for `settle`: there is no orbit to begin with
        return self.settle(work, chosen, answers, periods)

    def settle(self, work: Work, chosen: np.ndarray, answers: Answers, periods: int = MOST_PERIODS) -> np.ndarray:
        """March the chosen rows, an array of numbers: from the orbits there, or from far where none is GOOD.

        Returns the numbers of those that nothing holds as far as a tip is lowered, where it is pressed in for good.
        """
        from phasemap._kernels.rows.marched import march_rows

        return self._march(march_rows, work, chosen, answers, periods) if len(chosen) else chosen

    def _march(self, rows_of: Any, work: Work, chosen: np.ndarray, answers: Answers, periods: int) -> np.ndarray:
        """Let a kernel of `rows.marched` fill the chosen rows; returns as `settle`."""
        # An error per period counts Q / pi times in the steady orbit, and goes with eta^8.
        eta = self.eta * min(1.0, 2 * ENOUGH * float(work.lever[col.ALPHA0])) ** 0.125
        some, codes, _ = answers.of(chosen)
        rows = np.ascontiguousarray(work.rows[chosen])
        rows_of(work.law, rows, work.lever, work.amplitudes[chosen], eta, periods, some, codes)
        periodic = (codes == col.GOOD) & ~col.irregular(some)
        coarser = max(self.eta / ETA, 1.0) ** 8
        errors = np.array([ERROR_PHASE, ERROR_HEIGHT])
        some[np.ix_(periodic, [col.ERROR_PHASE, col.ERROR_HEIGHT])] = coarser * errors
        if work.law.memory:
            self._state_closure(some, periodic)
        pressed = codes == col.PRESSED
        codes[pressed] = col.NO_STABLE_ORBIT
        answers.put(chosen, Answers(some, codes, np.full(len(chosen), col.MARCH, np.int8)))
        return np.asarray(chosen[pressed])

    @staticmethod
    def _state_closure(some: np.ndarray, periodic: np.ndarray) -> None:
        """State larger errors where energy is missing that surfaces remember: dents that last have kinks.

        With no other error sin(lag) is off by that share of itself, and the offset by less than that of the amplitude.
        """
        missing = np.abs(some[periodic, col.CLOSURE])
        for column, error in (
            (col.ERROR_PHASE, MISSING * missing),
            (col.ERROR_HEIGHT, missing * some[periodic, col.AMPLITUDE]),
        ):
            some[periodic, column] = np.maximum(some[periodic, column], error)


class FromFar(March):
    """The march, engaged from far in time: no other solver is asked on which orbit that ends."""

    rows_per_chunk = 1

    def solve(self, work: Work, accuracy: Accuracy, first: int, last: int, answers: Answers) -> None:
        """See `phasemap.solvers.solver.Solver`."""
        self.engage(work, np.arange(first, last), answers, accuracy.periods)


class Remembering(FromFar):
    """The march for surfaces that remember, and another solver for the materials among them that do not.

    Where that does not march, solids are solved by the lever's response if one tap leaves the next no dent. Where it is
    the march from far, all are engaged from far.
    """

    rows_per_chunk = March.rows_per_chunk

    def __init__(self, other: Solver) -> None:
        super().__init__()
        self.other = other

    def solve(self, work: Work, accuracy: Accuracy, first: int, last: int, answers: Answers) -> None:
        """See `phasemap.solvers.solver.Solver`."""
        rows = work.rows[first:last]
        remembers = (rows[:, col.RELAXATION] > 0) | (rows[:, col.DAMPING] > 0)
        far = first + np.flatnonzero(remembers)
        if len(far) and not isinstance(self.other, March):
            self._respond(work, far, answers)
            far = far[answers.status[far] != col.GOOD]
        if len(far) and not isinstance(self.other, FromFar):
            self._start_averaged(work, far, answers, accuracy.periods)
            far = far[answers.status[far] != col.GOOD]
        self.engage(work, far, answers, accuracy.periods)
        rest = first + np.flatnonzero(~remembers)
        if not len(rest):
            return
        plain = replace(work.part(rest), law=work.law._replace(memory=0))
        some = answers.of(rest)
        self.other.solve(plain, accuracy, 0, len(rest), some)
        answers.put(rest, some)

    def _respond(self, work: Work, chosen: np.ndarray, answers: Answers) -> None:
        """Find the chosen rows by the lever's response, as exactly as the march does, where that is possible."""
        from phasemap._kernels.rows.relaxing import relaxing_rows

        some, limits = answers.of(chosen), np.array([ERROR_PHASE, ERROR_HEIGHT])
        rows = np.ascontiguousarray(work.rows[chosen])
        relaxing_rows(work.law, rows, work.lever, work.amplitudes[chosen], limits, some)
        answers.put(chosen, some)

    def _start_averaged(self, work: Work, chosen: np.ndarray, answers: Answers, periods: int) -> None:
        """March the chosen rows from their averaged orbits, where averaging is sure of them."""
        from phasemap._kernels.rows.marched import remembering_rows

        self._march(remembering_rows, work, chosen, answers, periods)


def check_integrals(names: list[str]) -> None:
    """Refuse variables and channels that are integrals over a static force, where contacts remember.

    `names`: of those that are, among the variables asked for.
    Raises `InputError`, with what is allowed.
    """
    if names:
        allowed = "variables that are no integral over a static force, where contacts remember"
        hint = (
            "loss_tangent, dissipation and virial are none; harmonics, loss_tangent_corrected and a second mode's are."
        )
        raise InputError("variables", ", ".join(names), allowed, hint)


def check_marches(name: str) -> None:
    """Refuse a solver that does not march, where contacts remember."""
    if name not in ("auto", March.name):
        raise InputError("solver", name, "'march' or 'auto' where contacts remember")
