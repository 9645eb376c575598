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
from phasemap._kernels.law import Law, contact_force, contact_slope, damping
from phasemap._kernels.lever import mismatch
from phasemap._kernels.orbits.response.apex import apex_between
from phasemap._kernels.orbits.response.passes import (
    AMP,
    APEX,
    CLOSED,
    DRAG,
    ENOUGH,
    ERR_HEIGHT,
    ERR_PHASE,
    HEIGHT,
    LOSS,
    MEAN,
    MOST_MOVES,
    MOST_PASSES,
    PASSES,
    PHASE,
    PUSH,
    SLOPE,
    VIRIAL,
    WORK,
    E,
    after_pass,
    closure,
    first_pass,
)
from phasemap._kernels.orbits.response.sound import DOUBLING, LEAST_SLOPE, turned

M = 48  # nodes on a period
SHALLOWEST = 1.03  # e over -A: nearer than this to leaving contact the force is no longer smooth
_ANGLE = 2 * np.pi * np.arange(M + 1) / M
_COS, _SIN = np.cos(_ANGLE), np.sin(_ANGLE)
# Rows of the scratch array, shape (ROWS, 2 M + 1): motion, its rate, force, twice round what a force makes of both, and
# omega and alpha0 of the lever that does.
W, U, G, TO_W, TO_U, OF, ROWS = 0, 1, 2, 3, 4, 5, 6


