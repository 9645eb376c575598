"""How much higher the exact orbit lies than the averaged one.

First-order averaging has the phase at a given amplitude within hundredths of a degree, but the tip offset off by some
percent of the indentation, for the tip is slowed while it is in contact. A slow flow over a ground raised by that comes
to rest where the exact orbit is.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from phasemap._kernels.approach import averaged_orbits, slope_of
from phasemap._kernels.corrected import HEIGHT
from phasemap._kernels.law import OPTIONS, Law
from phasemap._kernels.mesh import reach_of
from phasemap._kernels.quick import cheap_orbit, engage, new_room, parameters, refine


@njit(**OPTIONS)
def lifts(
    law: Law, rows: np.ndarray, lever: np.ndarray, amplitudes: np.ndarray, limits: np.ndarray, first: int, last: int,
    out: np.ndarray,
) -> None:  # fmt: skip
    """Exact less averaged tip offset [m] of the rows [first, last); NaN where the cheap path finds none.

    limits = (phase [rad], height [m]) are errors that may be left. Of several orbits the one on which the tip engages
    counts where that is sure, and the nearest to the surface elsewhere.
    """
    room, guess = new_room(), np.zeros(6)
    for i in range(first, last):
        p, amplitude = parameters(rows[i]), amplitudes[i]
        out[i] = math.nan
        surety = engage(law, p, lever, amplitude, guess, room.top)
        if cheap_orbit(law, p, lever, amplitude, surety, limits, guess, room):
            out[i] = room.state[HEIGHT] - guess[0]
            continue
        for orbit in averaged_orbits(law, p, lever, amplitude):
            guess[:5] = orbit
            guess[5] = slope_of(law, p, lever, guess)
            if refine(law, p, lever, reach_of(law, p), guess, limits, room.nodes, room.state):
                out[i] = room.state[HEIGHT] - guess[0]
