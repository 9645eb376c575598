"""Test whether a tip that fell onto the sample and sticks comes back to an amplitude before it comes free.

It is raised until adhesion lets go, at the latest where the lever no longer rests in contact. If that is so far up that
a free tip touches nothing, the lever swings freely from then on, is lowered again as it was before, and falls where it
fell: a feedback hunts for ever. Unless, on the way, it swings by the setpoint while it touches. In contact all the time
the depth is d_r or more, and the in-phase force P of a swing A = d cos least where d_r is just reached, for a contact
gets stiffer with depth; and by X = P + A (1 - omega^2) <= u0 an orbit has no more than u0 - A (1 - omega^2) of it.
Where that decides nothing, a softening neck or an attraction that reaches beyond contact, the tip is raised in time.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.goal import Goal, coarse_tolerance
from phasemap._kernels.excitation import likely_amplitude
from phasemap._kernels.law import Oscillator, contact_force, has_hysteresis, has_longrange
from phasemap._kernels.numerics import copy
from phasemap._kernels.orbits.time.period_map import come_to_rest, march_tip
from phasemap._kernels.orbits.time.tip import (
    TOUCHES,
    Z0,
    MovingTip,
    Way,
    amplitude_of,
    amplitude_slope,
    copy_state,
    motion_size,
    move_state,
    ring_down_periods,
    slopes_of_orbit,
)

FALLEN = 0.9  # of the setpoint: less comes of no step along an orbit, but of a fall
SWING = 1.5  # least depth that a tip comes to: so many amplitudes of the first harmonic above its mean
PUSH_MARGIN = 2.0  # of the least in-phase force P of an orbit in contact, over the largest that the drive balances
BEYOND_FREE = 2.0  # over the largest amplitude of the free lever
ANGLES = 32  # at depths along the neck, and at angles of a swing
RAISING_STRIDE = 0.1  # of the amplitude, the first step of a tip that is raised
LAST_STRIDE = 0.0125  # of the amplitude, the last one: as closely is its end known
RAISING_MISS = 0.1  # of the amplitude, by which a longer one may miss a linear prediction
END_JUMP = 0.05  # of the amplitude, by which it rises more in a step where it jumps
RAISING_PATIENCE = 8.0  # ring-down times, in which it comes to rest after such a step
# Of what its amplitude is too large, by which a tip that came loose is lowered from above where it fell
LEAD_OF_LOOSE = 2.0
# What becomes of a tip that is raised.
REACHES_AMPLITUDE = 0
JUMPS_FREE = 1  # across the amplitude, and touches nothing
JUMPS_TO_TAPPING = 2  # across the amplitude, and taps
NOT_KNOWN = 3


@kernel
def in_contact_throughout(p: np.ndarray, tip: MovingTip) -> bool:
    """True if tip or neck touched the sample during the whole last period."""
    acc = tip.acc
    touches = not has_hysteresis(p) or tip.u[TOUCHES] != 0.0
    return touches and acc.mean_z - tip.u[Z0] - SWING * math.hypot(acc.cos, acc.sin) >= p[col.RELEASE]


@kernel
def sticks(p: np.ndarray, lever: np.ndarray, amplitude: float, tip: MovingTip) -> bool:
    """True if the oscillation collapsed to less than FALLEN times this amplitude [m] and the tip stays in contact."""
    return amplitude_of(lever, tip.acc) < FALLEN * amplitude and in_contact_throughout(p, tip)


@kernel
def pull_off_tip_offset(oscillator: Oscillator) -> float:
    """Tip offset [m] of pull-off: the highest one at which the lever rests in contact or neck."""
    law, p, lever = oscillator
    highest = -math.inf
    for i in range(ANGLES + 1):
        d = p[col.RELEASE] * i / ANGLES
        highest = max(highest, -contact_force(law, d, p) / lever[col.STIFFNESS] - d)
    return highest


@kernel
def least_in_phase_force(oscillator: Oscillator, amplitude: float) -> float:
    """Least in-phase force P [m] of an oscillation in permanent contact: of one that just reaches release."""
    law, p, lever = oscillator
    total = 0.0
    for i in range(ANGLES):
        cosine = math.cos(math.pi * (i + 0.5) / ANGLES)
        total += contact_force(law, p[col.RELEASE] + amplitude * (1.0 + cosine), p) * cosine
    return 2.0 * total / ANGLES / lever[col.STIFFNESS]


@kernel
def contact_too_stiff(oscillator: Oscillator, amplitude: float) -> bool:
    """True if the drive cannot force this amplitude [m] in permanent contact, and a lever pulled off swings freely.

    False where that is not known: without a neck, a long-range attraction lets the tip leave contact in each period.
    """
    p, lever = oscillator.p, oscillator.lever
    if not has_hysteresis(p) and has_longrange(p):
        return False
    of_tip, drive = likely_amplitude(lever, amplitude, 1), lever[col.DRIVE]
    if not of_tip > 0.0 or pull_off_tip_offset(oscillator) < BEYOND_FREE * drive / lever[col.DYNAMIC_LOSS]:
        return False
    needed = drive + of_tip * abs(lever[col.DYNAMIC_STIFFNESS])
    return least_in_phase_force(oscillator, of_tip) > PUSH_MARGIN * needed


@kernel
def raise_along_contact_orbits(oscillator: Oscillator, goal: Goal, tip: MovingTip) -> int:
    """Raise a tip that sticks to the sample along its orbits in contact, to where they end.

    Returns REACHES_AMPLITUDE with the tip near the amplitude, JUMPS_FREE or JUMPS_TO_TAPPING where the motion jumps
    across the amplitude at the end of the orbits, which is known to `LAST_STRIDE`, or NOT_KNOWN.
    """
    p, lever, amplitude, tolerance = oscillator.p, oscillator.lever, goal.amplitude, coarse_tolerance(goal)
    u, acc, linear, before, slopes = tip.u, tip.acc, tip.linear, np.empty(motion_size(lever)), Way()
    copy_state(u, before)
    patience, shortest = int(RAISING_PATIENCE * ring_down_periods(lever)) + ANGLES, LAST_STRIDE * amplitude
    stride, step, ceiling = RAISING_STRIDE * amplitude, 0.0, math.inf
    slope = low = 0.0
    while tip.periods.marched + patience < goal.most_periods:
        rests, now = come_to_rest(oscillator, tolerance, patience, tip), amplitude_of(lever, acc)
        least = step <= shortest
        as_said = least or (
            abs(now - low - slope * step) < RAISING_MISS * amplitude and amplitude_slope(linear) * slope >= 0.0
        )
        if now < amplitude and (as_said if rests else least and step > 0.0 and now < FALLEN * amplitude):
            copy_state(u, before)
            if rests:
                slope = slopes_of_orbit(linear, slopes)
            stride = max(stride, 2.0 * step) if ceiling == math.inf else 2.0 * step
            low, ceiling = now, ceiling if u[Z0] < ceiling else math.inf
        elif rests and in_contact_throughout(p, tip) and now >= amplitude:
            return REACHES_AMPLITUDE
        elif least:
            if rests and step > 0.0 and now > low + END_JUMP * amplitude:
                return JUMPS_FREE if acc.deepest < p[col.RELEASE] else JUMPS_TO_TAPPING
            break
        else:
            if not (rests and now < amplitude):
                ceiling = u[Z0]
            stride = 0.5 * step
            copy(before, u)
        step = min(stride, max(0.5 * (ceiling - u[Z0]), shortest))
        slopes.z0 = 1.0
        move_state(lever, slopes, step, u)
    return NOT_KNOWN


@kernel
def raise_stuck_tip(oscillator: Oscillator, goal: Goal, periodic: bool, slow: bool, tip: MovingTip) -> int:
    """Raise a tip that fell across the amplitude and sticks, from a `periodic` motion, or as it was lowered slowly.

    Returns JUMPS_FREE where no orbit holds the amplitude, JUMPS_TO_TAPPING where the tip can be lowered again,
    REACHES_AMPLITUDE, or NOT_KNOWN with the tip as it was: a feedback may lower it faster than it was lowered.
    """
    p, lever, u, amplitude = oscillator.p, oscillator.lever, tip.u, goal.amplitude
    if (periodic or has_hysteresis(p)) and contact_too_stiff(oscillator, amplitude):
        return JUMPS_FREE
    fell = u.copy()
    comes = raise_along_contact_orbits(oscillator, goal, tip)
    if comes == REACHES_AMPLITUDE or (comes == JUMPS_FREE and periodic):
        return comes
    if comes == NOT_KNOWN or not (periodic or slow):
        copy(fell, u)
        march_tip(oscillator, coarse_tolerance(goal).step_size, tip)
        return NOT_KNOWN
    if comes == JUMPS_FREE:
        u[Z0] = min(u[Z0], fell[Z0] + LEAD_OF_LOOSE * (amplitude_of(lever, tip.acc) - amplitude))
    return JUMPS_TO_TAPPING
