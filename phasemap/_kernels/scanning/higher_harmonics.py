"""How far the lever's higher harmonics carry the tip while the surface pushes, for the slow flow.

First-order averaging has the phase at a given amplitude within hundredths of a degree, but the tip offset off by some
percent of the indentation: a short push excites harmonics n >= 2 as well, whose deflections P/(n^2 - 1) add up to 3/4 P
at the time of contact and to less if that is longer. So an orbit with first harmonic P lies higher than its average by
kappa P, and kappa, which hardly depends on P, is taken from the exact orbits at the setpoint: theory,
Eqs. (averaging-11) and (slow-flow-2).
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.arrays import copy
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law, parameters
from phasemap._kernels.lever import reach_of
from phasemap._kernels.orbits.averaged.orbits import averaged_orbits, slope_of
from phasemap._kernels.orbits.response.orbit import new_room, refine
from phasemap._kernels.orbits.response.passes import HEIGHT

ATTRACTED, REPELLED = 0, 1


@kernel
def lifts(
    law: Law, rows: np.ndarray, lever: np.ndarray, amplitudes: np.ndarray, limits: np.ndarray, first: int, last: int,
    out: np.ndarray,
) -> None:  # fmt: skip
    """Fill out, shape (n, 2), with kappa where P < 0 and where P > 0; NaN where the cheap path has no such orbit.

    limits = (phase [rad], height [m]) are errors of the exact orbits that may be left.
    """
    room, guess = new_room(), np.zeros(col.GUESS)
    for i in range(first, last):
        p, amplitude = parameters(rows[i]), amplitudes[i]
        out[i] = math.nan
        orbits = averaged_orbits(law, p, lever, amplitude)
        for j in range(len(orbits)):
            copy(orbits[j], guess)
            guess[col.G_SLOPE] = slope_of(law, p, lever, guess)
            if refine(law, p, lever, reach_of(law, p), guess, limits, room):
                side = REPELLED if guess[col.G_P] > 0.0 else ATTRACTED
                out[i, side] = (room.state[HEIGHT] - guess[col.G_Z0]) / guess[col.G_P]
