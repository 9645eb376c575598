"""Exact periodic orbits."""

from __future__ import annotations

import numpy as np

from phasemap.accuracy import Accuracy
from phasemap.work import Work


class Orbit:
    """Exact periodic orbit at the setpoint, by collocation split at the contact points and Newton's method.

    The error left is far below any `Accuracy` one would ask for (1e-6 degree, 1e-3 pm against independent orbits).
    """

    name = "orbit"
    rows_per_chunk = 500

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
        from phasemap._kernels.batch import orbit_rows
        from phasemap._kernels.tables import TABLES

        limits = np.zeros(2)
        orbit_rows(work.law, work.rows, work.lever, TABLES, work.amplitudes, limits, first, last, out, status, solver)
