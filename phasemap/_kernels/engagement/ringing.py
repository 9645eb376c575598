"""Engaging a lever that rings on for long, where `lower_to_setpoint` does not settle: by the energy the surface takes.

Far from the resonance a tip that loses its orbit bounces with all that the lever has stored. What rings down is then
faster than the lever alone, by what each period loses to the surface, theory, Eq. (time-6); and much of it locks to the
drive, and repeats itself after some periods. Such a pattern is followed as a periodic orbit is, which takes no time.
Between two patterns the tip is lowered slowly; after a jump it stays where it is until it has come to rest, and is
raised if it rests below the setpoint.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.goal import Goal, coarse_tolerance, fine_tolerance
from phasemap._kernels.engagement.holding_mean import GROUP, SLOW_GAIN, WORST_CLOSURE, hold_mean
from phasemap._kernels.engagement.lock_in import (
    FEWEST_AVERAGED,
    STEPS_LENGTH,
    STEPS_PHASE,
    LockIn,
    average,
    begin_lock_in,
    block_of,
    fill_spread,
    mean_amplitude,
    mean_phasor,
)
from phasemap._kernels.engagement.lowering import (
    AMPLITUDE_REACHED,
    DISTURBED,
    FEWEST_RINGING,
    JUMPED,
    LOWEST_OFFSET,
    MOVED,
    TIME_SPENT,
    follow_down,
    too_far,
)
from phasemap._kernels.engagement.stuck import sticks
from phasemap._kernels.excitation import detected_phasor
from phasemap._kernels.law import Oscillator
from phasemap._kernels.lever import free_amplitude, slowest_decay
from phasemap._kernels.orbits.time.many_periods import find_pattern, shorten
from phasemap._kernels.orbits.time.period_map import fill_row_at_rest, fill_row_of_period, hold_periodic, march_tip
from phasemap._kernels.orbits.time.tip import Z0, Tip, amplitude_of
from phasemap._kernels.records import record

LONG_RINGING = 320.0  # periods in which a lever rings down for which this is worth the while, and by which it begins
RINGING_PACE = 8e-3  # of the free amplitude, by which z0 falls in the periods in which the motion rings down
QUICK_RINGING = 40.0  # periods, over the 1 / DISTURBED of those in which a pattern that ends may go over into its like
FIRST_LOOK = 500  # periods after which a pattern is looked for
LATER_LOOKS = 1.3  # times more before the next look
LATEST_LOOK = 4000  # periods, at most
LONGEST_BLOCK = 500  # periods that are averaged at a time, at most
PATTERN_SHARE = 0.25  # of the periods left, which a pattern may be followed, or held
BLOCK_JUMP = 0.05  # of the setpoint, by which the amplitude changes in a block only where it jumps
MOST_CROSSINGS = 4  # jumps across the setpoint, after which it is given up
LOCK_IN_SETTLES = 400  # periods in which a lock-in settles


@record
class SlowApproach:
    """A tip that is lowered and raised slowly."""

    cos: float  # phasor [m] behind a low-pass as long as the motion rings down
    sin: float
    to_air: float  # energies [J] that a period loses to lever and surface, behind the same
    to_surface: float
    before: float  # the amplitude before [m]
    side: float  # +1 on the way down, -1 on the way up
    still: float  # until when the tip stays where it is [periods]
    turns: int  # jumps across the setpoint
    start: float  # tip offset where it began [m]


@kernel
def with_ring_down(lever: np.ndarray, periods: float) -> np.ndarray:
    """A copy of the lever whose motion rings down in this number of periods."""
    other = lever.copy()
    other[col.RINGING] = periods
    return other


@kernel
def fill_row_of_pattern(oscillator: Oscillator, step_size: float, tip: Tip, row: np.ndarray) -> int:
    """Fill a result row with means over a motion that repeats itself after `tip.periods.pattern` drive periods."""
    lever = oscillator.lever
    count = tip.periods.pattern
    if count <= 1:
        fill_row_at_rest(lever, tip, row)
        return col.GOOD
    fill_row_of_period(lever, tip.u[Z0], tip.acc, row)
    lock_in, whole = LockIn(), count * (LOCK_IN_SETTLES // count + 1)
    begin_lock_in(lever, tip.acc, lock_in)
    for _ in range(2):  # the first average only settles the lock-in
        if not average(oscillator, step_size, whole, (0.0, 0.0, 0.0), tip, lock_in):
            return col.NOT_SETTLED
    fill_spread(lock_in.total, row)
    row[col.ERROR_PHASE], row[col.ERROR_HEIGHT] = STEPS_PHASE, STEPS_LENGTH
    return col.GOOD if abs(row[col.CLOSURE]) < WORST_CLOSURE else col.NOT_SETTLED


@kernel
def follow_and_hold(oscillator: Oscillator, goal: Goal, step: float, tip: Tip, row: np.ndarray) -> int:
    """Lower a tip along a periodic pattern of taps, or from far, and hold the amplitude when it reaches it.

    Returns GOOD; NOT_CONVERGED where the pattern ends, or UNSTABLE where it ends as it is held; else what is final.
    """
    law, p, lever = oscillator
    quick, periods, ends = with_ring_down(lever, QUICK_RINGING), tip.periods, AMPLITUDE_REACHED
    amplitude, step_size, most_periods = goal
    exact = fine_tolerance(p, goal)
    if amplitude_of(lever, tip.acc) > amplitude:
        limit = periods.marched + int(PATTERN_SHARE * (most_periods - periods.marched))
        ends = follow_down(Oscillator(law, p, quick), Goal(amplitude, step_size, limit), step, 0.0, tip)
    if ends == LOWEST_OFFSET:
        return col.NO_STABLE_ORBIT
    if ends != AMPLITUDE_REACHED:
        return col.NOT_CONVERGED
    if sticks(p, lever, amplitude, tip):
        return col.NOT_SETTLED
    limit = periods.marched + int(PATTERN_SHARE * (most_periods - periods.marched))
    if hold_periodic(Oscillator(law, p, quick), exact, amplitude, limit, tip, row) != col.GOOD:
        return col.UNSTABLE
    if not shorten(oscillator, exact, amplitude, tip):
        return col.UNSTABLE
    return fill_row_of_pattern(oscillator, exact.step_size, tip, row)


@kernel
def update_ring_down(lever: np.ndarray, lock_in: LockIn, way: SlowApproach) -> None:
    """Update the filtered phasor and energy losses, and the lever's ring-down time, from a block of periods."""
    total = lock_in.total
    count, (x, y) = total.count, mean_phasor(lever, total)
    share = min(1.0, count / lever[col.RINGING])
    way.cos += share * (x - way.cos)
    way.sin += share * (y - way.sin)
    way.to_air += share * (total.period.air / count - way.to_air)
    way.to_surface += share * (total.period.loss / count - way.to_surface)
    alone = lever[col.OMEGA] / (2.0 * math.pi * slowest_decay(lever))
    lever[col.RINGING] = max(float(FEWEST_RINGING), alone * way.to_air / (way.to_air + way.to_surface))


