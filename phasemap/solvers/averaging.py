"""First-order averaging."""

from __future__ import annotations

import numpy as np

from phasemap.accuracy import Accuracy
from phasemap.work import Work


class Averaging:
    """First-order Krylov-Bogolyubov-Mitropolsky averaging (Wang 1999, Eqs. 5-8): fast, and good in air.

    Which branch it is on is decided as for every solver, by engagement. It does not look at `Accuracy`: its error is
    what it is, and `phasemap bench` measures it over regimes.
    """

    name = "averaging"
    rows_per_chunk = 2000

    def solve(
        self,
        work: Work,
        accuracy: Accuracy,
        first: int,
        last: int,
        out: np.ndarray,
        status: np.ndarray,
        solver: np.ndarray,
    ) -> None:
        """See `phasemap.solvers.Solver`."""
        from phasemap._kernels.batch import averaging_rows
        from phasemap._kernels.tables import TABLES

        averaging_rows(work.law, work.rows, work.lever, TABLES, work.amplitudes, first, last, out, status, solver)
