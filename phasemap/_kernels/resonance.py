"""Which side the tip is on at resonance, without following the curve of averaged orbits.

At resonance the largest attraction P falls as A^(-1/2), and what holding the ratio r = A/A_free takes is
u0 (1 - r^2)^(1/2): the attractive branch is nearest to its end at r = 3^(-1/2), or at the setpoint if that is above.
The mismatch of the drive rises there with the attraction to a first maximum. Well above zero, the tip stays attractive
down to the setpoint; well below, it jumps to the repulsive branch on the way; and each side has one crossing there.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from phasemap._kernels import columns as col
from phasemap._kernels.averaging import harmonics, mismatch
from phasemap._kernels.law import OPTIONS, Law, contact_force, longrange_force

ATTRACTIVE, REPULSIVE, UNCLEAR = -1, 1, 0
PLAIN = 0.06  # mismatch at the maximum that leaves no doubt, over that of the free lever
CLOSE = 1e-7  # mismatch left at a crossing, far below what averaging is wrong by
STEEPEST = 0.2  # least dz0/dA of an averaged orbit that is far from a fold
# Entries of a maximum: gap b = e - A [m], mismatch, P [m] there, and the same gap one step deeper.
GAP, HEIGHT, PUSH, BEHIND, MAXIMUM = 0, 1, 2, 3, 4


@njit(**OPTIONS)
def at_gap(
    law: Law, p: np.ndarray, lever: np.ndarray, reach: float, amplitude: float, gap: float
) -> tuple[float, float]:
    """Mismatch and in-phase force P of the harmonic orbit with this gap."""
    push, drag, _ = harmonics(law, p, lever, reach, amplitude, 1.0 + gap / amplitude)
    return mismatch(lever, amplitude, push, drag), push


@njit(**OPTIONS)
def balance_depth(law: Law, p: np.ndarray, reach: float) -> float:
    """Indentation [m] at which the elastic force makes up for the attraction, taking it to rise as d^(3/2)."""
    d = 0.1 * reach
    rise = contact_force(law, d, p) - contact_force(law, 0.0, p)
    if not rise > 0.0:
        return 10.0 * reach
    return min(d * (-longrange_force(law, 0.0, p) / rise) ** (2 / 3), 10.0 * reach)


@njit(**OPTIONS)
def strongest(
    law: Law, p: np.ndarray, lever: np.ndarray, reach: float, amplitude: float, plain: float, top: np.ndarray
) -> int:
    """Find the first maximum of the mismatch as the tip comes near, or stop early where it is plainly above zero."""
    h, push = at_gap(law, p, lever, reach, amplitude, 0.0)
    top[GAP], top[HEIGHT], top[PUSH] = 0.0, h, push
    if h >= plain:
        return ATTRACTIVE
    before, h_before, here, h_here = 0.0, h, 0.0, h
    deeper = -0.12 * balance_depth(law, p, reach)
    for _ in range(60):
        h, push = at_gap(law, p, lever, reach, amplitude, deeper)
        if h < h_here or push > 0.0:
            break
        top[GAP], top[HEIGHT], top[PUSH] = deeper, h, push
        if h >= plain:
            return ATTRACTIVE
        before, h_before, here, h_here = here, h_here, deeper, h
        deeper *= 2.0
    top[BEHIND] = deeper
    if here < 0.0 and push <= 0.0:
        # A parabola through three points, in the root of the depth.
        x0, x1, x2 = math.sqrt(-before), math.sqrt(-here), math.sqrt(-deeper)
        rise = (h_here - h_before) / (x1 - x0)
        bend = ((h - h_here) / (x2 - x1) - rise) / (x2 - x0)
        x = 0.5 * (x0 + x1) - 0.5 * rise / bend if bend < 0.0 else 0.0
        highest = h_before + (x - x0) * (rise + bend * (x - x1))
        if x0 < x < x2 and abs(highest) < 2.0 * plain:
            h, push = at_gap(law, p, lever, reach, amplitude, -x * x)
            if h > top[HEIGHT]:
                top[GAP], top[HEIGHT], top[PUSH] = -x * x, h, push
    if top[HEIGHT] >= plain:
        return ATTRACTIVE
    return REPULSIVE if top[HEIGHT] <= -plain else UNCLEAR


@njit(**OPTIONS)
def _between(
    law: Law, p: np.ndarray, lever: np.ndarray, reach: float, amplitude: float, side: int, shift: float,
    a: float, f_a: float, b: float, f_b: float,
) -> float:  # fmt: skip
    """Gap of the crossing between gaps a and b of opposite sign, by regula falsi in ln(gap + shift) or in the gap."""
    logarithmic = side == ATTRACTIVE
    if logarithmic:
        a, b = math.log(a + shift), math.log(b + shift)
    x = a
    for _ in range(50):
        x = (a * f_b - b * f_a) / (f_b - f_a)
        h, push = at_gap(law, p, lever, reach, amplitude, math.exp(x) - shift if logarithmic else x)
        f = sided(side, h, push)
        if abs(f) < CLOSE:
            return math.exp(x) - shift if logarithmic else x
        if (f > 0.0) == (f_b > 0.0):
            b, f_b = x, f
            f_a *= 0.5
        else:
            a, f_a = x, f
            f_b *= 0.5
    return math.nan


@njit(**OPTIONS)
def sided(side: int, h: float, push: float) -> float:
    """Logarithm of drive needed over drive given, squared; on the repulsive side negative wherever attraction holds."""
    if side == ATTRACTIVE or push > 0.0:
        return math.log1p(h)
    return min(-0.5, -abs(math.log1p(h)))


@njit(**OPTIONS)
def outer(law: Law, p: np.ndarray, lever: np.ndarray, reach: float, amplitude: float, top: np.ndarray) -> float:
    """Gap of the attractive crossing, outside of a point with more than enough attraction; NaN if it is not found."""
    near, h_near = top[GAP], top[HEIGHT]
    shift = reach + max(-near, 0.0)
    for _ in range(40):
        far = near + 2.0 * (near + shift)
        h, _ = at_gap(law, p, lever, reach, amplitude, far)
        if h <= 0.0:
            return _between(
                law, p, lever, reach, amplitude, ATTRACTIVE, shift, near, math.log1p(h_near), far, math.log1p(h)
            )
        near, h_near = far, h
    return math.nan


@njit(**OPTIONS)
def inner(law: Law, p: np.ndarray, lever: np.ndarray, reach: float, amplitude: float, top: np.ndarray) -> float:
    """Gap of the repulsive crossing, behind the strongest attraction; NaN if it is not found."""
    peak, want = top[GAP], lever[col.BASE] - top[PUSH]
    near, h_near, push_near = peak, top[HEIGHT], top[PUSH]
    gap = top[BEHIND]
    for _ in range(60):
        h, push = at_gap(law, p, lever, reach, amplitude, gap)
        if push > 0.0 and h > 0.0:
            f_near = sided(REPULSIVE, h_near, push_near)
            return _between(law, p, lever, reach, amplitude, REPULSIVE, 0.0, near, f_near, gap, math.log1p(h))
        near, h_near, push_near = gap, h, push
        # Behind the maximum P rises about as the square of the depth.
        grow = 1.1 * math.sqrt(want / max(push - top[PUSH], 0.02 * want))
        gap = peak + (gap - peak) * min(max(grow, 1.15), 4.0)
        if gap < -1.9 * amplitude:
            break
    return math.nan


@njit(**OPTIONS)
def decide(
    law: Law, p: np.ndarray, lever: np.ndarray, reach: float, amplitude: float, free: float, margin: float,
    top: np.ndarray,
) -> int:  # fmt: skip
    """Side on which the tip comes to this amplitude, by averaging; UNCLEAR nearer than `margin` to the jump."""
    top[:] = 0.0
    if p[4] == 0.0:
        # Without attraction there is one branch; with adhesion alone its onset jumps.
        top[BEHIND] = -1e-3 * amplitude
        return REPULSIVE if contact_force(law, 0.0, p) >= 0.0 else UNCLEAR
    plain = (PLAIN * (1.0 - (amplitude / free) ** 2) + 0.03) * margin
    return strongest(law, p, lever, reach, amplitude, plain, top)


@njit(**OPTIONS)
def on_side(
    law: Law, p: np.ndarray, lever: np.ndarray, reach: float, amplitude: float, side: int, top: np.ndarray,
    guess: np.ndarray,
) -> bool:  # fmt: skip
    """Fill guess = (z0, mean deflection, A, P, S, dh/dz0) with this side's averaged orbit, if it is far from a fold."""
    if side == ATTRACTIVE:
        gap = outer(law, p, lever, reach, amplitude, top)
    else:
        gap = inner(law, p, lever, reach, amplitude, top)
    if math.isnan(gap):
        return False
    c = 1.0 + gap / amplitude
    push, drag, mean = harmonics(law, p, lever, reach, amplitude, c)
    h = mismatch(lever, amplitude, push, drag)
    # dz0/dA along the orbits, from the two slopes of the mismatch at fixed A and fixed c.
    small = 1e-5 * (reach if reach > 0.0 else -gap)
    slope = (at_gap(law, p, lever, reach, amplitude, gap + small)[0] - h) / small
    larger = amplitude * 1.00001
    push_a, drag_a, _ = harmonics(law, p, lever, reach, larger, c)
    along = c - (mismatch(lever, larger, push_a, drag_a) - h) / (1e-5 * amplitude * slope)
    if not along > STEEPEST or (push > 0.0) != (side == REPULSIVE):
        return False
    guess[0], guess[1], guess[2], guess[3], guess[4], guess[5] = (
        amplitude * c + mean,
        mean,
        amplitude,
        push,
        drag,
        slope,
    )
    return True
