"""Lowering of a tip to the setpoint: along periodic orbits, and where it is carried over its resonance, in time.

Where a lever leaps it depends on its motion where it lands. There the tip is lowered so slowly that the way of a free
amplitude takes a thousand ring-down times, and is seen behind a low-pass of one ring-down time: as it falls the
amplitude of single periods swings through the setpoint and back. When what is seen falls to the setpoint an integral
feedback holds it, ten times slower than the lever rings down, and ever slower: a tip that it drives through the
setpoint, down and up again, may be held when it comes by more slowly.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.beside_resonance import attraction_defies_averaging
from phasemap._kernels.engagement.by_averaging import forces_are_plain, leaps_to_resonance
from phasemap._kernels.engagement.goal import Goal, coarse_tolerance
from phasemap._kernels.engagement.stuck import in_contact_throughout
from phasemap._kernels.excitation import detected_phasor
from phasemap._kernels.law import Oscillator, has_hysteresis, has_longrange, longrange_force
from phasemap._kernels.lever import FARTHEST_AT_ALL, free_amplitude, near_resonance, reach_of
from phasemap._kernels.numerics import copy
from phasemap._kernels.orbits.time.many_periods import PeriodFlow, begin_flow, pass_many
from phasemap._kernels.orbits.time.period_map import come_to_rest, march_tip, skip_transient
from phasemap._kernels.orbits.time.tip import (
    Z0,
    MovingTip,
    V,
    Way,
    Z,
    amplitude_of,
    amplitude_slope,
    copy_state,
    motion_size,
    move_state,
    ring_down_periods,
    slopes_of_orbit,
)
from phasemap._kernels.records import record

LONGEST_STRIDE = 8.0  # steps of the tip offset on that way, over the one given
SHORTEST_STRIDE = 0.02  # the same, at least
DEEPER_STRIDE = 0.05  # of the depth to which a lever is pressed in: steps of the tip offset there, if that is longer
PREDICTION_MISS = 0.02  # of the amplitude, by which a linear prediction of the next orbit may be off
WELL_PREDICTED = 0.1  # of that: the next step may be twice as long
FIRST_STRIDE, SHORTER = 0.1, 0.25  # the first step over the one given, and a shorter one over the one before
SLOPED = 1e-3  # [1], dA/dz0 of an amplitude that surely falls or rises with the tip
DISTURBED = 8.0  # ring-down times in which a motion that lost its orbit may find another
DISTURBED_NECK = 1.0  # the same of a contact with hysteresis: it mostly finds none
STILL_MOTION = 1e-3  # of the amplitude, change of the phasor from period to period at which an orbit is tried for
LEAP_PACE = 1e-3  # of the free amplitude, by which a tip that may leap is lowered in a ring-down time
ROUGH_STEPS = 1.6  # longer steps of the march where the tip is on its way
# Of 1 - omega^2: farther off lever and drive part by 0.1 rad a period, and falls are violent, as they are where
# adhesion bends the lever a lot: there every period is marched.
FAR_BESIDE = 0.03
MANY_PERIODS_MISS = 1e-2  # of the reach, by which a step of many periods may be off
TRAIL_PERIODS = 16.0  # periods of that, in which it is moved at once to see whether it comes to rest
FEWEST_RINGING = 4  # periods, or a ring-down time, behind which its amplitude is seen
FIRST_GAIN = 0.1  # of the amplitude's error, by which the feedback moves it in a ring-down time, at first
GAIN_HALVES = 50.0  # ring-down times in which that halves; after so many more it is a third, and so on
FEEDBACK_PATIENCE = 400.0  # ring-down times in which the feedback has to come to rest
FEEDBACK_SHARE = 0.3  # of the periods allowed, after which the mean of a motion that does not is taken
LAST_GAIN = FIRST_GAIN / (1.0 + FEEDBACK_PATIENCE / GAIN_HALVES)
# How lowering ends.
AMPLITUDE_REACHED = 0  # reached
ORBIT_LEFT = 1  # no periodic orbit
TIME_SPENT = 2
LOWEST_OFFSET = 3  # as low as a tip is lowered
ORBIT_AGAIN = 4  # periodic again
ORBIT_HELD = 5  # on the amplitude
MOTION_KEPT = 6  # on the amplitude, and not periodic
KEPT_WITHIN = 0.01  # of the amplitude, by which what is seen may miss it to be MOTION_KEPT
KEPT_FOR = 40  # ring-down times of that
DEEPEST = 30.0  # free amplitudes by which a lever is lowered past the surface, near resonance of those there
WHOLE_FALL = 64.0  # ring-down times that a fall takes with what comes before and after, unless the tip sticks


@kernel(light=True)
def deepest_offset(lever: np.ndarray) -> float:
    """Lowest tip offset [m] of an approach: -30 free amplitudes, near resonance -30 of those at the resonance."""
    if not near_resonance(lever):
        return -DEEPEST * free_amplitude(lever)
    return -0.5 * DEEPEST * lever[col.DRIVE] / lever[col.ALPHA0]


@kernel
def too_far(lever: np.ndarray, from_z0: float, z0: float) -> bool:
    """True if a tip left the range of offsets: `deepest_offset`, and as far above both surface and where it began."""
    lowest = deepest_offset(lever)
    return not lowest < z0 < max(from_z0, 0.0) - lowest


@kernel
def pace_of_leap(oscillator: Oscillator) -> float:
    """Step down of the tip per period [m] where attraction may carry the lever over its resonance; 0 where it does not.

    Forces no more attractive than f0 have an in-phase force P >= -2/pi f0/k. Where that leaves A (1 - omega^2) + P
    above zero from the free amplitude on, no orbit comes to the resonance.
    """
    law, p, lever = oscillator
    free = free_amplitude(lever)
    # A contact with hysteresis leaves its orbits by sticking, at any frequency.
    smooth = has_longrange(p) and forces_are_plain(oscillator)
    if not (smooth and leaps_to_resonance(oscillator)):
        return 0.0
    if -longrange_force(law, 0.0, p) < lever[col.STIFFNESS] * free * lever[col.DYNAMIC_STIFFNESS]:
        return 0.0
    return LEAP_PACE * free / max(FEWEST_RINGING, ring_down_periods(lever))


@kernel
def follow_down(oscillator: Oscillator, goal: Goal, step: float, trail: float, tip: MovingTip) -> int:
    """Lower the tip along periodic orbits until the amplitude is reached; returns how the motion ends.

    Steps of the tip offset are longer where the linear prediction of the next orbit is good, and short where the orbit
    ends. From there the motion is marched, at first for some ring-down times. LOWEST_OFFSET: a centimetre down.
    """
    p, lever, amplitude, tolerance = oscillator.p, oscillator.lever, goal.amplitude, coarse_tolerance(goal)
    u, linear, slopes = tip.u, tip.linear, Way()
    before, predicted = np.empty(motion_size(lever)), np.empty(motion_size(lever))
    patience = int((DISTURBED if not has_hysteresis(p) else DISTURBED_NECK) * ring_down_periods(lever))
    stride, slope = 0.0, 0.0
    while tip.periods.marched < goal.most_periods:
        if u[Z0] < -FARTHEST_AT_ALL:
            return LOWEST_OFFSET
        copy_state(u, before)
        move_state(lever, slopes, -stride, u)
        copy_state(u, predicted)
        rests = skip_transient(oscillator, tolerance, 0.0, tip)
        missed = math.hypot(u[Z] - predicted[Z], u[V] - predicted[V]) if rests else math.inf
        turned = (
            rests and amplitude_slope(linear) < -SLOPED and slope > SLOPED
        )  # the amplitude has a minimum on the way
        small = stride <= SHORTEST_STRIDE * step
        if not small and (turned or missed > PREDICTION_MISS * amplitude):
            stride *= SHORTER
            copy(before, u)
            if rests or trail == 0.0:
                continue
            # A tip that moves trails its orbit, and loses one that draws in its closest neighbours only.
            u[Z0] -= trail
            missed = math.inf
            if not skip_transient(oscillator, tolerance, 0.0, tip):
                return ORBIT_LEFT
        elif not rests and trail > 0.0 and stride > 0.0:
            copy(before, u)
            return ORBIT_LEFT
        elif not rests:
            copy(before, u)
            u[Z0] -= stride
            if not come_to_rest(oscillator, tolerance, min(patience, goal.most_periods - tip.periods.marched), tip):
                return ORBIT_LEFT
        if amplitude_of(lever, tip.acc) <= amplitude:
            return AMPLITUDE_REACHED
        slope = slopes_of_orbit(linear, slopes)
        if stride == 0.0:
            stride = FIRST_STRIDE * step
        elif missed < WELL_PREDICTED * PREDICTION_MISS * amplitude:
            stride = min(2.0 * stride, max(LONGEST_STRIDE * step, -DEEPER_STRIDE * u[Z0]))
    return TIME_SPENT


class Fall(NamedTuple):
    """Settings of a tip that is lowered in time."""

    amplitude: float  # at which a feedback takes over [m]
    pace: float  # by which it is lowered in a period until then [m]
    step_size: float  # as for `march_oscillator`
    gentle: bool  # whether many periods may be passed at once


@record
class FilteredMotion:
    """The motion of a falling tip behind a low-pass of one ring-down time."""

    cos: float  # phasor [m]
    sin: float
    held: int  # periods since the feedback took over, 0 before
    change: float  # largest change of the phasor from period to period in the last ring-down time [m]
    missed: float  # largest error of the amplitude in that time [m]


@kernel
def falls_gently(oscillator: Oscillator) -> bool:
    """True if a fall is smooth enough for many periods at once.

    The phase of a ringing mode above the first changes from each period to the next, which allows no long steps.
    """
    law, lever = oscillator.law, oscillator.lever
    gentle = law.memory == 0 and lever[col.MODES] < 2 and abs(lever[col.DYNAMIC_STIFFNESS]) < FAR_BESIDE
    return gentle and not attraction_defies_averaging(oscillator)


@kernel
def pass_ring_down_time(
    oscillator: Oscillator, fall: Fall, ring: int, tip: MovingTip, flow: PeriodFlow, motion: FilteredMotion
) -> bool:
    """March for a ring-down time, in which the tip is lowered, or held by the feedback; False where marching fails."""
    lever = oscillator.lever
    acc, passed, allowed = tip.acc, 0, MANY_PERIODS_MISS * reach_of(oscillator.p)
    motion.change = motion.missed = 0.0
    while passed < ring:
        last_x, last_y, many = acc.cos, acc.sin, 1
        if motion.held == 0 and fall.gentle:
            flow.count = min(flow.count, ring)
            many = pass_many(oscillator, ROUGH_STEPS * fall.step_size, fall.pace, allowed, tip, flow)
        else:
            off = math.hypot(motion.cos, motion.sin) - fall.amplitude
            gain = FIRST_GAIN / (ring + motion.held / GAIN_HALVES)
            tip.u[Z0] -= fall.pace if motion.held == 0 else gain * off
            many = 1 if march_tip(oscillator, fall.step_size, tip) else 0
        if many == 0:
            return False
        passed += many
        motion.change = max(motion.change, math.hypot(acc.cos - last_x, acc.sin - last_y) / many)
        late_x, late_y, behind = acc.cos, acc.sin, float(ring)
        if many > 1:
            late_x, late_y = 0.5 * (last_x + acc.cos), 0.5 * (last_y + acc.sin)
            behind = 1.0 / (1.0 - (1.0 - 1.0 / ring) ** many)
        late_x, late_y = detected_phasor(lever, late_x, late_y)
        motion.cos += (late_x - motion.cos) / behind
        motion.sin += (late_y - motion.sin) / behind
        off = math.hypot(motion.cos, motion.sin) - fall.amplitude
        if motion.held > 0 or off <= 0.0:
            motion.held += 1
        motion.missed = max(motion.missed, abs(off))
    return True


@kernel
def end_of_fall(oscillator: Oscillator, goal: Goal, far: bool, tip: MovingTip, motion: FilteredMotion) -> int:
    """End of a fall by the filtered motion; ORBIT_LEFT while it goes on. Orbits above the amplitude count if `far`."""
    ring, amplitude = max(FEWEST_RINGING, ring_down_periods(oscillator.lever)), goal.amplitude
    still, held, tolerance = motion.change < STILL_MOTION * amplitude, motion.held > 0, coarse_tolerance(goal)
    if motion.held > FEEDBACK_PATIENCE * ring or (held and tip.periods.marched > FEEDBACK_SHARE * goal.most_periods):
        if not still:
            return AMPLITUDE_REACHED
        return ORBIT_AGAIN if math.hypot(motion.cos, motion.sin) > amplitude else ORBIT_HELD
    if still and held:
        if in_contact_throughout(oscillator.p, tip):
            return ORBIT_AGAIN if amplitude_of(oscillator.lever, tip.acc) > amplitude else ORBIT_HELD
        if skip_transient(oscillator, tolerance, amplitude, tip):
            return ORBIT_HELD
    elif still and far and skip_transient(oscillator, tolerance, 0.0, tip):
        return ORBIT_AGAIN
    return ORBIT_LEFT


@kernel
def fall_to_setpoint(oscillator: Oscillator, goal: Goal, pace: float, least: float, tip: MovingTip) -> int:
    """Lower the tip by `pace` [m] a period until its motion repeats itself, above the amplitude or at it.

    A pace of 0 leaves it to the feedback from the start.

    Returns ORBIT_AGAIN or ORBIT_HELD, also where it stays in contact above the amplitude or below. Else MOTION_KEPT
    where the feedback holds it so for long, AMPLITUDE_REACHED where it does not come to rest, TIME_SPENT or
    LOWEST_OFFSET. An orbit above the amplitude is not looked for before z0 has fallen by `least` [m].
    """
    lever, acc, u, amplitude, tolerance = oscillator.lever, tip.acc, tip.u, goal.amplitude, coarse_tolerance(goal)
    ring, motion, flow, steady = max(FEWEST_RINGING, ring_down_periods(lever)), FilteredMotion(), PeriodFlow(), 0
    if not march_tip(oscillator, tolerance.step_size, tip):
        return TIME_SPENT
    motion.cos, motion.sin = detected_phasor(lever, acc.cos, acc.sin)
    motion.held, from_z0 = 0 if pace > 0.0 else 1, u[Z0]
    fall = Fall(amplitude, pace, tolerance.step_size, falls_gently(oscillator))
    if motion.held == 0 and fall.gentle and not begin_flow(oscillator, ROUGH_STEPS * fall.step_size, pace, tip, flow):
        return TIME_SPENT
    while tip.periods.marched + ring <= goal.most_periods:
        if not pass_ring_down_time(oscillator, fall, ring, tip, flow, motion):
            return TIME_SPENT
        if too_far(lever, from_z0, u[Z0]):
            return LOWEST_OFFSET
        ends = end_of_fall(oscillator, goal, from_z0 - u[Z0] > least, tip, motion)
        if ends != ORBIT_LEFT:
            return ends
        steady = steady + 1 if motion.held > 0 and motion.missed < KEPT_WITHIN * amplitude else 0
        if steady >= KEPT_FOR:
            return MOTION_KEPT
    return TIME_SPENT
