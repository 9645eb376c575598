"""Averaged orbits on either side of the resonance, found by how near the tip comes at its lowest point.

The mismatch of the drive is h = (X^2 + Y^2)/u0^2 - 1 with the drive X + iY that a harmonic orbit needs and the u0 that
there is (`lever.mismatch`). As the tip comes near at a fixed amplitude, attraction raises it to a maximum, and
repulsion raises it once more behind that: the attractive orbit lies outside of the maximum, the repulsive one behind.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law, Oscillator, contact_force, longrange_force
from phasemap._kernels.lever import lowest_tip_offset, mismatch, reach_of
from phasemap._kernels.numerics import narrow_bracket, parabola
from phasemap._kernels.orbits.averaged.harmonics import harmonics
from phasemap._kernels.orbits.harmonic_orbit import HarmonicOrbit, fill_harmonic_orbit
from phasemap._kernels.records import record

ATTRACTIVE = -1
REPULSIVE = 1
UNCLEAR = 0
CROSSING_TOLERANCE = 1e-7  # mismatch left at a crossing, far below what averaging is wrong by
LEAST_MISMATCH = -0.999999  # mismatch, where its logarithm is taken
STEEPEST = 0.2  # least dz0/dA of an averaged orbit that is far from a fold
FIRST_DEPTH = 0.12  # of `balance_depth`: the first depth at which the maximum of the mismatch is sought, then doubled
TRIAL_DEPTH = 0.1  # of the reach, depth at which the elastic force is asked for
MOST_DEPTHS_OF_BALANCE = 10.0  # in reaches, at which attraction still outweighs what is elastic: a soft sample
MOST_GAPS = 60  # that are tried for a maximum or a crossing: each grows by a share, so that they reach any scale
MOST_CROSSING_STEPS = 50  # of regula falsi, whose bracket is decades wide
FARTHER = 2.0  # times the height over the pole, by which the gap grows on the way out to the attractive crossing
NOT_REPULSIVE = -0.5  # value in place of the logarithm of 1 + mismatch where the orbit is no repulsive one, or less
OVERSHOOT = 1.1  # of the depth at which P, rising as its square, would be what is wanted: the crossing is then inside
LEAST_DEPTH_GROWTH, MOST_DEPTH_GROWTH = 1.15, 4.0  # of that depth from one gap to the next
LEAST_RISE = 0.02  # of what P has to rise by, the least that counts as its rise
DIFFERENCE = 1e-5  # of reach, gap or amplitude, by which derivatives are taken


@record
class Maximum:
    """The first maximum of the mismatch as the tip comes near."""

    gap: float  # b = e - A [m]
    mismatch: float
    push: float  # P [m]
    deeper_gap: float  # gap one step deeper [m]


@kernel
def mismatch_at_gap(oscillator: Oscillator, amplitude: float, gap: float) -> tuple[float, float]:
    """Mismatch of the drive, and in-phase force P [m], of the harmonic orbit with this amplitude and gap."""
    lever = oscillator.lever
    push, drag, _ = harmonics(oscillator, amplitude, 1.0 + gap / amplitude)
    return mismatch(lever, amplitude, push, drag), push


@kernel
def attractive_mismatch(lever: np.ndarray, amplitude: float, push: float, drag: float) -> float:
    """Mismatch of the drive, with the square of the in-phase drive X counted as negative where X > 0.

    With X > 0 the square of X would hide that attraction begins to count.
    """
    x = (push + amplitude * lever[col.DYNAMIC_STIFFNESS]) / lever[col.DRIVE]
    h = mismatch(lever, amplitude, push, drag)
    return h if x <= 0.0 else h - 2.0 * x * x


@kernel
def attractive_mismatch_at_gap(oscillator: Oscillator, amplitude: float, gap: float) -> tuple[float, float]:
    """`attractive_mismatch`, and in-phase force P [m], of the harmonic orbit that comes to `gap` [m] above contact."""
    lever = oscillator.lever
    push, drag, _ = harmonics(oscillator, amplitude, 1.0 + gap / amplitude)
    return attractive_mismatch(lever, amplitude, push, drag), push


@kernel
def balance_depth(law: Law, p: np.ndarray) -> float:
    """Indentation [m] at which the elastic force balances the attraction, if it rises as d^(3/2)."""
    reach = reach_of(p)
    d = TRIAL_DEPTH * reach
    rise = contact_force(law, d, p) - contact_force(law, 0.0, p)
    if not rise > 0.0:
        return MOST_DEPTHS_OF_BALANCE * reach
    return min(d * (-longrange_force(law, 0.0, p) / rise) ** (2 / 3), MOST_DEPTHS_OF_BALANCE * reach)


@kernel
def find_mismatch_maximum(oscillator: Oscillator, amplitude: float, plain: float, top: Maximum) -> None:
    """Fill `top` with the first maximum of the attractive mismatch on approach.

    A mismatch above `plain` is enough: the gap is then one at which it is that large, and none is looked for behind. A
    maximum between the gaps is not looked for where it is more than twice that from 0. Infinite: it always is.
    """
    law, p = oscillator.law, oscillator.p
    h, push = attractive_mismatch_at_gap(oscillator, amplitude, 0.0)
    top.gap, top.mismatch, top.push = 0.0, h, push
    if h >= plain:
        return
    before, h_before, here, h_here = 0.0, h, 0.0, h
    deeper = -FIRST_DEPTH * balance_depth(law, p)
    for _ in range(MOST_GAPS):
        h, push = attractive_mismatch_at_gap(oscillator, amplitude, deeper)
        if h < h_here or push > 0.0:
            break
        top.gap, top.mismatch, top.push = deeper, h, push
        if h >= plain:
            return
        before, h_before, here, h_here = here, h_here, deeper, h
        deeper *= 2.0
    top.deeper_gap = deeper
    if here < 0.0 and push <= 0.0:
        # A parabola through three points, in the root of the depth.
        x0, x1, x2 = math.sqrt(-before), math.sqrt(-here), math.sqrt(-deeper)
        x, highest, bend = parabola((x0, h_before), (x1, h_here), (x2, h))
        if bend < 0.0 and x0 < x < x2 and abs(highest) < 2.0 * plain:
            h, push = attractive_mismatch_at_gap(oscillator, amplitude, -x * x)
            if h > top.mismatch:
                top.gap, top.mismatch, top.push = -x * x, h, push


@kernel
def gap_of_crossing(
    oscillator: Oscillator, amplitude: float, side: int, shift: float,
    first: tuple[float, float], second: tuple[float, float],
) -> float:  # fmt: skip
    """Gap [m] of zero mismatch between two points (gap, f) of opposite sign, by regula falsi; NaN without one.

    f is that of `sided_log_mismatch`; on the attractive side its chords are drawn over the logarithm of gap + shift.
    """
    lever = oscillator.lever
    a, f_a = first
    b, f_b = second
    logarithmic = side == ATTRACTIVE
    if logarithmic:
        a, b = math.log(a + shift), math.log(b + shift)
    x = a
    for _ in range(MOST_CROSSING_STEPS):
        x = (a * f_b - b * f_a) / (f_b - f_a)
        h, push = mismatch_at_gap(oscillator, amplitude, math.exp(x) - shift if logarithmic else x)
        f = sided_log_mismatch(lever, amplitude, side, h, push)
        if abs(f) < CROSSING_TOLERANCE:
            return math.exp(x) - shift if logarithmic else x
        a, f_a, b, f_b = narrow_bracket(a, f_a, b, f_b, x, f)
    return math.nan


@kernel
def gap_of_push(
    oscillator: Oscillator, amplitude: float, wanted: float, first: tuple[float, float], second: tuple[float, float]
) -> float:
    """Gap [m] at which the in-phase force is `wanted` [m], between two points (gap, P); the first gap if at none."""
    (a, f_a), (b, f_b) = first, second
    f_a, f_b, x = f_a - wanted, f_b - wanted, a
    for _ in range(MOST_CROSSING_STEPS if (f_a > 0.0) != (f_b > 0.0) else 0):
        x = (a * f_b - b * f_a) / (f_b - f_a)
        f = mismatch_at_gap(oscillator, amplitude, x)[1] - wanted
        if abs(f) < CROSSING_TOLERANCE * oscillator.lever[col.DRIVE]:
            break
        a, f_a, b, f_b = narrow_bracket(a, f_a, b, f_b, x, f)
    return x


@kernel
def repelled(lever: np.ndarray, amplitude: float, push: float) -> bool:
    """True if repulsion outweighs attraction, P > 0, and the lever's detuning above resonance, X > 0."""
    return push > 0.0 and push + amplitude * lever[col.DYNAMIC_STIFFNESS] > 0.0


