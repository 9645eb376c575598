"""Where a lever lands that attraction carries over its resonance.

Driven below resonance the lever comes nearer to it as the tip is lowered, swings wider, and so brings the tip nearer
still: if its amplitude may rise by more than the reach of the force, the orbit it is on ends at a fold, and the tip
falls. Beyond the resonance an attractive orbit may hold it, and in contact, below the resonance that repulsion moves
up, a repulsive one. Which of the two it comes to is no question of how the curve of orbits runs, for the tip leaves the
curve: it is one of the motion after the fold, that of the averaged lever a at a fixed tip offset,

    2 (alpha0 + i omega) a' = u0 - (1 - omega^2 + 2 i alpha0 omega) a - (P - i S) a/|a|

(theory, Eq. (slow-flow-1) without a''), which is followed here until it comes to rest. Mean deflection and higher
harmonics follow at once: harmonics lift the tip by 3/4 P where it touches shortly, by less where longer. Basins may
be finely woven, and averaging is not exact. So the motion is followed several times, from several depths, with less
lift, and with other damping; where ends differ, or forces are too strong to be averaged, only time tells. Ends that
are all attractive are no proof either, for of 995 draws 134 are wrong, unless the fold is about as high as any
repulsive orbit, where none of 159 is. More damping than there is makes some ends attractive: of 175 draws without
another such end none is.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.resonance import ATTRACTIVE, REPULSIVE, UNCLEAR, balance_depth
from phasemap._kernels.law import Oscillator, longrange_force
from phasemap._kernels.lever import free_amplitude, inverse_inertia
from phasemap._kernels.orbits.averaged.harmonics import harmonics
from phasemap._kernels.records import record

STRONG = 0.3  # of the stiffness times the free amplitude: a larger adhesion bends the lever too much to be averaged
FARTHEST_FOLD = 30.0  # in reaches, gap from which a fold is sought
NEARER = 0.75  # steps of its distance from -1.5
CLEAR = 1.0  # in reaches, height of the fold over any repulsive orbit that leaves no doubt
LIKELY = -0.25  # the same where all variants fall alike
FOLD_HALVINGS = 8
VARIANTS = np.array(
    [
        [1.0, 0.1, 0.75],
        [1.0, 0.2, 0.6],
        [1.0, 0.05, 0.5],
        [1.0, 0.4, 0.25],
        [1.0, 0.1, 1.0],
        [0.75, 0.1, 0.75],
        [1.3, 0.1, 0.75],
    ]
)
"""Damping and drive over what they are, depth below the fold in reaches, share of P by which harmonics lift the tip.

