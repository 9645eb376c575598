"""Exact periodic orbits."""

from __future__ import annotations

import math

import numpy as np

from phasemap.accuracy import Accuracy
from phasemap.work import Work

PHASE, LENGTH = 1e-3, 1e-12  # [degree, m], estimated errors that the cheap path may leave


class Orbit:
    """Exact periodic orbit at the setpoint.

    Where the lever's response to the force converges, that is enough; its own estimate must be within 1e-3 degree and
    1 pm, or within `Accuracy` where that is less, and is some hundred times what is wrong. Elsewhere collocation split
    at the contact points and Newton's method leave 1e-6 degree and 1e-3 pm.

    Parameters
    ----------
    complete : bool
        Collocation everywhere, for what the response does not give: Floquet multipliers, slope of the feedback.
    """

    name = "orbit"
    rows_per_chunk = 500

    def __init__(self, complete: bool = False) -> None:
        self.complete = complete

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

        limits = np.array([math.radians(min(accuracy.phase, PHASE)), min(accuracy.height, LENGTH)])
        if self.complete:
            limits[:] = 0.0
        orbit_rows(
            work.law, work.rows, work.lever, TABLES, work.amplitudes, limits, False, first, last, out, status, solver
        )