@kernel
def sided_log_mismatch(lever: np.ndarray, amplitude: float, side: int, h: float, push: float) -> float:
    """Logarithm of 1 + mismatch; on the repulsive side made negative where the orbit is not a repulsive one."""
    if side != REPULSIVE or repelled(lever, amplitude, push):
        return math.log1p(h)
    return min(NOT_REPULSIVE, -abs(math.log1p(h)))


@kernel
def attractive_gap(oscillator: Oscillator, amplitude: float, top: Maximum) -> float:
    """Gap of the attractive crossing, outside of a point with more than enough attraction; NaN if it is not found."""
    near, h_near = top.gap, top.mismatch
    shift = reach_of(oscillator.p) + max(-near, 0.0)
    for _ in range(MOST_GAPS):
        far = near + FARTHER * (near + shift)
        h, _ = mismatch_at_gap(oscillator, amplitude, far)
        if h <= 0.0:
            return gap_of_crossing(
                oscillator, amplitude, ATTRACTIVE, shift, (near, math.log1p(h_near)), (far, math.log1p(h))
            )
        near, h_near = far, h
    return math.nan


@kernel
def repulsive_gap(oscillator: Oscillator, amplitude: float, top: Maximum) -> float:
    """Gap of the repulsive crossing, behind the strongest attraction; NaN if it is not found."""
    lever = oscillator.lever
    stiff = amplitude * lever[col.DYNAMIC_STIFFNESS]
    peak, want = top.gap, lever[col.DRIVE] - stiff - top.push
    near, f_near = peak, min(NOT_REPULSIVE, -abs(math.log1p(max(top.mismatch, LEAST_MISMATCH))))
    gap, last = top.deeper_gap, lowest_tip_offset(oscillator)
    for _ in range(MOST_GAPS):
        h, push = mismatch_at_gap(oscillator, amplitude, gap)
        if h > 0.0 and push > 0.0:
            if not repelled(lever, amplitude, push):
                return math.nan  # damping takes up the drive before repulsion makes up for the lever's detuning
            return gap_of_crossing(oscillator, amplitude, REPULSIVE, 0.0, (near, f_near), (gap, math.log1p(h)))
        near, f_near = gap, sided_log_mismatch(lever, amplitude, REPULSIVE, h, push)
        # Behind the maximum P rises about as the square of the depth.
        grow = OVERSHOOT * math.sqrt(want / max(push - top.push, LEAST_RISE * want))
        gap = peak + (gap - peak) * min(max(grow, LEAST_DEPTH_GROWTH), MOST_DEPTH_GROWTH)
        if gap < last:
            break
    return math.nan


