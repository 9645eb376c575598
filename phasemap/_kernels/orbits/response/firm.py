"""Whether an orbit that Newton's method on the response found is one that the tip can be held on."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels.columns import ALPHA0, DRIVE, DYNAMIC_LOSS, DYNAMIC_STIFFNESS, LONGRANGE, OMEGA, STIFFNESS
from phasemap._kernels.compilation import kernel
from phasemap._kernels.dense import factor, substitute
from phasemap._kernels.law import Oscillator, longrange_slope
from phasemap._kernels.lever import modes_of, static_compliance
from phasemap._kernels.orbits.response.multipliers import is_held
from phasemap._kernels.orbits.response.newton import Bench, copy_motion, drive_of, fill_system
from phasemap._kernels.orbits.response.nodes import (
    GAUSS_WEIGHTS,
    IN,
    OUT,
    N,
    contact_node,
    parts_of,
)
from phasemap._kernels.orbits.response.sound import kicked, touches_once, trace_of

LEAST_SLOPE_AT_NEWTON = 0.1  # dz0/dA: less is too near to a fold
SURELY = 0.98  # of the trace at which a multiplier is minus one, or one
CLEARLY = 0.5  # of (1 - lambda)^2 where both multipliers are alike: nearer to one they may not be


@kernel
def _rises(lever: np.ndarray, bench: Bench) -> bool:
    """Whether the tip offset clearly rises with the amplitude at the drive given: theory, Eq. (stability-5)."""
    f, state, m, right = bench.nodes, bench.state, bench.system, bench.right
    amplitude, n = state.amplitude, N * parts_of(f)
    s, y = lever[DYNAMIC_STIFFNESS], lever[DYNAMIC_LOSS]
    for j in range(n):
        right[j] = m[j, n] * f.cos[contact_node(j)] - m[j, n + 1] * f.sin[contact_node(j)]
    substitute(m, n, bench.order, right)
    per_a = 2.0 * ((state.push + amplitude * s) * s + (y * amplitude - state.drag) * y) / lever[DRIVE] ** 2
    per_e, mean_a, mean_e = 0.0, 0.0, 0.0
    for j in range(n):
        to_h, to_mean = drive_of(lever, f, state, j), GAUSS_WEIGHTS[j % N] * f.weight[contact_node(j)] / (2 * math.pi)
        per_a, per_e = per_a + to_h * right[j], per_e - to_h * bench.per_e[j]
        mean_a, mean_e = mean_a + to_mean * right[j], mean_e - to_mean * bench.per_e[j]
    e_a = -per_a / per_e
    return e_a - static_compliance(lever) * (mean_a + mean_e * e_a) > LEAST_SLOPE_AT_NEWTON


@kernel
def _stable(oscillator: Oscillator, bench: Bench) -> bool:
    """Whether both multipliers are surely within one: theory, Eq. (stability-4).

    Through the contact two motions are solved for as the orbit was; outside, the long-range stiffness kicks.
    """
    law, p, lever = oscillator
    f, state, m, one, two = bench.nodes, bench.state, bench.system, bench.right, bench.per_e
    omega, alpha0, n = lever[OMEGA], lever[ALPHA0], N * parts_of(f)
    a, nu, amplitude = -alpha0 / omega, math.sqrt(1.0 - alpha0 * alpha0) / omega, state.amplitude
    x1, y1, x2, y2, decay = 1.0, 0.0, 0.0, 1.0, -4.0 * math.pi * a
    copy_motion(f, bench.motions)
    fill_system(oscillator, f, state, bench.motions[:2], False, m)
    for j in range(n):
        i, kappa, gamma = contact_node(j), m[j, n], m[j, n + 1]
        c, s = f.turn_cos[i] / f.growth[i], f.turn_sin[i] / f.growth[i]
        one[j], two[j] = kappa * c + gamma * (a * c - nu * s), kappa * s + gamma * (a * s + nu * c)
        decay += GAUSS_WEIGHTS[j % N] * f.weight[i] * gamma / (omega * omega)
    if not factor(m, n, bench.order):
        return False
    substitute(m, n, bench.order, one)
    substitute(m, n, bench.order, two)
    for side in range(2):
        if side == 1:
            by_x1, by_y1, by_x2, by_y2 = 0.0, 0.0, 0.0, 0.0
            for j in range(n):
                i = contact_node(j)
                kick = GAUSS_WEIGHTS[j % N] * f.weight[i] * f.growth[i] / (omega * omega * nu)
                c, s = kick * f.turn_cos[i], kick * f.turn_sin[i]
                by_x1, by_y1 = by_x1 + s * one[j], by_y1 - c * one[j]
                by_x2, by_y2 = by_x2 + s * two[j], by_y2 - c * two[j]
            x1, y1, x2, y2 = (
                x1 + by_x1 * x1 + by_x2 * y1,
                y1 + by_y1 * x1 + by_y2 * y1,
                x2 + by_x1 * x2 + by_x2 * y2,
                y2 + by_y1 * x2 + by_y2 * y2,
            )
        for k in range(N if p[LONGRANGE] != 0.0 else 0):
            i = IN + N - 1 - k if side == 0 else OUT + k  # in the order of time
            d = min(amplitude * f.cos[i] + f.w[i] - state.centre, 0.0)
            kick = GAUSS_WEIGHTS[i % N] * f.weight[i] * longrange_slope(law, d, p)
            kick /= lever[STIFFNESS] * omega * omega * nu
            x1, y1 = kicked(f.turn_cos[i], f.turn_sin[i], kick, x1, y1)
            x2, y2 = kicked(f.turn_cos[i], f.turn_sin[i], kick, x2, y2)
    trace, determinant = trace_of(a, nu, x1, y1, x2, y2), math.exp(-decay)
    # Near resonance both multipliers lie near one, as those of the free lever do: (1 - lambda) (1 - lambda') is small.
    most = max(SURELY * (1.0 + determinant), 1.0 + determinant - CLEARLY * (1.0 - math.sqrt(determinant)) ** 2)
    return -SURELY * (1.0 + determinant) < trace < most


@kernel
def newton_orbit_is_kept(oscillator: Oscillator, reach: float, bench: Bench) -> bool:
    """Whether an orbit that was FOUND touches where it was taken to, is stable, and far from the end of its branch."""
    lever = oscillator.lever
    f, state = bench.nodes, bench.state
    if not _rises(lever, bench):
        return False
    if modes_of(lever) > 1:
        return is_held(oscillator, f, state) and touches_once(oscillator, reach, f, state)
    return _stable(oscillator, bench) and touches_once(oscillator, reach, f, state)
