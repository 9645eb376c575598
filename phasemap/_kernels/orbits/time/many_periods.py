"""Many periods of the drive: several in a step, dents that come to rest, a tip that has lost its orbit.

* Where the motion changes little from one period to the next: a period takes (z, z') to itself and a little more, k. So
  N periods are a sum of N such changes along a smooth way, as an ordinary differential equation is an integral, and are
  approximated by the k of a few periods on the way (a multi-revolution method, theory, Eq. (time-5)). A lever of one
  mode has no motion faster than that, for its harmonics follow the force at once.
* Dents that last form under a tip that taps at its amplitude. They may become deeper than the taps that form them, and
  take ten times as long as they last until they change no more.
* A tip that has lost its orbit lands on another one: the full equation in time says on which.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator
from phasemap._kernels.numerics import copy
from phasemap._kernels.orbits.time.arms import dent_survival
from phasemap._kernels.orbits.time.march import march_oscillator
from phasemap._kernels.orbits.time.period_map import (
    Tolerance,
    come_to_rest,
    fill_row_at_rest,
    linearise_period,
    pass_along,
)
from phasemap._kernels.orbits.time.tip import (
    TOUCHES,
    Z0,
    MovingTip,
    PeriodMap,
    PeriodResult,
    Periods,
    V,
    Way,
    Z,
    fill_higher_modes,
    fill_way_to_rest,
    length_of,
    motion_size,
)
from phasemap._kernels.records import record

FEWEST_IN_STEP = 6  # periods in a step: fewer are marched one by one
STEP_SAFETY = 0.9  # of the step that would just meet the tolerance
MOST_GROWTH = 3.0  # of the step, over the last one
LEAST_GROWTH = 0.2  # the same, at least
FORMING_TIME = 18.0  # times as long as they last, in which dents of an amplitude come to rest, to 1e-8 of it
FORMING_WAY = 0.05  # of the amplitude, a way for which derivatives serve
FORMING_STEP = 0.1  # of the amplitude: a longer step leads elsewhere
LANDING_ETA = 0.5  # steps of the march: a hundredth of a degree is enough to tell orbits apart


@record
class PeriodFlow:
    """State handed from step to step of many periods."""

    z: float  # change of z in the period to come [m]
    v: float  # and of z' [m]
    count: float  # periods to try next


@kernel
def _change(oscillator: Oscillator, step_size: float, tip: MovingTip, at: complex, z0: float, y: np.ndarray) -> complex:
    """Change of z + i z' in a period that starts in state y at the tip offset z0; NaN if the march fails."""
    copy(tip.u, y)
    y[Z], y[V], y[Z0] = at.real, at.imag, z0
    tip.periods.marched += 1
    if march_oscillator(oscillator, z0, step_size, y, tip.acc) < 0:
        return complex(math.nan, math.nan)
    return complex(y[Z], y[V]) - at


@kernel
def begin_flow(oscillator: Oscillator, step_size: float, pace: float, tip: MovingTip, flow: PeriodFlow) -> bool:
    """March the next period, in which z0 falls by `pace` [m], and fill `flow` with what it changes."""
    u = tip.u
    k = _change(oscillator, step_size, tip, complex(u[Z], u[V]), u[Z0] - pace, np.empty(len(u)))
    flow.z, flow.v, flow.count = k.real, k.imag, FEWEST_IN_STEP
    return math.isfinite(flow.z + flow.v)


