"""Which motion the controller finds, by engaging in time: the answer where no curve of periodic orbits gives it.

A lever that swings freely is lowered from far while the equation of motion is marched. As long as the motion repeats
itself every period, the periodic orbit is followed by Newton's method on the map of one period (`period_map`). A
contact with hysteresis that is just touched, a period that doubles, or a tip that sticks for some periods leaves no
such orbit. There the tip offset falls slowly, from period to period, and what counts is what a lock-in shows: the mean
phasor of the first harmonic. Where its modulus comes to the setpoint, `holding` goes on. Theory, Eqs. (irregular-2) to
(irregular-4).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.arrays import copy
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.averages import CHANGE, FEWEST, alike, average, begin_sums, block_of, seen
from phasemap._kernels.engagement.holding import (
    COARSE,
    EAGER,
    OFFSET_ERROR,
    SLOW,
    STATE_ERROR,
    WIDE,
    fine,
    hold,
    hold_mean,
)
from phasemap._kernels.engagement.landed import skip_to
from phasemap._kernels.engagement.leap import strong
from phasemap._kernels.engagement.lowering import (
    AGAIN,
    BESIDE,
    DISTURBED,
    HELD,
    KEPT,
    LAST_GAIN,
    LEFT,
    LOWEST,
    ROUGH,
    SEEN,
    SPENT,
    STILL,
    TRAIL,
    WHOLE,
    fall,
    follow_down,
    pace_of_leap,
    too_far,
)
from phasemap._kernels.engagement.ringing import RINGS, engage_ringing
from phasemap._kernels.engagement.stuck import FREE, REACHED, UNKNOWN, comes_loose, presses, sticks, too_stiff
from phasemap._kernels.law import Oscillator
from phasemap._kernels.lever import free_amplitude, free_phasor
from phasemap._kernels.orbits.time.period_map import Tolerance, fill_orbit, pass_period, rest, skip
from phasemap._kernels.orbits.time.tip import MARCHED, Z0, Tip, amplitude_of, new_tip, ring_down, tip_in

if TYPE_CHECKING:
    from phasemap._kernels.law import Law

FALL = 4e-3  # of the free amplitude, by which z0 falls in FEWEST periods, or a ring-down time, without a periodic orbit
HASTE, CLOSER = 4.0, 0.25  # times faster than that z0 of such a contact falls, at most, and of what is left to go
FELL = 0.05  # of the amplitude, by which it changes in that time only where the motion jumps
STEADY, TAMER = 0.3, 0.5  # of its way, by which the amplitude may not go with z0; and of CHANGE: else it was too fast
LANDING, FINEST = 0.1, 64.0  # of the amplitude that is left, by which it falls in that time; least part of FALL
LEAD = 2.0  # of what its amplitude is too large, by which a tip that came loose is lowered from above where it fell
WAITING = 0.25  # of the periods allowed, in which a motion rings down that is left all of them before `ringing`'s turn
AT_ONCE = 0.05  # of them, after which it is others' turn
NONE_LEFT = 2.0
ALIKE = math.radians(1e-3)  # by which phases of one pattern may differ
AWAY = 5e-3  # of the free amplitude, that a tip without periodic orbit is lowered before one is tried again


@kernel
def pace_of(lever: np.ndarray) -> float:
    """How far [m] z0 moves in a period where no periodic orbit is followed."""
    return FALL * free_amplitude(lever) / max(FEWEST, ring_down(lever))


@kernel
def move_slowly(
    oscillator: Oscillator, amplitude: float, least: float, tolerance: Tolerance, most: int, tip: Tip
) -> int:
    """Lower or raise the tip period by period until the mean amplitude is reached: SEEN, AGAIN, SPENT or LOWEST.

    Past a contact with hysteresis it goes faster as long as amplitude and z0 change alike and the motion stays as
    irregular as it was (else once more, slowly), and ever slower near the end, for the way decides on the pattern of
    taps. AGAIN is said where the motion repeats itself every period, but not before z0 has changed by `least` [m].
    """
    p, lever = oscillator.p, oscillator.lever
    block, slow, from_z0 = block_of(lever), pace_of(lever), tip.u[Z0]
    hasty, haste = p[col.RELEASE] != 0.0, 1.0
    eta = ROUGH * tolerance.eta if hasty else tolerance.eta
    sums, u, acc = begin_sums(lever, tip.acc), tip.u.copy(), tip.acc.copy()
    if tip.periods[MARCHED] + block > most or not average(oscillator, eta, block, (0.0, 0.0, 0.0), tip, sums):
        return SPENT
    before, change = seen(lever, sums), sums[CHANGE]
    down = before > amplitude
    while tip.periods[MARCHED] + block <= most:
        pace = haste * slow
        if hasty:
            pace = max(slow / FINEST, min(pace, LANDING * abs(before - amplitude) / block))
        copy(tip.u, u)
        copy(tip.acc, acc)
        if not average(oscillator, eta, block, (pace if down else -pace, 0.0, 0.0), tip, sums):
            return SPENT
        now = seen(lever, sums)
        led = abs(abs(now - before) - pace * block) > STEADY * pace * block or sums[CHANGE] < TAMER * change
        if haste > 1.0 and led:  # to another motion, perhaps: once more, slowly
            copy(u, tip.u)
            copy(acc, tip.acc)
            sums, haste = begin_sums(lever, acc), 1.0
            continue
        if not hasty and (now <= amplitude) == down and abs(now - before) > FELL * amplitude:
            # Swings after a jump may pass it: what they come to counts.
            wait = int(DISTURBED) * block
            if tip.periods[MARCHED] + wait + block > most:
                return SPENT
            if not average(oscillator, eta, wait, (0.0, 0.0, 0.0), tip, sums):
                return SPENT
            if not average(oscillator, eta, block, (0.0, 0.0, 0.0), tip, sums):
                return SPENT
            now = seen(lever, sums)
        if (now <= amplitude) == down:
            return SEEN
        if too_far(lever, from_z0, tip.u[Z0]):
            return LOWEST
        before, change = now, sums[CHANGE]
        still = change < STILL * (max(amplitude, now) if hasty else amplitude) and alike(sums)
        if still and abs(from_z0 - tip.u[Z0]) > least and skip(oscillator, tolerance, 0.0, tip):
            return AGAIN
        if hasty and not still:
            haste = max(1.0, min(2.0 * haste, HASTE, CLOSER * abs(now - amplitude) / (slow * block)))
        else:
            haste = 1.0
    return SPENT


@kernel
def lower(
    oscillator: Oscillator, amplitude: float, step: float, eta: float, most: int, tip: Tip, row: np.ndarray
) -> int:
    """Lower a tip that swings freely until its amplitude first reaches the setpoint, and hold it; as `approach`."""
    law, p, lever = oscillator
    free = free_amplitude(lever)
    tolerance = Tolerance(COARSE * eta, WIDE * STATE_ERROR * amplitude, WIDE * OFFSET_ERROR)
    least, pace, loose, fell = AWAY * free, pace_of_leap(oscillator), False, tip.u.copy()
    short = WHOLE * ring_down(lever) > most  # for more than to see that the surface catches the tip
    while True:
        if loose and pace > 0.0:
            ends, periodic = fall(oscillator, amplitude, 0.0, 0.0, tolerance, most, tip), False
        else:
            ends = follow_down(oscillator, amplitude, step, TRAIL * pace, tolerance, most, tip)
            periodic = ends == SEEN
        if ends == LEFT and pace > 0.0:
            ends = fall(oscillator, amplitude, pace, least, tolerance, most, tip)
            least *= 2.0
            if short and not (ends == HELD and sticks(p, lever, amplitude, tip)):
                return col.NOT_SETTLED
        elif ends == LEFT:
            ends = move_slowly(oscillator, amplitude, least, tolerance, most, tip)
            least *= 2.0
        if law.memory == 0 and ends in (SEEN, HELD) and sticks(p, lever, amplitude, tip):
            known = periodic or p[col.RELEASE] != 0.0
            if loose or (known and too_stiff(oscillator, amplitude)):
                return col.NO_STABLE_ORBIT
            copy(tip.u, fell)
            comes = comes_loose(oscillator, amplitude, tolerance, most, tip)
            if comes == REACHED:
                return hold(oscillator, amplitude, eta, most, tip, row)
            if comes == FREE and periodic:
                return col.NO_STABLE_ORBIT
            loose = comes != UNKNOWN and (periodic or pace > 0.0)
            if not loose:  # a feedback may lower it faster than it was lowered
                copy(fell, tip.u)
                pass_period(oscillator, tolerance.eta, tip)
            elif comes == FREE:
                tip.u[Z0] = min(tip.u[Z0], fell[Z0] + LEAD * (amplitude_of(lever, tip.acc) - amplitude))
            if loose:
                continue
        leapt = ends == AGAIN and pace > 0.0 and law.memory == 0
        if leapt and skip_to(oscillator, amplitude, tolerance, tip):
            ends = HELD
        if periodic or ends == HELD:
            return hold(oscillator, amplitude, eta, most, tip, row)
        if ends in (SEEN, KEPT):
            gain = SLOW if ends == KEPT else LAST_GAIN if pace > 0.0 else EAGER
            return hold_mean(oscillator, amplitude, gain, eta, most, tip, row)
        if ends == LOWEST and presses(p, tip):
            return col.PRESSED
        if ends != AGAIN:
            return col.NOT_SETTLED if ends == SPENT else col.NO_STABLE_ORBIT


@kernel
def free_tip(law: Law, lever: np.ndarray, z0: float) -> Tip:
    """Return a tip at z0 [m] that touches nothing, of a lever that swings as it does freely."""
    free = free_phasor(lever)
    return new_tip(law, lever, 0.0, free.real, -lever[col.OMEGA] * free.imag, z0)


@kernel
def share_of(oscillator: Oscillator, most: int) -> float:
    """Share of the periods allowed that `lower` has, before `engage_ringing` has its turn: NONE_LEFT if it has none.

    A contact with hysteresis or memory leads to one pattern or another, as it is lowered.
    """
    law, p, lever = oscillator
    if ring_down(lever) < RINGS or p[col.RELEASE] != 0.0 or law.memory != 0:
        return NONE_LEFT
    # Where a lever that leaps over its resonance lands depends on how, unless it is far and adhesion bends it a lot.
    if pace_of_leap(oscillator) > 0.0:
        far = abs(1.0 - lever[col.OMEGA] ** 2) > BESIDE
        return 1.0 if far and strong(oscillator, free_amplitude(lever)) else NONE_LEFT
    return 1.0 if DISTURBED * ring_down(lever) < WAITING * most else AT_ONCE


@kernel
def approach(
    oscillator: Oscillator, amplitude: float, z0: float, step: float, eta: float, most: int, row: np.ndarray
) -> int:
    """Engage from z0 [m]: lower a freely swinging lever until its amplitude first reaches the setpoint, and hold it.

    Parameters
    ----------
    step : float
        Length on which orbits change as the tip comes near [m].
    eta : float
        As for `march_period`.
    most : int
        Periods that may be marched.

    Returns GOOD; NOT_SETTLED after `most` periods; PRESSED where it was lowered as far as a tip is, and into the
    surface for good; NO_STABLE_ORBIT where the amplitude jumps across the setpoint.
    """
    law, lever = oscillator.law, oscillator.lever
    tip, share = free_tip(law, lever, z0), share_of(oscillator, most)
    row[:] = math.nan
    status = lower(oscillator, amplitude, step, eta, int(min(share, 1.0) * most), tip, row)
    if status != col.NOT_SETTLED or share > 1.0:
        return status
    again = free_tip(law, lever, z0)
    began = again.periods[MARCHED] = tip.periods[MARCHED]
    row[:] = math.nan
    status = engage_ringing(oscillator, amplitude, step, eta, most, again, row)
    spent = again.periods[MARCHED]
    if status != col.GOOD or not row[col.SPREAD_AMPLITUDE] > 0.0 or 2 * spent - began > most:
        return status
    # Several patterns may hold the setpoint: what another start does not lead to is found by chance.
    tip, other = free_tip(law, lever, z0 + AWAY * free_amplitude(lever)), np.empty(col.COLUMNS)
    tip.periods[MARCHED] = spent
    if engage_ringing(oscillator, amplitude, step, eta, most, tip, other) != col.GOOD:
        return col.GOOD
    allowed = ALIKE + row[col.ERROR_PHASE] + (other[col.ERROR_PHASE] if other[col.SPREAD_AMPLITUDE] > 0.0 else 0.0)
    return col.GOOD if abs(other[col.PHASE] - row[col.PHASE]) < allowed else col.NOT_SETTLED


@kernel
def carry_to(oscillator: Oscillator, z0: float, eta: float, most: int, u: np.ndarray, row: np.ndarray) -> int:
    """Move a tip in state u = (z, z', touching, its tip offset) slowly to z0 [m], and fill a row with its motion there.

    Returns GOOD, or NOT_SETTLED after `most` periods; u is where it then is.
    """
    p, lever = oscillator.p, oscillator.lever
    tip = tip_in(u)
    count = int(abs(u[Z0] - z0) / pace_of(lever))
    if count >= most or not pass_period(oscillator, eta, tip):
        return col.NOT_SETTLED
    move, sums = ((u[Z0] - z0) / max(count, 1), 0.0, 0.0), begin_sums(lever, tip.acc)
    if not average(oscillator, COARSE * eta, count, move, tip, sums):
        return col.NOT_SETTLED
    u[Z0] = z0
    tolerance = Tolerance(fine(p, eta), STATE_ERROR * free_amplitude(lever), OFFSET_ERROR)
    if rest(oscillator, tolerance, min(int(DISTURBED * ring_down(lever)), most - tip.periods[MARCHED]), tip):
        fill_orbit(lever, tip, row)
        return col.GOOD
    return hold_mean(oscillator, 0.0, 0.0, eta, most, tip, row)


@kernel
def carry_on(oscillator: Oscillator, amplitude: float, eta: float, most: int, u: np.ndarray, row: np.ndarray) -> int:
    """Move a tip in state u slowly until its amplitude is the one asked for, hold it, and fill a row; as `approach`."""
    lever = oscillator.lever
    tip = tip_in(u)
    if not pass_period(oscillator, eta, tip):
        return col.NOT_SETTLED
    tolerance = Tolerance(COARSE * eta, WIDE * STATE_ERROR * amplitude, WIDE * OFFSET_ERROR)
    ends = move_slowly(oscillator, amplitude, AWAY * free_amplitude(lever), tolerance, most, tip)
    if ends == AGAIN:
        return hold(oscillator, amplitude, eta, most, tip, row)
    if ends == SEEN:
        return hold_mean(oscillator, amplitude, EAGER, eta, most, tip, row)
    return col.NOT_SETTLED if ends == SPENT else col.NO_STABLE_ORBIT
