"""The solvers, by one protocol, so that every contract test runs on each.

A solver finds, for every row of a `Work`, the orbit on which the controller holds the setpoint. It may be called from
several threads at once.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Protocol

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.columns import ErrorLimits
from phasemap._kernels.lever import beside_resonance, low_q, near_resonance
from phasemap._kernels.rows.answers import Answers
from phasemap._shared.checks import check_choice
from phasemap._shared.errors import InputError
from phasemap.experiment.accuracy import Accuracy
from phasemap.experiment.lever import sees_tip
from phasemap.solvers.in_time import ETA, InTime
from phasemap.solvers.problem import Work

NO_ORBIT = (col.NOT_CONVERGED, col.TOO_MANY_CONTACTS, col.UNSTABLE)
"""Status codes without a periodic orbit, where the motion is found in time."""
PHASE, LENGTH = 1e-3, 1e-12  # [degree, m], estimated errors that the cheap path may leave


class Solver(Protocol):
    """Protocol of every solver."""

    name: str
    rows_per_chunk: int  # about a tenth of a second of work

    def solve(self, work: Work, accuracy: Accuracy, answers: Answers) -> None:
        """Fill the answers to a work: rows with the columns of `phasemap._kernels.columns`, and their codes.

        Amplitudes of the work are as the detector sees them where that is more than the tip's times a number; rows are
        of the tip.
        """
        ...


class Orbit:
    """Exact periodic orbit at the setpoint, or what a lock-in shows of a motion that is not periodic.

    Where the lever's response to the force converges, that is enough; its own estimate must be within 1e-3 degree and
    1 pm, or within `Accuracy` where that is less, and is mostly ten to ten thousand times what is wrong. Elsewhere
    collocation split at the contact points and Newton's method leave some 1e-8 degree and 1e-5 pm in air, up to 1e-5
    degree and 0.01 pm in a liquid; the error stated is twice what elements of half the length change. Which motion a
    contact with hysteresis comes to, or one of which no periodic orbit is found, is decided by engaging in time, which
    leaves some 5e-5 degree.

    `complete`: collocation everywhere, for what the response does not give: Floquet multipliers, slope of the feedback.
    `in_time`: whether engagement in time decides where no curve of orbits tells; else such a pixel keeps its status.
    """

    name = "orbit"
    rows_per_chunk = 500

    def __init__(self, complete: bool = False, in_time: bool = True) -> None:
        self.complete, self.in_time = complete, in_time

    def solve(self, work: Work, accuracy: Accuracy, answers: Answers) -> None:
        """Exact orbits, to `accuracy` or of all columns, and in time where no curve leads to one."""
        limits = (0.0, 0.0) if self.complete else (min(accuracy.phase, PHASE), min(accuracy.height, LENGTH))
        if self.in_time:
            solve_exactly(work, limits, average=False, periods=accuracy.periods, answers=answers)
        else:
            solve_on_curves(work, limits, average=False, answers=answers)


def solve_exactly(work: Work, limits: tuple[float, float], average: bool, periods: int, answers: Answers) -> None:
    """Take the cheap path where its error is below `limits` [degree, m], else collocation, else time.

    With `average` an averaged orbit may stand. Collocation and the march are compiled when the first pixel needs them.
    Far from the resonance all is left to time: the orbit from far may end before the setpoint, at a doubled period or
    where a harmonic is at resonance, and no curve says where the tip lands.
    """
    if near_resonance(work.lever):
        solve_on_curves(work, limits, average, answers)
        engage_lost(work, periods, answers)
    else:
        InTime().engage(work, np.arange(len(work)), answers, periods)


def solve_on_curves(work: Work, limits: tuple[float, float], average: bool, answers: Answers) -> None:
    """Solve as `solve_exactly` does, but without the march in time.

    A contact with hysteresis is left to the march at once: between far and the setpoint there may be no periodic orbit.
    """
    from phasemap._kernels.rows.by_response import response_rows

    phase, height = limits
    status, allowed = answers.status, ErrorLimits(math.radians(phase), height)
    if phase > 0:
        if not response_rows(work.pixels, allowed, average, answers):
            return
    else:
        status[:] = col.PENDING
    hysteretic = work.rows[:, col.RELEASE] != 0
    status[hysteretic & (status == col.PENDING)] = col.NOT_CONVERGED
    if (status == col.PENDING).any():
        from phasemap._kernels.quadrature import TABLES
        from phasemap._kernels.rows.by_collocation import collocation_rows

        collocation_rows(work.pixels, TABLES, answers)


def engage_lost(work: Work, periods: int, answers: Answers) -> None:
    """Ask time where no periodic orbit was found, and beside resonance where the curve leads to none that is held."""
    if (answers.status != col.GOOD).any():
        lost = (*NO_ORBIT, col.NO_STABLE_ORBIT) if beside_resonance(work.lever) else NO_ORBIT
        InTime().engage(work, np.flatnonzero(np.isin(answers.status, lost)), answers, periods)


class Averaging:
    """First-order Krylov-Bogolyubov-Mitropolsky averaging (Wang 1999, Eqs. 5-8): fast, and good in air.

    Which branch it is on is decided as for every solver, by engagement; where the motion is not periodic it is marched
    in time. It looks at no error allowed by `Accuracy`: its error is what it is, and `phasemap bench` measures it over
    regimes.
    """

    name = "averaging"
    rows_per_chunk = 2000

    def solve(self, work: Work, accuracy: Accuracy, answers: Answers) -> None:
        """Averaged orbits on the branch on which the tip engages; means in time where motion is not periodic."""
        from phasemap._kernels.rows.by_response import averaged_near_rows

        if not engage_averaged(work, accuracy.periods, answers):
            return
        # What is not periodic has no averaged orbit: the march's mean stands.
        kept = np.flatnonzero(col.is_mean(answers.rows))
        means = answers.rows[kept]
        averaged_near_rows(work.pixels, answers)
        answers.rows[kept], answers.status[kept], answers.solver[kept] = means, col.GOOD, col.MARCH


def engage_averaged(work: Work, periods: int, answers: Answers) -> bool:
    """Find averaged orbits where averaging can tell the branch, exact ones elsewhere; says whether there are such.

    Far from the resonance it cannot: what ends the orbits there are terms that it leaves out. Nor is it asked where the
    detector does not see the tip.
    """
    from phasemap._kernels.rows.by_response import averaging_rows

    if sees_tip(work.lever):
        averaging_rows(work.pixels, answers)
    if not near_resonance(work.lever) or not sees_tip(work.lever):
        answers.status[:] = col.PENDING
    doubtful = np.flatnonzero(answers.status == col.PENDING)
    if not len(doubtful):
        return False
    exact = answers.of(doubtful)
    solve_exactly(work.part(doubtful), (PHASE, LENGTH), average=False, periods=periods, answers=exact)
    answers.put(doubtful, exact)
    return True


class Auto:
    """Per pixel: the averaged orbit where its estimated error meets the accuracy, else the exact orbit, else the march.

    The error of averaging is its distance from the orbit corrected by the lever's response, and what is left in that.
    """

    name = "auto"
    rows_per_chunk = 500

    def solve(self, work: Work, accuracy: Accuracy, answers: Answers) -> None:
        """The cheapest orbit that meets `accuracy`."""
        solve_exactly(work, (accuracy.phase, accuracy.height), average=True, periods=accuracy.periods, answers=answers)


class March(InTime):
    """Solver in time, of every material, from an orbit that holds the setpoint or, where none is known, from far.

    Slow: it is what the other solvers are checked against. Near the resonance they say on which branch the tip engages,
    and where on it the march begins; what it comes to shares nothing with them but the equation. A lever with several
    modes is lowered from far in time.
    """

    name = "march"
    rows_per_chunk = 8

    def solve(self, work: Work, accuracy: Accuracy, answers: Answers) -> None:
        """March from the orbit that another solver engages, or from far where none can."""
        # Averaging knows no harmonics of the higher modes, which may decide on the branch.
        if work.lever[col.MODES] > 1 or not near_resonance(work.lever):
            self.engage(work, np.arange(len(work)), answers, accuracy.periods)
            return
        if low_q(work.lever):  # an averaged orbit is far from that which holds the setpoint
            solve_exactly(work, (PHASE, LENGTH), average=False, periods=accuracy.periods, answers=answers)
        else:
            engage_averaged(work, accuracy.periods, answers)
        again = answers.status != col.NO_STABLE_ORBIT
        if self.eta == ETA:  # what was engaged from far was so with the steps of the default
            again &= answers.solver != col.MARCH
        self.settle(work, np.flatnonzero(again), answers, accuracy.periods)


class FromFar(March):
    """The march, engaged from far in time: no other solver is asked on which orbit that ends."""

    rows_per_chunk = 1

    def solve(self, work: Work, accuracy: Accuracy, answers: Answers) -> None:
        """March every material from far."""
        self.engage(work, np.arange(len(work)), answers, accuracy.periods)


class BothDrives(FromFar):
    """The march, engaged from far, under both drives of a lever whose second mode is driven too."""

    def solve(self, work: Work, accuracy: Accuracy, answers: Answers) -> None:
        """March every material from far, with both drives on; amplitudes are the detector's, not the tip's."""
        self.engage_with_second_drive(work, np.arange(len(work)), answers, accuracy.periods)


class OnlyInTime(FromFar):
    """The march for surfaces that remember or are wet, and another solver for the materials among them that are not.

    Where that is the march from far, the surface is wet, the lever has several modes or the detector does not see the
    tip, all are engaged from far.
    """

    rows_per_chunk = March.rows_per_chunk

    def __init__(self, other: Solver) -> None:
        super().__init__()
        self.other = other

    def solve(self, work: Work, accuracy: Accuracy, answers: Answers) -> None:
        """March what remembers or is wet, and let `other` solve the rest without memory."""
        remembers, engaged = work.remembers, work.loses
        forgetful = replace(work, law=work.law._replace(memory=0))
        self.engage(forgetful, np.flatnonzero(engaged & ~remembers), answers, accuracy.periods)
        self.engage(work, np.flatnonzero(engaged & remembers), answers, accuracy.periods)
        far = np.flatnonzero(remembers & ~engaged)
        one_mode = work.lever[col.MODES] < 2 and sees_tip(work.lever)
        if len(far) and one_mode and not isinstance(self.other, FromFar):
            from phasemap._kernels.rows.marched import remembering_rows

            self._march(remembering_rows, work, far, answers, accuracy.periods)  # from averaged orbits that are sure
            far = far[answers.status[far] != col.GOOD]
        self.engage(work, far, answers, accuracy.periods)
        rest, plain = work.static()
        if not len(rest):
            return
        of_rest = answers.of(rest)
        self.other.solve(plain, accuracy, of_rest)
        answers.put(rest, of_rest)


def check_integrals(names: list[str]) -> None:
    """Refuse integrals over a static force, by their names, where contacts remember or are wet."""
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


SOLVERS: tuple[Solver, ...] = (Auto(), Averaging(), Orbit(), March())


def by_name(name: object) -> Solver:
    """Return the solver of this name."""
    known = {solver.name: solver for solver in SOLVERS}
    check_choice("solver", name, known)
    return known[str(name)]