@kernel
def pass_many(
    oscillator: Oscillator, step_size: float, pace: float, allowed: float, tip: MovingTip, flow: PeriodFlow
) -> int:
    """Carry a tip, which falls by `pace` [m] a period, over as many periods as an error `allowed` [m] lets it.

    Returns how many; 0 if the march fails. tip.acc has the observables of the period to come.

    The formulae for an integral are those of Bogacki and Shampine (orders 3 and 2), with weights for a sum.
    """
    u, y, omega, n = tip.u, np.empty(len(tip.u)), oscillator.lever[col.OMEGA], int(flow.count)
    state, z0, k1 = complex(u[Z], u[V]), u[Z0] - pace, complex(flow.z, flow.v)
    share = 0.0
    while n >= FEWEST_IN_STEP:
        x = 1.0 / n
        b2, b3 = (1.0 - x) * (1.0 + 4.0 * x) / 3.0, 4.0 / 9.0 * (1.0 - x) * (1.0 - 2.0 * x)
        half, more = 0.5 * n, 0.75 * n
        k2 = _change(oscillator, step_size, tip, state + half * k1, z0 - half * pace, y)
        k3 = _change(oscillator, step_size, tip, state + more * k2, z0 - more * pace, y)
        end = state + n * ((1.0 - b2 - b3) * k1 + b2 * k2 + b3 * k3)
        k4 = _change(oscillator, step_size, tip, end, z0 - n * pace, y)
        difference = -5 / 72 * k1 + 1 / 12 * k2 + 1 / 9 * k3 - 1 / 8 * k4
        error = n * math.hypot(difference.real, difference.imag / omega) / allowed
        if not math.isfinite(error):
            return 0
        share = min(MOST_GROWTH, max(LEAST_GROWTH, STEP_SAFETY * max(error, 1e-9) ** (-1.0 / 3.0)))
        if error <= 1.0:
            break
        n = int(share * n)
    else:
        share, n, end = n + 1.0, 1, state + k1
        k4 = _change(oscillator, step_size, tip, end, z0 - pace, y)
    u[Z], u[V], u[Z0] = end.real, end.imag, u[Z0] - n * pace
    flow.z, flow.v, flow.count = k4.real, k4.imag, share * n
    return n if math.isfinite(flow.z + flow.v) else 0


@kernel
def form_dents(oscillator: Oscillator, tolerance: Tolerance, target: float, most_periods: int, tip: MovingTip) -> bool:
    """Let time pass at the amplitude `target` until dents are at rest; False if it may take more than so many periods.

    The tip goes on ahead as the map of one period says, whose derivatives are taken anew now and then.
    """
    ahead, y, share = Way(), np.empty(len(tip.u)), dent_survival(oscillator)
    if share == 0 or FORMING_TIME > -math.log(share) * most_periods:
        return False
    tip.periods.formed, gone = 1, math.inf
    while tip.periods.marched < most_periods:
        if gone > FORMING_WAY * target:
            if not linearise_period(oscillator, tolerance.step_size, tip):
                return False
            fill_way_to_rest(tip.linear, tip.linear.now, target, ahead)
            gone = 0.0
        step = length_of(ahead) + abs(ahead.z0)
        part = min(FORMING_STEP * target / step, 1.0)
        gone += part * step
        remaining = pass_along(oscillator, tolerance, target, part, tip, ahead, y)
        if not remaining < math.inf or remaining <= 1 - share * share:
            return remaining < math.inf
    return False


@kernel(light=True)
def state_in_row(lever: np.ndarray, row: np.ndarray) -> np.ndarray:
    """State at drive phase 0 of a full row's orbit, whose higher modes are those of its first harmonic."""
    u = np.zeros(motion_size(lever))
    u[Z], u[V], u[TOUCHES], u[Z0] = row[col.START_Z], row[col.START_V], row[col.START_HELD], row[col.TIP_OFFSET]
    fill_higher_modes(lever, row[col.MEAN], u)
    return u


@kernel
def land_free(oscillator: Oscillator, u: np.ndarray, close: float, most_periods: int, row: np.ndarray) -> bool:
    """Fill a result row with the orbit on which a tip that is let go in state u comes to rest, to `close` [m].

    False if it comes to none within so many periods.
    """
    tip = MovingTip(u, PeriodResult(), PeriodMap(), Periods())
    if not come_to_rest(oscillator, Tolerance(LANDING_ETA, close, close), most_periods, tip):
        return False
    fill_row_at_rest(oscillator.lever, tip, row)
    return True
