"""The cheap path to an exact orbit: averaged decision, then the lever's response, each handed on where it is in doubt.

Where averaging leaves the side open, the maximum of the mismatch is sought again with the lever's response
in it, and what it then leaves open is for the curve of exact orbits.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels.columns import ALPHA0, GOOD, LONGRANGE, PENDING, RELEASE, STIFF
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.averaged import DOUBTFUL, OPEN, SURE, question, settle_side, worst_amplitude
from phasemap._kernels.engagement.averaged import engage as engage_averaged
from phasemap._kernels.engagement.resonance import ATTRACTIVE, GAP, REPULSIVE, UNCLEAR, leaps, narrowest, pull
from phasemap._kernels.engagement.resonance import HEIGHT as HIGHEST
from phasemap._kernels.law import Law
from phasemap._kernels.lever import free_amplitude, reach_of
from phasemap._kernels.orbits.response.orbit import Room, refine, steep
from phasemap._kernels.orbits.response.passes import AMP, DRAG, PUSH, SLOPE, E, beside_resonance, converge, start

LOWEST_Q = 25.0  # below this averaging does not choose the branch
TIGHT = 0.015  # mismatch at the exact maximum that decides
MOST_SHIFTS = 3  # of three points, to where orbits are found
FAR_BELOW = -0.15  # the same where one point and the averaged maximum are enough


@kernel
def engage(law: Law, p: np.ndarray, lever: np.ndarray, amplitude: float, guess: np.ndarray, top: np.ndarray) -> int:
    """How sure the branch is, after looking at averaged orbits; where it is SURE the orbit is in `guess`."""
    if p[RELEASE] != 0.0:
        return DOUBTFUL  # where a contact lasts longer than its depth says, curves of orbits end
    if lever[ALPHA0] > 0.5 / LOWEST_Q:
        return question(law, p, lever, amplitude, top)
    status, surety = engage_averaged(law, p, lever, amplitude, guess, top)
    return surety if status == GOOD else DOUBTFUL


@kernel
def _held(
    law: Law, p: np.ndarray, lever: np.ndarray, reach: float, amplitude: float, gap: float, f: np.ndarray,
    state: np.ndarray,
) -> float:  # fmt: skip
    """`pull` of the exact orbit with this amplitude and gap, whatever drive it needs; NaN if it is not found."""
    state[:] = 0.0
    state[AMP], state[E], state[SLOPE] = amplitude, amplitude + gap, -1.0 / reach
    if not start(law, p, lever, reach, f, state):
        return math.nan
    if not converge(law, p, lever, f, state, True, 1e-4, math.inf):
        return math.nan
    return pull(lever, amplitude, state[PUSH], state[DRAG])


@kernel
def decide_exactly(
    law: Law, p: np.ndarray, lever: np.ndarray, reach: float, amplitude: float, top: np.ndarray, f: np.ndarray,
    state: np.ndarray, fit: np.ndarray,
) -> int:  # fmt: skip
    """Side on which the tip passes the amplitude at which the attractive branch is nearest to its end.

    Fills fit = (gap of the maximum, mismatch there, its curvature).
    """
    middle = top[GAP]
    step = 0.3 * (reach + abs(middle))
    h0 = _held(law, p, lever, reach, amplitude, middle, f, state)
    if top[HIGHEST] < FAR_BELOW and h0 < FAR_BELOW:
        return REPULSIVE
    h1 = _held(law, p, lever, reach, amplitude, middle + step, f, state)
    h2 = _held(law, p, lever, reach, amplitude, middle - step, f, state)
    for _ in range(MOST_SHIFTS):
        if math.isfinite(h0 + h1 + h2) or not beside_resonance(lever):
            break
        middle, h1, h0 = middle - step, h0, h2  # passes may not converge where a tip just touches
        h2 = _held(law, p, lever, reach, amplitude, middle - step, f, state)
    bend = (h1 - 2.0 * h0 + h2) / (step * step)
    if not bend < 0.0:
        return UNCLEAR
    at = min(max(middle - 0.5 * (h1 - h2) / (step * bend), middle - 2.0 * step), middle + 2.0 * step)
    h = _held(law, p, lever, reach, amplitude, at, f, state)
    fit[0], fit[1], fit[2] = at, h, bend
    highest = max(max(h0, h1), max(h2, h))
    if not math.isfinite(h):
        return UNCLEAR
    if highest > TIGHT:
        return ATTRACTIVE
    # The parabola's own maximum must agree, for the points may have missed it.
    return REPULSIVE if max(highest, h0 - (h1 - h2) ** 2 / (8.0 * step * step * bend)) < -TIGHT else UNCLEAR


@kernel
def cheap_orbit(
    law: Law, p: np.ndarray, lever: np.ndarray, amplitude: float, surety: int, limits: np.ndarray, guess: np.ndarray,
    room: Room,
) -> int:  # fmt: skip
    """Exact orbit in room.state: GOOD; STIFF where only `guess` is sure; PENDING where the decision does not hold."""
    reach = reach_of(law, p)
    if surety == SURE:
        return GOOD if refine(law, p, lever, reach, guess, limits, room.nodes, room.state) else STIFF
    if surety != OPEN:
        return PENDING
    side = REPULSIVE
    if p[LONGRANGE] != 0.0:
        worst = worst_amplitude(lever, amplitude)
        side = decide_exactly(law, p, lever, reach, worst, room.top, room.nodes, room.state, room.fit)
        if side == ATTRACTIVE and (narrowest(lever) > 1.0 or leaps(lever, reach, free_amplitude(lever))):
            return PENDING  # the branch may be cut above the free amplitude, or left by the jump to it
    if side == UNCLEAR or not settle_side(law, p, lever, reach, amplitude, side, room.top, guess):
        return PENDING
    if not refine(law, p, lever, reach, guess, limits, room.nodes, room.state):
        return STIFF if side == REPULSIVE else PENDING
    return GOOD if side == REPULSIVE or steep(law, p, lever, limits, room) else PENDING
