"""Averages over some periods, as a lock-in shows them, of a motion that need not repeat itself, with their spread.

The mean phasor of the first harmonic counts, and its spread behind a low-pass of stated bandwidth: theory,
Eqs. (irregular-2) and (irregular-4).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.second_drive import (
    averaging_weight,
    felt_by_second_mode,
    hold_second_mode,
    pass_period,
)
from phasemap._kernels.excitation import detected_phasor
from phasemap._kernels.law import Oscillator
from phasemap._kernels.numerics import copy
from phasemap._kernels.orbits.time.march import march_oscillator
from phasemap._kernels.orbits.time.tip import Z0, MovingTip, PeriodResult, add_period, ring_down_periods
from phasemap._kernels.records import clear, numbers_of, record

if TYPE_CHECKING:
    from phasemap._kernels.orbits.time.runge_kutta import Numbers

BANDWIDTH = 0.01
"""Bandwidth, in drive frequencies, of the lock-in whose spread is stated: a first-order low-pass, a step a period."""
FEWEST_AVERAGED = 16  # periods, or a ring-down time, that are averaged before the controller acts
FEWEST_GROUPS = 6  # whose scatter tells the error of their mean
UNSURE = 0.25  # share of what the mean amplitude misses, by which the tip offset may be wrong beside its own slope
LEAST_COS = 1e-3  # of the lag's cosine, for a slope that ends at the resonance of the free lever
STEPS_PHASE = math.radians(2e-4)  # error by the steps, found against an independent code [rad]
STEPS_LENGTH = 2e-14  # the same [m]


@record
class Total:
    """Sums over periods."""

    period: PeriodResult  # but the largest depth
    count: float  # of periods
    amplitude: float  # amplitude behind the lock-in [m]
    amplitude2: float  # its square
    angle: float  # [rad], from a phasor of `LockIn`
    angle2: float  # its square
    offset: float  # tip offset [m]
    averages: float  # of what a second mode feels
    felt_re: float  # what the surface adds to its dynamic stiffness [1]
    felt_im: float


@record
class LockIn:
    """A lock-in over some periods: its sums, and the state at their end, from which the next average goes on."""

    total: Total
    low_cos: float  # phasor behind the low-pass [m]
    low_sin: float
    from_cos: float  # that from which angles count [m]
    from_sin: float
    last_cos: float  # that of the last period [m]
    last_sin: float
    change: float  # largest change of it from period to period [m]
    least_depth: float  # of all periods [m]


class Series(NamedTuple):
    """A series of averages: tip offset and phasor [m] of each."""

    offset: np.ndarray
    cos: np.ndarray
    sin: np.ndarray


class MeanErrors(NamedTuple):
    """Errors of a mean, and the bias of its lag."""

    lag: float  # that is stated [rad]
    offset: float  # that is stated of the tip offset [m]
    lag_off: float  # what the lag is too large by [rad]
    # By how much averages scatter about them, with a share of what the amplitude misses: until when to average.
    lag_scatter: float
    offset_scatter: float


@kernel(light=True)
def angle_between(from_x: float, from_y: float, x: float, y: float) -> float:
    """Angle [rad] from one phasor to another."""
    return math.atan2(y * from_x - x * from_y, x * from_x + y * from_y)


@kernel
def begin_lock_in(lever: np.ndarray, acc: PeriodResult, lock_in: LockIn) -> None:
    """Let a lock-in show the phasor of the last period, as the detector sees it."""
    clear(lock_in)
    cosine, sine = detected_phasor(lever, acc.cos, acc.sin)
    lock_in.low_cos = lock_in.from_cos = lock_in.last_cos = cosine
    lock_in.low_sin = lock_in.from_sin = lock_in.last_sin = sine


@kernel
def add_total(total: Total, more: Total) -> None:
    """Add sums over other periods."""
    deepest, sums, numbers = max(total.period.deepest, more.period.deepest), numbers_of(total), numbers_of(more)
    for j in range(len(sums)):
        sums[j] += numbers[j]
    total.period.deepest = deepest


@kernel
def average_periods(
    oscillator: Oscillator, step_size: float, count: int, move: Numbers, tip: MovingTip, lock_in: LockIn
) -> bool:
    """March so many periods, and sum up the detected motion; z0 falls by way + gain (A - setpoint) [m] in each.

    A is the amplitude behind the lock-in. z0 falls gradually: a tip moved at once may change its pattern of taps.
    """
    lever, total = oscillator.lever, lock_in.total
    clear(total)
    lock_in.change, total.period.deepest, lock_in.least_depth = 0.0, -math.inf, math.inf
    keep = math.exp(-2.0 * math.pi * BANDWIDTH)
    acc, (way, gain, setpoint) = tip.acc, move
    second, driven = complex(0.0, 0.0), lever[col.SECOND_FORCE] > 0.0
    for i in range(count):
        tip.u[Z0] -= way + gain * (math.hypot(lock_in.low_cos, lock_in.low_sin) - setpoint)
        tip.periods.marched += 1
        if march_oscillator(oscillator, tip.u[Z0], step_size, tip.u, acc) < 0:
            return False
        add_period(total.period, acc)
        lock_in.least_depth = min(lock_in.least_depth, acc.deepest)
        cosine, sine = detected_phasor(lever, acc.cos, acc.sin)
        x = keep * lock_in.low_cos + (1.0 - keep) * cosine
        y = keep * lock_in.low_sin + (1.0 - keep) * sine
        from_x, from_y = lock_in.from_cos, lock_in.from_sin
        size, angle = math.hypot(x, y), angle_between(from_x, from_y, x, y)
        total.count += 1.0
        total.offset += tip.u[Z0]
        total.amplitude += size
        total.amplitude2 += size * size
        total.angle += angle
        total.angle2 += angle * angle
        lock_in.change = max(lock_in.change, math.hypot(cosine - lock_in.last_cos, sine - lock_in.last_sin))
        lock_in.low_cos, lock_in.low_sin, lock_in.last_cos, lock_in.last_sin = x, y, cosine, sine
        if driven:
            second += averaging_weight(i, count) / count * complex(acc.second_cos, -acc.second_sin)
            pass_period(lever)
    if driven:
        felt = felt_by_second_mode(lever, second)
        total.averages, total.felt_re, total.felt_im = 1.0, felt.real, felt.imag
        hold_second_mode(lever, felt)
    return True


@kernel
def mean_phasor(lever: np.ndarray, total: Total) -> tuple[float, float]:
    """Mean phasor [m] that the detector sees."""
    return detected_phasor(lever, total.period.cos / total.count, total.period.sin / total.count)


@kernel
def mean_amplitude(lever: np.ndarray, lock_in: LockIn) -> float:
    """Amplitude [m] of the mean phasor that the detector sees."""
    x, y = mean_phasor(lever, lock_in.total)
    return math.hypot(x, y)


@kernel
def touches_alike(lock_in: LockIn) -> bool:
    """True if the tip touched in every period, or in none: in some only, its motion does not repeat itself."""
    return (lock_in.least_depth >= 0.0) == (lock_in.total.period.deepest >= 0.0)


@kernel
def block_of(lever: np.ndarray) -> int:
    """Periods that are averaged at a time: a multiple of 12, in which orbits of 2, 3, 4 or 6 periods repeat."""
    return 12 * (max(FEWEST_AVERAGED, ring_down_periods(lever)) // 12 + 1)


@kernel
def fill_spread(total: Total, row: np.ndarray) -> None:
    """Fill in the scatter of amplitude and phase behind the lock-in."""
    size, angle = total.amplitude / total.count, total.angle / total.count
    row[col.SPREAD_AMPLITUDE] = math.sqrt(max(total.amplitude2 / total.count - size * size, 0.0))
    row[col.SPREAD_PHASE] = math.sqrt(max(total.angle2 / total.count - angle * angle, 0.0))


@kernel
def new_series(count: int) -> Series:
    """Return a series with room for so many averages."""
    return Series(np.zeros(count), np.zeros(count), np.zeros(count))


@kernel
def with_average(lever: np.ndarray, total: Total, series: Series, count: int) -> Series:
    """The series, longer if it must be, with its entry `count` filled by this average."""
    if count == len(series.offset):
        longer = new_series(2 * count)
        copy(series.offset, longer.offset[:count])
        copy(series.cos, longer.cos[:count])
        copy(series.sin, longer.sin[:count])
        series = longer
    series.offset[count] = total.offset / total.count
    series.cos[count], series.sin[count] = mean_phasor(lever, total)
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
def fitted_slope(x: np.ndarray, y: np.ndarray) -> float:
    """Slope of a straight line fitted to all points; 0 where all x are the same."""
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
    return lever[col.DYNAMIC_LOSS] / (lever[col.DRIVE] * steep)


@kernel
def errors_of_mean(lever: np.ndarray, series: Series, first: int, count: int, amplitude: float) -> MeanErrors:
    """Errors of averages from `first` on: theory, Eq. (irregular-6).

    Where an amplitude is held, lag and tip offset vary with it, by single taps or on the way to the setpoint. Slopes of
    both over the amplitude, from all averages, take that off (a control variate). The lag is then wrong by as much as
    the mean amplitude misses the setpoint, times the slope of the scatter or that of the branch: which is not known.
    """
    x = y = 0.0
    for i in range(first, count):
        x, y = x + series.cos[i], y + series.sin[i]
    held, a, z, w = amplitude > 0.0, np.empty(count), np.empty(count), np.empty(count)
    for i in range(count):
        a[i] = angle_between(x, y, series.cos[i], series.sin[i])
        z[i] = math.hypot(series.cos[i], series.sin[i]) - amplitude
        w[i] = series.offset[i] - z[i]
    slope = w_slope = missed = branch = 0.0
    if held:
        slope, w_slope, branch = fitted_slope(z, a), fitted_slope(z, w), branch_slope(lever, x, y)
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
    return MeanErrors(lag + unknown, offset, slope * missed, lag + share * abs(slope), offset_scatter)
