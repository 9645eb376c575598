"""Many periods in a step, where the motion changes little from one to the next: a multi-revolution method.

A period of the drive takes (z, z') to itself and a little more, k. So N periods are a sum of N such changes along a
smooth way, as an ordinary differential equation is an integral, and are approximated by the k of a few periods on the
way: theory, Eq. (time-5). The lever has no motion faster than that, for its harmonics follow the force at once.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.arrays import copy
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator
from phasemap._kernels.orbits.time.march import march_period
from phasemap._kernels.orbits.time.tip import MOST_COORDINATES, Z0, Tip, coordinate_count, entry_of
from phasemap._kernels.records import column, record

FEWEST_IN_STEP = 6  # periods in a step: fewer are marched one by one
STEP_SAFETY = 0.9  # of the step that would just meet the tolerance
MOST_GROWTH = 3.0  # of the step, over the last one
LEAST_GROWTH = 0.2  # the same, at least


@record
class Flow:
    """What is carried on from step to step of many periods."""

    count: float  # periods to try next
    change: np.ndarray = column(MOST_COORDINATES)  # of the coordinates in the period to come [m]


@record
class Slopes:
    """Changes of the coordinates in a period in the stages of a step [m], and where a stage or the step ends."""

    second: np.ndarray = column(MOST_COORDINATES)
    third: np.ndarray = column(MOST_COORDINATES)
    last: np.ndarray = column(MOST_COORDINATES)
    end: np.ndarray = column(MOST_COORDINATES)


@kernel
def _fill_change(
    oscillator: Oscillator, eta: float, tip: Tip, start: np.ndarray, z0: float, y: np.ndarray, change: np.ndarray
) -> bool:
    """Fill in the change of the coordinates in a period from a start at the tip offset z0; False if the march fails."""
    copy(tip.u, y)
    count = coordinate_count(oscillator.lever)
    for i in range(count):
        y[entry_of(i)] = start[i]
    y[Z0] = z0
    tip.periods.marched += 1
    if march_period(oscillator, z0, eta, y, tip.acc) < 0:
        return False
    total = 0.0
    for i in range(count):
        change[i] = y[entry_of(i)] - start[i]
        total += change[i]
    return math.isfinite(total)


@kernel
def fill_coordinates(lever: np.ndarray, u: np.ndarray, to: np.ndarray) -> None:
    """Fill in the coordinates of a state."""
    for i in range(coordinate_count(lever)):
        to[i] = u[entry_of(i)]


@kernel
def begin_flow(oscillator: Oscillator, eta: float, pace: float, tip: Tip, flow: Flow) -> bool:
    """March the period to come, in which z0 falls by `pace` [m], which `flow` then knows."""
    u, slopes = tip.u, Slopes()
    flow.count = FEWEST_IN_STEP
    fill_coordinates(oscillator.lever, u, slopes.end)
    return _fill_change(oscillator, eta, tip, slopes.end, u[Z0] - pace, np.empty(len(u)), flow.change)


@kernel
def pass_many(oscillator: Oscillator, eta: float, pace: float, allowed: float, tip: Tip, flow: Flow) -> int:
    """Carry a tip, which falls by `pace` [m] a period, over as many periods as an error `allowed` [m] lets it.

    Returns how many; 0 if the march fails. tip.acc is what the period to come gives.

    The formulae for an integral are those of Bogacki and Shampine (orders 3 and 2), with weights for a sum.
    """
    lever = oscillator.lever
    u, y, omega, n, count = tip.u, np.empty(len(tip.u)), lever[col.OMEGA], int(flow.count), coordinate_count(lever)
    z0, slopes, at, k1 = u[Z0] - pace, Slopes(), np.empty(count), flow.change
    k2, k3, k4, end = slopes.second, slopes.third, slopes.last, slopes.end
    fill_coordinates(lever, u, at)
    while n >= FEWEST_IN_STEP:
        x = 1.0 / n
        b2, b3 = (1.0 - x) * (1.0 + 4.0 * x) / 3.0, 4.0 / 9.0 * (1.0 - x) * (1.0 - 2.0 * x)
        b1, half, more, error = 1.0 - b2 - b3, 0.5 * n, 0.75 * n, 0.0
        for i in range(count):
            end[i] = at[i] + half * k1[i]
        good = _fill_change(oscillator, eta, tip, end, z0 - half * pace, y, k2)
        for i in range(count):
            end[i] = at[i] + more * k2[i]
        good = good and _fill_change(oscillator, eta, tip, end, z0 - more * pace, y, k3)
        for i in range(count):
            end[i] = at[i] + n * (b1 * k1[i] + b2 * k2[i] + b3 * k3[i])
        if not (good and _fill_change(oscillator, eta, tip, end, z0 - n * pace, y, k4)):
            return 0
        for i in range(count):
            off = -5 / 72 * k1[i] + 1 / 12 * k2[i] + 1 / 9 * k3[i] - 1 / 8 * k4[i]
            error += off * off if i % 2 == 0 else (off / omega) ** 2
        error = n * math.sqrt(error) / allowed
        share = min(MOST_GROWTH, max(LEAST_GROWTH, STEP_SAFETY * max(error, 1e-9) ** (-1.0 / 3.0)))
        if error <= 1.0:
            for i in range(count):
                u[entry_of(i)], k1[i] = end[i], k4[i]
            u[Z0] -= n * pace
            flow.count = share * n
            return n
        n = int(share * n)
    for i in range(count):
        u[entry_of(i)] = end[i] = at[i] + k1[i]
    u[Z0] = z0
    flow.count = n + 1.0
    return 1 if _fill_change(oscillator, eta, tip, end, z0 - pace, y, k1) else 0
