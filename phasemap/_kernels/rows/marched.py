"""Loop over pixels for the march."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.holding import settle
from phasemap._kernels.engagement.in_time import approach
from phasemap._kernels.law import Law, parameters
from phasemap._kernels.lever import free_amplitude, reach_of, scale_of
from phasemap._kernels.orbits.averaged.orbits import far_start


@kernel
def march_rows(
    law: Law,
    rows: np.ndarray,
    lever: np.ndarray,
    amplitudes: np.ndarray,
    eta: float,
    most: int,
    out: np.ndarray,
    status: np.ndarray,
) -> None:
    """Motion that holds each amplitude in time, started near the orbit in `out`, for at most so many periods.

    Where the status is not GOOD, no orbit is known to start from, and the tip is engaged from far.
    """
    free = free_amplitude(lever)
    for i in range(len(rows)):
        p, amplitude = parameters(rows[i]), amplitudes[i]
        if status[i] == col.GOOD:
            status[i] = settle(law, p, lever, amplitude, eta, most, out[i])
        else:
            far = free * far_start(law, p, lever, reach_of(law, p), free, amplitude)
            step = 0.1 * scale_of(law, p, lever, free) + 1e-3 * free
            status[i] = approach(law, p, lever, amplitude, far, step, eta, most, out[i])
        if status[i] != col.GOOD:
            out[i] = math.nan
