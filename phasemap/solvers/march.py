"""The full equation of motion, marched in time."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap.accuracy import Accuracy
from phasemap.solvers.averaging import engage_averaged
from phasemap.work import Work

ENOUGH = 500.0  # quality factor up to which the steps need not be shorter
ETA = 0.25  # size of the steps, of which the following are the errors
ERROR_PHASE, ERROR_HEIGHT = math.radians(5e-5), 1e-14  # [rad, m], found against independent orbits


class March:
    """Time integration with Runge-Kutta steps of order 8 and the contact located, until the orbit repeats itself.

    Slow, and independent of the other solvers from the equation on: it is what they are checked against. Only orbits
    that time leads to are found, so that an orbit that settles is stable.

    Parameters
    ----------
    eta : float
        Size of the steps up to Q = 500, shorter above; the error goes with its 8th power and is below 5e-5 degree and
        0.01 pm at the default. That is what a row states; smaller steps state no less, for the orbit is followed
        until it repeats itself to about as much.
    """

    name = "march"
    rows_per_chunk = 8

    def __init__(self, eta: float = ETA) -> None:
        self.eta = eta

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
        engage_averaged(work, first, last, out, status, solver)
        self.settle(work, first, last, out, status, solver)

    def settle(
        self, work: Work, first: int, last: int, out: np.ndarray, status: np.ndarray, solver: np.ndarray
    ) -> None:
        """March from the orbits in `out`, or from far where there is none that converged."""
        from phasemap._kernels.marching import march_rows

        # An error per period counts Q / pi times in the steady orbit, and goes with eta^8.
        eta = self.eta * min(1.0, 2 * ENOUGH * float(work.lever[col.ALPHA0])) ** 0.125
        march_rows(work.law, work.rows, work.lever, work.amplitudes, eta, first, last, out, status, solver)
        held = first + np.flatnonzero(status[first:last] == col.GOOD)
        coarser = max(self.eta / ETA, 1.0) ** 8
        out[held, col.ERROR_PHASE], out[held, col.ERROR_HEIGHT] = coarser * ERROR_PHASE, coarser * ERROR_HEIGHT


class FromFar(March):
    """The march, engaged from far in time: no other solver is asked on which orbit that ends."""

    rows_per_chunk = 1

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
        status[first:last] = col.NOT_CONVERGED  # for `settle`: there is no orbit to begin with
        self.settle(work, first, last, out, status, solver)