@kernel
def fill_averaged_orbit_at_gap(oscillator: Oscillator, amplitude: float, gap: float, harmonic: HarmonicOrbit) -> float:
    """Fill `harmonic` with the averaged orbit at this gap; returns dz0/dA."""
    lever, reach = oscillator.lever, reach_of(oscillator.p)
    c = 1.0 + gap / amplitude
    push, drag, mean = harmonics(oscillator, amplitude, c)
    h = mismatch(lever, amplitude, push, drag)
    # dz0/dA along the orbits, from the two slopes of the mismatch at fixed A and fixed c.
    small = DIFFERENCE * (reach if reach > 0.0 else -gap)
    slope = (mismatch_at_gap(oscillator, amplitude, gap + small)[0] - h) / small
    larger = amplitude * (1.0 + DIFFERENCE)
    push_a, drag_a, _ = harmonics(oscillator, larger, c)
    fill_harmonic_orbit(harmonic, amplitude, c, push, drag, mean)
    harmonic.mismatch_slope = slope
    return c - (mismatch(lever, larger, push_a, drag_a) - h) / (DIFFERENCE * amplitude * slope)


@kernel
def fill_averaged_orbit_on_side(
    oscillator: Oscillator, amplitude: float, side: int, top: Maximum, harmonic: HarmonicOrbit
) -> bool:
    """Fill `harmonic` with the averaged orbit on this side; False near a fold, or where the tip is pressed in."""
    if side == ATTRACTIVE:
        gap = attractive_gap(oscillator, amplitude, top)
    else:
        gap = repulsive_gap(oscillator, amplitude, top)
    if math.isnan(gap):
        return False
    along = fill_averaged_orbit_at_gap(oscillator, amplitude, gap, harmonic)
    inside = harmonic.tip_offset > lowest_tip_offset(oscillator)
    return along > STEEPEST and (harmonic.push > 0.0) == (side == REPULSIVE) and inside
