"""Motion that the controller finds, by engaging in time: the answer where no curve of periodic orbits gives it.

A lever that swings freely is lowered from far while the equation of motion is marched. As long as the motion repeats
itself every period, the periodic orbit is followed by Newton's method on the map of one period (`period_map`). A
contact with hysteresis that is just touched, a period that doubles, or a tip that sticks for some periods leaves no
such orbit. There the tip offset falls slowly, from period to period, and what counts is what a lock-in shows: the mean
phasor of the first harmonic. Where its modulus comes to the setpoint, `holding_in_time` goes on. Theory,
Eqs. (irregular-2) to (irregular-4).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.averages import (
    FEWEST_AVERAGED,
    LockIn,
    average_periods,
    begin_lock_in,
    block_of,
    mean_amplitude,
    touches_alike,
)
from phasemap._kernels.engagement.goal import COARSER_STEPS, Goal, coarse_tolerance, fine_tolerance
from phasemap._kernels.engagement.holding_in_time import hold_in_time
from phasemap._kernels.engagement.holding_mean import EAGER_GAIN, SLOW_GAIN, hold_mean
from phasemap._kernels.engagement.lowering import (
    AMPLITUDE_REACHED,
    DISTURBED,
    LAST_GAIN,
    LOWEST_OFFSET,
    MOTION_KEPT,
    ORBIT_AGAIN,
    ORBIT_HELD,
    ORBIT_LEFT,
    ROUGH_STEPS,
    STILL_MOTION,
    TIME_SPENT,
    TRAIL_PERIODS,
    WHOLE_FALL,
    fall_to_setpoint,
    follow_down,
    pace_of_leap,
    too_far,
)
from phasemap._kernels.engagement.second_drive import begin_second_drive, pass_period
from phasemap._kernels.engagement.stuck import JUMPS_FREE, JUMPS_TO_TAPPING, REACHES_AMPLITUDE, raise_stuck_tip, sticks
from phasemap._kernels.law import Oscillator, has_hysteresis
from phasemap._kernels.lever import free_amplitude, free_phasor, scale_of
from phasemap._kernels.numerics import copy
from phasemap._kernels.orbits.averaged.orbits import ratio_far_from_surface
from phasemap._kernels.orbits.time.period_map import come_to_rest, fill_row_at_rest, march_tip, skip_transient
from phasemap._kernels.orbits.time.tip import (
    Z0,
    MovingTip,
    PeriodMap,
    PeriodResult,
    Periods,
    new_state,
    ring_down_periods,
)
from phasemap._kernels.records import assign

if TYPE_CHECKING:
    from phasemap._kernels.law import Law

# Of the free amplitude, by which z0 falls in FEWEST_AVERAGED periods, or a ring-down time, without a periodic orbit.
SLOW_FALL = 4e-3
MOST_SPEED_UP = 4.0  # times faster than that z0 of such a contact falls, at most
SPEED_UP_NEAR = 0.25  # the same, of what is left to go
JUMPS_BY = 0.05  # of the amplitude, by which it changes in that time only where the motion jumps
PARTS_BY = 0.3  # of its way, by which the amplitude may not go with z0: else it was too fast
STEP_OF_SCALE, STEP_OF_FREE = (
    0.1,
    1e-3,
)  # of the length on which forces change, and the free amplitude: first steps down
LEAST_CHANGE_KEPT = 0.5  # of the change from period to period before, below which it may not fall: the same
LANDING_FALL = 0.1  # of the amplitude that is left, by which it falls in that time
FINEST_FALL = 64.0  # least part of SLOW_FALL
NEXT_TRY = 5e-3  # of the free amplitude, that a tip without periodic orbit is lowered before one is tried again


@kernel
def slow_pace(lever: np.ndarray) -> float:
    """Change of the tip offset [m] per period where no periodic orbit is followed."""
    return SLOW_FALL * free_amplitude(lever) / max(FEWEST_AVERAGED, ring_down_periods(lever))


@kernel
def amplitude_after_jump(
    oscillator: Oscillator, step_size: float, block: int, most_periods: int, tip: MovingTip, lock_in: LockIn
) -> float:
    """Mean amplitude [m] on which the lever settles after a jump, which it may overshoot; NaN if periods run out."""
    wait = int(DISTURBED) * block
    if tip.periods.marched + wait + block > most_periods:
        return math.nan
    for count in (wait, block):
        if not average_periods(oscillator, step_size, count, (0.0, 0.0, 0.0), tip, lock_in):
            return math.nan
    return mean_amplitude(oscillator.lever, lock_in)


@kernel
def move_to_mean_amplitude(oscillator: Oscillator, goal: Goal, least: float, tip: MovingTip) -> int:
    """Lower or raise the tip period by period until the mean amplitude is reached; returns how the motion ends.

    Past a contact with hysteresis it goes faster as long as amplitude and z0 change alike and the motion stays as
    irregular as it was (else once more, slowly), and ever slower near the end, for the way decides on the pattern of
    taps. It ends with ORBIT_AGAIN where the motion repeats itself every period, but not before z0
    has changed by `least` [m].
    """
    p, lever, tolerance = oscillator.p, oscillator.lever, coarse_tolerance(goal)
    amplitude, _, most_periods = goal
    block, slow, from_z0 = block_of(lever), slow_pace(lever), tip.u[Z0]
    hysteretic, speed_up = has_hysteresis(p), 1.0
    step_size = ROUGH_STEPS * tolerance.step_size if hysteretic else tolerance.step_size
    lock_in, u, acc = LockIn(), tip.u.copy(), PeriodResult()
    begin_lock_in(lever, tip.acc, lock_in)
    if tip.periods.marched + block > most_periods or not average_periods(
        oscillator, step_size, block, (0.0, 0.0, 0.0), tip, lock_in
    ):
        return TIME_SPENT
    before, change = mean_amplitude(lever, lock_in), lock_in.change
    down = before > amplitude
    while tip.periods.marched + block <= most_periods:
        pace = speed_up * slow
        if hysteretic:
            pace = max(slow / FINEST_FALL, min(pace, LANDING_FALL * abs(before - amplitude) / block))
        copy(tip.u, u)
        assign(acc, tip.acc)
        if not average_periods(oscillator, step_size, block, (pace if down else -pace, 0.0, 0.0), tip, lock_in):
            return TIME_SPENT
        now = mean_amplitude(lever, lock_in)
        diverted = (
            abs(abs(now - before) - pace * block) > PARTS_BY * pace * block
            or lock_in.change < LEAST_CHANGE_KEPT * change
        )
        if speed_up > 1.0 and diverted:  # perhaps to another motion: once more, slowly
            copy(u, tip.u)
            assign(tip.acc, acc)
            begin_lock_in(lever, acc, lock_in)
            speed_up = 1.0
            continue
        if not hysteretic and (now <= amplitude) == down and abs(now - before) > JUMPS_BY * amplitude:
            now = amplitude_after_jump(oscillator, step_size, block, most_periods, tip, lock_in)
            if math.isnan(now):
                return TIME_SPENT
        if (now <= amplitude) == down:
            return AMPLITUDE_REACHED
        if too_far(lever, from_z0, tip.u[Z0]):
            return LOWEST_OFFSET
        before, change = now, lock_in.change
        still = change < STILL_MOTION * (max(amplitude, now) if hysteretic else amplitude) and touches_alike(lock_in)
        if still and abs(from_z0 - tip.u[Z0]) > least and skip_transient(oscillator, tolerance, 0.0, tip):
            return ORBIT_AGAIN
        if hysteretic and not still:
            speed_up = max(
                1.0, min(2.0 * speed_up, MOST_SPEED_UP, SPEED_UP_NEAR * abs(now - amplitude) / (slow * block))
            )
        else:
            speed_up = 1.0
    return TIME_SPENT


@kernel
def free_state(law: Law, lever: np.ndarray, z0: float) -> np.ndarray:
    """State of a freely swinging lever whose tip offset is z0 [m]."""
    free = free_phasor(lever)
    return new_state(law, lever, 0.0, free.real, -lever[col.OMEGA] * free.imag, z0)


@kernel
def engage_by_march(oscillator: Oscillator, goal: Goal, row: np.ndarray) -> int:
    """Engage from far: lower a freely swinging lever until its amplitude first reaches the setpoint, and hold it.

    Returns GOOD; NOT_SETTLED after the periods allowed; NO_STABLE_ORBIT where it was lowered as far as a tip is, or the
    amplitude jumps across the setpoint.
    """
    law, p, lever = oscillator
    free = free_amplitude(lever)
    u = free_state(law, lever, free * ratio_far_from_surface(oscillator, goal.amplitude))
    tip = MovingTip(u, PeriodResult(), PeriodMap(), Periods())
    row[:] = math.nan
    step, least = STEP_OF_SCALE * scale_of(oscillator) + STEP_OF_FREE * free, NEXT_TRY * free
    pace, loose = pace_of_leap(oscillator), False
    # Too few periods are allowed to follow a fall to its end: only whether the tip sticks can be told.
    short = WHOLE_FALL * ring_down_periods(lever) > goal.most_periods
    while True:
        if loose and pace > 0.0:
            ends, periodic = fall_to_setpoint(oscillator, goal, 0.0, 0.0, tip), False
        else:
            ends = follow_down(oscillator, goal, step, TRAIL_PERIODS * pace, tip)
            periodic = ends == AMPLITUDE_REACHED
        if ends == ORBIT_LEFT:
            if pace > 0.0:
                ends = fall_to_setpoint(oscillator, goal, pace, least, tip)
                if short and not (ends == ORBIT_HELD and sticks(p, lever, goal.amplitude, tip)):
                    return col.NOT_SETTLED
            else:
                ends = move_to_mean_amplitude(oscillator, goal, least, tip)
            least *= 2.0
        if law.memory == 0 and ends in (AMPLITUDE_REACHED, ORBIT_HELD) and sticks(p, lever, goal.amplitude, tip):
            if loose:
                return col.NO_STABLE_ORBIT
            comes = raise_stuck_tip(oscillator, goal, periodic, pace > 0.0, tip)
            if comes == JUMPS_FREE:
                return col.NO_STABLE_ORBIT
            if comes == REACHES_AMPLITUDE:
                ends = ORBIT_HELD
            if comes == JUMPS_TO_TAPPING:
                loose = True
                continue
        if periodic or ends == ORBIT_HELD:
            return hold_in_time(oscillator, goal, tip, row)
        if ends == MOTION_KEPT:
            return hold_mean(oscillator, goal, SLOW_GAIN, tip, row)
        if ends == AMPLITUDE_REACHED:
            return hold_mean(oscillator, goal, LAST_GAIN if pace > 0.0 else EAGER_GAIN, tip, row)
        if ends != ORBIT_AGAIN:
            return col.NOT_SETTLED if ends == TIME_SPENT else col.NO_STABLE_ORBIT


@kernel
def engage_with_second_drive(oscillator: Oscillator, goal: Goal, row: np.ndarray) -> int:
    """Engage from far a lever whose second mode is driven too, as `engage_by_march`."""
    law, p, shared = oscillator
    lever = np.empty(len(shared))
    copy(shared, lever)
    u = free_state(law, lever, free_amplitude(lever) * ratio_far_from_surface(oscillator, goal.amplitude))
    begin_second_drive(lever, u)
    row[:] = math.nan
    return move_to_amplitude(Oscillator(law, p, lever), goal.amplitude, goal.step_size, goal.most_periods, u, row)


@kernel
def move_to_tip_offset(
    oscillator: Oscillator, z0: float, step_size: float, most_periods: int, u: np.ndarray, row: np.ndarray
) -> int:
    """Move a tip in state u = (z, z', touching, tip offset) slowly to z0 [m], and fill a result row with its motion.

    Returns GOOD, or NOT_SETTLED after `most_periods` periods; u is where it then is.
    """
    p, lever = oscillator.p, oscillator.lever
    tip = MovingTip(u, PeriodResult(), PeriodMap(), Periods())
    count = int(abs(u[Z0] - z0) / slow_pace(lever))
    if count >= most_periods or not march_tip(oscillator, step_size, tip):
        return col.NOT_SETTLED
    move, lock_in = ((u[Z0] - z0) / max(count, 1), 0.0, 0.0), LockIn()
    begin_lock_in(lever, tip.acc, lock_in)
    if not average_periods(oscillator, COARSER_STEPS * step_size, count, move, tip, lock_in):
        return col.NOT_SETTLED
    u[Z0] = z0
    tolerance = fine_tolerance(p, Goal(free_amplitude(lever), step_size, most_periods))
    if come_to_rest(
        oscillator, tolerance, min(int(DISTURBED * ring_down_periods(lever)), most_periods - tip.periods.marched), tip
    ):
        fill_row_at_rest(lever, tip, row)
        return col.GOOD
    return hold_mean(oscillator, Goal(0.0, step_size, most_periods), 0.0, tip, row)


@kernel
def move_to_amplitude(
    oscillator: Oscillator, amplitude: float, step_size: float, most_periods: int, u: np.ndarray, row: np.ndarray
) -> int:
    """Move a tip in state u slowly to the amplitude [m], hold it, and fill a result row; as `engage_by_march`.

    Under a second drive no period is like the next.
    """
    lever = oscillator.lever
    driven = lever[col.SECOND_FORCE] > 0.0
    tip = MovingTip(u, PeriodResult(), PeriodMap(), Periods())
    if not march_tip(oscillator, step_size, tip):
        return col.NOT_SETTLED
    if driven:
        pass_period(lever)
    goal, least = Goal(amplitude, step_size, most_periods), math.inf if driven else NEXT_TRY * free_amplitude(lever)
    ends = move_to_mean_amplitude(oscillator, goal, least, tip)
    if ends == ORBIT_AGAIN:
        return hold_in_time(oscillator, goal, tip, row)
    if ends == AMPLITUDE_REACHED:
        return hold_mean(oscillator, goal, EAGER_GAIN, tip, row)
    return col.NOT_SETTLED if ends == TIME_SPENT else col.NO_STABLE_ORBIT
