"""Holding an amplitude in the mean, where the motion does not repeat itself.

An integral controller holds the modulus of the mean phasor, as an instrument does, and averages over time are the
result, with their spread behind a lock-in of stated bandwidth: theory, Eqs. (irregular-3) to (irregular-6).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.averages import (
    LockIn,
    MeanErrors,
    Series,
    Total,
    add_total,
    angle_between,
    average_periods,
    begin_lock_in,
    block_of,
    errors_of_mean,
    fill_spread,
    mean_amplitude,
    mean_phasor,
    new_series,
    touches_alike,
    with_average,
)
from phasemap._kernels.engagement.goal import COARSER_STEPS, Goal, fine_tolerance
from phasemap._kernels.engagement.lowering import STILL_MOTION
from phasemap._kernels.excitation import detected_phasor, sees_tip
from phasemap._kernels.law import Oscillator, has_hysteresis
from phasemap._kernels.lever import free_amplitude
from phasemap._kernels.lever_modes import mode_of
from phasemap._kernels.orbits.orbit_nodes import FELT_IM, FELT_RE, KEPT_COUNT, KEPT_NODES, SECOND_IN_TIME
from phasemap._kernels.orbits.time.period_map import fill_row_at_rest, fill_row_of_period, skip_transient
from phasemap._kernels.orbits.time.tip import Z0, MovingTip, divide_result
from phasemap._kernels.records import record

GROUP = 4  # averages that are one independent value of the mean
LEAST_GROUPS = 5  # of these that are needed
STICKY_GROUP = 2  # the same of a contact with hysteresis, whose motion forgets sooner
STICKY_GROUPS = 6
CALM_ENOUGH = 1e-5  # of the amplitude, by which it may there be missed when averaging begins
EAGER_GAIN = 0.5  # integral gain of the controller, to come to the setpoint
SLOW_GAIN = 0.1  # the same, to stay there
PHASE_SOUGHT = math.radians(0.01)  # standard error at which averaging ends [rad]
LENGTH_SOUGHT = 2e-12  # the same [m]
MEAN_MISS = 0.01  # of the amplitude, by which the mean may miss it and still be of the motion that holds it
WORST_PHASE = math.radians(0.05)  # standard error with which a mean still counts as held [rad]
WORST_LENGTH = 1e-11  # the same [m]
SERIES_START = 64  # averages that are kept, before room is made for more
HUNTED = 0.2  # of the amplitude, root mean square by which groups miss it: the feedback hunts, and holds nothing
HOPE = 4.0  # times the periods allowed, that a mean would take by its first standard errors: it is given up
WORST_MEAN_CLOSURE = 0.05  # energy in less energy out, over energy in, with which a mean still counts


class Controller(NamedTuple):
    """A controller that holds a mean amplitude, and how averages are taken meanwhile."""

    amplitude: float  # that is held [m]; 0 where the tip offset is left alone
    gain: float  # tip offset over the error of an average's amplitude
    # Whether the contact has hysteresis. Then the tip offset follows little by little, in every period, which keeps the
    # motion to its pattern of taps.
    sticky: bool
    step_size: float  # as for `march_oscillator`
    block: int  # periods of an average
    size: int  # averages of a group
    fewest: int  # groups that are needed


@record
class Groups:
    """Groups of averages: mean, and sum of squared deviations, of the tip offset at the setpoint and of the lag."""

    first: int  # average that counts
    count: int  # averages, with those before it
    full: int  # groups that are complete
    offset: float  # [m]
    offset_square: float
    lag: float  # [rad], from a phasor of `LockIn`
    lag_square: float
    short: float  # sum of what the amplitude falls short of the setpoint [m]
    missed: float  # sum of squares by which groups miss it, but the first ones [m2]
    total: Total  # of all that count


@kernel
def average_and_control(
    oscillator: Oscillator, controller: Controller, tip: MovingTip, lock_in: LockIn, series: Series, groups: Groups
) -> tuple[bool, Series]:
    """Average over some periods, and let the controller act; False where the march fails, and the series with it.

    The tip offset moves behind the periods. Where the contact is sticky, the same gain is spread over them: a move at
    once could change the pattern of taps.
    """
    lever, amplitude, gain = oscillator.lever, controller.amplitude, controller.gain
    move = 0.0, gain / controller.block if controller.sticky else 0.0, amplitude  # as `average_periods` takes it
    if not average_periods(oscillator, controller.step_size, controller.block, move, tip, lock_in):
        return False, series
    series = with_average(lever, lock_in.total, series, groups.count)
    groups.count += 1
    if not controller.sticky:
        tip.u[Z0] += gain * (amplitude - mean_amplitude(lever, lock_in))
    return True, series


@kernel
def add_group_of_averages(
    oscillator: Oscillator, controller: Controller, tip: MovingTip, lock_in: LockIn, series: Series, groups: Groups
) -> tuple[bool, Series]:
    """Take the averages of one group, and add their mean to the groups; False where the march fails.

    Of the tip offset that is where the amplitude would be held: as A rises with z0 one to one, z0 and what A is short.
    """
    lever, amplitude, count = oscillator.lever, controller.amplitude, controller.size * controller.block
    z0 = cosine = sine = 0.0
    for _ in range(controller.size):
        good, series = average_and_control(oscillator, controller, tip, lock_in, series, groups)
        if not good:
            return False, series
        add_total(groups.total, lock_in.total)
        z0 += lock_in.total.offset / count
        cosine += lock_in.total.period.cos
        sine += lock_in.total.period.sin
    x, y = detected_phasor(lever, cosine / count, sine / count)
    short = amplitude - math.hypot(x, y)
    groups.full += 1
    groups.short += short
    groups.missed += short * short
    held_at = z0 + short
    difference = held_at - groups.offset  # Welford's running mean and sum of squares
    groups.offset += difference / groups.full
    groups.offset_square += difference * (held_at - groups.offset)
    lag = angle_between(lock_in.from_cos, lock_in.from_sin, x, y)
    difference = lag - groups.lag
    groups.lag += difference / groups.full
    groups.lag_square += difference * (lag - groups.lag)
    return True, series


@kernel
def come_to_mean(
    oscillator: Oscillator, controller: Controller, tip: MovingTip, lock_in: LockIn, series: Series, groups: Groups
) -> tuple[bool, Series]:
    """Let the controller come to the setpoint, before averages count; False where the march fails."""
    lever, amplitude = oscillator.lever, controller.amplitude
    for j in range(3 * GROUP):
        good, series = average_and_control(oscillator, controller, tip, lock_in, series, groups)
        if not good:
            return False, series
        missed = abs(mean_amplitude(lever, lock_in) - amplitude)
        if controller.sticky and j >= GROUP and missed < CALM_ENOUGH * amplitude:
            break
    groups.first = groups.count
    lock_in.from_cos, lock_in.from_sin = mean_phasor(lever, lock_in.total)
    return True, series


@kernel
def misses_setpoint(amplitude: float, groups: Groups) -> bool:
    """True if the mean misses the amplitude that is held by so much that it belongs to another motion."""
    return amplitude > 0.0 and abs(groups.short) > MEAN_MISS * amplitude * groups.full


@kernel
def scatters_little(errors: MeanErrors) -> bool:
    """True if averages scatter so little about their mean that it counts as held."""
    return errors.lag_scatter < 2.0 * WORST_PHASE and errors.offset_scatter < 2.0 * WORST_LENGTH


@kernel
def judge_groups(lever: np.ndarray, controller: Controller, series: Series, most_periods: int, groups: Groups) -> int:
    """GOOD where groups are precise by their scatter, NOT_SETTLED where they will not be within so many periods.

    NO_STABLE_ORBIT where the feedback hunts for the amplitude, else PENDING.
    """
    amplitude, full, fewest, size = controller.amplitude, groups.full, controller.fewest, controller.size
    if full >= fewest:
        z_error = math.sqrt(groups.offset_square / (full - 1) / full)
        a_error = math.sqrt(groups.lag_square / (full - 1) / full)
        if z_error < LENGTH_SOUGHT and a_error < PHASE_SOUGHT and not misses_setpoint(amplitude, groups):
            if scatters_little(errors_of_mean(lever, series, groups.first, groups.count, amplitude)):
                return col.GOOD
        needed = size * controller.block * full * max(z_error / WORST_LENGTH, a_error / WORST_PHASE) ** 2
        if full >= 4 * fewest and needed > HOPE * most_periods:
            return col.NOT_SETTLED
    if full == fewest:
        groups.missed = 0.0  # a feedback comes to the amplitude before it holds it
    elif amplitude > 0.0 and full % fewest == 0 and groups.missed > (full - fewest) * (HUNTED * amplitude) ** 2:
        return col.NO_STABLE_ORBIT  # the amplitude jumps across the setpoint
    return col.PENDING


@kernel
def fill_mean(
    oscillator: Oscillator, controller: Controller, tip: MovingTip, series: Series, groups: Groups, row: np.ndarray
) -> int:
    """Fill a result row with the mean of all averages that count, and with its errors; NOT_SETTLED if they are large.

    Energy that is missing says that steps or rounding are too coarse for so small a motion. As the mean amplitude
    misses the setpoint, the lag is off by `lag_off`. Where the contact is sticky it goes with the amplitude as averages
    scatter, and that is taken off; elsewhere it need not, and the error is as much larger. Under a second drive what
    the surface adds to the second mode's stiffness [N/m] is kept where other rows keep nodes.
    """
    lever, amplitude, total = oscillator.lever, controller.amplitude, groups.total
    errors = errors_of_mean(lever, series, groups.first, groups.count, amplitude)
    if groups.full < controller.fewest or misses_setpoint(amplitude, groups) or not scatters_little(errors):
        return col.NOT_SETTLED
    divide_result(total.period, total.count)
    fill_row_of_period(lever, groups.offset if amplitude > 0.0 else tip.u[Z0], total.period, row)
    if amplitude > 0.0 and sees_tip(lever):
        row[col.AMPLITUDE] = amplitude
    fill_spread(total, row)
    row[col.ERROR_PHASE], row[col.ERROR_HEIGHT] = errors.lag, errors.offset
    if total.averages > 0.0 and len(row) > KEPT_NODES:
        felt = lever[col.STIFFNESS] / (mode_of(lever, 1).share * total.averages)
        row[KEPT_COUNT], row[FELT_RE], row[FELT_IM] = SECOND_IN_TIME, felt * total.felt_re, felt * total.felt_im
    if controller.sticky:
        row[col.PHASE] += errors.lag_off
    else:
        row[col.ERROR_PHASE] += abs(errors.lag_off)
    return col.GOOD if abs(row[col.CLOSURE]) < WORST_MEAN_CLOSURE else col.NOT_SETTLED


@kernel
def hold_mean(oscillator: Oscillator, goal: Goal, gain: float, tip: MovingTip, row: np.ndarray) -> int:
    """Hold the mean amplitude by an integral controller and fill the row with averages over time.

    The tip offset goes with the amplitude one to one where a surface limits it, so that each average of both gives
    the one that would hold the setpoint. Averaging ends when the standard error of groups is small; the stated error
    is larger: theory, Eqs. (irregular-5) and (irregular-6). NOT_SETTLED if groups still scatter after `most_periods`
    periods, or will. NO_STABLE_ORBIT where the amplitude jumps across the setpoint, down as the tip comes
    nearer and up as it goes away, so that a feedback hunts for ever. An `amplitude` of 0 leaves the tip offset alone;
    `gain` is that of the controller at first, but at most SLOW_GAIN past a contact with hysteresis: a tip that is moved
    faster takes to another pattern of taps than the one that it lands on.
    """
    p, lever, (amplitude, step_size, most_periods) = oscillator.p, oscillator.lever, goal
    size = amplitude if amplitude > 0.0 else free_amplitude(lever)
    tolerance = fine_tolerance(p, Goal(size, step_size, most_periods))
    sticky, block, rough = has_hysteresis(p), block_of(lever), COARSER_STEPS * step_size
    slow = Controller(
        amplitude, min(gain, SLOW_GAIN), sticky, rough, block, STICKY_GROUP if sticky else GROUP,
        STICKY_GROUPS if sticky else LEAST_GROUPS,
    )  # fmt: skip
    if tip.periods.marched + 3 * GROUP * block > most_periods:
        return col.NOT_SETTLED
    at_first = Controller(amplitude, slow.gain if sticky else gain, sticky, rough, block, slow.size, slow.fewest)
    lock_in, groups, series, says = LockIn(), Groups(), new_series(SERIES_START), col.PENDING
    groups.total.period.deepest = -math.inf  # of a tip that reaches liquid only
    begin_lock_in(lever, tip.acc, lock_in)
    good, series = come_to_mean(oscillator, at_first, tip, lock_in, series, groups)
    while good and says == col.PENDING and tip.periods.marched + slow.size * block <= most_periods:
        good, series = add_group_of_averages(oscillator, slow, tip, lock_in, series, groups)
        still = good and lock_in.change < STILL_MOTION * mean_amplitude(lever, lock_in) and touches_alike(lock_in)
        if still and lever[col.SECOND_FORCE] == 0.0 and skip_transient(oscillator, tolerance, amplitude, tip):
            fill_row_at_rest(lever, tip, row)  # it repeats itself by now
            return col.GOOD
        says = judge_groups(lever, slow, series, most_periods, groups)
    if says == col.NO_STABLE_ORBIT:
        return says
    if says == col.NOT_SETTLED or not good:
        return col.NOT_SETTLED
    return fill_mean(oscillator, slow, tip, series, groups, row)
