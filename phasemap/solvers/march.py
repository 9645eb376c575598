"""The solver "march": the full equation of motion in time, until its motion is steady."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.rows.answers import Answers
from phasemap._shared.errors import InputError
from phasemap.experiment.accuracy import Accuracy
from phasemap.solvers.averaging import engage_averaged
from phasemap.solvers.in_time import ERROR_HEIGHT, ERROR_PHASE, ETA, InTime
from phasemap.solvers.orbit import LENGTH, PHASE, solve_exactly
from phasemap.solvers.problem import Work

if TYPE_CHECKING:
    from phasemap.solvers.solver import Solver


class March(InTime):
    """Every material in time, from an orbit that holds the setpoint or, where none is known, from far.

    Slow: it is what the other solvers are checked against. Near the resonance they say on which branch the tip engages,
    and where on it the march begins; what it comes to shares nothing with them but the equation. A lever with several
    modes is lowered from far in time.

    Parameters
    ----------
    eta : float
        As for `InTime`.
    """

    name = "march"
    rows_per_chunk = 8

    def solve(self, work: Work, accuracy: Accuracy, first: int, last: int, answers: Answers) -> None:
        """See `phasemap.solvers.solver.Solver`."""
        from phasemap._kernels.lever import low_q, near_resonance

        # Averaging knows no harmonics of the higher modes, which may decide on the branch.
        if work.lever[col.MODES] > 1 or not near_resonance(work.lever):
            self.engage(work, np.arange(first, last), answers, accuracy.periods)
            return
        if low_q(work.lever):  # an averaged orbit is far from that which holds the setpoint
            solve_exactly(work, (PHASE, LENGTH), False, accuracy.periods, first, last, answers)
        else:
            engage_averaged(work, accuracy.periods, first, last, answers)
        _, status, solver = answers
        decided = np.isin(status[first:last], (col.GOOD, col.NO_STABLE_ORBIT))
        in_time = solver[first:last] == col.MARCH  # engaged from far, with the steps of the default
        again = first + np.flatnonzero(~decided | (status[first:last] == col.GOOD))
        if self.eta == ETA:
            again = again[~in_time[again - first]]
        self.settle(work, again, answers, accuracy.periods)


class FromFar(March):
    """The march, engaged from far in time: no other solver is asked on which orbit that ends."""

    rows_per_chunk = 1

    def solve(self, work: Work, accuracy: Accuracy, first: int, last: int, answers: Answers) -> None:
        """See `phasemap.solvers.solver.Solver`."""
        self.engage(work, np.arange(first, last), answers, accuracy.periods)


class BothDrives(FromFar):
    """The march, engaged from far, under both drives of a lever whose second mode is driven too."""

    def solve(self, work: Work, accuracy: Accuracy, first: int, last: int, answers: Answers) -> None:
        """See `phasemap.solvers.solver.Solver`."""
        self.engage_with_second_drive(work, np.arange(first, last), answers, accuracy.periods)


class OnlyInTime(FromFar):
    """The march for surfaces that remember or are wet, and another solver for the materials among them that are not.

    Where that does not march, solids are solved by the lever's response if one tap leaves the next no dent. Where it is
    the march from far, the surface is wet or the lever has several modes, all are engaged from far.
    """

    rows_per_chunk = March.rows_per_chunk

    def __init__(self, other: Solver) -> None:
        super().__init__()
        self.other = other

    def solve(self, work: Work, accuracy: Accuracy, first: int, last: int, answers: Answers) -> None:
        """See `phasemap.solvers.solver.Solver`."""
        rows = work.rows[first:last]
        lossy = bool(work.law.lossy) & ((rows[:, col.WITHDRAWN] > 0) | (rows[:, col.LOSS] > 0))
        engaged = lossy | (rows[:, col.FORMING] < 0)
        self.engage(work, first + np.flatnonzero(engaged), answers, accuracy.periods)
        remembers = ~engaged & bool(work.law.memory) & ((rows[:, col.RELAXATION] > 0) | (rows[:, col.DAMPING] > 0))
        far = first + np.flatnonzero(remembers)
        one_mode = work.lever[col.MODES] < 2
        if len(far) and one_mode and not isinstance(self.other, March):
            self._respond(work, far, answers)
            far = far[answers.status[far] != col.GOOD]
        if len(far) and one_mode and not isinstance(self.other, FromFar):
            self._start_averaged(work, far, answers, accuracy.periods)
            far = far[answers.status[far] != col.GOOD]
        self.engage(work, far, answers, accuracy.periods)
        rest = first + np.flatnonzero(~(remembers | engaged))
        if not len(rest):
            return
        plain = replace(work.part(rest), law=work.law._replace(memory=0, lossy=0))
        some = answers.of(rest)
        self.other.solve(plain, accuracy, 0, len(rest), some)
        answers.put(rest, some)

    def _respond(self, work: Work, chosen: np.ndarray, answers: Answers) -> None:
        """Find the chosen rows by the lever's response, as exactly as the march does, where that is possible."""
        from phasemap._kernels.rows.marched import relaxing_rows

        some, limits = answers.of(chosen), np.array([ERROR_PHASE, ERROR_HEIGHT])
        relaxing_rows(work.part(chosen).pixels, limits, some)
        answers.put(chosen, some)

    def _start_averaged(self, work: Work, chosen: np.ndarray, answers: Answers, periods: int) -> None:
        """March the chosen rows from their averaged orbits, where averaging is sure of them."""
        from phasemap._kernels.rows.marched import remembering_rows

        self._march(remembering_rows, work, chosen, answers, periods)


def check_integrals(names: list[str]) -> None:
    """Refuse variables and channels that are integrals over a static force, where contacts remember or are wet.

    `names`: of those that are, among the variables asked for.
    Raises `InputError`, with what is allowed.
    """
    if names:
        allowed = "variables that are no integral over a static force, where contacts remember or are wet"
        hint = (
            "loss_tangent, dissipation and virial are none; harmonics, loss_tangent_corrected and a second mode's are."
        )
        raise InputError("variables", ", ".join(names), allowed, hint)


def check_marches(name: str) -> None:
    """Refuse a solver that does not march, where contacts remember or are wet."""
    if name not in ("auto", March.name):
        raise InputError("solver", name, "'march' or 'auto' where contacts remember or are wet")
