"""Highest tip offset to which a tip on a repulsive orbit can be raised before it leaves that branch."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.averages import average, begin_sums, block_of
from phasemap._kernels.engagement.holding import COARSE
from phasemap._kernels.engagement.in_time import pace_of
from phasemap._kernels.law import Law, Oscillator, parameters
from phasemap._kernels.orbits.time.tip import COS, MARCHED, Z0, new_tip


@kernel
def reach_rows(
    law: Law, rows: np.ndarray, lever: np.ndarray, eta: float, most: int, orbits: np.ndarray, reach: np.ndarray
) -> None:
    """Replace each tip offset in `reach` by the one at which the mean phase changes sign on the way there.

    Parameters
    ----------
    orbits : ndarray, shape (n, COLUMNS)
        From which the tip is raised.
    reach : ndarray, shape (n,)
        Up to which tip offset [m]; infinite where the branch is not left.
    """
    block, up = block_of(lever), (-pace_of(lever), 0.0, 0.0)
    for i in range(len(rows)):
        orbit, lag = orbits[i], 0.5 * math.pi - orbits[i, col.PHASE]
        z = orbit[col.MEAN] + orbit[col.AMPLITUDE] * math.cos(lag)
        v = lever[col.OMEGA] * orbit[col.AMPLITUDE] * math.sin(lag)
        tip = new_tip(law, lever, orbit[col.MEAN], z, v, orbit[col.TIP_OFFSET])
        sums, top = begin_sums(lever, tip.acc), reach[i]
        reach[i] = math.inf
        while tip.periods[MARCHED] < most and tip.u[Z0] < top:
            if (
                not average(Oscillator(law, parameters(rows[i]), lever), COARSE * eta, block, up, tip, sums)
                or sums[COS] < 0.0
            ):
                reach[i] = tip.u[Z0]
                break
