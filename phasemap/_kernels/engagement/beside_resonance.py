"""Engagement of a lever that is driven beside its resonance, where only time tells: the tip falls, or rebounds.

The fall from the fold below resonance is that of theory/engagement, "First: averaging"; the rebound, at which the lever
between two taps keeps a time of its own, is theory, Eq. (engagement-6). Of 300 materials drawn at 0.867 to 1.117 of the
resonance, the four on another motion than that of engaging in time have tau/abs(T - 2 pi) from 0.15 to 0.45; samples of
50 to 300 GPa at 1.1 of the resonance that move irregularly, from 0.68 to 0.99; of 100,000 ordinary pixels none is below
1.26.
"""

from __future__ import annotations

import math

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator, contact_force, longrange_force
from phasemap._kernels.lever import beside_resonance, free_amplitude, near_resonance, reach_of
from phasemap._kernels.numerics import parabola
from phasemap._kernels.orbits.averaged.harmonics import harmonics
from phasemap._kernels.orbits.averaged.sides import balance_depth, gap_of_push

STRONG = 0.3  # of the stiffness times the free amplitude: a larger adhesion bends the lever too much to be averaged
MOST_STEPS_TO_BALANCE, BALANCED = 4, 1e-3  # to the amplitude at a gap, and last change over the reach: a pull is flat
FARTHEST_FOLD = 30.0  # in reaches, gap from which a fold is sought
DEEPEST_FOLD = 1.4  # reaches into the surface up to which it is
GAP_SHRINKS = 0.75  # steps of its distance from -1.5
FIRST_OF_BALANCE, DEEPER = 0.7, 1.4  # of the depth at which forces balance, and times that: sought for repulsion
IN_CONTACT_TO = 1.9  # amplitudes of depth: at 2 the tip never leaves the surface
CLEAR = 1.0  # in reaches, height of the fold over any repulsive orbit that leaves no doubt
LASTS = 2.943  # of the depth over the velocity: time of a Hertzian impact, 2 pi^(1/2) Gamma(7/5)/Gamma(9/10)
STORED = 0.4  # of depth times force: energy of a Hertzian contact


@kernel
def orbit_below_resonance(oscillator: Oscillator, gap: float, amplitude: float) -> tuple[float, float]:
    """Amplitude and tip offset [m] of the averaged orbit of this gap driven below resonance, X > 0; NaN without one.

    (A s + P)^2 + (2 alpha0 omega A)^2 = u0^2 is a quadratic equation for A, with P that hardly depends on it. What
    damping in the sample takes is left out: folds lie where the tip hardly touches.
    """
    lever = oscillator.lever
    stiff, damped = lever[col.DYNAMIC_STIFFNESS], lever[col.DYNAMIC_LOSS]
    whole = stiff * stiff + damped * damped
    push = mean = 0.0
    for _ in range(MOST_STEPS_TO_BALANCE):
        push, _, mean = harmonics(oscillator, amplitude, 1.0 + gap / amplitude)
        square = lever[col.DRIVE] ** 2 * whole - (push * damped) ** 2
        if square < 0.0:
            return math.nan, math.nan
        before, amplitude = amplitude, (math.sqrt(square) - push * stiff) / whole
        if abs(amplitude - before) < BALANCED * reach_of(oscillator.p):
            break
    return (amplitude, amplitude + gap + mean) if push + amplitude * stiff > 0.0 else (math.nan, math.nan)


@kernel
def tip_offset_of_fold(oscillator: Oscillator) -> float:
    """Tip offset [m] of the fold over the resonance: the least one of the averaged orbits from far, X > 0.

    Infinite where they have none, NaN where it is farther than the search begins.
    """
    reach, amplitude = reach_of(oscillator.p), free_amplitude(oscillator.lever)
    gap = FARTHEST_FOLD * reach
    x0 = x1 = z0 = z1 = math.inf
    while gap >= -DEEPEST_FOLD * reach:
        amplitude, z = orbit_below_resonance(oscillator, gap, amplitude)
        if not math.isfinite(z):
            break
        if z > z1:
            vertex, _, _ = parabola((x0, z0), (x1, z1), (gap, z))
            return orbit_below_resonance(oscillator, vertex, amplitude)[1]
        x0, z0, x1, z1 = x1, z1, gap, z
        gap = GAP_SHRINKS * (gap + 1.5 * reach) - 1.5 * reach
    return math.inf


@kernel
def highest_repulsive_tip_offset(oscillator: Oscillator) -> float:
    """Highest tip offset [m] of an orbit below the resonance that repulsion raises, X > 0; -infinity without one.

    X = P + A (1 - omega^2) is the part of the drive in phase with the motion. The orbit is next to X = 0, where the
    attraction has brought the resonance down to the drive and the amplitude is the largest that the drive can make
    without losses in the sample, u0/(2 alpha0 omega). Its gap is sought from deeper and deeper ones to P = -A (1 -
    omega^2), and is that at which the tip just touches where P is above that even there.
    """
    law, p, lever = oscillator
    pull = lever[col.DYNAMIC_STIFFNESS] * lever[col.DRIVE] / lever[col.DYNAMIC_LOSS]
    amplitude = lever[col.DRIVE] / lever[col.DYNAMIC_LOSS]
    before, gap = (0.0, harmonics(oscillator, amplitude, 1.0)[0]), -FIRST_OF_BALANCE * balance_depth(law, p)
    push, _, _ = harmonics(oscillator, amplitude, 1.0 + gap / amplitude)
    while push + pull <= 0.0:
        before, gap = (gap, push), DEEPER * gap
        if gap < -IN_CONTACT_TO * amplitude:
            return -math.inf
        push, _, _ = harmonics(oscillator, amplitude, 1.0 + gap / amplitude)
    gap = gap_of_push(oscillator, amplitude, -pull, before, (gap, push))
    return amplitude + gap + harmonics(oscillator, amplitude, 1.0 + gap / amplitude)[2]


@kernel
def attraction_defies_averaging(oscillator: Oscillator) -> bool:
    """True if the attraction at d = 0 is too large, against stiffness times free amplitude, to be averaged."""
    law, p, lever = oscillator
    return -longrange_force(law, 0.0, p) > STRONG * lever[col.STIFFNESS] * free_amplitude(lever)


@kernel
def lands_attractive(oscillator: Oscillator) -> bool:
    """True if a tip from far is surely on the attractive side after its jump at the fold, or does not jump."""
    highest = highest_repulsive_tip_offset(oscillator) + CLEAR * reach_of(oscillator.p)
    return tip_offset_of_fold(oscillator) > highest


@kernel
def rebounds(oscillator: Oscillator, push: float) -> bool:
    """True if a contact with in-phase force P [m] lasts less than the drive's period differs from the free lever's.

    A short contact turns the velocity v = pi P/(2 omega) round. It is so short if the depth of a contact that lasts as
    long as the difference takes more energy than v^2/2. Within a linewidth of the resonance a lever keeps no time of
    its own, and far from it time has been asked already.
    """
    law, p, lever = oscillator
    if not (push > 0.0 and beside_resonance(lever) and near_resonance(lever)):
        return False
    omega = lever[col.OMEGA]
    velocity = 0.5 * math.pi * push / omega
    depth = velocity * 2.0 * math.pi * abs(1.0 / omega - 1.0) / LASTS
    elastic = (contact_force(law, depth, p) - contact_force(law, 0.0, p)) / lever[col.STIFFNESS]
    return bool(STORED * depth * elastic > 0.5 * velocity * velocity)
