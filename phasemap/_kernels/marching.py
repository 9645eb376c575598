"""Loop over pixels for the march."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from phasemap._kernels import columns as col
from phasemap._kernels.approach import far_start, free_amplitude, scale_of
from phasemap._kernels.law import OPTIONS, Law
from phasemap._kernels.march import approach, settle
from phasemap._kernels.mesh import reach_of
from phasemap._kernels.quick import parameters

MOST_PERIODS = 200_000  # that a march may take to settle


@njit(**OPTIONS)
def march_rows(
    law: Law,
    rows: np.ndarray,
    lever: np.ndarray,
    amplitudes: np.ndarray,
    eta: float,
    first: int,
    last: int,
    out: np.ndarray,
    status: np.ndarray,
    solver: np.ndarray,
) -> None:
    """Settled orbit of every row in [first, last) by time integration, started near the orbit in `out`.

    Where neither averaging nor the curve of exact orbits said which one that is, the tip is engaged from far in time.
    """
    start = np.zeros(4)
    free = free_amplitude(lever)
    for i in range(first, last):
        p, amplitude, done = parameters(rows[i]), amplitudes[i], status[i]
        solver[i] = col.MARCH
        if done == col.GOOD:
            start[0], start[1] = out[i, col.TIP_OFFSET], out[i, col.MEAN]
            start[2], start[3] = amplitude, 0.5 * math.pi - out[i, col.PHASE]
            done = settle(law, rows[i], lever, amplitude, start, eta, 1.0, MOST_PERIODS, out[i])
        elif done == col.NOT_CONVERGED or done == col.TOO_MANY_CONTACTS:
            far = free * far_start(law, p, lever, reach_of(law, p), free, amplitude)
            step = 0.1 * scale_of(law, p, lever, free) + 1e-3 * free
            done = approach(law, rows[i], lever, amplitude, far, step, eta, 1.0, MOST_PERIODS, out[i])
        if done != col.GOOD:
            out[i] = math.nan
        status[i] = done
