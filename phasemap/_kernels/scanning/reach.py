"""Highest tip offset to which a tip on a repulsive orbit can be raised before it leaves that branch."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.averages import LockIn, average, begin_lock_in, block_of
from phasemap._kernels.engagement.holding_mean import COARSER_STEPS
from phasemap._kernels.engagement.in_time import slow_pace
from phasemap._kernels.law import Law, Oscillator, parameters
from phasemap._kernels.orbits.time.tip import Z0, PeriodMap, PeriodResult, Periods, Tip, new_state


@kernel
def reach_rows(
    law: Law,
    rows: np.ndarray,
    lever: np.ndarray,
    step_size: float,
    most_periods: int,
    orbits: np.ndarray,
    reach: np.ndarray,
) -> None:
    """Replace each tip offset in `reach` by the one at which the mean phase changes sign on the way there.

    Parameters
    ----------
    orbits : ndarray, shape (n, COLUMNS)
        From which the tip is raised.
    reach : ndarray, shape (n,)
        Up to which tip offset [m]; infinite where the branch is not left.
    """
    block, up = block_of(lever), (-slow_pace(lever), 0.0, 0.0)
    for i in range(len(rows)):
        orbit, lag = orbits[i], 0.5 * math.pi - orbits[i, col.PHASE]
        z = orbit[col.MEAN] + orbit[col.AMPLITUDE] * math.cos(lag)
        v = lever[col.OMEGA] * orbit[col.AMPLITUDE] * math.sin(lag)
        u = new_state(law, lever, orbit[col.MEAN], z, v, orbit[col.TIP_OFFSET])
        tip, lock_in, top = Tip(u, PeriodResult(), PeriodMap(), Periods()), LockIn(), reach[i]
        begin_lock_in(lever, tip.acc, lock_in)
        reach[i] = math.inf
        while tip.periods.marched < most_periods and tip.u[Z0] < top:
            if (
                not average(
                    Oscillator(law, parameters(rows[i]), lever), COARSER_STEPS * step_size, block, up, tip, lock_in
                )
                or lock_in.total.period.cos < 0.0
            ):
                reach[i] = tip.u[Z0]
                break
