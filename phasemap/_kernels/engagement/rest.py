"""Where the tip lands when the oscillation it came in with ends: in contact for good, or tapping.

A surface that attracts more steeply than the lever is stiff holds the lever itself: at some tip offset the oscillation
is caught and the tip stays in contact, about the static equilibrium. No curve of orbits that can be followed leads
there: it passes orbits that linger at an unstable equilibrium, or ends where the tip first touches a force that jumps.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator, contact_force, contact_slope, damping, longrange_slope
from phasemap._kernels.lever import bend_by_adhesion, lowest_tip_offset
from phasemap._kernels.orbits.collocation.contacts import PERMANENT
from phasemap._kernels.orbits.collocation.linearised import linearise_orbit
from phasemap._kernels.orbits.collocation.newton import NewtonLimits, begin_harmonic, floquet, solve_orbit
from phasemap._kernels.orbits.collocation.system import Orbit, head_of, hold_offset, no_drift

LINGERING = 1e4  # a multiplier as large belongs to an orbit that lingers at an unstable equilibrium, or grazes
LINEAR_SWING = 0.3  # of the depth, a swing that the surface answers like a spring
LANDING_PRECISION = 1e-6  # of the amplitude, at which a landing is known


@kernel
def pressed_in(oscillator: Oscillator, orbit: Orbit) -> bool:
    """Whether the tip stays in contact with the lever pressed in farther than any instrument would."""
    if head_of(orbit).contacts != PERMANENT:
        return False
    return head_of(orbit).tip_offset < lowest_tip_offset(oscillator)


@kernel
def static_depth(oscillator: Oscillator, z0: float) -> float:
    """Deepest depth [m] at which the lever rests in contact, theory, Eq. (engagement-5); NaN if it does at none."""
    law, p, lever = oscillator
    inverse_k = 1.0 / lever[col.STIFFNESS]
    high = 2.0 * (abs(z0) + bend_by_adhesion(oscillator)) + 1e-12
    while z0 + high + inverse_k * contact_force(law, high, p) <= 0.0:
        high *= 2.0
    low = high
    for _ in range(200):
        low = 0.7 * high
        if z0 + low + inverse_k * contact_force(law, low, p) <= 0.0:
            break
        high = low
    else:
        return math.nan
    for _ in range(60):
        middle = 0.5 * (low + high)
        if z0 + middle + inverse_k * contact_force(law, middle, p) <= 0.0:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@kernel
def lets_go(oscillator: Oscillator) -> bool:
    """Whether a tip that loses contact is gone: adhesion ends there, or falls more steeply than the lever is stiff."""
    law, p, lever = oscillator
    if p[col.LONGRANGE] == 0.0:
        return bend_by_adhesion(oscillator) > 0.0
    return lever[col.STIFFNESS] + longrange_slope(law, 0.0, p) < 0.0


@kernel
def resting_amplitude(oscillator: Oscillator, d: float) -> float:
    """Amplitude [m] of the small oscillation of a lever that rests in contact at this depth."""
    law, p, lever = oscillator
    omega = lever[col.OMEGA]
    slope = contact_slope(law, d, p) / lever[col.STIFFNESS]
    alpha = damping(law, d, p) if p[col.DAMPING] != 0.0 else 0.0
    return lever[col.DRIVE] / math.hypot(
        lever[col.DYNAMIC_STIFFNESS] + slope, lever[col.DYNAMIC_LOSS] + 2.0 * alpha * omega
    )


@kernel
def loosened(oscillator: Oscillator, z0: float, amplitude: float) -> float:
    """Tip offset to which the resting lever can be retracted before it swings by much of its depth or the setpoint.

    So far the oscillation is linear about the rest, and there is no need to follow it.
    """
    law, p, lever = oscillator
    d = static_depth(oscillator, z0)
    for _ in range(2000):
        following = 0.98 * d
        if not resting_amplitude(oscillator, following) < min(0.9 * amplitude, LINEAR_SWING * following):
            break
        offset = -following - contact_force(law, following, p) / lever[col.STIFFNESS]
        if not offset > z0:
            break
        d, z0 = following, offset
    return z0


@kernel
def resting(oscillator: Oscillator, z0: float, guess: np.ndarray) -> bool:
    """Fill `guess` with the small oscillation about the lever's rest in contact; False if it rests at no depth."""
    law, p, lever = oscillator
    omega = lever[col.OMEGA]
    d = static_depth(oscillator, z0)
    if math.isnan(d):
        return False
    slope = contact_slope(law, d, p) / lever[col.STIFFNESS]
    alpha = damping(law, d, p) if p[col.DAMPING] != 0.0 else 0.0
    amplitude = resting_amplitude(oscillator, d)
    guess[col.G_Z0], guess[col.G_MEAN], guess[col.G_A] = z0, z0 + d, amplitude
    guess[col.G_P], guess[col.G_S] = slope * amplitude, -2.0 * alpha * omega * amplitude
    return amplitude > 0.0 and math.isfinite(amplitude)


@kernel
def held_there(
    oscillator: Oscillator, tables: np.ndarray, z0: float, guess: np.ndarray, level: int, orbit: Orbit, spare: Orbit
) -> tuple[bool, Orbit, Orbit]:
    """Go from a harmonic orbit to the exact one at this tip offset; True if it is stable."""
    if not guess[col.G_A] > 0.0 or not begin_harmonic(oscillator, tables, orbit, guess, level):
        return False, orbit, spare
    status, _, orbit, spare = solve_orbit(
        oscillator,
        tables,
        orbit,
        spare,
        hold_offset(z0),
        NewtonLimits(level, LANDING_PRECISION * guess[col.G_A], 20, False),
    )
    good = (
        status == col.GOOD and head_of(orbit).amplitude > 0.0 and linearise_orbit(oscillator, tables, orbit, no_drift())
    )
    return good and floquet(head_of(orbit).transfer, 2 * orbit.modes.shape[1]) < 1.0, orbit, spare


@kernel
def land(
    oscillator: Oscillator, tables: np.ndarray, z0: float, level: int, orbit: Orbit, spare: Orbit
) -> tuple[bool, Orbit, Orbit]:
    """The stable orbit in contact for good on which the tip lands at this tip offset; False if there is none."""
    guess = np.zeros(col.GUESS)
    # A tip that swings by more than it rests deep leaves contact.
    if not resting(oscillator, z0, guess) or guess[col.G_A] > guess[col.G_MEAN] - z0:
        return False, orbit, spare
    return held_there(oscillator, tables, z0, guess, level, orbit, spare)
