"""Which averaged orbit the controller finds when it engages from far.

At fixed drive the averaged orbits form a curve, followed here from far in the plane of the harmonic orbit's gap
b = z0 - A0 - A and of its amplitude. Quasi-static engagement follows the curve while z0 falls. Where z0 would rise
(a fold) the state jumps to the first later piece of the curve that z0 reaches again while falling. So the visited part
of the curve is where z0 is lower than ever before (theory, Eq. (engagement-1)), and the controller stops at the first
visited crossing of the setpoint; a crossing that lies inside the jump counts if the tip lands beyond it, since the
controller then retracts to it.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.leap import FARTHEST_FOLD, attraction_defies_averaging, landing_side
from phasemap._kernels.engagement.resonance import (
    ATTRACTIVE,
    DETUNED,
    REPULSIVE,
    STEEPEST,
    UNCLEAR,
    Maximum,
    decisive_mismatch,
    fill_averaged_orbit_on_side,
    find_mismatch_maximum,
    leaps,
    mismatch_at_gap,
    narrowest_amplitude_ratio,
    near_resonance,
    put_averaged_orbit,
    side_reached_from_far,
)
from phasemap._kernels.law import Oscillator
from phasemap._kernels.lever import free_amplitude, lowest_tip_offset, mismatch, reach_of, scale_of
from phasemap._kernels.orbits.averaged.harmonics import harmonics, put_harmonic_orbit
from phasemap._kernels.orbits.averaged.orbits import averaged_orbits, crossing, far_start, mismatch_slope

LARGEST_CURVE_STEP = 0.6  # in (zeta, WEIGHT ln A), with b = epsilon sinh(zeta)
SMALLEST_CURVE_STEP = 1e-6
TINY = 1e-6
AMPLITUDE_WEIGHT = 4.0
MOST_CURVE_STEPS = 400
FINELY = 0.15  # of the gap and the reach, in which the mismatch is looked at on the way in
MARGIN = 0.06  # a fold within this fraction of the setpoint makes the averaged decision doubtful
SURE = 0  # what averaging says of the branch
DOUBTFUL = 1
UNDECIDED = 2
LEAP = 3


@kernel
def log_mismatch(oscillator: Oscillator, reach: float, epsilon: float, zeta: float, eta: float) -> float:
    """Logarithm of drive needed over drive given, squared, in the coordinates in which the curve is followed."""
    lever = oscillator.lever
    amplitude = math.exp(eta / AMPLITUDE_WEIGHT)
    c = 1.0 + epsilon * math.sinh(zeta) / amplitude
    push, drag, _ = harmonics(oscillator, reach, amplitude, c)
    return math.log(1.0 + mismatch(lever, amplitude, push, drag))


@kernel
def low_q_margin_factor(lever: np.ndarray) -> float:
    """Factor by which damping widens decision margins: averaging neglects terms of order 1/Q."""
    return 1.0 + 120.0 * lever[col.ALPHA0]


@kernel
def engage_traced(oscillator: Oscillator, amplitude: float, guess: np.ndarray) -> tuple[int, int]:
    """`engage_by_averaging` along the whole curve of averaged orbits."""
    law, p, lever = oscillator
    free = free_amplitude(lever)
    reach = reach_of(law, p)
    epsilon = scale_of(oscillator, free)
    start = far_start(oscillator, reach, free, amplitude)
    zeta, eta = math.asinh((start - 1.0) * free / epsilon), AMPLITUDE_WEIGHT * math.log(free)
    step, t_zeta, t_eta = 0.3, -1.0, 0.0
    h = log_mismatch(oscillator, reach, epsilon, zeta, eta)
    a, c, z, lowest, found = free, start, start * free, 1e300, math.nan
    rising, surety, margin = False, SURE, MARGIN * low_q_margin_factor(lever)
    for _ in range(MOST_CURVE_STEPS):
        slope_zeta = (log_mismatch(oscillator, reach, epsilon, zeta + TINY, eta) - h) / TINY
        slope_eta = (log_mismatch(oscillator, reach, epsilon, zeta, eta + TINY) - h) / TINY
        slope = math.hypot(slope_zeta, slope_eta)
        n_zeta, n_eta = slope_zeta / slope, slope_eta / slope
        onward = 1.0 if n_eta * t_zeta - n_zeta * t_eta > 0.0 else -1.0
        turn = onward * (n_eta * t_zeta - n_zeta * t_eta)  # cosine of the angle to the step before
        t_zeta, t_eta = onward * n_eta, -onward * n_zeta
        if turn < 0.8:
            step *= max(0.3, turn)
        # From a point along the tangent, go back to the curve along the normal.
        while True:
            at_zeta, at_eta, s = zeta + step * t_zeta, eta + step * t_eta, 0.0
            h, across = log_mismatch(oscillator, reach, epsilon, at_zeta, at_eta), slope
            for _ in range(5):
                if abs(h) < 1e-3 * step * across:
                    break
                move = -h / across
                h_new = log_mismatch(
                    oscillator, reach, epsilon, at_zeta + (s + move) * n_zeta, at_eta + (s + move) * n_eta
                )
                across = (h_new - h) / move
                s, h = s + move, h_new
                if not 0.2 * slope < across < 5.0 * slope or abs(s) > 0.5 * step:
                    break
            if abs(h) < 1e-3 * step * slope and abs(s) < 0.5 * step:
                break
            step *= 0.4
            if step < SMALLEST_CURVE_STEP:
                return col.NO_AVERAGED_ORBIT, DOUBTFUL
        zeta, eta = at_zeta + s * n_zeta, at_eta + s * n_eta
        step = min(step * (1.6 if abs(s) < 0.1 * step else 1.0 if abs(s) < 0.25 * step else 0.6), LARGEST_CURVE_STEP)

        a_before, c_before, z_before = a, c, z
        a = math.exp(eta / AMPLITUDE_WEIGHT)
        c = 1.0 + epsilon * math.sinh(zeta) / a
        z = a * c + harmonics(oscillator, reach, a, c)[2]
        if a > a_before and not rising and abs(a_before - amplitude) < margin * amplitude:
            surety = DOUBTFUL
        rising = a > a_before
        if a_before > amplitude >= a and z < z_before and math.isnan(found):
            found = crossing(oscillator, reach, amplitude, c, c_before)
            if math.isnan(found):
                return col.NO_AVERAGED_ORBIT, DOUBTFUL
            if amplitude * found + harmonics(oscillator, reach, amplitude, found)[2] >= lowest:
                surety = DOUBTFUL
        elif a > amplitude >= a_before and z >= lowest:
            found = math.nan  # the tip lands before that crossing
        if not math.isnan(found) and z < lowest and (a < amplitude * (1.0 - margin) or rising):
            break
        lowest = min(lowest, z)
        if a < 0.3 * amplitude and c < -1.5:
            break
    if math.isnan(found):
        return col.NO_STABLE_ORBIT, DOUBTFUL
    push, drag, mean = harmonics(oscillator, reach, amplitude, found)
    put_harmonic_orbit(guess, amplitude, found, push, drag, mean)
    return col.GOOD, surety


@kernel(shared=True)
def engage_by_averaging(oscillator: Oscillator, amplitude: float, guess: np.ndarray, top: Maximum) -> tuple[int, int]:
    """Find the averaged orbit that holds `amplitude` after engaging from far.

    Fills guess = (z0, mean deflection, A, P, S, dh/dz0) and returns a status code and how sure the decision is; OPEN
    where averaging cannot tell the side, with the maximum of the mismatch in `top` and, after a leap, the orbit on the
    averaged curve or a P that is NaN; LEAP where the tip is carried over its resonance and only time can tell where.
    """
    law, p, lever = oscillator
    free, reach = free_amplitude(lever), reach_of(law, p)
    rises = p[col.LONGRANGE] != 0.0 and leaps(lever, reach, free)
    bent, near = rises and attraction_defies_averaging(oscillator, free), near_resonance(lever)
    if near:
        if bent:
            return col.GOOD, LEAP
        side = side_reached_from_far(oscillator, reach, amplitude, free, low_q_margin_factor(lever), top)
        doubtful = side == UNCLEAR and p[col.LONGRANGE] != 0.0
        if (doubtful or (rises and side != REPULSIVE)) and fill_only_averaged_orbit(
            oscillator, reach, amplitude, guess
        ):
            return col.GOOD, SURE
        if rises and side != REPULSIVE:
            landed = landing_side(oscillator, reach, free)
            if landed == REPULSIVE:
                find_mismatch_maximum(oscillator, reach, amplitude, math.inf, top)
                if fill_averaged_orbit_on_side(oscillator, reach, amplitude, REPULSIVE, top, guess):
                    return col.GOOD, SURE
            if landed != ATTRACTIVE:
                return col.GOOD, LEAP
        if doubtful and narrowest_amplitude_ratio(lever) <= 1.0:
            if rises and engage_traced(oscillator, amplitude, guess) != (col.GOOD, SURE):
                guess[col.G_P] = math.nan
            return col.GOOD, UNDECIDED
        if side != UNCLEAR and settle_side(oscillator, reach, amplitude, side, top, guess):
            return col.GOOD, SURE
        if rises and side == REPULSIVE and fill_only_averaged_orbit(oscillator, reach, amplitude, guess):
            return col.GOOD, SURE
        if rises and narrowest_amplitude_ratio(lever) > 1.0 and side != REPULSIVE:
            return col.GOOD, LEAP  # the curve from far may not lead to where the tip lands
    status, surety = engage_traced(oscillator, amplitude, guess)
    if status == col.GOOD:
        guess[col.G_SLOPE] = mismatch_slope(oscillator, guess)
        if rises and not near and guess[col.G_P] + amplitude * lever[col.DYNAMIC_STIFFNESS] < 0.0:
            return col.GOOD, LEAP
    return status, surety


@kernel
def fill_only_averaged_orbit(oscillator: Oscillator, reach: float, amplitude: float, guess: np.ndarray) -> bool:
    """Fill `guess` with the averaged orbit of this amplitude; False if there may be others or none.

    Where the sample takes so much, as where it is soft and lossy, that the lever is held before contact repels more
    than the rest attracts. As the tip comes near the mismatch then rises through zero from well below it to well above,
    and never falls again.
    """
    lever = oscillator.lever
    plain = decisive_mismatch(lever, amplitude, low_q_margin_factor(lever)) * (
        1.0 + DETUNED * abs(lever[col.DYNAMIC_STIFFNESS])
    )
    gap, deepest, highest = FARTHEST_FOLD * reach, lowest_tip_offset(oscillator), -math.inf
    while gap > deepest and gap > -2.0 * amplitude:
        h, _ = mismatch_at_gap(oscillator, reach, amplitude, gap)
        if h < min(highest, plain) and highest > -plain:
            return False
        highest, gap = max(highest, h), gap - FINELY * (abs(gap) + reach)
    if not highest > plain:
        return False
    found = averaged_orbits(oscillator, amplitude)
    if len(found) != 1:
        return False
    gap = found[0, col.G_Z0] - found[0, col.G_MEAN] - amplitude
    return put_averaged_orbit(oscillator, reach, amplitude, gap, guess) > STEEPEST


@kernel
def worst_amplitude(lever: np.ndarray, amplitude: float) -> float:
    """Amplitude [m], from the setpoint to the free one, at which the attractive branch is nearest to its end."""
    return max(amplitude, min(narrowest_amplitude_ratio(lever), 1.0) * free_amplitude(lever))


@kernel
def certainty_at_low_q(oscillator: Oscillator, amplitude: float, top: Maximum) -> int:
    """Return UNDECIDED, and fill `top`, if exact orbits may decide the branch where averaging cannot; else DOUBTFUL."""
    law, p, lever = oscillator
    if not near_resonance(lever):
        return DOUBTFUL
    if p[col.LONGRANGE] == 0.0:
        side = side_reached_from_far(oscillator, 0.0, amplitude, free_amplitude(lever), 1.0, top)
        return UNDECIDED if side != UNCLEAR else DOUBTFUL
    find_mismatch_maximum(oscillator, reach_of(law, p), worst_amplitude(lever, amplitude), math.inf, top)
    return UNDECIDED


@kernel
def settle_side(
    oscillator: Oscillator, reach: float, amplitude: float, side: int, top: Maximum, guess: np.ndarray
) -> bool:
    """Fill `guess` with the averaged orbit of this side at the setpoint; False where a fold is near."""
    p, lever = oscillator.p, oscillator.lever
    free = free_amplitude(lever)
    if p[col.LONGRANGE] != 0.0 and amplitude < narrowest_amplitude_ratio(lever) * free:
        # The maximum was sought where the attractive branch is nearest to its end; here it is another.
        find_mismatch_maximum(oscillator, reach, amplitude, 0.0 if side == ATTRACTIVE else math.inf, top)
        if side == ATTRACTIVE and not top.mismatch > 0.0:
            return False
    return fill_averaged_orbit_on_side(oscillator, reach, amplitude, side, top, guess)
