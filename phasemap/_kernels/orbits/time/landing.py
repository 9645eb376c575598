"""Where a tip goes that has lost its orbit: the full equation in time, until it follows one of the stable orbits."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator
from phasemap._kernels.orbits.time.march import march_period
from phasemap._kernels.orbits.time.period_map import Tolerance, come_to_rest, fill_row_at_rest
from phasemap._kernels.orbits.time.tip import (
    TOUCHES,
    Z0,
    PeriodMap,
    PeriodResult,
    Periods,
    Tip,
    V,
    Z,
    fill_higher_modes,
    motion_size,
)

LANDING_ETA = 0.5  # steps of the march: a hundredth of a degree is enough to tell orbits apart
LANDED_PERIODS = 3  # periods so close


@kernel(light=True)
def state_in_row(lever: np.ndarray, row: np.ndarray) -> np.ndarray:
    """State at drive phase 0 of a full row's orbit, whose higher modes are those of its first harmonic."""
    u = np.zeros(motion_size(lever))
    u[Z], u[V], u[TOUCHES], u[Z0] = row[col.START_Z], row[col.START_V], row[col.START_HELD], row[col.TIP_OFFSET]
    fill_higher_modes(lever, row[col.MEAN], u)
    return u


@kernel
def land_on(
    oscillator: Oscillator, z0: float, y: np.ndarray, targets: np.ndarray, close: float, most_periods: int
) -> int:
    """Index of the orbit that a tip settles on, -1 if none within `most_periods` periods.

    `targets` (shape (n, 2)): in-phase and quadrature amplitude [m] of the stable orbits at this tip offset; one counts
    as reached as `close` [m] in this plane. `y`: state at drive phase 0, advanced in place.
    """
    acc = PeriodResult()
    streak, last = 0, -1
    for _ in range(most_periods):
        if march_period(oscillator, z0, LANDING_ETA, y, acc) < 0:
            return -1
        near, best = -1, math.inf
        for i in range(len(targets)):
            apart = math.hypot(acc.cos - targets[i, 0], acc.sin - targets[i, 1])
            if apart < best:
                near, best = i, apart
        streak = streak + 1 if best < close and near == last else 0
        last = near
        if streak >= LANDED_PERIODS:
            return near
    return -1


@kernel
def land_free(oscillator: Oscillator, u: np.ndarray, close: float, most_periods: int, row: np.ndarray) -> bool:
    """Fill a result row with the orbit on which a tip comes to rest, to `close` [m], that is let go in state u.

    False if it comes to none within so many periods.
    """
    tip = Tip(u, PeriodResult(), PeriodMap(), Periods())
    if not come_to_rest(oscillator, Tolerance(LANDING_ETA, close, close), most_periods, tip):
        return False
    fill_row_at_rest(oscillator.lever, tip, row)
    return True
