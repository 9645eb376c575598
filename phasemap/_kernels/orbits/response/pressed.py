"""Exact orbits of a tip that never leaves the sample, by passes of the lever's response.

The force is smooth then, all the way round: nodes lie evenly on the period, sums over them converge like a power of
their number, and what a pass makes of the force,

    w(theta_i) = -sum_j K(theta_i - theta_j) g_j,
    K(theta) = (2/M) sum_n Re[exp(i n theta) / (1 - n^2 omega^2 + 2 i alpha0 n omega)],

n = 2 ... M/2 - 1, is a table of M numbers. Harmonics of so long a contact are small: a few passes do.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels.columns import ALPHA0, DAMPING, OMEGA, STIFFNESS
from phasemap._kernels.compilation import ANY_ORDER, kernel
from phasemap._kernels.law import Oscillator, contact_force, contact_slope, damping
from phasemap._kernels.lever import mismatch
from phasemap._kernels.orbits.response.apex import apex_between
from phasemap._kernels.orbits.response.passes import (
    ENERGY_LEFT,
    LIFT_LEFT,
    MOST_MOVES,
    MOST_PASSES,
    PassState,
    after_pass,
    first_pass,
    relative_energy_defect,
)
from phasemap._kernels.orbits.response.sound import DOUBLING, LEAST_SLOPE, turned
from phasemap._kernels.records import column, record

EVEN_NODES = 48  # nodes on a period
SHALLOWEST = 1.03  # e over -A: nearer than this to leaving contact the force is no longer smooth
_ANGLE = 2 * np.pi * np.arange(EVEN_NODES + 1) / EVEN_NODES
_COS, _SIN = np.cos(_ANGLE), np.sin(_ANGLE)


@record
class EvenNodes:
    """Motion and force at nodes that lie evenly on the period, and the response of the lever to a force at one."""

    omega: float  # of the lever that the tables are of
    alpha0: float
    w: np.ndarray = column(EVEN_NODES + 1)  # motion beyond mean and first harmonic [m]
    u: np.ndarray = column(EVEN_NODES + 1)  # dw/d(theta) [m]
    g: np.ndarray = column(EVEN_NODES)  # force over stiffness [m]
    to_w: np.ndarray = column(2 * EVEN_NODES + 1)  # what a force makes of w, twice round
    to_u: np.ndarray = column(2 * EVEN_NODES + 1)


@kernel
def _tabulate(lever: np.ndarray, f: EvenNodes) -> None:
    """Fill the response to a force at a node: entry M - i + j is that of node i to node j."""
    omega, alpha0 = lever[OMEGA], lever[ALPHA0]
    if f.omega == omega and f.alpha0 == alpha0:
        return
    f.omega, f.alpha0 = omega, alpha0
    for k in range(2 * EVEN_NODES + 1):
        f.to_w[k], f.to_u[k] = 0.0, 0.0
    for n in range(2, EVEN_NODES // 2):
        x, y = 1.0 - (n * omega) ** 2, 2.0 * alpha0 * n * omega
        below = 2.0 / (EVEN_NODES * (x * x + y * y))
        x, y = below * x, below * y
        for k in range(EVEN_NODES):
            c, s = _COS[n * k % EVEN_NODES], _SIN[n * k % EVEN_NODES]
            f.to_w[EVEN_NODES - k] -= x * c + y * s
            f.to_u[EVEN_NODES - k] -= n * (y * c - x * s)
    f.to_w[0], f.to_u[0] = f.to_w[EVEN_NODES], f.to_u[EVEN_NODES]
    for k in range(EVEN_NODES):
        f.to_w[EVEN_NODES + k], f.to_u[EVEN_NODES + k] = f.to_w[k], f.to_u[k]


@kernel(fastmath=ANY_ORDER)
def _respond(f: EvenNodes) -> None:
    """Replace w and w' by the lever's response to g."""
    g = f.g
    for i in range(EVEN_NODES):
        to_w, to_u = f.to_w[EVEN_NODES - i : 2 * EVEN_NODES - i], f.to_u[EVEN_NODES - i : 2 * EVEN_NODES - i]
        w, u = 0.0, 0.0
        for j in range(EVEN_NODES):
            w += to_w[j] * g[j]
            u += to_u[j] * g[j]
        f.w[i], f.u[i] = w, u


@kernel(fastmath=ANY_ORDER)
def _force(oscillator: Oscillator, f: EvenNodes, state: PassState) -> float:
    """Fill g at the nodes, and the state from it; returns the mismatch of the drive."""
    law, p, lever = oscillator
    amplitude, e, omega, inverse_k = state.amplitude, state.centre, lever[OMEGA], 1.0 / lever[STIFFNESS]
    mean, push, drag, work, loss, virial = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    damped = p[DAMPING] != 0.0
    for j in range(EVEN_NODES):
        at = amplitude * _COS[j] + f.w[j]
        d, turn = max(at - e, 0.0), f.u[j] - amplitude * _SIN[j]
        g = inverse_k * contact_force(law, d, p)
        work += g * turn
        if damped:
            drop = 2.0 * omega * damping(law, d, p) * turn
            loss += drop * turn
            g += drop
        f.g[j] = g
        mean, push, drag, virial = mean + g, push + g * _COS[j], drag + g * _SIN[j], virial + g * at
    state.mean_force, state.push, state.drag = mean / EVEN_NODES, 2.0 / EVEN_NODES * push, 2.0 / EVEN_NODES * drag
    share = 2.0 * math.pi / EVEN_NODES
    state.work, state.loss, state.virial = share * work, share * loss, share * virial
    return mismatch(lever, amplitude, state.push, state.drag)


@kernel
def _unresolved(f: EvenNodes) -> float:
    """Estimated error of P, S and the mean deflection [m], from the highest harmonic that the nodes show.

    What the nodes do not tell apart from P is twice as high; what the response leaves out goes with 1/n^2.
    """
    highest = 0.0
    for j in range(EVEN_NODES):
        highest += f.g[j] if j % 2 == 0 else -f.g[j]
    return 8.0 / (EVEN_NODES * EVEN_NODES) * abs(highest) / EVEN_NODES


@kernel
def _steady(oscillator: Oscillator, f: EvenNodes, state: PassState) -> bool:
    """Whether period doubling is far: theory, Eq. (stability-6), the whole period in contact."""
    law, p, lever = oscillator
    omega, alpha0, width = lever[OMEGA], lever[ALPHA0], 2.0 * math.pi / EVEN_NODES
    nu2 = (1.0 - alpha0 * alpha0) / (omega * omega)
    x1, y1, x2, y2, decay = 1.0, 0.0, 0.0, 1.0, 4.0 * math.pi * alpha0 / omega
    for j in range(EVEN_NODES):
        d = state.amplitude * _COS[j] + f.w[j] - state.centre
        squared = nu2 + contact_slope(law, d, p) / (lever[STIFFNESS] * omega * omega)
        x1, y1 = turned(squared, width, x1, y1)
        x2, y2 = turned(squared, width, x2, y2)
        if p[DAMPING] != 0.0:
            decay += 2.0 / omega * width * damping(law, d, p)
    return math.exp(-2.0 * math.pi * alpha0 / omega) * (x1 + y2) > -DOUBLING * (1.0 + math.exp(-decay))


@kernel
def _finish(f: EvenNodes, state: PassState) -> float:
    """Fill in the largest A cos(theta) + w, and return the least at the nodes."""
    f.w[EVEN_NODES], f.u[EVEN_NODES] = f.w[0], f.u[0]
    amplitude, most, least = state.amplitude, -math.inf, math.inf
    for j in range(EVEN_NODES):
        at = amplitude * _COS[j] + f.w[j]
        between, _ = apex_between(amplitude, _ANGLE[j], f.w[j], f.u[j], _ANGLE[j + 1], f.w[j + 1], f.u[j + 1])
        most, least = max(most, max(at, between)), min(least, at)
    state.apex = most
    return least


@kernel
def pressed_orbit(oscillator: Oscillator, limits: np.ndarray, f: EvenNodes, state: PassState) -> bool:
    """Exact orbit near the harmonic one of `state` if the tip stays in contact on it; as `converge` and `sound`.

    `f` is a scratch array, zero at first, which keeps the lever's table.
    """
    lever = oscillator.lever
    amplitude = state.amplitude
    _tabulate(lever, f)
    for j in range(EVEN_NODES):
        f.w[j], f.u[j] = 0.0, 0.0
    _force(oscillator, f, state)
    first_pass(state)
    for _ in range(MOST_PASSES):
        _respond(f)
        h = first = _force(oscillator, f, state)
        for _ in range(MOST_MOVES):
            h_before, move = h, -h / state.slope
            state.centre += move
            h = _force(oscillator, f, state)
            if abs(h) < LIFT_LEFT * abs(first):
                break
            if 0.3 < (h - h_before) / move / state.slope < 3.0:
                state.slope = (h - h_before) / move
        state.passes += 1
        ratio = after_pass(lever, state, h, f.w[0], _unresolved(f))
        if not (math.isfinite(state.phase + state.tip_offset) and state.centre < -amplitude):
            return False
        small = state.phase_error < limits[0] and state.tip_offset_error < limits[1]
        if ratio >= 0.0 and small and abs(relative_energy_defect(lever, state)) < ENERGY_LEFT:
            stays = _finish(f, state) - state.centre > (SHALLOWEST - 1.0) * amplitude
            clear = state.slope * (amplitude - state.centre) < -LEAST_SLOPE
            return stays and clear and _steady(oscillator, f, state)
    return False
