"""Whether a tip that fell onto the sample and sticks comes back to an amplitude before it comes free.

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
from phasemap._kernels.arrays import copy
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.rest import loosened, static_depth
from phasemap._kernels.law import Oscillator, contact_force
from phasemap._kernels.orbits.time.period_map import Tolerance, relaxed, rest, slope_of
from phasemap._kernels.orbits.time.tip import (
    BY_Z0,
    COS,
    DEEPEST,
    MARCHED,
    MEAN,
    SIN,
    TOUCHES,
    Z0,
    Tip,
    V,
    Z,
    amplitude_of,
    ring_down,
)

FALLEN = 0.9  # of the setpoint: less comes of no step along an orbit, but of a fall
SWING = 1.5  # least depth that a tip comes to: so many amplitudes of the first harmonic above its mean
TOO_STIFF, BEYOND = 2.0, 2.0  # over what the drive has for P, and over the largest amplitude of the free lever
LOOKS = 32  # at depths along the neck, and at angles of a swing
STRIDE = 0.1  # of the amplitude, the first step of a tip that is raised
SHORTEST = 0.0125  # of the amplitude, the last one: as closely is its end known
EXPECTED = 0.1  # of the amplitude, by which a longer one may miss a linear prediction
JUMP = 0.05  # of the amplitude, by which it rises more in a step where it jumps
PATIENCE = 8.0  # ring-down times, in which it comes to rest after such a step
REACHED, FREE, LOOSE, UNKNOWN = 0, 1, 2, 3
"""What becomes of a tip that is raised: it comes to the amplitude, or jumps across it, and touches nothing or does."""


@kernel
def presses(p: np.ndarray, tip: Tip) -> bool:
    """Whether the tip was in contact, or the neck, all the last period."""
    acc = tip.acc
    touches = p[col.RELEASE] == 0.0 or tip.u[TOUCHES] != 0.0
    return touches and acc[MEAN] - tip.u[Z0] - SWING * math.hypot(acc[COS], acc[SIN]) >= p[col.RELEASE]


@kernel
def sticks(p: np.ndarray, lever: np.ndarray, amplitude: float, tip: Tip) -> bool:
    """Whether the tip fell across this amplitude [m], and stays in contact."""
    return amplitude_of(lever, tip.acc) < FALLEN * amplitude and presses(p, tip)


@kernel
def pull_off(oscillator: Oscillator) -> float:
    """Highest tip offset [m] at which the lever rests in contact or neck."""
    law, p, lever = oscillator
    highest = -math.inf
    for i in range(LOOKS + 1):
        d = p[col.RELEASE] * i / LOOKS
        highest = max(highest, -contact_force(law, d, p) / lever[col.STIFFNESS] - d)
    return highest


@kernel
def least_push(oscillator: Oscillator, amplitude: float) -> float:
    """In-phase force P [m] of a swing in contact that just reaches release."""
    law, p, lever = oscillator
    total = 0.0
    for i in range(LOOKS):
        cosine = math.cos(math.pi * (i + 0.5) / LOOKS)
        total += contact_force(law, p[col.RELEASE] + amplitude * (1.0 + cosine), p) * cosine
    return 2.0 * total / LOOKS / lever[col.STIFFNESS]


@kernel
def too_stiff(oscillator: Oscillator, amplitude: float) -> bool:
    """Whether no orbit swings by this amplitude [m] in contact, and a tip that comes loose touches nothing.

    Without a neck, an attraction that reaches beyond contact lets a tip leave it for a part of each period: the forces
    do not say then.
    """
    p, lever = oscillator.p, oscillator.lever
    if p[col.RELEASE] == 0.0 and p[col.LONGRANGE] != 0.0:
        return False
    of_tip, drive = amplitude - lever[col.SHAKER], lever[col.BASE]
    if not of_tip > 0.0 or pull_off(oscillator) < BEYOND * drive / (2.0 * lever[col.ALPHA0] * lever[col.OMEGA]):
        return False
    needed = drive + of_tip * abs(1.0 - lever[col.OMEGA] ** 2)
    return least_push(oscillator, of_tip) > TOO_STIFF * needed


@kernel
def comes_loose(oscillator: Oscillator, amplitude: float, tolerance: Tolerance, most: int, tip: Tip) -> int:
    """Raise a tip that sticks along its orbits in contact, to where they end.

    As long as it swings by little about the lever's rest there is nothing to follow. Returns REACHED with the tip near
    the amplitude, FREE or LOOSE where it jumps across it at the end, which is known to `SHORTEST`, or UNKNOWN.
    """
    p, lever = oscillator.p, oscillator.lever
    u, acc, linear, before = tip.u, tip.acc, tip.linear, np.empty(4)
    copy(u, before)
    z0 = loosened(oscillator, u[Z0], amplitude)
    if z0 > u[Z0]:
        u[Z], u[V], u[TOUCHES], u[Z0] = z0 + static_depth(oscillator, z0), 0.0, 1.0, z0
    patience, shortest = int(PATIENCE * ring_down(lever)) + LOOKS, SHORTEST * amplitude
    stride, step, ceiling = STRIDE * amplitude, 0.0, math.inf
    z_slope = v_slope = slope = low = 0.0
    while tip.periods[MARCHED] + patience < most:
        rests, now = rest(oscillator, tolerance, patience, tip), amplitude_of(lever, acc)
        least = step <= shortest
        as_said = least or (abs(now - low - slope * step) < EXPECTED * amplitude and slope_of(linear) * slope >= 0.0)
        if now < amplitude and (as_said if rests else least and step > 0.0 and now < FALLEN * amplitude):
            copy(u, before)
            if rests:
                z_slope, v_slope = relaxed(linear, linear[BY_Z0, Z], linear[BY_Z0, V])
                slope = slope_of(linear)
            stride = max(stride, 2.0 * step) if ceiling == math.inf else 2.0 * step
            low, ceiling = now, ceiling if u[Z0] < ceiling else math.inf
        elif rests and presses(p, tip) and now >= amplitude:
            return REACHED
        elif least:
            if rests and step > 0.0 and now > low + JUMP * amplitude:
                return FREE if acc[DEEPEST] < p[col.RELEASE] else LOOSE
            break
        else:
            if not (rests and now < amplitude):
                ceiling = u[Z0]
            stride = 0.5 * step
            copy(before, u)
        step = min(stride, max(0.5 * (ceiling - u[Z0]), shortest))
        u[Z], u[V], u[Z0] = u[Z] + z_slope * step, u[V] + v_slope * step, u[Z0] + step
    return UNKNOWN