Those that change the damping come last: they have a fold of their own."""
NO_FOLD = 0  # how the search for a fold ends
FOUND = 1
FOLD_TOO_FAR = 2  # farther than where the search begins
FALL_TOLERANCE = 0.02  # in reaches, local error of a step
WAY_FROM_FOLD = 0.5  # in reaches, where a fall begins
REST = 0.1  # of the fastest rate, at which the motion counts as at rest
MOST_FALL_STEPS = 1000


@record
class FoldPoint:
    """A harmonic orbit on the curve of a tip that comes near, or the fold of that curve."""

    amplitude: float  # [m]
    gap: float  # e - A [m]
    mean_deflection: float  # [m]
    push: float  # in-phase force P over stiffness [m]


@kernel
def find_orbit_below_resonance(
    oscillator: Oscillator, reach: float, gap: float, amplitude: float, at: FoldPoint
) -> bool:
    """Fill `at` with the averaged orbit of this gap driven below resonance, X > 0; False if there is none.

    (A s + P)^2 + (2 alpha0 omega A)^2 = u0^2 is a quadratic equation for A, with P that hardly depends on it. What
    damping in the sample takes is left out: folds lie where the tip hardly touches.
    """
    lever = oscillator.lever
    stiff, damped = lever[col.DYNAMIC_STIFFNESS], lever[col.DYNAMIC_LOSS]
    whole = stiff * stiff + damped * damped
    for _ in range(4):
        push, _, mean = harmonics(oscillator, reach, amplitude, 1.0 + gap / amplitude)
        square = lever[col.DRIVE] ** 2 * whole - (push * damped) ** 2
        if square < 0.0:
            return False
        before, amplitude = amplitude, (math.sqrt(square) - push * stiff) / whole
        at.amplitude, at.gap, at.mean_deflection, at.push = amplitude, gap, mean, push
        if abs(amplitude - before) < 1e-3 * reach:
            break
    return push + amplitude * stiff > 0.0


@kernel
def find_fold(oscillator: Oscillator, reach: float, free: float, at: FoldPoint) -> int:
    """Fill `at` with the fold, the least tip offset of the orbits from far; FOUND, NO_FOLD or FOLD_TOO_FAR."""
    gap, amplitude = FARTHEST_FOLD * reach, free
    x0 = x1 = z0 = z1 = math.inf
    while find_orbit_below_resonance(oscillator, reach, gap, amplitude, at):
        amplitude = at.amplitude
        z = amplitude + gap + at.mean_deflection
        if z > z1:
            if not math.isfinite(z0):
                return FOLD_TOO_FAR
            # The bottom of a parabola through three points.
            rise = (z1 - z0) / (x1 - x0)
            bend = ((z - z1) / (gap - x1) - rise) / (gap - x0)
            gap = 0.5 * (x0 + x1) - 0.5 * rise / bend
            return FOUND if find_orbit_below_resonance(oscillator, reach, gap, amplitude, at) else FOLD_TOO_FAR
        x0, z0, x1, z1 = x1, z1, gap, z
        gap = NEARER * (gap + 1.5 * reach) - 1.5 * reach
        if gap < -1.4 * reach:
            break
    return NO_FOLD


@kernel
def _complex_amplitude_rate(
    oscillator: Oscillator, reach: float, z0: float, lift: float, a: complex, mean: float
) -> tuple[complex, float, float]:
    """Time derivative of the complex amplitude, in-phase force P [m], and mean deflection with harmonics [m]."""
    lever = oscillator.lever
    size = abs(a)
    push, drag, more = harmonics(oscillator, reach, size, (z0 - mean) / size)
    drive = lever[col.DRIVE] - complex(lever[col.DYNAMIC_STIFFNESS], lever[col.DYNAMIC_LOSS]) * a
    return (
        (drive - complex(push, -drag) * a / size) * inverse_inertia(lever),
        push,
        more + lift * push,
    )


@kernel
def fall_from_fold(oscillator: Oscillator, reach: float, at: FoldPoint, below: float, lift: float) -> int:
    """Side on which a tip comes to rest that left the fold; UNCLEAR if it does not.

    The steps are the pair of orders 3 and 2 of Bogacki and Shampine, Appl. Math. Lett. 2 (1989) 321.
    """
    lever = oscillator.lever
    alpha0 = lever[col.ALPHA0]
    stiff, mean = lever[col.DYNAMIC_STIFFNESS], at.mean_deflection + lift * at.push
    z0 = at.amplitude + at.gap + mean - below * reach
    # u0 = (X - i Y) a/|a| on an orbit.
    begun = (
        lever[col.DRIVE]
        * at.amplitude
        / complex(at.push + at.amplitude * stiff, lever[col.DYNAMIC_LOSS] * at.amplitude)
    )
    a, h, fastest = begun, 0.02 / alpha0, 0.0
    k1, push, mean = _complex_amplitude_rate(oscillator, reach, z0, lift, a, mean)
    for _ in range(MOST_FALL_STEPS):
        k2, _, _ = _complex_amplitude_rate(oscillator, reach, z0, lift, a + 0.5 * h * k1, mean)
        k3, _, middle = _complex_amplitude_rate(oscillator, reach, z0, lift, a + 0.75 * h * k2, mean)
        end = a + h * (2 / 9 * k1 + 1 / 3 * k2 + 4 / 9 * k3)
        k4, push, last = _complex_amplitude_rate(oscillator, reach, z0, lift, end, middle)
        error = abs(h * (-5 / 72 * k1 + 1 / 12 * k2 + 1 / 9 * k3 - 1 / 8 * k4)) / (FALL_TOLERANCE * reach)
        if error <= 1.0:
            a, k1, mean = end, k4, last
            fastest = max(fastest, abs(k1))
            if abs(k1) < REST * fastest and abs(a - begun) > WAY_FROM_FOLD * reach:
                return REPULSIVE if push + abs(a) * stiff > 0.0 else ATTRACTIVE
        h *= min(4.0, max(0.2, 0.9 * max(error, 1e-6) ** (-1.0 / 3.0)))
    return UNCLEAR


@kernel
def highest_repulsive_tip_offset(oscillator: Oscillator, reach: float) -> float:
    """Highest tip offset [m] of an orbit below the resonance that repulsion raises, X > 0; -infinity without one.

    It is next to X = 0, where the amplitude is the largest that the drive can make if the sample takes nothing, and
    -P = A (1 - omega^2) on the way in from the strongest attraction.
    """
    law, p, lever = oscillator
    pull = lever[col.DYNAMIC_STIFFNESS] * lever[col.DRIVE] / lever[col.DYNAMIC_LOSS]
    amplitude = lever[col.DRIVE] / lever[col.DYNAMIC_LOSS]
    outer, inner, mean = 0.0, 0.7 * balance_depth(law, p, reach), 0.0
    push, _, _ = harmonics(oscillator, reach, amplitude, 1.0 - inner / amplitude)
    while push + pull <= 0.0:
        outer, inner = inner, 1.4 * inner
        if inner > 1.9 * amplitude:
            return -math.inf
        push, _, _ = harmonics(oscillator, reach, amplitude, 1.0 - inner / amplitude)
    for _ in range(FOLD_HALVINGS):
        middle = 0.5 * (outer + inner)
        push, _, more = harmonics(oscillator, reach, amplitude, 1.0 - middle / amplitude)
        if push + pull > 0.0:
            inner = middle
        else:
            outer, mean = middle, more
    return amplitude - outer + mean


@kernel
def attraction_defies_averaging(oscillator: Oscillator, free: float) -> bool:
    """True if the attraction at d = 0 is too large, against stiffness times free amplitude, to be averaged."""
    law, p, lever = oscillator
    return -longrange_force(law, 0.0, p) > STRONG * lever[col.STIFFNESS] * free


@kernel
def landing_side(oscillator: Oscillator, reach: float, free: float) -> int:
    """Side on which a tip from far lands after its jump at the fold; UNCLEAR where only time marching can tell."""
    law, p, lever = oscillator
    at, other = FoldPoint(), lever.copy()
    status = find_fold(oscillator, reach, free, at)
    if status != FOUND:
        return ATTRACTIVE if status == NO_FOLD else UNCLEAR
    height = at.amplitude + at.gap + at.mean_deflection - highest_repulsive_tip_offset(oscillator, reach)
    if height > CLEAR * reach:
        return ATTRACTIVE
    landed = UNCLEAR
    for i in range(len(VARIANTS)):
        other[col.ALPHA0] = VARIANTS[i, 0] * lever[col.ALPHA0]
        other[col.DYNAMIC_LOSS] = VARIANTS[i, 0] * lever[col.DYNAMIC_LOSS]
        other[col.DRIVE] = VARIANTS[i, 0] * lever[col.DRIVE]
        if VARIANTS[i, 0] != 1.0 and find_fold(Oscillator(law, p, other), reach, free_amplitude(other), at) != FOUND:
            return UNCLEAR
        end = fall_from_fold(Oscillator(law, p, other), reach, at, VARIANTS[i, 1], VARIANTS[i, 2])
        if i == 0:
            landed = end
        more = landed == REPULSIVE and VARIANTS[i, 0] > 1.0
        if not more and (end == UNCLEAR or end != landed):
            return UNCLEAR
    return landed if landed == REPULSIVE or height > LIKELY * reach else UNCLEAR
