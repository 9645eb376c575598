"""Motions that repeat themselves after some periods of the drive: found by Newton's method on the map of so many.

Far from the resonance a lever rings at its own frequency while it taps at that of the drive, until both lock: the tip
comes by the same state after n periods, and the map of n periods has an orbit there. See theory, Eq. (time-7).
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator
from phasemap._kernels.lever import free_amplitude
from phasemap._kernels.orbits.time.march import march_period
from phasemap._kernels.orbits.time.period_map import Tolerance, march_tip, skip
from phasemap._kernels.orbits.time.tip import Z0, Tip, V, Z

LONGEST_PATTERN = 32  # periods after which a motion may repeat itself
PERIODS_COMPARED = 3 * LONGEST_PATTERN  # periods that are compared with one another
NEAR_REPEAT = 0.1  # of the tip's way, by which states n periods apart may differ where Newton's method is tried, and
CLOSEST_REPEAT = 4.0  # over the least of these differences: a multiple of n, and what comes nearest by chance
MOST_TRIED = 2  # such n, the least first, and 1 in any case
SAME_STATE = 1e-3  # of the free amplitude, below which a fraction of n may do


@kernel
def distance_after(oscillator: Oscillator, step_size: float, count: int, tip: Tip) -> float:
    """Distance [m] between the motion now and after `count` periods at the same tip offset."""
    lever = oscillator.lever
    y = tip.u.copy()
    tip.periods.marched += count
    for _ in range(count):
        if march_period(oscillator, tip.u[Z0], step_size, y, tip.acc) < 0:
            return math.inf
    return math.hypot(y[Z] - tip.u[Z], (y[V] - tip.u[V]) / lever[col.OMEGA])


@kernel
def shorten(oscillator: Oscillator, tolerance: Tolerance, target: float, tip: Tip) -> bool:
    """Put a tip that is at rest on a pattern to rest on the shortest one that it repeats; as `skip`."""
    lever = oscillator.lever
    count = tip.periods.pattern
    for n in range(1, count):
        if count % n == 0 and distance_after(oscillator, tolerance.step_size, n, tip) < SAME_STATE * free_amplitude(
            lever
        ):
            tip.periods.pattern = n
            if skip(oscillator, tolerance, target, tip):
                return True
    tip.periods.pattern = count
    return skip(oscillator, tolerance, target, tip)


@kernel
def find_pattern(oscillator: Oscillator, tolerance: Tolerance, target: float, tip: Tip) -> bool:
    """Let some periods pass, and skip the transient to the pattern to which the motion decays, if it does; as `skip`.

    Of the n for which all states n periods apart are nearest to each other the least counts.
    """
    lever = oscillator.lever
    u, way, size = tip.u, np.empty((PERIODS_COMPARED, 2)), free_amplitude(lever)
    for i in range(PERIODS_COMPARED):
        way[i, Z], way[i, V] = u[Z], u[V] / lever[col.OMEGA]
        if not march_tip(oscillator, tolerance.step_size, tip):
            return False
        size = max(size, math.hypot(way[i, Z] - tip.acc.mean_z, way[i, V]))
    most, least, tried = np.zeros(LONGEST_PATTERN + 1), math.inf, 0
    for n in range(1, LONGEST_PATTERN + 1):
        for i in range(n, PERIODS_COMPARED):
            most[n] = max(most[n], math.hypot(way[i, Z] - way[i - n, Z], way[i, V] - way[i - n, V]))
        least = min(least, most[n])
    for n in range(1, LONGEST_PATTERN + 1):
        near = most[n] < NEAR_REPEAT * size and (n == 1 or most[n] < CLOSEST_REPEAT * least)
        if near and tried < MOST_TRIED:
            tried += 1 if n > 1 else 0
            tip.periods.pattern = n
            if skip(oscillator, tolerance, target, tip):
                return shorten(oscillator, tolerance, target, tip)
    tip.periods.pattern = 1
    return False
