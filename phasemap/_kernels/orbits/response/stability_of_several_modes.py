"""The largest multiplier of an orbit of a lever that has several modes.

Between nodes each mode moves freely, at them the surface kicks all modes by what it makes of a small motion: its
stiffness, its damping. What a period so makes of a motion of each mode is the monodromy matrix.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels.columns import LONGRANGE, OMEGA, STIFFNESS
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator, longrange_slope
from phasemap._kernels.lever import all_shares, mode_of, modes_of
from phasemap._kernels.orbits.response.newton import stiffness
from phasemap._kernels.orbits.response.nodes import (
    ENTRY,
    EXIT,
    GAUSS_WEIGHTS,
    LATE,
    OUT,
    N,
    Nodes,
    contact_node,
    count_of,
    fill_mode,
    parts_of,
)  # fmt: skip
from phasemap._kernels.orbits.response.state import PassState

SQUARINGS_WITHIN = 20  # of a monodromy matrix, that show whether its powers vanish
DIVERGED_POWER = 1e60  # entry of a power of it that will not vanish
FAINT_KICK = 1e-7  # [rad], change of the rate by a kick that does nothing
CLEARLY_HELD = 0.25  # of what a free lever's slowest mode loses in a period, that must be lost at least


@kernel
def is_held(oscillator: Oscillator, nodes: Nodes, state: PassState) -> bool:
    """Whether all multipliers of a lever of several modes are within one, and clearly so."""
    lever, slowest = oscillator.lever, -math.inf
    size = 2 * modes_of(lever)
    for i in range(modes_of(lever)):
        slowest = max(slowest, mode_of(lever, i).decay)
    motions = np.zeros((size, size))
    fill_monodromy(oscillator, nodes, state, motions)
    return _is_within(motions, 1.0 + CLEARLY_HELD * math.expm1(2.0 * math.pi * slowest))


@kernel
def _is_within(m: np.ndarray, bound: float) -> bool:
    """Whether all eigenvalues of a matrix are: its powers then vanish."""
    n = len(m)
    power, squared = m / bound, np.empty((n, n))
    for _ in range(SQUARINGS_WITHIN):
        largest = 0.0
        for i in range(n):
            for j in range(n):
                largest = max(largest, abs(power[i, j]))
        if n * largest < 1.0:
            return True
        if not largest < DIVERGED_POWER:
            break
        for i in range(n):
            for j in range(n):
                total = 0.0
                for k in range(n):
                    total += power[i, k] * power[k, j]
                squared[i, j] = total
        power, squared = squared, power
    return False


@kernel
def fill_monodromy(oscillator: Oscillator, nodes: Nodes, state: PassState, motions: np.ndarray) -> None:
    """Fill in the monodromy matrix, shape (2 modes, 2 modes) and zero at first: theory, Eq. (stability-7)."""
    lever = oscillator.lever
    modes = modes_of(lever)
    turns, one = np.empty((count_of(nodes), 3 * modes)), np.empty((2, 2 * modes))
    for i in range(modes):
        mode = mode_of(lever, i)
        fill_mode(nodes, mode)
        for j in range(count_of(nodes)):
            turns[j, 3 * i], turns[j, 3 * i + 1], turns[j, 3 * i + 2] = (
                nodes.growth[j],
                nodes.turn_cos[j],
                nodes.turn_sin[j],
            )
        motions[2 * i, 2 * i] = motions[2 * i + 1, 2 * i + 1] = 1.0
    touching, longrange = nodes.theta[EXIT] > nodes.theta[ENTRY], oscillator.p[LONGRANGE] != 0.0
    contact = N * parts_of(nodes)
    for k in range(2 * N + contact):
        # In the order of time: the element before contact runs backwards.
        j = N - 1 - k if k < N else contact_node(k - N) if k < N + contact else OUT + k - N - contact
        if touching if N <= k < N + contact else longrange:
            _kick(oscillator, nodes, state, j, N <= k < N + contact, turns[j], one, motions)
    for i in range(modes):  # on to the next period
        mode = mode_of(lever, i)
        shrink = math.exp(2.0 * math.pi * mode.decay)
        c, s = shrink * math.cos(2.0 * math.pi * mode.turn), shrink * math.sin(2.0 * math.pi * mode.turn)
        for k in range(2 * modes):
            x, y = motions[2 * i, k], motions[2 * i + 1, k]
            motions[2 * i, k], motions[2 * i + 1, k] = c * x + s * y, c * y - s * x


@kernel
def _kick(
    oscillator: Oscillator, nodes: Nodes, state: PassState, j: int, in_contact: bool, turns: np.ndarray,
    one: np.ndarray, motions: np.ndarray,
) -> None:  # fmt: skip
    """Kick small motions x cos(nu theta) + y sin(nu theta) of each mode by the surface's answer at a node.

    `turns` (shape (3 modes,)): growth, cosine and sine of each mode there.
    `one` (shape (2, 2 modes)): room.
    `motions` (shape (2 modes, 2 modes)): x and y of each mode, a motion in each column.
    """
    law, p, lever = oscillator
    omega, modes = lever[OMEGA], modes_of(lever)
    d = state.amplitude * nodes.cos[j] + nodes.w[j] - state.centre
    width = GAUSS_WEIGHTS[j % N if j < LATE else (j - LATE) % N] * nodes.weight[j] / (omega * omega)
    if in_contact:
        kappa, gamma = stiffness(oscillator, max(d, 0.0), nodes.u[j] - state.amplitude * nodes.sin[j])
    else:
        kappa, gamma = longrange_slope(law, min(d, 0.0), p) / lever[STIFFNESS], 0.0
    if width * (abs(kappa) + gamma) < FAINT_KICK:
        return
    for i in range(modes):
        mode = mode_of(lever, i)
        c, s, grow = turns[3 * i + 1], turns[3 * i + 2], turns[3 * i]
        one[0, 2 * i] = (kappa * c + gamma * (mode.decay * c - mode.turn * s)) / grow
        one[0, 2 * i + 1] = (kappa * s + gamma * (mode.decay * s + mode.turn * c)) / grow
        one[1, 2 * i] = width * mode.share / mode.turn * grow * s
        one[1, 2 * i + 1] = -width * mode.share / mode.turn * grow * c
    within = 1.0 / (1.0 + 0.5 * width * gamma * all_shares(lever))  # damping acts on the mean of the velocities
    for k in range(2 * modes):
        force = 0.0
        for i in range(2 * modes):
            force += one[0, i] * motions[i, k]
        for i in range(2 * modes):
            motions[i, k] += within * force * one[1, i]
