"""The solver "orbit": exact periodic orbits, with estimates of their errors."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.rows.answers import Answers
from phasemap.experiment.accuracy import Accuracy
from phasemap.experiment.lever import sees_tip
from phasemap.solvers.detected_setpoint import engage as engage_seen
from phasemap.solvers.in_time import InTime
from phasemap.solvers.problem import Work

NO_ORBIT = (col.NOT_CONVERGED, col.TOO_MANY_CONTACTS, col.UNSTABLE)
"""Where no periodic orbit was found; what the tip does there is asked of time."""
PHASE, LENGTH = 1e-3, 1e-12  # [degree, m], estimated errors that the cheap path may leave


class Orbit:
    """Exact periodic orbit at the setpoint, or what a lock-in shows of a motion that is not periodic.

    Where the lever's response to the force converges, that is enough; its own estimate must be within 1e-3 degree and
    1 pm, or within `Accuracy` where that is less, and is mostly ten to ten thousand times what is wrong. Elsewhere
    collocation split at the contact points and Newton's method leave some 1e-8 degree and 1e-5 pm in air, up to 1e-5
    degree and 0.01 pm in a liquid; the error stated is twice what elements of half the length change. Which motion a
    contact with hysteresis comes to, or one of which no periodic orbit is found, is decided by engaging in time.

    Parameters
    ----------
    complete : bool
        Collocation everywhere, for what the response does not give: Floquet multipliers, slope of the feedback.
    in_time : bool
        Whether engagement in time decides where no curve of orbits tells; else such a pixel keeps its status.
    """

    name = "orbit"
    rows_per_chunk = 500

    def __init__(self, complete: bool = False, in_time: bool = True) -> None:
        self.complete, self.in_time = complete, in_time

    def solve(self, work: Work, accuracy: Accuracy, first: int, last: int, answers: Answers) -> None:
        """See `phasemap.solvers.solver.Solver`."""
        limits = (0.0, 0.0) if self.complete else (min(accuracy.phase, PHASE), min(accuracy.height, LENGTH))
        if self.in_time:
            solve_exactly(work, limits, False, accuracy.periods, first, last, answers)
            polish(work, first, last, answers)
        else:
            solve_on_curves(work, limits, False, first, last, answers)


def solve_exactly(
    work: Work,
    limits: tuple[float, float],
    average: bool,
    periods: int,
    first: int,
    last: int,
    answers: Answers,
) -> None:
    """Take the cheap path where its error is below `limits` [degree, m], else collocation, else time.

    With `average` an averaged orbit may stand. Collocation and the march are compiled when the first pixel needs them.
    Far from the resonance all is left to time: the orbit from far may end before the setpoint, at a doubled period or
    where a harmonic is at resonance, and no curve says where the tip lands.
    """
    from phasemap._kernels.lever import near_resonance

    if near_resonance(work.lever):
        solve_on_curves(work, limits, average, first, last, answers)
        engage_lost(work, periods, first, last, answers)
    else:
        InTime().engage(work, np.arange(first, last), answers, periods)


def solve_on_curves(
    work: Work, limits: tuple[float, float], average: bool, first: int, last: int, answers: Answers
) -> None:
    """`solve_exactly` without time.

    A contact with hysteresis is left to it at once: between far and the setpoint there may be no periodic orbit.
    """
    from phasemap._kernels.rows.fast import cheap_rows

    phase, height = limits
    status, allowed = answers.status, np.array([math.radians(phase), height])
    if not sees_tip(work.lever):
        engage_seen(work, allowed, first, last, answers)
        return
    if phase > 0:
        if not cheap_rows(work.pixels, allowed, average, first, last, answers):
            return
    else:
        status[first:last] = col.PENDING
    hysteretic = work.rows[first:last, col.RELEASE] != 0
    in_time = hysteretic & (status[first:last] == col.PENDING)
    status[first:last][in_time] = col.NOT_CONVERGED
    if (status[first:last] == col.PENDING).any():
        from phasemap._kernels.quadrature import TABLES
        from phasemap._kernels.rows.exact import exact_rows

        exact_rows(work.pixels, TABLES, first, last, answers)


def engage_lost(work: Work, periods: int, first: int, last: int, answers: Answers) -> None:
    """Ask time where no periodic orbit was found, and beside resonance where the curve leads to none that is held."""
    from phasemap._kernels.lever import beside_resonance

    unsolved = first + np.flatnonzero(answers.status[first:last] != col.GOOD)
    if not len(unsolved):
        return
    lost = (*NO_ORBIT, col.NO_STABLE_ORBIT) if beside_resonance(work.lever) else NO_ORBIT
    InTime().engage(work, unsolved[np.isin(answers.status[unsolved], lost)], answers, periods)


def polish(work: Work, first: int, last: int, answers: Answers) -> None:
    """Replace periodic orbits that were found in time by those of collocation beside them."""
    out, status, solver = answers
    marched = solver[first:last] == col.MARCH
    if not marched.any() or not sees_tip(work.lever):
        return
    periodic = marched & (status[first:last] == col.GOOD)
    chosen = first + np.flatnonzero(periodic & ~col.irregular(out[first:last]))
    if not len(chosen):
        return
    from phasemap._kernels.quadrature import TABLES
    from phasemap._kernels.rows.exact import rows_beside

    rows, done = out[chosen], np.empty(len(chosen), np.bool_)
    rows_beside(work.part(chosen).pixels, TABLES, rows, done)
    out[chosen[done]], solver[chosen[done]] = rows[done], col.ORBIT