@kernel
def move_until(oscillator: Oscillator, goal: Goal, tip: Tip, lock_in: LockIn, way: SlowApproach) -> int:
    """Lower or raise the tip slowly until the amplitude is reached or periods are over; returns how it ends."""
    lever, (amplitude, step_size, until) = oscillator.lever, goal
    free, periods = free_amplitude(lever), tip.periods
    while periods.marched < until:
        ring, waits, down = lever[col.RINGING], periods.marched < way.still, way.side > 0.0
        block = 12 * (int(min(max(ring, float(FEWEST_AVERAGED)), float(LONGEST_BLOCK))) // 12 + 1)
        pace = 0.0 if waits else way.side * RINGING_PACE * free / ring
        if not average(oscillator, step_size, block, (pace, 0.0, 0.0), tip, lock_in):
            return TIME_SPENT
        update_ring_down(lever, lock_in, way)
        now = mean_amplitude(lever, lock_in)
        if waits:
            if periods.marched >= way.still:
                way.before = math.hypot(way.cos, way.sin)
                if (way.before <= amplitude) == down:
                    way.side = -way.side
                    way.turns += 1
            continue
        if (now <= amplitude) == down:
            if abs(now - way.before) < BLOCK_JUMP * amplitude:
                return AMPLITUDE_REACHED
            way.still = periods.marched + DISTURBED * lever[col.RINGING]
            return JUMPED
        way.before = now
        if too_far(lever, way.start, tip.u[Z0]):
            return LOWEST_OFFSET
    return MOVED


@kernel
def engage_ringing(oscillator: Oscillator, goal: Goal, step: float, tip: Tip, row: np.ndarray) -> int:
    """Lower a freely swinging tip until its amplitude first is at the setpoint; hold it, as `engage_by_march`."""
    law, p, lever = oscillator
    slow, periods, acc = with_ring_down(lever, LONG_RINGING), tip.periods, tip.acc
    amplitude, _, most_periods = goal
    coarse, exact = coarse_tolerance(goal), fine_tolerance(p, goal)
    way, wait, found = SlowApproach(), FIRST_LOOK, march_tip(oscillator, coarse.step_size, tip)
    lock_in = LockIn()
    begin_lock_in(lever, acc, lock_in)
    way.start, way.side = tip.u[Z0], 1.0
    while periods.marched < most_periods and way.turns <= MOST_CROSSINGS:
        if found:
            status = follow_and_hold(oscillator, goal, step, tip, row)
            if status not in (col.NOT_CONVERGED, col.UNSTABLE):
                return status
            if status == col.UNSTABLE:
                way.turns += 1
            periods.pattern, wait = 1, FIRST_LOOK
            begin_lock_in(lever, acc, lock_in)
            way.cos, way.sin = detected_phasor(lever, acc.cos, acc.sin)
            way.before, way.still = math.inf, 0.0
        next_look = Goal(amplitude, coarse.step_size, min(most_periods, periods.marched + wait))
        ends = move_until(Oscillator(law, p, slow), next_look, tip, lock_in, way)
        if ends == TIME_SPENT:
            return col.NOT_SETTLED
        if ends == LOWEST_OFFSET:
            return col.NO_STABLE_ORBIT
        if ends == AMPLITUDE_REACHED:
            if find_pattern(Oscillator(law, p, slow), exact, amplitude, tip):
                return fill_row_of_pattern(oscillator, exact.step_size, tip, row)
            if periods.marched + 3 * GROUP * block_of(slow) < most_periods:
                return hold_mean(Oscillator(law, p, slow), goal, SLOW_GAIN, tip, row)
            way.still = most_periods  # no time for a mean, but a pattern may be found
        if ends != MOVED:
            wait = FIRST_LOOK
        found = find_pattern(Oscillator(law, p, slow), coarse, 0.0, tip)
        wait = min(int(LATER_LOOKS * wait), LATEST_LOOK)
    return col.NOT_SETTLED
