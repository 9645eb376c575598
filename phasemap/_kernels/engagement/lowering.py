"""How a tip is lowered to the setpoint: along periodic orbits, and where it is carried over its resonance, in time.

Where a lever leaps it depends on its motion where it lands. There the tip is lowered so slowly that the way of a free
amplitude takes a thousand ring-down times, and is seen behind a low-pass of one ring-down time: as it falls the
amplitude of single periods swings through the setpoint and back. When what is seen falls to the setpoint an integral
feedback holds it, ten times slower than the lever rings down, and ever slower: a tip that it drives through the
setpoint, down and up again, may be held when it comes by more slowly.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.leap import strong
from phasemap._kernels.engagement.resonance import FARTHEST_AT_ALL, leaps, near_resonance
from phasemap._kernels.engagement.stuck import presses
from phasemap._kernels.law import Oscillator, longrange_force
from phasemap._kernels.lever import free_amplitude, reach_of
from phasemap._kernels.orbits.time.many_periods import FLOW, NEXT, begin_flow, pass_many
from phasemap._kernels.orbits.time.period_map import Tolerance, pass_period, relaxed, rest, skip, slope_of
from phasemap._kernels.orbits.time.tip import BY_Z0, COS, MARCHED, SIN, Z0, Tip, V, Z, amplitude_of, ring_down

if TYPE_CHECKING:
    pass

LONGEST, SHORTEST = 8.0, 0.02  # steps of the tip offset on that way, over the one given
DEEPER = 0.05  # of the depth to which a lever is pressed in: steps of the tip offset there, if that is longer
PREDICTED = 0.02  # of the amplitude, by which a linear prediction of the next orbit may be off
DISTURBED = 8.0  # ring-down times in which a motion that lost its orbit may find another
STUCK = 1.0  # the same of a contact with hysteresis: it mostly finds none
STILL = 1e-3  # of the amplitude, change of the phasor from period to period at which an orbit is tried for
PACE = 1e-3  # of the free amplitude, by which a tip that may leap is lowered in a ring-down time
ROUGH = 1.6  # longer steps of the march where the tip is on its way
BESIDE = 0.03  # of 1 - omega^2: farther off lever and drive part by 0.1 rad a period, and falls are violent, as they
# are where adhesion bends the lever a lot: there every period is marched
ASTRAY = 1e-2  # of the reach, by which a step of many periods may be off
TRAIL = 16.0  # periods of that, in which it is moved at once to see whether it comes to rest
FEWEST = 4  # periods, or a ring-down time, behind which its amplitude is seen
GAIN = 0.1  # of the amplitude's error, by which the feedback moves it in a ring-down time, at first
SLOWER = 50.0  # ring-down times in which that halves; after so many more it is a third, and so on
PATIENCE = 400.0  # ring-down times in which the feedback has to come to rest
SHARE = 0.3  # of the periods allowed, after which the mean of a motion that does not is taken
LAST_GAIN = GAIN / (1.0 + PATIENCE / SLOWER)
SEEN, LEFT, SPENT, LOWEST, AGAIN, HELD, KEPT = 0, 1, 2, 3, 4, 5, 6
"""How lowering ends: amplitude reached, no periodic orbit, no time left, pressed in without end, periodic again; and
held on the amplitude, by a periodic orbit or a motion that is none."""
EVEN, LONG = 0.01, 40  # of the amplitude, by which what is seen may miss it for so many ring-down times to be KEPT
WHOLE = 64.0  # ring-down times that a fall takes with what comes before and after, unless the tip sticks


@kernel(light=True)
def deepest(lever: np.ndarray) -> float:
    """Tip offset [m] down to which a tip is lowered: -30 free amplitudes, near resonance of those at it."""
    if not near_resonance(lever):
        return -30.0 * free_amplitude(lever)
    return -15.0 * lever[col.BASE] / lever[col.ALPHA0]


@kernel
def too_far(lever: np.ndarray, from_z0: float, z0: float) -> bool:
    """Whether a tip is as low as it is lowered, or as much above the surface and where it began."""
    lowest = deepest(lever)
    return not lowest < z0 < max(from_z0, 0.0) - lowest


@kernel
def pace_of_leap(oscillator: Oscillator) -> float:
    """How far [m] a tip is lowered in a period that may be carried over its resonance; 0 where it is not.

    Forces no more attractive than f0 have an in-phase force P >= -2/pi f0/k. Where that leaves A (1 - omega^2) + P
    above zero from the free amplitude on, no orbit comes to the resonance.
    """
    law, p, lever = oscillator
    free = free_amplitude(lever)
    # A contact with hysteresis leaves its orbits by sticking, at any frequency.
    smooth = p[col.LONGRANGE] != 0.0 and p[col.RELEASE] == 0.0
    if not (smooth and leaps(lever, reach_of(law, p), free)):
        return 0.0
    if -longrange_force(law, 0.0, p) < lever[col.STIFFNESS] * free * (1.0 - lever[col.OMEGA] ** 2):
        return 0.0
    return PACE * free / max(FEWEST, ring_down(lever))


@kernel
def follow_down(
    oscillator: Oscillator, amplitude: float, step: float, trail: float, tolerance: Tolerance, most: int, tip: Tip
) -> int:
    """Lower the tip along periodic orbits until the amplitude is reached; returns SEEN, LEFT, SPENT or LOWEST.

    LOWEST is said where the tip does not leave the surface any more, or a hundredth of a metre down.

    Steps of the tip offset are longer where the linear prediction of the next orbit is good, and short where the orbit
    ends; what comes next is then for time to say, at first for some ring-down times.
    """
    p, lever = oscillator.p, oscillator.lever
    u, linear, before = tip.u, tip.linear, np.empty(4)
    lowest = deepest(lever)
    patience = int((DISTURBED if p[col.RELEASE] == 0.0 else STUCK) * ring_down(lever))
    stride, slope, z_slope, v_slope = 0.0, 0.0, 0.0, 0.0
    while tip.periods[MARCHED] < most:
        if u[Z0] < lowest and (presses(p, tip) or u[Z0] < -FARTHEST_AT_ALL):
            return LOWEST
        for j in range(4):
            before[j] = u[j]
        z, v = u[Z] - z_slope * stride, u[V] - v_slope * stride
        u[Z], u[V], u[Z0] = z, v, u[Z0] - stride
        rests = skip(oscillator, tolerance, 0.0, tip)
        off = math.hypot(u[Z] - z, u[V] - v) if rests else math.inf
        turned = rests and slope_of(linear) < -1e-3 and slope > 1e-3  # the amplitude has a minimum on the way
        small = stride <= SHORTEST * step
        if not small and (turned or off > PREDICTED * amplitude):
            stride *= 0.25
            for j in range(4):
                u[j] = before[j]
            if rests or trail == 0.0:
                continue
            # A tip that moves trails its orbit, and loses one that draws in its closest neighbours only.
            u[Z0] -= trail
            off = math.inf
            if not skip(oscillator, tolerance, 0.0, tip):
                return LEFT
        elif not rests and trail > 0.0 and stride > 0.0:
            for j in range(4):
                u[j] = before[j]
            return LEFT
        elif not rests:
            for j in range(4):
                u[j] = before[j]
            u[Z0] -= stride
            if not rest(oscillator, tolerance, min(patience, most - tip.periods[MARCHED]), tip):
                return LEFT
        if amplitude_of(lever, tip.acc) <= amplitude:
            return SEEN
        slope = slope_of(linear)
        z_slope, v_slope = relaxed(linear, linear[BY_Z0, Z], linear[BY_Z0, V])
        if stride == 0.0:
            stride = 0.1 * step
        elif off < 0.1 * PREDICTED * amplitude:
            stride = min(2.0 * stride, max(LONGEST * step, -DEEPER * u[Z0]))
    return SPENT


@kernel
def fall(
    oscillator: Oscillator, amplitude: float, pace: float, least: float, tolerance: Tolerance, most: int, tip: Tip
) -> int:
    """Lower the tip by `pace` [m] a period until its motion repeats itself, AGAIN above the amplitude or HELD at it.

    A pace of 0 leaves it to the feedback from the start.

    AGAIN and HELD too where it stays in contact, above the amplitude and below. Else KEPT where the feedback holds it
    so for long, SEEN where it does not come to rest, SPENT or LOWEST. An orbit above the amplitude is not looked for
    before z0 has fallen by `least` [m].
    """
    law, p, lever = oscillator
    u, acc, ring = tip.u, tip.acc, max(FEWEST, ring_down(lever))
    if not pass_period(oscillator, tolerance.eta, tip):
        return SPENT
    x, y = acc[COS] - lever[col.SHAKER], acc[SIN]
    from_z0, steady = u[Z0], 0
    seen, flow, allowed = 0 if pace > 0.0 else 1, np.zeros(FLOW), ASTRAY * reach_of(law, p)
    gentle = law.memory == 0 and abs(1.0 - lever[col.OMEGA] ** 2) < BESIDE
    gentle = gentle and not strong(oscillator, free_amplitude(lever))
    if seen == 0 and gentle and not begin_flow(oscillator, ROUGH * tolerance.eta, pace, tip, flow):
        return SPENT
    while tip.periods[MARCHED] + ring <= most:
        change, missed, passed = 0.0, 0.0, 0
        while passed < ring:
            last_x, last_y, many = acc[COS], acc[SIN], 1
            if seen == 0 and gentle:
                flow[NEXT] = min(flow[NEXT], ring)
                many = pass_many(oscillator, ROUGH * tolerance.eta, pace, allowed, tip, flow)
                if many == 0:
                    return SPENT
            else:
                u[Z0] -= pace if seen == 0 else GAIN / (ring + seen / SLOWER) * (math.hypot(x, y) - amplitude)
                if not pass_period(oscillator, tolerance.eta, tip):
                    return SPENT
            passed += many
            change = max(change, math.hypot(acc[COS] - last_x, acc[SIN] - last_y) / many)
            late_x, late_y = acc[COS], acc[SIN]
            behind = float(ring)
            if many > 1:
                late_x, late_y = 0.5 * (last_x + acc[COS]), 0.5 * (last_y + acc[SIN])
                behind = 1.0 / (1.0 - (1.0 - 1.0 / ring) ** many)
            x += (late_x - lever[col.SHAKER] - x) / behind
            y += (late_y - y) / behind
            if seen > 0 or math.hypot(x, y) <= amplitude:
                seen += 1
            missed = max(missed, abs(math.hypot(x, y) - amplitude))
        if too_far(lever, from_z0, u[Z0]):
            return LOWEST
        still = change < STILL * amplitude
        if seen > PATIENCE * ring or (seen > 0 and tip.periods[MARCHED] > SHARE * most):
            return SEEN if not still else AGAIN if math.hypot(x, y) > amplitude else HELD
        if still:
            if seen > 0 and presses(p, tip):
                return AGAIN if amplitude_of(lever, acc) > amplitude else HELD
            if seen > 0 and skip(oscillator, tolerance, amplitude, tip):
                return HELD
            if seen == 0 and from_z0 - u[Z0] > least and skip(oscillator, tolerance, 0.0, tip):
                return AGAIN
        steady = steady + 1 if seen > 0 and missed < EVEN * amplitude else 0
        if steady >= LONG:
            return KEPT
    return SPENT
