"""The solver "auto": for each material the cheapest one that meets the accuracy asked for."""

from __future__ import annotations

from phasemap._kernels.rows.answers import Answers
from phasemap.experiment.accuracy import Accuracy
from phasemap.solvers.orbit import solve_exactly
from phasemap.solvers.problem import Work


class Auto:
    """Per pixel: the averaged orbit where its estimated error meets the accuracy, else the exact orbit, else the march.

    The error of averaging is its distance from the orbit corrected by the lever's response, and what is left in that.
    """

    name = "auto"
    rows_per_chunk = 500

    def solve(self, work: Work, accuracy: Accuracy, first: int, last: int, answers: Answers) -> None:
        """See `phasemap.solvers.solver.Solver`."""
        solve_exactly(work, (accuracy.phase, accuracy.height), True, accuracy.periods, first, last, answers)