@kernel
def _tabulate(lever: np.ndarray, f: np.ndarray) -> None:
    """Fill the response to a force at a node: entry M - i + j is that of node i to node j."""
    omega, alpha0 = lever[OMEGA], lever[ALPHA0]
    if f[OF, 0] == omega and f[OF, 1] == alpha0:
        return
    f[OF, 0], f[OF, 1] = omega, alpha0
    f[TO_W], f[TO_U] = 0.0, 0.0
    for n in range(2, M // 2):
        x, y = 1.0 - (n * omega) ** 2, 2.0 * alpha0 * n * omega
        below = 2.0 / (M * (x * x + y * y))
        x, y = below * x, below * y
        for k in range(M):
            c, s = _COS[n * k % M], _SIN[n * k % M]
            f[TO_W, M - k] -= x * c + y * s
            f[TO_U, M - k] -= n * (y * c - x * s)
    f[TO_W, 0], f[TO_U, 0] = f[TO_W, M], f[TO_U, M]
    for k in range(M):
        f[TO_W, M + k], f[TO_U, M + k] = f[TO_W, k], f[TO_U, k]


@kernel(fastmath=ANY_ORDER)
def _respond(f: np.ndarray) -> None:
    """Replace w and w' by the lever's response to g."""
    g = f[G]
    for i in range(M):
        to_w, to_u = f[TO_W, M - i : 2 * M - i], f[TO_U, M - i : 2 * M - i]
        w, u = 0.0, 0.0
        for j in range(M):
            w += to_w[j] * g[j]
            u += to_u[j] * g[j]
        f[W, i], f[U, i] = w, u


@kernel(fastmath=ANY_ORDER)
def _force(law: Law, p: np.ndarray, lever: np.ndarray, f: np.ndarray, state: np.ndarray) -> float:
    """Fill g at the nodes, and the state from it; returns the mismatch of the drive."""
    amplitude, e, omega, inverse_k = state[AMP], state[E], lever[OMEGA], 1.0 / lever[STIFFNESS]
    mean, push, drag, work, loss, virial = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    damped = p[DAMPING] != 0.0
    for j in range(M):
        at = amplitude * _COS[j] + f[W, j]
        d, turn = max(at - e, 0.0), f[U, j] - amplitude * _SIN[j]
        g = inverse_k * contact_force(law, d, p)
        work += g * turn
        if damped:
            drop = 2.0 * omega * damping(law, d, p) * turn
            loss += drop * turn
            g += drop
        f[G, j] = g
        mean, push, drag, virial = mean + g, push + g * _COS[j], drag + g * _SIN[j], virial + g * at
    state[MEAN], state[PUSH], state[DRAG] = mean / M, 2.0 / M * push, 2.0 / M * drag
    share = 2.0 * math.pi / M
    state[WORK], state[LOSS], state[VIRIAL] = share * work, share * loss, share * virial
    return mismatch(lever, amplitude, state[PUSH], state[DRAG])


@kernel
def _unresolved(f: np.ndarray) -> float:
    """Estimated error of P, S and the mean deflection [m], from the highest harmonic that the nodes show.

    What the nodes do not tell apart from P is twice as high; what the response leaves out goes with 1/n^2.
    """
    highest = 0.0
    for j in range(M):
        highest += f[G, j] if j % 2 == 0 else -f[G, j]
    return 8.0 / (M * M) * abs(highest) / M


@kernel
def _steady(law: Law, p: np.ndarray, lever: np.ndarray, f: np.ndarray, state: np.ndarray) -> bool:
    """Whether period doubling is far: theory, Eq. (stability-6), the whole period in contact."""
    omega, alpha0, width = lever[OMEGA], lever[ALPHA0], 2.0 * math.pi / M
    nu2 = (1.0 - alpha0 * alpha0) / (omega * omega)
    x1, y1, x2, y2, decay = 1.0, 0.0, 0.0, 1.0, 4.0 * math.pi * alpha0 / omega
    for j in range(M):
        d = state[AMP] * _COS[j] + f[W, j] - state[E]
        squared = nu2 + contact_slope(law, d, p) / (lever[STIFFNESS] * omega * omega)
        x1, y1 = turned(squared, width, x1, y1)
        x2, y2 = turned(squared, width, x2, y2)
        if p[DAMPING] != 0.0:
            decay += 2.0 / omega * width * damping(law, d, p)
    return math.exp(-2.0 * math.pi * alpha0 / omega) * (x1 + y2) > -DOUBLING * (1.0 + math.exp(-decay))


@kernel
def _finish(f: np.ndarray, state: np.ndarray) -> float:
    """Fill in the largest A cos(theta) + w, and return the least at the nodes."""
    f[W, M], f[U, M] = f[W, 0], f[U, 0]
    amplitude, most, least = state[AMP], -math.inf, math.inf
    for j in range(M):
        at = amplitude * _COS[j] + f[W, j]
        between, _ = apex_between(amplitude, _ANGLE[j], f[W, j], f[U, j], _ANGLE[j + 1], f[W, j + 1], f[U, j + 1])
        most, least = max(most, max(at, between)), min(least, at)
    state[APEX] = most
    return least


@kernel
def press(law: Law, p: np.ndarray, lever: np.ndarray, limits: np.ndarray, f: np.ndarray, state: np.ndarray) -> bool:
    """Exact orbit near the harmonic one of `state` if the tip stays in contact on it; as `converge` and `sound`.

    `f` is a scratch array, zero at first, which keeps the lever's table.
    """
    amplitude = state[AMP]
    _tabulate(lever, f)
    f[W], f[U] = 0.0, 0.0
    _force(law, p, lever, f, state)
    first_pass(state)
    for _ in range(MOST_PASSES):
        _respond(f)
        h = first = _force(law, p, lever, f, state)
        for _ in range(MOST_MOVES):
            h_before, move = h, -h / state[SLOPE]
            state[E] += move
            h = _force(law, p, lever, f, state)
            if abs(h) < ENOUGH * abs(first):
                break
            if 0.3 < (h - h_before) / move / state[SLOPE] < 3.0:
                state[SLOPE] = (h - h_before) / move
        state[PASSES] += 1.0
        ratio = after_pass(lever, state, h, f[W, 0], _unresolved(f))
        if not (math.isfinite(state[PHASE] + state[HEIGHT]) and state[E] < -amplitude):
            return False
        small = state[ERR_PHASE] < limits[0] and state[ERR_HEIGHT] < limits[1]
        if ratio >= 0.0 and small and abs(closure(lever, state)) < CLOSED:
            stays = _finish(f, state) - state[E] > (SHALLOWEST - 1.0) * amplitude
            clear = state[SLOPE] * (amplitude - state[E]) < -LEAST_SLOPE
            return stays and clear and _steady(law, p, lever, f, state)
    return False
