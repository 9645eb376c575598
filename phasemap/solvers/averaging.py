"""The solver "averaging": orbits to first order."""

from __future__ import annotations

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.rows.answers import Answers
from phasemap.experiment.accuracy import Accuracy
from phasemap.experiment.lever import sees_tip
from phasemap.solvers.orbit import LENGTH, PHASE, solve_exactly
from phasemap.solvers.problem import Work


class Averaging:
    """First-order Krylov-Bogolyubov-Mitropolsky averaging (Wang 1999, Eqs. 5-8): fast, and good in air.

    Which branch it is on is decided as for every solver, by engagement; where the motion is not periodic it is marched
    in time. It looks at no error allowed by `Accuracy`: its error is
    what it is, and `phasemap bench` measures it over regimes.
    """

    name = "averaging"
    rows_per_chunk = 2000

    def solve(self, work: Work, accuracy: Accuracy, first: int, last: int, answers: Answers) -> None:
        """See `phasemap.solvers.solver.Solver`."""
        from phasemap._kernels.rows.fast import averaged_near_rows

        if not engage_averaged(work, accuracy.periods, first, last, answers):
            return
        # What is not periodic has no averaged orbit: the march's mean stands.
        kept = first + np.flatnonzero(col.irregular(answers.rows[first:last]))
        means = answers.rows[kept]
        averaged_near_rows(work.pixels, first, last, answers)
        answers.rows[kept], answers.status[kept], answers.solver[kept] = means, col.GOOD, col.MARCH


def engage_averaged(work: Work, periods: int, first: int, last: int, answers: Answers) -> bool:
    """Find averaged orbits where averaging can tell the branch, exact ones elsewhere; says whether there are such.

    Far from the resonance it cannot: what ends the orbits there are terms that it leaves out. Nor is it asked where the
    detector does not see the tip.
    """
    from phasemap._kernels.lever import near_resonance
    from phasemap._kernels.rows.fast import averaging_rows

    if sees_tip(work.lever):
        averaging_rows(work.pixels, first, last, answers)
    if not near_resonance(work.lever) or not sees_tip(work.lever):
        answers.status[first:last] = col.PENDING
    doubtful = first + np.flatnonzero(answers.status[first:last] == col.PENDING)
    if not len(doubtful):
        return False
    some = answers.of(doubtful)
    solve_exactly(work.part(doubtful), (PHASE, LENGTH), False, periods, 0, len(doubtful), some)
    answers.put(doubtful, some)
    return True
