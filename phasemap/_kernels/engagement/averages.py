"""What a lock-in shows of a motion that need not repeat itself: averages over some periods, with their spread.

The mean phasor of the first harmonic counts, and its spread behind a low-pass of stated bandwidth: theory,
Eqs. (irregular-2) and (irregular-4).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.orbits.time.march import march_period
from phasemap._kernels.orbits.time.tip import COS, DEEPEST, GIVEN, SIN, Z0, Tip, ring_down

if TYPE_CHECKING:
    from phasemap._kernels.law import Law
    from phasemap._kernels.orbits.time.runge_kutta import Numbers

BANDWIDTH = 0.01
"""Of the lock-in whose spread is stated, in drive frequencies: a low-pass of first order, one step a period."""
FEWEST = 16  # periods, or a ring-down time, that are averaged before the controller acts
FEWEST_GROUPS = 6  # whose scatter tells the error of their mean
UNSURE = 0.25  # share of what the mean amplitude misses, by which tip offset and phase at the setpoint may be wrong
STEPS_PHASE, STEPS_LENGTH = math.radians(2e-4), 2e-14  # errors [rad, m] by the steps, found against an independent code
# What is added up over periods: the seven of `march_period` (the largest depth is kept), their number, the amplitude
# and angle behind the lock-in, their squares, and the tip offset. Carried on: the phasor behind the lock-in, the one
# from which angles count, that of the last period; the largest change of it in a period, and the least depth.
COUNT, SIZE, SIZE2, ANGLE, ANGLE2, OFFSET, ADDED = 7, 8, 9, 10, 11, 12, 13
LOW_COS, LOW_SIN, FROM_COS, FROM_SIN, LAST_COS, LAST_SIN, CHANGE, LEAST, SUMS = 13, 14, 15, 16, 17, 18, 19, 20, 21
# A series of averages: tip offset and phasor [m] of each.
AT_OFFSET, AT_COS, AT_SIN = 0, 1, 2


class Errors(NamedTuple):
    """Errors of lag [rad] and tip offset [m] of a mean, and what its lag is too large by [rad]."""

    lag: float
    offset: float
    lag_off: float


@kernel
def begin_sums(lever: np.ndarray, acc: np.ndarray) -> np.ndarray:
    """Return empty sums of a lock-in that shows the phasor of the last period, as the detector sees it."""
    sums = np.zeros(SUMS)
    sums[LOW_COS] = sums[FROM_COS] = sums[LAST_COS] = acc[COS] - lever[col.SHAKER]
    sums[LOW_SIN] = sums[FROM_SIN] = sums[LAST_SIN] = acc[SIN]
    return sums


@kernel
def average(
    law: Law, p: np.ndarray, lever: np.ndarray, eta: float, count: int, move: Numbers, tip: Tip, sums: np.ndarray
) -> bool:
    """March so many periods, and sum up what is seen; z0 falls by way + gain (A - setpoint) [m] in each.

    A is behind the lock-in. It falls by little: a tip moved at once may take to another pattern of taps.
    """
    for j in range(ADDED):
        sums[j] = 0.0
    sums[CHANGE], sums[DEEPEST], sums[LEAST] = 0.0, -math.inf, math.inf
    keep = math.exp(-2.0 * math.pi * BANDWIDTH)
    acc, (way, gain, setpoint) = tip.acc, move
    for _ in range(count):
        tip.u[Z0] -= way + gain * (math.hypot(sums[LOW_COS], sums[LOW_SIN]) - setpoint)
        tip.periods[0] += 1
        if march_period(law, p, lever, tip.u[Z0], eta, tip.u, acc) < 0:
            return False
        for j in range(GIVEN):
            sums[j] = max(sums[j], acc[j]) if j == DEEPEST else sums[j] + acc[j]
        sums[LEAST] = min(sums[LEAST], acc[DEEPEST])
        cosine, sine = acc[COS] - lever[col.SHAKER], acc[SIN]
        x = keep * sums[LOW_COS] + (1.0 - keep) * cosine
        y = keep * sums[LOW_SIN] + (1.0 - keep) * sine
        from_x, from_y = sums[FROM_COS], sums[FROM_SIN]
        size, angle = math.hypot(x, y), math.atan2(y * from_x - x * from_y, x * from_x + y * from_y)
        sums[COUNT] += 1.0
        sums[OFFSET] += tip.u[Z0]
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
    return math.hypot(sums[COS] / sums[COUNT] - lever[col.SHAKER], sums[SIN] / sums[COUNT])


@kernel
def alike(sums: np.ndarray) -> bool:
    """Whether the tip touched in every period, or in none: in some only, its motion does not repeat itself."""
    return (sums[LEAST] >= 0.0) == (sums[DEEPEST] >= 0.0)


@kernel
def block_of(lever: np.ndarray) -> int:
    """Periods that are averaged at a time: a multiple of 12, in which orbits of 2, 3, 4 or 6 periods repeat."""
    return 12 * (max(FEWEST, ring_down(lever)) // 12 + 1)


@kernel
def noted(lever: np.ndarray, sums: np.ndarray, series: np.ndarray, count: int) -> np.ndarray:
    """The series, longer if it must be, with its row `count` filled: tip offset and phasor [m] of this average."""
    if count == len(series):
        longer = np.zeros((2 * count, 3))
        for i in range(count):
            for j in range(3):
                longer[i, j] = series[i, j]
        series = longer
    series[count, AT_OFFSET] = sums[OFFSET] / sums[COUNT]
    series[count, AT_COS] = sums[COS] / sums[COUNT] - lever[col.SHAKER]
    series[count, AT_SIN] = sums[SIN] / sums[COUNT]
    return series


@kernel
def half_width(x: np.ndarray, count: int) -> float:
    """Half of the 95 % confidence interval of the mean of a correlated series, which is overwritten.

    The widest over groups of 1, 2, 4, ... values, of which the longest are independent: Flyvbjerg and Petersen,
    J. Chem. Phys. 91, 461 (1989), with Student's factor (the first terms in one over the degrees of freedom).
    """
    widest = 0.0
    while count >= FEWEST_GROUPS:
        mean = square = 0.0
        for i in range(count):
            mean += x[i] / count
        for i in range(count):
            square += (x[i] - mean) ** 2
        free = count - 1
        factor = 1.96 + 2.37 / free + 2.82 / free**2
        widest = max(widest, factor * math.sqrt(square / free / count))
        count //= 2
        for i in range(count):
            x[i] = 0.5 * (x[2 * i] + x[2 * i + 1])
    return widest


@kernel
def errors_of_mean(series: np.ndarray, first: int, count: int, amplitude: float) -> Errors:
    """Errors of averages from `first` on.

    Where an amplitude is held, lag and amplitude go together, whether a tap more or less or the way to the setpoint is
    the cause. The slope of that is taken from all averages (a control variate): by it and what the mean amplitude
    misses, the lag is wrong; and by that way itself, both may be in part.
    """
    x = y = missed = lag = 0.0
    for i in range(first, count):
        x, y = x + series[i, AT_COS], y + series[i, AT_SIN]
    held, a, z = amplitude > 0.0, np.empty(count), np.empty(count)
    for i in range(count):
        a[i] = math.atan2(series[i, AT_SIN] * x - series[i, AT_COS] * y, series[i, AT_COS] * x + series[i, AT_SIN] * y)
        z[i] = math.hypot(series[i, AT_COS], series[i, AT_SIN]) - amplitude
        missed, lag = missed + z[i] / count, lag + a[i] / count
    both = square = 0.0
    for i in range(count):
        both += (z[i] - missed) * (a[i] - lag)
        square += (z[i] - missed) ** 2
    slope = both / square if held and square > 0.0 else 0.0
    missed = math.hypot(x, y) / (count - first) - amplitude if held else 0.0
    for i in range(first, count):
        a[i - first] = a[i] - slope * z[i]
        z[i - first] = series[i, AT_OFFSET] - z[i]
    wide_lag, wide_z = half_width(a, count - first), half_width(z, count - first)
    lag_error = math.hypot(wide_lag, STEPS_PHASE) + UNSURE * abs(slope * missed)
    return Errors(lag_error, math.hypot(wide_z, STEPS_LENGTH) + UNSURE * abs(missed), slope * missed)
