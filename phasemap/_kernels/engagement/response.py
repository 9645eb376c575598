"""The cheap path to an exact orbit: averaged decision, then the lever's response, each handed on where it is in doubt.

Where averaging leaves the side open, the maximum of the mismatch is sought again with the lever's response in it
(`end`), and what that leaves open is for the curve of exact orbits.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels.columns import (
    DYNAMIC_STIFFNESS,
    G_P,
    G_Z0,
    GOOD,
    KNOWN,
    LONGRANGE,
    NOT_CONVERGED,
    PENDING,
    RELEASE,
)
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.averaged import (
    DOUBTFUL,
    LEAP,
    SURE,
    UNDECIDED,
    certainty_at_low_q,
    settle_side,
    worst_amplitude,
)
from phasemap._kernels.engagement.averaged import engage_by_averaging as engage_averaged
from phasemap._kernels.engagement.end import (
    decide_by_refined_maximum,
    decide_exactly,
    fill_orbit_outside_maximum,
    maximum_of_exact_mismatch,
)
from phasemap._kernels.engagement.rebound import rebounds
from phasemap._kernels.engagement.resonance import (
    REPULSIVE,
    UNCLEAR,
    Maximum,
    attraction_is_too_weak,
    leaps,
    narrowest_amplitude_ratio,
)
from phasemap._kernels.law import Oscillator
from phasemap._kernels.lever import free_amplitude, low_q, reach_of
from phasemap._kernels.orbits.response.orbit import Room, grazes, refine, slope_is_clear


@kernel
def engage_by_response(oscillator: Oscillator, amplitude: float, guess: np.ndarray, top: Maximum) -> int:
    """Certainty of the branch, judged by averaged orbits; where it is SURE, `guess` holds the orbit."""
    p, lever = oscillator.p, oscillator.lever
    if p[RELEASE] != 0.0:
        return DOUBTFUL  # where a contact lasts longer than its depth says, curves of orbits end
    if low_q(lever):
        return certainty_at_low_q(oscillator, amplitude, top)
    status, surety = engage_averaged(oscillator, amplitude, guess, top)
    if status != GOOD:
        return DOUBTFUL
    return LEAP if surety == SURE and rebounds(oscillator, guess[G_P]) else surety


@kernel
def cheap_orbit(
    oscillator: Oscillator, amplitude: float, surety: int, limits: np.ndarray, guess: np.ndarray, room: Room
) -> int:
    """Exact orbit in room.state: GOOD; KNOWN where only `guess` is sure; PENDING where the decision does not hold.

    NOT_CONVERGED where only time tells.
    """
    law, p, lever = oscillator
    reach = reach_of(law, p)
    if surety == SURE:
        if refine(oscillator, reach, guess, limits, room):
            return GOOD
        return PENDING if grazes(p, reach, guess) else KNOWN
    if surety != UNDECIDED:
        return PENDING
    side, worst = REPULSIVE, amplitude
    if p[LONGRANGE] != 0.0:
        worst = worst_amplitude(lever, amplitude)
        room.fit.gap = room.fit.mismatch = room.fit.curvature = math.nan
        leapt, low = leaps(lever, reach, free_amplitude(lever)), low_q(lever)
        if leapt or not low or not attraction_is_too_weak(lever, worst, room.top.mismatch):
            side = decide_exactly(oscillator, reach, worst, room.top, room.nodes, room.state, room.fit)
        # At high Q a leap is known to end on the attractive branch.
        if side != REPULSIVE and (narrowest_amplitude_ratio(lever) > 1.0 or (leapt and low)):
            return PENDING  # the branch may be cut above the free amplitude, or left by the jump to it
        if side == UNCLEAR:
            side = decide_by_refined_maximum(oscillator, reach, amplitude, worst, room)
        if leapt and not low and (guess[G_P] + amplitude * lever[DYNAMIC_STIFFNESS]) * side < 0.0:
            return PENDING  # the averaged curve ends elsewhere
    if side == UNCLEAR:
        return PENDING
    known, outside = settle_side(oscillator, reach, amplitude, side, room.top, guess), False
    if side == REPULSIVE and not known:
        return PENDING
    if side == REPULSIVE and rebounds(oscillator, guess[G_P]):
        return NOT_CONVERGED
    while True:
        if known and refine(oscillator, reach, guess, limits, room):
            if side == REPULSIVE or slope_is_clear(oscillator, limits, room):
                break
        if side == REPULSIVE or outside:
            return KNOWN
        if worst != amplitude:
            maximum_of_exact_mismatch(oscillator, reach, amplitude, room)
        known = outside = fill_orbit_outside_maximum(oscillator, reach, amplitude, guess, room)
        if not outside:
            return PENDING
    if outside:
        guess[G_Z0] = math.nan  # no averaged orbit, which could stand for this one
    return GOOD
