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
    1 pm, or within `Accuracy` where that is less, and is mostly ten to ten thousand times what is wrong. Elsewhere
    collocation split at the contact points and Newton's method leave some 1e-8 degree and 1e-5 pm in air, up to 1e-5
    degree and 0.01 pm in a liquid; the error stated is twice what elements of half the length change.

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
        phase, height = (0.0, 0.0) if self.complete else (min(accuracy.phase, PHASE), min(accuracy.height, LENGTH))
        solve_exactly(work, phase, height, False, first, last, out, status, solver)


def solve_exactly(
    work: Work,
    phase: float,
    height: float,
    average: bool,
    first: int,
    last: int,
    out: np.ndarray,
    status: np.ndarray,
    solver: np.ndarray,
) -> None:
    """Take the cheap path where its error is below `phase` [degree] and `height` [m], else collocation.

    With `average` an averaged orbit may stand. Collocation is compiled when the first pixel needs it. Curves of laws
    with a neck are in pieces: where one does not lead to the setpoint, all of them are followed.
    """
    from phasemap._kernels import columns as col
    from phasemap._kernels.cheap import cheap_rows

    waiting = last - first
    if phase > 0:
        limits = np.array([math.radians(phase), height])
        waiting = cheap_rows(
            work.law, work.rows, work.lever, work.amplitudes, limits, average, first, last, out, status, solver
        )
    else:
        status[first:last] = col.PENDING
    if waiting:
        from phasemap._kernels.batch import exact_rows
        from phasemap._kernels.tables import TABLES

        exact_rows(work.law, work.rows, work.lever, TABLES, work.amplitudes, first, last, out, status, solver)
        necks = work.rows[first:last, col.RELEASE] != 0
        for i in first + np.flatnonzero(necks & (status[first:last] == col.NOT_CONVERGED)):
            from phasemap.curves.engage import engage

            status[i] = engage(work, int(i), out[i])
