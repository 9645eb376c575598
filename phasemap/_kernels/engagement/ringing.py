"""Engaging a lever that rings on for long, where `in_time.approach` does not settle: by what the surface takes from it.

Far from the resonance a tip that loses its orbit bounces with all that the lever has stored. What rings down is then
faster than the lever alone, by what each period loses to the surface, theory, Eq. (time-6); and much of it locks to the
drive, and repeats itself after some periods. Such a pattern is followed as a periodic orbit is, which takes no time.
Between two patterns the tip is lowered slowly; after a jump it stays where it is until it has come to rest, and is
raised if it rests below the setpoint.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.averages import (
    ANGLE,
    ANGLE2,
    COUNT,
    SIZE,
    SIZE2,
    STEPS_LENGTH,
    STEPS_PHASE,
    average,
    begin_sums,
    block_of,
    seen,
)
from phasemap._kernels.engagement.averages import FEWEST as LEAST_BLOCK
from phasemap._kernels.engagement.holding import (
    COARSE,
    GROUP,
    OFFSET_ERROR,
    SLOW,
    STATE_ERROR,
    WIDE,
    WORST_CLOSURE,
    fine,
    hold_mean,
)
from phasemap._kernels.engagement.lowering import DISTURBED, FEWEST, LOWEST, SEEN, follow_down, too_far
from phasemap._kernels.engagement.stuck import presses, sticks
from phasemap._kernels.law import Oscillator
from phasemap._kernels.lever import free_amplitude
from phasemap._kernels.orbits.time.pattern import find_pattern, shorten
from phasemap._kernels.orbits.time.period_map import Tolerance, fill, fill_orbit, hold_periodic, pass_period
from phasemap._kernels.orbits.time.tip import (
    AIR,
    COS,
    LOST,
    MARCHED,
    PATTERN,
    SIN,
    Z0,
    Tip,
    amplitude_of,
)

if TYPE_CHECKING:
    pass

RINGS = 320.0  # periods in which a lever rings down for which this is worth the while, and by which it begins
PACE = 8e-3  # of the free amplitude, by which z0 falls in the periods in which the motion rings down
QUICK = 40.0  # periods, over the 1 / DISTURBED of those in which a pattern that ends may go over into its like
SOON, LATER, LATEST = 500, 1.3, 4000  # periods after which a pattern is looked for, again and again
BLOCK = 500  # periods that are averaged at a time, at most
PART = 0.25  # of the periods left, which a pattern may be followed, or held
FELL = 0.05  # of the setpoint, by which the amplitude changes in a block only where it jumps
MOST_TURNS = 4  # jumps across the setpoint, after which it is given up
SETTLED = 400  # periods in which a lock-in settles
# What is carried along: phasor [m] behind a low-pass as long as the motion rings down, energies [J] that a period loses
# to lever and surface, behind it too; the amplitude [m] before; +1 on the way down and -1 up; until when the tip stays
# where it is, jumps across the setpoint, and the tip offset [m] where it began.
X, Y, TO_AIR, TO_SURFACE, BEFORE, SIDE, STILL, TURNS, FROM, WAY = 0, 1, 2, 3, 4, 5, 6, 7, 8, 9
LOOK, JUMPED, REACHED, DEEP, OVER = 0, 1, 2, 3, 4
"""How moving slowly ends: a pattern may be looked for, at once after a jump; at the setpoint, or at none."""


@kernel
def with_ringing(lever: np.ndarray, periods: float) -> np.ndarray:
    """The lever, with so many periods in which motion rings down."""
    other = np.empty(col.RINGING + 1)
    for j in range(col.RINGING):
        other[j] = lever[j]
    other[col.RINGING] = periods
    return other


@kernel
def fill_pattern(oscillator: Oscillator, eta: float, tip: Tip, row: np.ndarray) -> int:
    """Fill a result row from a tip at rest on a pattern."""
    lever = oscillator.lever
    count = tip.periods[PATTERN]
    if count == 1:
        fill_orbit(lever, tip, row)
        return col.GOOD
    fill(lever, tip.u[Z0], tip.acc, row)
    sums, whole = begin_sums(lever, tip.acc), count * (SETTLED // count + 1)
    for _ in range(2):
        if not average(oscillator, eta, whole, (0.0, 0.0, 0.0), tip, sums):
            return col.NOT_SETTLED
    size, angle = sums[SIZE] / sums[COUNT], sums[ANGLE] / sums[COUNT]
    row[col.SPREAD_AMPLITUDE] = math.sqrt(max(sums[SIZE2] / sums[COUNT] - size * size, 0.0))
    row[col.SPREAD_PHASE] = math.sqrt(max(sums[ANGLE2] / sums[COUNT] - angle * angle, 0.0))
    row[col.ERROR_PHASE], row[col.ERROR_HEIGHT] = STEPS_PHASE, STEPS_LENGTH
    return col.GOOD if abs(row[col.CLOSURE]) < WORST_CLOSURE else col.NOT_SETTLED


@kernel
def follow_and_hold(
    oscillator: Oscillator, amplitude: float, step: float, eta: float, most: int, tip: Tip, row: np.ndarray
) -> int:
    """Lower a tip along its pattern, or from far, and hold the amplitude where it comes by it.

    Returns GOOD; NOT_CONVERGED where the pattern ends, or UNSTABLE where it ends as it is held; else what is final.
    """
    law, p, lever = oscillator
    quick, periods, ends = with_ringing(lever, QUICK), tip.periods, SEEN
    coarse = Tolerance(COARSE * eta, WIDE * STATE_ERROR * amplitude, WIDE * OFFSET_ERROR)
    exact = Tolerance(fine(p, eta), STATE_ERROR * amplitude, OFFSET_ERROR)
    if amplitude_of(lever, tip.acc) > amplitude:
        limit = periods[MARCHED] + int(PART * (most - periods[MARCHED]))
        ends = follow_down(Oscillator(law, p, quick), amplitude, step, 0.0, coarse, limit, tip)
    if ends == LOWEST:
        return col.PRESSED if presses(p, tip) else col.NO_STABLE_ORBIT
    if ends != SEEN:
        return col.NOT_CONVERGED
    if sticks(p, lever, amplitude, tip):
        return col.NOT_SETTLED
    limit = periods[MARCHED] + int(PART * (most - periods[MARCHED]))
    if hold_periodic(Oscillator(law, p, quick), exact, amplitude, limit, tip, row) != col.GOOD:
        return col.UNSTABLE
    if not shorten(oscillator, exact, amplitude, tip):
        return col.UNSTABLE
    return fill_pattern(oscillator, exact.eta, tip, row)


@kernel
def renew(lever: np.ndarray, sums: np.ndarray, way: np.ndarray) -> None:
    """Take up what a block of periods showed: phasor, and in how many periods the motion rings down."""
    count = sums[COUNT]
    share = min(1.0, count / lever[col.RINGING])
    way[X] += share * (sums[COS] / count - lever[col.SHAKER] - way[X])
    way[Y] += share * (sums[SIN] / count - way[Y])
    way[TO_AIR] += share * (sums[AIR] / count - way[TO_AIR])
    way[TO_SURFACE] += share * (sums[LOST] / count - way[TO_SURFACE])
    alone = lever[col.OMEGA] / (2.0 * math.pi * lever[col.ALPHA0])
    lever[col.RINGING] = max(float(FEWEST), alone * way[TO_AIR] / (way[TO_AIR] + way[TO_SURFACE]))


@kernel
def move(
    oscillator: Oscillator, amplitude: float, eta: float, until: int, tip: Tip, sums: np.ndarray, way: np.ndarray
) -> int:
    """Lower or raise the tip slowly for some periods, or until it reaches the amplitude; `way` goes along."""
    lever = oscillator.lever
    free, periods = free_amplitude(lever), tip.periods
    while periods[MARCHED] < until:
        ring, waits, down = lever[col.RINGING], periods[MARCHED] < way[STILL], way[SIDE] > 0.0
        block = 12 * (int(min(max(ring, float(LEAST_BLOCK)), float(BLOCK))) // 12 + 1)
        pace = 0.0 if waits else way[SIDE] * PACE * free / ring
        if not average(oscillator, eta, block, (pace, 0.0, 0.0), tip, sums):
            return OVER
        renew(lever, sums, way)
        now = seen(lever, sums)
        if waits:
            if periods[MARCHED] >= way[STILL]:
                way[BEFORE] = math.hypot(way[X], way[Y])
                if (way[BEFORE] <= amplitude) == down:
                    way[SIDE] = -way[SIDE]
                    way[TURNS] += 1.0
            continue
        if (now <= amplitude) == down:
            if abs(now - way[BEFORE]) < FELL * amplitude:
                return REACHED
            way[STILL] = periods[MARCHED] + DISTURBED * lever[col.RINGING]
            return JUMPED
        way[BEFORE] = now
        if too_far(lever, way[FROM], tip.u[Z0]):
            return DEEP
    return LOOK


@kernel
def engage_ringing(
    oscillator: Oscillator, amplitude: float, step: float, eta: float, most: int, tip: Tip, row: np.ndarray
) -> int:
    """Lower a tip that swings freely until its amplitude first reaches the setpoint, and hold it; as `approach`."""
    law, p, lever = oscillator
    slow, periods, acc = with_ringing(lever, RINGS), tip.periods, tip.acc
    coarse = Tolerance(COARSE * eta, WIDE * STATE_ERROR * amplitude, WIDE * OFFSET_ERROR)
    exact = Tolerance(fine(p, eta), STATE_ERROR * amplitude, OFFSET_ERROR)
    way, wait, found = np.zeros(WAY), SOON, pass_period(oscillator, coarse.eta, tip)
    sums = begin_sums(lever, acc)
    way[FROM], way[SIDE] = tip.u[Z0], 1.0
    while periods[MARCHED] < most and way[TURNS] <= MOST_TURNS:
        if found:
            status = follow_and_hold(oscillator, amplitude, step, eta, most, tip, row)
            if status not in (col.NOT_CONVERGED, col.UNSTABLE):
                return status
            if status == col.UNSTABLE:
                way[TURNS] += 1.0
            periods[PATTERN], wait, sums = 1, SOON, begin_sums(lever, acc)
            way[X], way[Y], way[BEFORE], way[STILL] = acc[COS] - lever[col.SHAKER], acc[SIN], math.inf, 0.0
        ends = move(Oscillator(law, p, slow), amplitude, coarse.eta, min(most, periods[MARCHED] + wait), tip, sums, way)
        if ends == OVER:
            return col.NOT_SETTLED
        if ends == DEEP:
            return col.PRESSED if presses(p, tip) else col.NO_STABLE_ORBIT
        if ends == REACHED:
            if find_pattern(Oscillator(law, p, slow), exact, amplitude, tip):
                return fill_pattern(oscillator, exact.eta, tip, row)
            if periods[MARCHED] + 3 * GROUP * block_of(slow) < most:
                return hold_mean(Oscillator(law, p, slow), amplitude, SLOW, eta, most, tip, row)
            way[STILL] = most  # no time for a mean, but a pattern may be found
        if ends != LOOK:
            wait = SOON
        found = find_pattern(Oscillator(law, p, slow), coarse, 0.0, tip)
        wait = min(int(LATER * wait), LATEST)
    return col.NOT_SETTLED
