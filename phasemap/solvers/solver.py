"""Solvers: one protocol for all, so that every contract test runs on each.

A solver finds, for every row of a `Work`, the orbit on which the controller holds the setpoint. It works on a slice of
the rows and may be called from several threads at once.
"""

from __future__ import annotations

from typing import Protocol

from phasemap._kernels.rows.answers import Answers
from phasemap._shared.checks import check_choice
from phasemap.experiment.accuracy import Accuracy
from phasemap.solvers.auto import Auto
from phasemap.solvers.averaging import Averaging
from phasemap.solvers.march import March
from phasemap.solvers.orbit import Orbit
from phasemap.solvers.problem import Work


class Solver(Protocol):
    """What a solver offers."""

    name: str
    rows_per_chunk: int  # about a tenth of a second of work

    def solve(self, work: Work, accuracy: Accuracy, first: int, last: int, answers: Answers) -> None:
        """Fill rows [first, last) of the answers (columns of `phasemap._kernels.columns`), and their codes.

        Amplitudes of the work are as the detector sees them where that is more than the tip's times a number; rows are
        of the tip.
        """
        ...


SOLVERS: tuple[Solver, ...] = (Auto(), Averaging(), Orbit(), March())


def by_name(name: object) -> Solver:
    """Return the solver of this name."""
    known = {solver.name: solver for solver in SOLVERS}
    check_choice("solver", name, known)
    return known[str(name)]
