"""Where a lever lands that attraction carries over its resonance.

Driven below resonance the lever comes nearer to it as the tip is lowered, swings wider, and so brings the tip nearer
still: if its amplitude may rise by more than the reach of the force, the orbit it is on ends at a fold, and the tip
falls. Where no repulsive orbit lies as high as the fold it comes to an attractive one beyond the resonance. Elsewhere
the curve of orbits, which the tip has left, does not tell where it lands, but time does.
"""

from __future__ import annotations

import math

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator, longrange_force
from phasemap._kernels.lever import free_amplitude, reach_of
from phasemap._kernels.numerics import parabola
from phasemap._kernels.orbits.averaged.harmonics import harmonics
from phasemap._kernels.orbits.averaged.sides import balance_depth, gap_of_push
from phasemap._kernels.records import record

STRONG = 0.3  # of the stiffness times the free amplitude: a larger adhesion bends the lever too much to be averaged
FARTHEST_FOLD = 30.0  # in reaches, gap from which a fold is sought
GAP_SHRINKS = 0.75  # steps of its distance from -1.5
CLEAR = 1.0  # in reaches, height of the fold over any repulsive orbit that leaves no doubt
NO_FOLD = 0  # how the search for a fold ends
FOUND = 1
FOLD_TOO_FAR = 2  # farther than where the search begins


@record
class FoldPoint:
    """A harmonic orbit on the curve of a tip that comes near, or the fold of that curve."""

    amplitude: float  # [m]
    gap: float  # e - A [m]
    mean_deflection: float  # [m]
    push: float  # in-phase force P over stiffness [m]


@kernel
def find_orbit_below_resonance(oscillator: Oscillator, gap: float, amplitude: float, at: FoldPoint) -> bool:
    """Fill `at` with the averaged orbit of this gap driven below resonance, X > 0; False if there is none.

    (A s + P)^2 + (2 alpha0 omega A)^2 = u0^2 is a quadratic equation for A, with P that hardly depends on it. What
    damping in the sample takes is left out: folds lie where the tip hardly touches.
    """
    lever = oscillator.lever
    stiff, damped = lever[col.DYNAMIC_STIFFNESS], lever[col.DYNAMIC_LOSS]
    whole = stiff * stiff + damped * damped
    for _ in range(4):
        push, _, mean = harmonics(oscillator, amplitude, 1.0 + gap / amplitude)
        square = lever[col.DRIVE] ** 2 * whole - (push * damped) ** 2
        if square < 0.0:
            return False
        before, amplitude = amplitude, (math.sqrt(square) - push * stiff) / whole
        at.amplitude, at.gap, at.mean_deflection, at.push = amplitude, gap, mean, push
        if abs(amplitude - before) < 1e-3 * reach_of(oscillator.p):
            break
    return push + amplitude * stiff > 0.0


@kernel
def find_fold(oscillator: Oscillator, at: FoldPoint) -> int:
    """Fill `at` with the fold, the least tip offset of the orbits from far; FOUND, NO_FOLD or FOLD_TOO_FAR."""
    reach, amplitude = reach_of(oscillator.p), free_amplitude(oscillator.lever)
    gap = FARTHEST_FOLD * reach
    x0 = x1 = z0 = z1 = math.inf
    while find_orbit_below_resonance(oscillator, gap, amplitude, at):
        amplitude = at.amplitude
        z = amplitude + gap + at.mean_deflection
        if z > z1:
            if not math.isfinite(z0):
                return FOLD_TOO_FAR
            gap, _, _ = parabola((x0, z0), (x1, z1), (gap, z))
            return FOUND if find_orbit_below_resonance(oscillator, gap, amplitude, at) else FOLD_TOO_FAR
        x0, z0, x1, z1 = x1, z1, gap, z
        gap = GAP_SHRINKS * (gap + 1.5 * reach) - 1.5 * reach
        if gap < -1.4 * reach:
            break
    return NO_FOLD


@kernel
def highest_repulsive_tip_offset(oscillator: Oscillator) -> float:
    """Highest tip offset [m] of an orbit below the resonance that repulsion raises, X > 0; -infinity without one.

    It is next to X = 0, where the amplitude is the largest that the drive can make if the sample takes nothing, and
    -P = A (1 - omega^2) on the way in from the strongest attraction.
    """
    law, p, lever = oscillator
    pull = lever[col.DYNAMIC_STIFFNESS] * lever[col.DRIVE] / lever[col.DYNAMIC_LOSS]
    amplitude = lever[col.DRIVE] / lever[col.DYNAMIC_LOSS]
    before, gap = (0.0, harmonics(oscillator, amplitude, 1.0)[0]), -0.7 * balance_depth(law, p)
    push, _, _ = harmonics(oscillator, amplitude, 1.0 + gap / amplitude)
    while push + pull <= 0.0:
        before, gap = (gap, push), 1.4 * gap
        if gap < -1.9 * amplitude:
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
    """Whether a tip from far is surely on the attractive side after its jump at the fold, or does not jump."""
    at = FoldPoint()
    status = find_fold(oscillator, at)
    if status != FOUND:
        return status == NO_FOLD
    height = at.amplitude + at.gap + at.mean_deflection - highest_repulsive_tip_offset(oscillator)
    return height > CLEAR * reach_of(oscillator.p)
