"""What a lock-in shows of a motion that need not repeat itself: averages over some periods, with their spread.

The mean phasor of the first harmonic counts, and its spread behind a low-pass of stated bandwidth: theory,
Eqs. (irregular-2) and (irregular-4).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.orbits.time.march import march_period
from phasemap._kernels.orbits.time.period_map import Tip, ring_down

if TYPE_CHECKING:
    from phasemap._kernels.law import Law
    from phasemap._kernels.orbits.time.runge_kutta import Numbers

BANDWIDTH = 0.01
"""Of the lock-in whose spread is stated, in drive frequencies: a low-pass of first order, one step a period."""
FEWEST = 16  # periods, or a ring-down time, that are averaged before the controller acts
# What is added up over periods: the seven of `march_period` (the largest depth is kept), their number, the amplitude
# and angle behind the lock-in, their squares, and the tip offset. Carried on: the phasor behind the lock-in, the one
# from which angles count, that of the last period; the largest change of it in a period, and the least depth.
DEEPEST, COUNT, SIZE, SIZE2, ANGLE, ANGLE2, OFFSET, ADDED = 5, 7, 8, 9, 10, 11, 12, 13
LOW_COS, LOW_SIN, FROM_COS, FROM_SIN, LAST_COS, LAST_SIN, CHANGE, LEAST, SUMS = 13, 14, 15, 16, 17, 18, 19, 20, 21


@kernel
def begin_sums(lever: np.ndarray, acc: np.ndarray) -> np.ndarray:
    """Return empty sums of a lock-in that shows the phasor of the last period, as the detector sees it."""
    sums = np.zeros(SUMS)
    sums[LOW_COS] = sums[FROM_COS] = sums[LAST_COS] = acc[0] - lever[col.SHAKER]
    sums[LOW_SIN] = sums[FROM_SIN] = sums[LAST_SIN] = acc[1]
    return sums


@kernel
def average(
    law: Law, p: np.ndarray, lever: np.ndarray, eta: float, count: int, move: Numbers, tip: Tip, sums: np.ndarray
) -> bool:
    """March so many periods, and sum up what is seen; z0 falls by move[0] + move[1] (A - move[2]) [m] in each.

    A is behind the lock-in. It falls by little: a tip moved at once may take to another pattern of taps.
    """
    for j in range(ADDED):
        sums[j] = 0.0
    sums[CHANGE], sums[DEEPEST], sums[LEAST] = 0.0, -math.inf, math.inf
    keep = math.exp(-2.0 * math.pi * BANDWIDTH)
    acc = tip.acc
    for _ in range(count):
        tip.u[3] -= move[0] + move[1] * (math.hypot(sums[LOW_COS], sums[LOW_SIN]) - move[2])
        tip.periods[0] += 1
        if march_period(law, p, lever, tip.u[3], eta, tip.u, acc) < 0:
            return False
        for j in range(7):
            sums[j] = max(sums[j], acc[j]) if j == DEEPEST else sums[j] + acc[j]
        sums[LEAST] = min(sums[LEAST], acc[DEEPEST])
        cosine, sine = acc[0] - lever[col.SHAKER], acc[1]
        x = keep * sums[LOW_COS] + (1.0 - keep) * cosine
        y = keep * sums[LOW_SIN] + (1.0 - keep) * sine
        from_x, from_y = sums[FROM_COS], sums[FROM_SIN]
        size, angle = math.hypot(x, y), math.atan2(y * from_x - x * from_y, x * from_x + y * from_y)
        sums[COUNT] += 1.0
        sums[OFFSET] += tip.u[3]
        sums[SIZE] += size
        sums[SIZE2] += size * size
        sums[ANGLE] += angle
        sums[ANGLE2] += angle * angle
        sums[CHANGE] = max(sums[CHANGE], math.hypot(cosine - sums[LAST_COS], sine - sums[LAST_SIN]))
        sums[LOW_COS], sums[LOW_SIN], sums[LAST_COS], sums[LAST_SIN] = x, y, cosine, sine
    return True


@kernel
def seen(lever: np.ndarray, sums: np.ndarray) -> float:
    """Amplitude [m] of the mean phasor that the detector sees."""
    return math.hypot(sums[0] / sums[COUNT] - lever[col.SHAKER], sums[1] / sums[COUNT])


@kernel
def alike(sums: np.ndarray) -> bool:
    """Whether the tip touched in every period, or in none: in some only, its motion does not repeat itself."""
    return (sums[LEAST] >= 0.0) == (sums[DEEPEST] >= 0.0)


@kernel
def block_of(lever: np.ndarray) -> int:
    """Periods that are averaged at a time: a multiple of 12, in which orbits of 2, 3, 4 or 6 periods repeat."""
    return 12 * (max(FEWEST, ring_down(lever)) // 12 + 1)
