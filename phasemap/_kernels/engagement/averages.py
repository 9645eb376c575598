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
from phasemap._kernels.law import Oscillator
from phasemap._kernels.orbits.time.march import march_period
from phasemap._kernels.orbits.time.tip import COS, DEEPEST, GIVEN, MARCHED, SIN, Z0, Tip, ring_down

if TYPE_CHECKING:
    from phasemap._kernels.orbits.time.runge_kutta import Numbers

BANDWIDTH = 0.01
"""Of the lock-in whose spread is stated, in drive frequencies: a low-pass of first order, one step a period."""
FEWEST = 16  # periods, or a ring-down time, that are averaged before the controller acts
FEWEST_GROUPS = 6  # whose scatter tells the error of their mean
UNSURE = 0.25  # share of what the mean amplitude misses, by which the tip offset may be wrong beside its own slope
LEAST_COS = 1e-3  # of the lag's cosine, for a slope that ends at the resonance of the free lever
STEPS_PHASE, STEPS_LENGTH = math.radians(2e-4), 2e-14  # errors [rad, m] by the steps, found against an independent code
# What is added up over periods: the seven of `march_period` (the largest depth is kept), their number, the amplitude
# and angle behind the lock-in, their squares, and the tip offset. Carried on: the phasor behind the lock-in, the one
# from which angles count, that of the last period; the largest change of it in a period, and the least depth.
COUNT, SIZE, SIZE2, ANGLE, ANGLE2, OFFSET, ADDED = 7, 8, 9, 10, 11, 12, 13
LOW_COS, LOW_SIN, FROM_COS, FROM_SIN, LAST_COS, LAST_SIN, CHANGE, LEAST, SUMS = 13, 14, 15, 16, 17, 18, 19, 20, 21
# A series of averages: tip offset and phasor [m] of each.
AT_OFFSET, AT_COS, AT_SIN = 0, 1, 2


class Errors(NamedTuple):
    """Errors of a mean, and what its lag is too large by.

    Attributes
    ----------
    lag, offset : float
        What is stated of lag [rad] and tip offset [m].
    lag_off : float
        What the lag is too large by [rad].
    lag_scatter, offset_scatter : float
        By how much averages scatter about them, with a share of what the amplitude misses: until when to average.
    """

    lag: float
    offset: float
    lag_off: float
    lag_scatter: float
    offset_scatter: float


@kernel
def begin_sums(lever: np.ndarray, acc: np.ndarray) -> np.ndarray:
    """Return empty sums of a lock-in that shows the phasor of the last period, as the detector sees it."""
    sums = np.zeros(SUMS)
    sums[LOW_COS] = sums[FROM_COS] = sums[LAST_COS] = acc[COS] - lever[col.SHAKER]
    sums[LOW_SIN] = sums[FROM_SIN] = sums[LAST_SIN] = acc[SIN]
    return sums


@kernel
def average(oscillator: Oscillator, eta: float, count: int, move: Numbers, tip: Tip, sums: np.ndarray) -> bool:
    """March so many periods, and sum up what is seen; z0 falls by way + gain (A - setpoint) [m] in each.

    A is behind the lock-in. It falls by little: a tip moved at once may take to another pattern of taps.
    """
    lever = oscillator.lever
    for j in range(ADDED):
        sums[j] = 0.0
    sums[CHANGE], sums[DEEPEST], sums[LEAST] = 0.0, -math.inf, math.inf
    keep = math.exp(-2.0 * math.pi * BANDWIDTH)
    acc, (way, gain, setpoint) = tip.acc, move
    for _ in range(count):
        tip.u[Z0] -= way + gain * (math.hypot(sums[LOW_COS], sums[LOW_SIN]) - setpoint)
        tip.periods[MARCHED] += 1
        if march_period(oscillator, tip.u[Z0], eta, tip.u, acc) < 0:
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
def slope_on(x: np.ndarray, y: np.ndarray) -> float:
    """Slope of a straight line through all points; 0 where x is the same at all."""
    x_mean = y_mean = both = square = 0.0
    for i in range(len(x)):
        x_mean, y_mean = x_mean + x[i] / len(x), y_mean + y[i] / len(x)
    for i in range(len(x)):
        both += (x[i] - x_mean) * (y[i] - y_mean)
        square += (x[i] - x_mean) ** 2
    return both / square if square > 0.0 else 0.0


@kernel
def branch_slope(lever: np.ndarray, x: float, y: float) -> float:
    """Change of the lag with the amplitude [rad/m] where dissipation stays: theory, Eq. (irregular-7)."""
    cosine = x / math.hypot(x, y)
    steep = math.copysign(max(abs(cosine), LEAST_COS), cosine)
    return 2.0 * lever[col.ALPHA0] * lever[col.OMEGA] / (lever[col.BASE] * steep)


@kernel
def errors_of_mean(lever: np.ndarray, series: np.ndarray, first: int, count: int, amplitude: float) -> Errors:
    """Errors of averages from `first` on: theory, Eq. (irregular-6).

    Where an amplitude is held, lag and tip offset go with it, whether a tap more or less or the way to the setpoint is
    the cause. The slopes of that are taken from all averages (a control variate). By what the mean amplitude misses
    the lag is then wrong, on the way by another slope than in the scatter, and which of the two it was is not known.
    """
    x = y = 0.0
    for i in range(first, count):
        x, y = x + series[i, AT_COS], y + series[i, AT_SIN]
    held, a, z, w = amplitude > 0.0, np.empty(count), np.empty(count), np.empty(count)
    for i in range(count):
        a[i] = math.atan2(series[i, AT_SIN] * x - series[i, AT_COS] * y, series[i, AT_COS] * x + series[i, AT_SIN] * y)
        z[i] = math.hypot(series[i, AT_COS], series[i, AT_SIN]) - amplitude
        w[i] = series[i, AT_OFFSET] - z[i]
    slope = w_slope = missed = branch = 0.0
    if held:
        slope, w_slope, branch = slope_on(z, a), slope_on(z, w), branch_slope(lever, x, y)
        missed = math.hypot(x, y) / (count - first) - amplitude
    for i in range(first, count):
        a[i - first] = a[i] - slope * z[i]
        z[i - first] = w[i] - w_slope * z[i]
        w[i - first] = w[i]
    n, share = count - first, UNSURE * abs(missed)
    lag, offset = math.hypot(half_width(a, n), STEPS_PHASE), math.hypot(half_width(z, n), STEPS_LENGTH)
    offset += abs(w_slope * missed) + share
    unknown = max(abs(slope * missed), abs(branch - slope) * max(abs(missed), offset)) if held else 0.0
    offset_scatter = math.hypot(half_width(w, n), STEPS_LENGTH) + share
    return Errors(lag + unknown, offset, slope * missed, lag + share * abs(slope), offset_scatter)
