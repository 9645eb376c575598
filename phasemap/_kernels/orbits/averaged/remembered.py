"""Harmonics of the force of a contact that remembers, over a tap d = A (cos(theta) - c) on a surface without dents.

Nothing has to be marched, for the tip's way is known (theory, Eqs. (memory-8) and (memory-9)). With T = omega tau the
depth D that a dashpot sees is in closed form; while the contact grows F = K sqrt(R) (d^(3/2) - (3/2) kappa Y), with Y
a low-pass of (2/3) d^(3/2); while it shrinks its edge is where it was at an earlier theta_1, of which theta is a
function. Both ways are integrated over the nodes of theta_1, sin(theta_1/2) = -sin(theta_0/2) sin(psi).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law, Oscillator, contact_force, has_longrange, longrange_force
from phasemap._kernels.lever import distance_to_pole, reach_of
from phasemap._kernels.numerics import newton_in_bracket
from phasemap._kernels.orbits.time.arms import Arms, fill_arms, recovery_of
from phasemap._kernels.orbits.time.surface_memory import Layer, layer_of, pressed_to
from phasemap._kernels.quadrature import gauss, gauss_on_half_line

TapSums = tuple[float, float, float]  # integrals of F, F cos(theta), F sin(theta)


class Angle(NamedTuple):
    """Angle in retraction at which the edge of the contact is again where it was on the way in."""

    theta: float
    depth: float  # d over A
    rate: float  # d theta / d theta_1, over sin(theta_1)


LAST_ANGLE, MOST_ANGLES = 1e-6, 40  # of the angle sought for, last step; steps
_X, _W = gauss(16)
_COS, _SIN, _WEIGHTS = np.cos(_X[::-1] * np.pi / 2), np.sin(_X[::-1] * np.pi / 2), _W[::-1] * np.pi / 2  # theta rises
_FAR_X, _FAR_W = gauss_on_half_line(16)


@kernel(inline=True)
def _tap_sums_with(sums: TapSums, force: float, cosine: float, sine: float) -> TapSums:
    """Mean, in-phase and out-of-phase sums with the force at one more node."""
    mean, push, drag = sums
    return mean + force, push + force * cosine, drag + force * sine


@kernel(inline=True)
def _dashpot_depth(time: float, c: float, start: float, theta: float, cosine: float, sine: float) -> float:
    """Depth D over A that the dashpot of an arm sees at the angle `theta` of a tap d = A (cos(theta) - c).

    It solves D + T dD/d(theta) = d with D = 0 at the first touch, at `start`; T = omega tau is `time`.
    """
    rest = c - (c + time * math.sin(start)) / (1 + time * time)
    return (cosine + time * sine) / (1 + time * time) - c + rest * math.exp((start - theta) / time)


@kernel
def _angle_of_equal_edge(
    arms: Arms, omega: float, tap: tuple[float, float], row: np.ndarray, q2: float, back: float, most: float
) -> Angle:
    """Angle theta in retraction at which the edge q^2 is again that of theta_1, and depth over A; see `Angle`.

    d = q^2 + sum kappa y, y = D - q^2 - (D_1 - q^2) exp((theta_1 - theta)/T), by Newton's method in brackets from
    `back`; `row` has theta_1, a weight and D_1 of each arm. D and what is kept are left in values and slopes.
    """
    c, start = tap
    low, high, at = 0.0, most, back
    d, held, falls = 0.0, 1.0, 0.0
    for _ in range(MOST_ANGLES):
        cosine, sine = math.cos(at), math.sin(at)
        d, off, falls, held = cosine - c, cosine - c - q2, sine, 1.0
        for a in range(arms.count):
            time, share = omega / arms.rate[a], arms.share[a]
            dashpot_depth, kept = _dashpot_depth(time, c, start, at, cosine, sine), math.exp((row[0] - at) / time)
            left = (row[2 + a] - q2) * kept
            off -= share * (dashpot_depth - q2 - left)
            falls += share / time * (d - dashpot_depth + left)
            held -= share * (1 - kept)
            arms.value[a], arms.slope[a] = dashpot_depth, kept
        before = at
        at, low, high = newton_in_bracket(at, off, -falls, low, high, False)
        if abs(at - before) < LAST_ANGLE * most:
            break
    return Angle(at, d, held / falls)


@kernel
def _relaxing_sums(p: Any, amplitude: float, c: float, omega: float) -> tuple[TapSums, float]:
    """Integrals of the force of a solid that relaxes [N], and theta where the contact ends."""
    arms = Arms()
    fill_arms(p, arms)
    n, m2, of_material = arms.count, 0.5 * (1 - c), layer_of(p)
    layer = Layer(of_material.thinness * math.sqrt(amplitude), of_material.first)  # of lengths over the amplitude
    m, start = math.sqrt(m2), -2 * math.asin(math.sqrt(m2))
    tap, scale = (c, start), 1.5 * p[col.CONTACT] * amplitude**1.5
    sums, growing = (0.0, 0.0, 0.0), np.empty((len(_COS), 2 + 2 * n))
    before, last = 0.0, start
    for a in range(n):
        arms.y[a] = 0.0  # of each arm, Y
    for i in range(len(_COS)):
        slope = math.sqrt(1 - m2 * _SIN[i] * _SIN[i])
        d, theta = (1 - c) * _COS[i] * _COS[i], -2 * math.asin(m * _SIN[i])
        cosine, sine = d + c, -2 * m * _SIN[i] * slope
        whole, weight = pressed_to(layer, math.sqrt(d), d)[0], _WEIGHTS[i] * 2 * m * _COS[i] / slope
        force = whole
        for a in range(n):
            time = omega / arms.rate[a]
            passed = (theta - last) / time
            faded = -math.expm1(-passed)  # the low-pass of what is linear from node to node
            arms.y[a] += faded * (before - arms.y[a]) + (1 - faded / passed) * (whole - before)
            force -= arms.share[a] * arms.y[a]
            growing[i, 2 + a], growing[i, 2 + n + a] = _dashpot_depth(time, c, start, theta, cosine, sine), arms.y[a]
        sums = _tap_sums_with(sums, weight * scale * force, cosine, sine)
        growing[i, 0], growing[i, 1] = theta, weight
        before, last = whole, theta
    back = 1.0
    for i in range(len(_COS) - 1, -1, -1):
        row, theta, weight = growing[i], growing[i, 0], growing[i, 1]
        q2 = (1 - c) * _COS[i] * _COS[i]
        leaving = _angle_of_equal_edge(arms, omega, tap, row, q2, -back * theta, -theta)
        back = -leaving.theta / theta
        q, sine = math.sqrt(q2), math.sin(leaving.theta)
        force = pressed_to(layer, q, leaving.depth)[0]
        for a in range(n):
            now, before = pressed_to(layer, q, arms.value[a])[0], pressed_to(layer, q, row[2 + a])[0]
            force -= arms.share[a] * (now - arms.slope[a] * (before - row[2 + n + a]))
        weight *= math.sin(theta) * leaving.rate  # d theta / d theta_1
        sums = _tap_sums_with(sums, -weight * scale * force, leaving.depth + c, sine)
    first = np.zeros(2 + n)
    first[0] = start
    return sums, _angle_of_equal_edge(arms, omega, tap, first, 0.0, -back * start, -start).theta


@kernel
def _kelvin_voigt_sums(p: Any, amplitude: float, c: float, time: float) -> tuple[TapSums, float]:
    """Sums of a Kelvin-Voigt contact after Ting, and the angle of its end: theory, Eq. (memory-7), time = omega t0."""
    m2, whole = 0.5 * (1 - c), math.hypot(1.0, time)
    m, lag = math.sqrt(m2), math.atan(time)
    end, scale, sums = math.acos(c / whole) - lag, p[col.CONTACT] * amplitude**1.5, (0.0, 0.0, 0.0)
    for i in range(len(_COS)):
        slope, q = math.sqrt(1 - m2 * _SIN[i] * _SIN[i]), math.sqrt(1 - c) * _COS[i]
        cosine, sine = q * q + c, -2 * m * _SIN[i] * slope
        force = scale * (q * q * q - 1.5 * time * q * sine)
        sums = _tap_sums_with(sums, _WEIGHTS[i] * 2 * m * _COS[i] / slope * force, cosine, sine)
        theta = end * (1 - _COS[i] * _COS[i])
        pushed = max(whole * math.cos(theta + lag) - c, 0.0)
        weight = _WEIGHTS[i] * end * 2 * _COS[i] * _SIN[i]
        sums = _tap_sums_with(sums, weight * scale * pushed * math.sqrt(pushed), math.cos(theta), math.sin(theta))
    return sums, end


@kernel
def _longrange_integrals_over_dent(
    law: Law, p: Any, amplitude: float, c: float, theta: float, dent: float, rate: float
) -> TapSums:
    """Integrals of the long-range force from theta to pi over a dent that recovers, theory, Eq. (memory-6)."""
    start, sums = math.tan(0.5 * theta), (0.0, 0.0, 0.0)
    delta = distance_to_pole(start, reach_of(p) / amplitude)
    for i in range(len(_FAR_X)):
        u = start + delta * _FAR_X[i]
        below = 1 / (1 + u * u)
        cosine = 2 * below - 1
        gap = c - cosine
        if dent > 0:
            gap += dent * math.exp((theta - 2 * math.atan(u)) * rate)
        force = delta * _FAR_W[i] * below * longrange_force(law, -amplitude * max(gap, 0.0), p)
        sums = _tap_sums_with(sums, force, cosine, 2 * u * below)
    return sums


@kernel
def remembered_harmonics(oscillator: Oscillator, amplitude: float, c: float) -> TapSums:
    """P, S and A0 [m] of the harmonic orbit that taps, -1 < c < 1, as `harmonics` has them."""
    law, p, lever = oscillator
    omega, recovery = lever[col.OMEGA], recovery_of(p, lever)
    if p[col.RELAXATION] > 0:
        sums, end = _relaxing_sums(p, amplitude, c, omega)
    else:
        sums, end = _kelvin_voigt_sums(p, amplitude, c, omega / recovery)
    touch, pull = math.acos(c), contact_force(law, 0.0, p)
    sums = _tap_sums_with(sums, pull * (end + touch), 0.0, 0.0)
    mean, push, drag = sums
    push += pull * (math.sin(end) + math.sin(touch))
    drag += pull * (math.cos(touch) - math.cos(end))
    if has_longrange(p):
        dent = max(math.cos(end) - c, 0.0)
        mean_in, push_in, drag_in = _longrange_integrals_over_dent(law, p, amplitude, c, touch, 0.0, 0.0)
        mean_out, push_out, drag_out = _longrange_integrals_over_dent(law, p, amplitude, c, end, dent, recovery / omega)
        mean += mean_in + mean_out
        push += push_in + push_out
        drag += drag_out - drag_in
    share = 1 / (math.pi * lever[col.STIFFNESS])
    return share * push, share * drag, -0.5 * share * mean
