"""Which averaged orbit the controller finds when it engages from far, where averaging is sure of it."""

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
from phasemap._kernels.engagement.side_from_far import (
    DETUNED,
    attraction_is_too_weak,
    decide,
    decisive_mismatch,
    forces_are_plain,
    leaps,
    low_q_margin_factor,
    narrowest_amplitude_ratio,
    side_reached_from_far,
)
from phasemap._kernels.law import Oscillator, has_longrange
from phasemap._kernels.lever import free_amplitude, low_q, lowest_tip_offset, near_resonance, reach_of
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

FINELY = 0.15  # of the gap and the reach, in which the mismatch is looked at on the way in
# What decides on which orbit a tip from far holds the setpoint.
BY_AVERAGING = 0
BY_FOLD = 1  # the end of the attractive branch, sought among exact orbits
BY_CURVE = 2  # the curve of exact orbits
BY_TIME = 3  # the tip is carried over its resonance, or rebounds


@kernel(shared=True)
def engage_by_averaging(oscillator: Oscillator, amplitude: float, harmonic: HarmonicOrbit, top: Maximum) -> int:
    """What decides which orbit of this amplitude a tip from far comes to; BY_AVERAGING with that in `harmonic`.

    BY_FOLD the maximum of the mismatch is in `top`.
    """
    rung = find_side_and_orbit(oscillator, amplitude, harmonic, top)
    return BY_TIME if rung == BY_AVERAGING and rebounds(oscillator, harmonic.push) else rung


@kernel
def find_side_and_orbit(oscillator: Oscillator, amplitude: float, harmonic: HarmonicOrbit, top: Maximum) -> int:
    """`engage_by_averaging` of a tip that does not rebound."""
    p, lever = oscillator.p, oscillator.lever
    if not (forces_are_plain(oscillator) and near_resonance(lever)):
        return BY_CURVE  # where a contact lasts longer than its depth says, curves of orbits end
    attracted = has_longrange(p)
    rises = attracted and leaps(oscillator)
    if low_q(lever):
        return BY_AVERAGING if fill_orbit_at_low_q(oscillator, amplitude, rises, harmonic, top) else BY_CURVE
    if rises and attraction_defies_averaging(oscillator):
        return BY_TIME
    side = side_reached_from_far(oscillator, amplitude, top)
    falls = rises and side != REPULSIVE
    if side != UNCLEAR and not falls and fill_setpoint_orbit_on_side(oscillator, amplitude, side, top, harmonic):
        return BY_AVERAGING
    if attracted and fill_only_averaged_orbit(oscillator, amplitude, harmonic):
        return BY_AVERAGING
    if falls:
        attractive = side == ATTRACTIVE and lands_attractive(oscillator)
        found = attractive and fill_setpoint_orbit_on_side(oscillator, amplitude, side, top, harmonic)
        return BY_AVERAGING if found else BY_TIME  # the curve may not lead to where it lands
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
        if rises or not attraction_is_too_weak(lever, worst, top.mismatch):
            return False
    elif decide(oscillator, amplitude, 1.0, top) == UNCLEAR:
        return False
    return fill_setpoint_orbit_on_side(oscillator, amplitude, REPULSIVE, top, harmonic)


@kernel
def fill_only_averaged_orbit(oscillator: Oscillator, amplitude: float, harmonic: HarmonicOrbit) -> bool:
    """Fill `harmonic` with the averaged orbit of this amplitude; False if there may be others or none.

    Where the sample takes so much, as where it is soft and lossy, that the lever is held before contact repels more
    than the rest attracts. As the tip comes near the mismatch then rises through zero from well below it to well above,
    and never falls again.
    """
    lever, reach = oscillator.lever, reach_of(oscillator.p)
    plain = decisive_mismatch(lever, amplitude, low_q_margin_factor(lever)) * (
        1.0 + DETUNED * abs(lever[col.DYNAMIC_STIFFNESS])
    )
    gap, deepest, highest = FARTHEST_FOLD * reach, lowest_tip_offset(oscillator), -math.inf
    while gap > deepest and gap > -2.0 * amplitude:
        h, _ = mismatch_at_gap(oscillator, amplitude, gap)
        if h < min(highest, plain) and highest > -plain:
            return False
        highest, gap = max(highest, h), gap - FINELY * (abs(gap) + reach)
    if not highest > plain:
        return False
    found = averaged_orbits(oscillator, amplitude)
    if len(found) != 1:
        return False
    load_harmonic_orbit(found[0], harmonic)
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
