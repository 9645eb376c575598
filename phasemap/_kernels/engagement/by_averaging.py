"""Averaged orbit that holds the setpoint after engaging from far, where averaging is sure of it.

The curve of averaged orbits is not followed. With r = A/A_free, s = 1 - omega^2, and the free lever's (x, y) = (s, 2
alpha0 omega) A_free/u0, an orbit has X^2 + Y^2 = u0^2, X = P + A s, Y = 2 alpha0 omega A - S, and X < 0 on the
attractive side. That branch is nearest to its end at the r of theory, Eq. (engagement-4). There, or at the setpoint if
that is above, the maximum of the mismatch over the tip offset, counted negative while X > 0, decides: well above zero
the tip stays attractive down to the setpoint; well below, it jumps to the repulsive branch on the way. Where that r is
above one, a branch that is cut there may go on at r < 1 as an island: the tip then is on the repulsive side only if r =
1 itself cannot be held by attraction. A tip that rises over the resonance by more than the reach of the attraction
cannot follow the curve: it jumps, and where to is in `beside_resonance`.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.beside_resonance import (
    FARTHEST_FOLD,
    attraction_defies_averaging,
    lands_attractive,
    rebounds,
)
from phasemap._kernels.law import Oscillator, contact_force, has_hysteresis, has_longrange
from phasemap._kernels.lever import free_amplitude, low_q, near_resonance, reach_of
from phasemap._kernels.orbits.averaged.orbits import averaged_orbits
from phasemap._kernels.orbits.averaged.sides import (
    ATTRACTIVE,
    REPULSIVE,
    STEEPEST,
    UNCLEAR,
    Maximum,
    fill_averaged_orbit_at_gap,
    fill_averaged_orbit_on_side,
    find_mismatch_maximum,
    mismatch_at_gap,
)
from phasemap._kernels.orbits.harmonic_orbit import HarmonicOrbit, centre_height, load_harmonic_orbit
from phasemap._kernels.records import clear

CLEAR_MISMATCH = 0.06  # mismatch at the maximum that leaves no doubt, over that of the free lever
LEAST_CLEAR = 0.03  # the same where that goes to 0
PER_DAMPING = 120.0  # by which both grow with the damping ratio: averaging neglects terms of the order of 1/Q
DETUNED = 60.0  # by which that grows with |s|: averaging is off by terms of the order of u0/A
# So much averaged attraction, over that of theory, Eq. (engagement-3), or less leaves no doubt at low Q: one that bends
# the lever much draws the tip in faster than in a harmonic orbit, and acts for a shorter time.
WEAK = 2 / 3
TOO_WEAK = 0.5  # the same near resonance, X = (r x - q)/2: no doubt that the tip is repelled

BARELY = 1e-3  # of the amplitude, in contact: where the repulsive side begins without attraction before it
FINELY = 0.15  # of the gap and the reach, in which the mismatch is looked at on the way in
# What decides on which orbit a tip from far holds the setpoint.
BY_AVERAGING = 0
BY_FOLD = 1  # the end of the attractive branch, sought among exact orbits
BY_CURVE = 2  # the curve of exact orbits
IN_TIME = 3  # the tip is carried over its resonance, or rebounds


@kernel(light=True)
def free_drive_shares(lever: np.ndarray) -> tuple[float, float]:
    """(x, y): drive that stiffness and damping of the free lever take, over the whole drive."""
    stiff, damped = lever[col.DYNAMIC_STIFFNESS], lever[col.DYNAMIC_LOSS]
    whole = math.hypot(stiff, damped)
    return stiff / whole, damped / whole


@kernel(light=True)
def narrowest_amplitude_ratio(lever: np.ndarray) -> float:
    """Amplitude over the free one where the attractive branch is nearest to its end: theory, Eq. (engagement-4)."""
    x, y = free_drive_shares(lever)
    return math.sqrt((2.0 + x * x + x * math.sqrt(8.0 + x * x)) / 6.0) / y


@kernel(light=True)
def forces_are_plain(oscillator: Oscillator) -> bool:
    """True if averaging can decide the branch: no neck, and before contact attraction alone, the more the nearer."""
    return bool(not has_hysteresis(oscillator.p) and oscillator.law.attracts == 1)


@kernel
def leaps_to_resonance(oscillator: Oscillator) -> bool:
    """True if attraction brings the lever to its resonance by a jump: the amplitude rises by more than the reach."""
    lever = oscillator.lever
    x, y = free_drive_shares(lever)
    return x > 0.0 and (1.0 / y - 1.0) * free_amplitude(lever) > reach_of(oscillator.p)


@kernel
def low_q_margin_factor(lever: np.ndarray) -> float:
    """Factor by which damping widens decision margins: averaging neglects terms of order 1/Q."""
    return 1.0 + PER_DAMPING * lever[col.ALPHA0]


@kernel
def decisive_mismatch(lever: np.ndarray, amplitude: float) -> float:
    """Size of the maximum mismatch from which averaging decides the branch without doubt, at resonance."""
    x, y = free_drive_shares(lever)
    r = amplitude / free_amplitude(lever)
    q = math.sqrt(max(1.0 - r * r * y * y, 0.0))
    return (CLEAR_MISMATCH * q * (q + r * x) + LEAST_CLEAR) * low_q_margin_factor(lever)


@kernel
def decisive_mismatch_beside_resonance(lever: np.ndarray, amplitude: float) -> float:
    """Size of the maximum mismatch from which averaging decides the branch without doubt, at any drive frequency."""
    return decisive_mismatch(lever, amplitude) * (1.0 + DETUNED * abs(lever[col.DYNAMIC_STIFFNESS]))


@kernel
def mismatch_at_attraction_share(lever: np.ndarray, amplitude: float, share: float) -> float:
    """Mismatch where attraction is this share of the one that an orbit of this amplitude without losses needs.

    It is (X^2 + Y^2)/u0^2 - 1, with X/u0 = r x - share (q + r x) and (Y/u0)^2 = 1 - q^2.
    """
    x, y = free_drive_shares(lever)
    r = amplitude / free_amplitude(lever)
    q = math.sqrt(max(1.0 - r * r * y * y, 0.0))
    return (r * x - share * (q + r * x)) ** 2 - q * q


@kernel
def side_by_averaging(oscillator: Oscillator, amplitude: float, top: Maximum) -> int:
    """Side of the resonance on which the tip passes this amplitude, by averaging; UNCLEAR too near to the jump."""
    law, p, lever = oscillator
    clear(top)
    if not has_longrange(p):
        # Without attraction there is one branch; with adhesion alone its onset jumps.
        top.deeper_gap = -BARELY * amplitude
        return REPULSIVE if contact_force(law, 0.0, p) >= 0.0 else UNCLEAR
    least, plain = decisive_mismatch(lever, amplitude), decisive_mismatch_beside_resonance(lever, amplitude)
    find_mismatch_maximum(oscillator, amplitude, plain, top)
    if top.mismatch >= plain:
        return ATTRACTIVE
    weak = -mismatch_at_attraction_share(lever, amplitude, TOO_WEAK)
    return REPULSIVE if top.mismatch <= -min(plain, max(least, weak)) else UNCLEAR


@kernel
def side_reached_from_far(oscillator: Oscillator, amplitude: float, top: Maximum) -> int:
    """Side on which the tip from far reaches this amplitude, by averaging, there and where its branch is narrowest."""
    p, lever = oscillator.p, oscillator.lever
    free = free_amplitude(lever)
    worst = narrowest_amplitude_ratio(lever) * free
    side = side_by_averaging(oscillator, max(amplitude, min(worst, free)), top)
    if side == REPULSIVE or worst <= free or not has_longrange(p):
        return side
    return ATTRACTIVE if side_by_averaging(oscillator, worst, top) == ATTRACTIVE else UNCLEAR


@kernel(shared=True)
def engage_by_averaging(oscillator: Oscillator, amplitude: float, harmonic: HarmonicOrbit, top: Maximum) -> int:
    """Way to decide which orbit of this amplitude a tip from far comes to; BY_AVERAGING with that in `harmonic`.

    BY_FOLD: the maximum of the mismatch is in `top`.
    """
    decider = find_side_and_orbit(oscillator, amplitude, harmonic, top)
    return IN_TIME if decider == BY_AVERAGING and rebounds(oscillator, harmonic.push) else decider


@kernel
def find_side_and_orbit(oscillator: Oscillator, amplitude: float, harmonic: HarmonicOrbit, top: Maximum) -> int:
    """Way to decide which orbit of this amplitude a tip from far comes to, if it does not rebound.

    BY_AVERAGING: that orbit is in `harmonic`. BY_FOLD: the maximum of the mismatch is in `top`.
    """
    p, lever = oscillator.p, oscillator.lever
    if not (forces_are_plain(oscillator) and near_resonance(lever)):
        return BY_CURVE  # which ends where a contact with hysteresis is made or kept: only time tells what comes after
    attracted = has_longrange(p)
    rises = attracted and leaps_to_resonance(oscillator)
    if low_q(lever):
        return BY_AVERAGING if fill_orbit_at_low_q(oscillator, amplitude, rises, harmonic, top) else BY_CURVE
    if rises and attraction_defies_averaging(oscillator):
        return IN_TIME
    side = side_reached_from_far(oscillator, amplitude, top)
    falls = rises and side != REPULSIVE
    if side != UNCLEAR and not falls and fill_setpoint_orbit_on_side(oscillator, amplitude, side, top, harmonic):
        return BY_AVERAGING
    if attracted and fill_only_averaged_orbit(oscillator, amplitude, harmonic):
        return BY_AVERAGING
    if falls:
        attractive = side == ATTRACTIVE and lands_attractive(oscillator)
        found = attractive and fill_setpoint_orbit_on_side(oscillator, amplitude, side, top, harmonic)
        return BY_AVERAGING if found else IN_TIME  # the curve may not lead to where it lands
    open_side = side == UNCLEAR and attracted and narrowest_amplitude_ratio(lever) <= 1.0
    return BY_FOLD if open_side else BY_CURVE


@kernel
def fill_orbit_at_low_q(
    oscillator: Oscillator, amplitude: float, rises: bool, harmonic: HarmonicOrbit, top: Maximum
) -> bool:
    """Fill `harmonic` with the averaged orbit on which a lever of low Q engages; False where averaging is not sure.

    It is sure of one thing only there: that attraction is too weak for a branch of its own.
    """
    p, lever = oscillator.p, oscillator.lever
    worst = worst_amplitude(lever, amplitude)
    if has_longrange(p):
        find_mismatch_maximum(oscillator, worst, math.inf, top)
        if rises or top.mismatch > mismatch_at_attraction_share(lever, worst, WEAK):
            return False
    elif side_by_averaging(oscillator, amplitude, top) == UNCLEAR:
        return False
    return fill_setpoint_orbit_on_side(oscillator, amplitude, REPULSIVE, top, harmonic)


@kernel
def fill_only_averaged_orbit(oscillator: Oscillator, amplitude: float, harmonic: HarmonicOrbit) -> bool:
    """Fill `harmonic` with the averaged orbit of this amplitude; False if there may be several or none.

    On a soft and lossy sample the lever may lose so much that it is held before contact repels more
    than the rest attracts. As the tip comes near the mismatch then rises through zero from well below it to well above,
    and never falls again.
    """
    reach, plain = reach_of(oscillator.p), decisive_mismatch_beside_resonance(oscillator.lever, amplitude)
    gap, highest = FARTHEST_FOLD * reach, -math.inf
    while gap > -2.0 * amplitude:
        h, _ = mismatch_at_gap(oscillator, amplitude, gap)
        if h < min(highest, plain) and highest > -plain:
            return False
        highest, gap = max(highest, h), gap - FINELY * (abs(gap) + reach)
    if not highest > plain:
        return False
    orbits = averaged_orbits(oscillator, amplitude)
    if len(orbits) != 1:
        return False
    load_harmonic_orbit(orbits[0], harmonic)
    gap = centre_height(harmonic) - amplitude
    return fill_averaged_orbit_at_gap(oscillator, amplitude, gap, harmonic) > STEEPEST


@kernel
def worst_amplitude(lever: np.ndarray, amplitude: float) -> float:
    """Amplitude [m], from the setpoint to the free one, at which the attractive branch is nearest to its end."""
    return max(amplitude, min(narrowest_amplitude_ratio(lever), 1.0) * free_amplitude(lever))


@kernel
def fill_setpoint_orbit_on_side(
    oscillator: Oscillator, amplitude: float, side: int, top: Maximum, harmonic: HarmonicOrbit
) -> bool:
    """Fill `harmonic` with the averaged orbit of this side at the setpoint; False where a fold is near."""
    p, lever = oscillator.p, oscillator.lever
    if has_longrange(p) and amplitude < narrowest_amplitude_ratio(lever) * free_amplitude(lever):
        # The maximum was sought where the attractive branch is nearest to its end; here it is another.
        find_mismatch_maximum(oscillator, amplitude, 0.0 if side == ATTRACTIVE else math.inf, top)
        if side == ATTRACTIVE and not top.mismatch > 0.0:
            return False
    return fill_averaged_orbit_on_side(oscillator, amplitude, side, top, harmonic)
