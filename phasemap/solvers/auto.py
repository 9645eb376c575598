"""The cheapest solver that meets the accuracy asked for."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap.accuracy import Accuracy
from phasemap.solvers.march import March
from phasemap.work import Work


class Auto:
    """Per pixel: the averaged orbit where its estimated error meets the accuracy, else the exact orbit, else the march.

    The error of averaging is estimated by one Newton step towards the exact orbit.
    """

    name = "auto"
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

        limits = np.array([math.radians(accuracy.phase), accuracy.height])
        orbit_rows(
            work.law, work.rows, work.lever, TABLES, work.amplitudes, limits, True, first, last, out, status, solver
        )
        beyond = (col.NOT_CONVERGED, col.TOO_MANY_CONTACTS)
        for i in range(first, last):
            if status[i] in beyond:
                March().solve(work, accuracy, i, i + 1, out, status, solver)
