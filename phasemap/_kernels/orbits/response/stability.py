"""Checks of a converged orbit by passes: the tip touches where it was taken to touch, and the orbit is stable.

A small motion of each mode, x cos(nu theta) + y sin(nu theta), goes on freely between nodes and is kicked at them by
what the surface makes of it: its stiffness, its damping. What a period makes of it is the monodromy matrix, of one mode
theory, Eq. (stability-6), of several Eq. (stability-7).
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels.columns import ALPHA0, DAMPING, OMEGA, STIFFNESS
from phasemap._kernels.compilation import ANY_ORDER, kernel
from phasemap._kernels.law import Oscillator, contact_slope, damping, has_longrange, longrange_slope
from phasemap._kernels.lever import low_q, reach_of
from phasemap._kernels.lever_modes import all_shares, mode_of, modes_of
from phasemap._kernels.numerics import spectral_radius
from phasemap._kernels.orbits.response.apex import apex_between
from phasemap._kernels.orbits.response.motion import fill_response
from phasemap._kernels.orbits.response.newton_pass import surface_stiffness
from phasemap._kernels.orbits.response.nodes import (
    ENTRY,
    EXIT,
    IN,
    OUT,
    TOUCH,
    N,
    Nodes,
    contact_node,
    count_of,
    depth_at_node,
    fill_mode,
    grade_outer_nodes,
    lay_nodes,
    node_in_time,
    parts_of,
    rate_at_node,
    weight_of_node,
)
from phasemap._kernels.orbits.response.state import (
    LARGEST_CLOSURE,
    PassState,
    energy_closure_of_passes,
    slope_by_tip_offset,
)

DOUBLING = 0.75  # of the trace of the monodromy matrix at which a period doubles: nearer than this is not sure
BESIDE_CONTACT = 1e-3  # of the depth or the reach, by which nodes may lie beside the contact
LEAST_MISMATCH_SLOPE = 0.05  # of the mismatch over the depth: flatter is too near to where the branch ends
SQUARINGS_WITHIN = 20  # of a monodromy matrix, for its multipliers to some millionths
FAINT_KICK = 1e-7  # [rad], change of the rate by a kick that does nothing
CLEARLY_HELD = 0.25  # of what a free lever's slowest mode loses in a period, that must be lost at least


@kernel(fastmath=ANY_ORDER)
def motion_after_kick(c: float, s: float, kick: float, x: float, y: float) -> tuple[float, float]:
    """Motion (x, y) of one mode after a kick by a stiffness, at an angle with cosine c and sine s of nu theta."""
    force = kick * (c * x + s * y)
    return x + force * s, y - force * c


@kernel(fastmath=ANY_ORDER)
def motion_on_spring(squared: float, width: float, v: float, u: float) -> tuple[float, float]:
    """Motion v and its rate u after an angle `width`, under a stiffness that stays: v'' = -squared v."""
    z = squared * width * width
    c = 1.0 - z / 2.0 * (1.0 - z / 12.0 * (1.0 - z / 30.0))
    s = width * (1.0 - z / 6.0 * (1.0 - z / 20.0 * (1.0 - z / 42.0)))
    return c * v + s * u, c * u - squared * s * v


@kernel
def force_length(p: np.ndarray, state: PassState) -> float:
    """Length [m] over which the force changes on an orbit: the depth of its contact, or the gap with the reach."""
    return max(reach_of(p) + max(state.centre - state.amplitude, 0.0), state.amplitude - state.centre)


@kernel
def _is_sound(lever: np.ndarray, state: PassState, length: float) -> bool:
    """True if the mismatch falls clearly as the tip rises by this length [m], for no fold is near; energy closes."""
    falls = slope_by_tip_offset(lever, state) * length < -LEAST_MISMATCH_SLOPE
    return falls and abs(energy_closure_of_passes(lever, state)) < LARGEST_CLOSURE


@kernel(fastmath=ANY_ORDER)
def trace_of_one_mode(oscillator: Oscillator, nodes: Nodes, state: PassState) -> tuple[float, float]:
    """Trace of the monodromy matrix of one mode, NaN where the tip touches elsewhere, and the decay of its determinant.

    The mode is kicked at every node outside contact by the stiffness there, and turned faster by it in contact. The
    determinant exp(-decay) has the damping of the contact, the trace leaves it out.
    """
    law, p, lever = oscillator
    omega, alpha0, inverse_k = lever[OMEGA], lever[ALPHA0], 1.0 / lever[STIFFNESS]
    a, nu = -alpha0 / omega, math.sqrt(1.0 - alpha0 * alpha0) / omega
    x1, y1, x2, y2 = 1.0, 0.0, 0.0, 1.0
    fill_mode(nodes, mode_of(lever, 0))
    contact, beside, decay = N * parts_of(nodes), BESIDE_CONTACT * force_length(p, state), -4.0 * math.pi * a
    for k in range(2 * N + contact):
        j, in_contact = node_in_time(nodes, k), N <= k < N + contact
        if (nodes.touches if in_contact else nodes.outside) == 0:
            continue
        d, width = depth_at_node(nodes, state.amplitude, state.centre, j), weight_of_node(nodes, j)
        if d < -beside if in_contact else d > beside:
            return math.nan, decay
        slope = contact_slope(law, max(d, 0.0), p) if in_contact else longrange_slope(law, min(d, 0.0), p)
        if in_contact and p[DAMPING] != 0.0:
            decay += 2.0 / omega * width * damping(law, max(d, 0.0), p)
        squared = inverse_k * slope / (omega * omega)
        if not in_contact:
            x1, y1 = motion_after_kick(nodes.turn_cos[j], nodes.turn_sin[j], width * squared / nu, x1, y1)
            x2, y2 = motion_after_kick(nodes.turn_cos[j], nodes.turn_sin[j], width * squared / nu, x2, y2)
            continue
        if j == TOUCH:
            c, s = nodes.turn_cos[ENTRY], nodes.turn_sin[ENTRY]
            x1, y1, x2, y2 = c * x1 + s * y1, nu * (c * y1 - s * x1), c * x2 + s * y2, nu * (c * y2 - s * x2)
        x1, y1 = motion_on_spring(nu * nu + squared, width, x1, y1)
        x2, y2 = motion_on_spring(nu * nu + squared, width, x2, y2)
        if k == N + contact - 1:
            c, s = nodes.turn_cos[EXIT], nodes.turn_sin[EXIT]
            x1, y1, x2, y2 = c * x1 - s * y1 / nu, s * x1 + c * y1 / nu, c * x2 - s * y2 / nu, s * x2 + c * y2 / nu
    c, s = math.cos(2 * math.pi * nu), math.sin(2 * math.pi * nu)
    return math.exp(2 * math.pi * a) * ((x1 + y2) * c + (y1 - x2) * s), decay


@kernel(shared=True)
def orbit_is_kept(oscillator: Oscillator, nodes: Nodes, state: PassState) -> bool:
    """True if a converged orbit touches where assumed, far from period doubling and from the end of its branch.

    A period doubles where the trace is -1 less the determinant, which all damping makes smaller.
    """
    if modes_of(oscillator.lever) > 1:
        return _several_modes_are_kept(oscillator, nodes, state)
    trace, decay = trace_of_one_mode(oscillator, nodes, state)
    far = trace > -DOUBLING * (1.0 + math.exp(-decay))
    return far and _is_sound(oscillator.lever, state, force_length(oscillator.p, state))


@kernel
def _several_modes_are_kept(oscillator: Oscillator, nodes: Nodes, state: PassState) -> bool:
    """True if an orbit of several modes is accepted: contact as assumed, no fold near, energy balanced, stable."""
    lever = oscillator.lever
    if nodes.touches == 1:
        if not touches_once(oscillator, nodes, state):
            return False
    else:
        before = depth_at_node(nodes, state.amplitude, state.centre, IN)
        if max(before, depth_at_node(nodes, state.amplitude, state.centre, OUT)) > 0.0:
            return False
    # At low Q the length is the amplitude: a stiff sample turns several modes back within far less than the length
    # over which the drive is balanced.
    length = state.amplitude if low_q(lever) else force_length(oscillator.p, state)
    return _is_sound(lever, state, length) and multipliers_are_within_one(oscillator, nodes, state)


@kernel
def touches_once(oscillator: Oscillator, nodes: Nodes, state: PassState) -> bool:
    """True if the tip of a lever of several modes touches at the nodes in contact and nowhere else."""
    p, lever = oscillator.p, oscillator.lever
    amplitude, e, deepest = state.amplitude, state.centre, 0.0
    if nodes.outside == 0:  # no force, so no nodes yet
        grade_outer_nodes(nodes, amplitude, e, amplitude, nodes.theta[EXIT])
        nodes.outside = 1
        lay_nodes(nodes, nodes.theta[ENTRY], nodes.theta[EXIT])
        for j in range(N):
            nodes.g[IN + j], nodes.g[OUT + j] = 0.0, 0.0
        fill_response(nodes, lever, state.mean_force, state.push, state.drag)
        nodes.outside = 1 if has_longrange(p) else 0
    for k in range(N * parts_of(nodes)):
        deepest = max(deepest, depth_at_node(nodes, amplitude, e, contact_node(k)))
    aside = BESIDE_CONTACT * max(deepest, reach_of(p))
    for k in range(N * parts_of(nodes)):
        if depth_at_node(nodes, amplitude, e, contact_node(k)) < -aside:
            return False
    theta, w, u = nodes.theta, nodes.w, nodes.u
    for k in range(2 * N):
        j = k if k < N else OUT + k - N
        highest = amplitude * nodes.cos[j] + w[j]
        if j % N > 0:
            before, after = (j, j - 1) if k < N else (j - 1, j)  # the element before contact runs backwards
            highest = max(
                highest,
                apex_between(amplitude, theta[before], w[before], u[before], theta[after], w[after], u[after]),
            )
        if highest - e > aside:
            return False
    return True


@kernel
def multipliers_are_within_one(oscillator: Oscillator, nodes: Nodes, state: PassState) -> bool:
    """True if all Floquet multipliers of a lever of several modes are clearly within the unit circle."""
    lever, slowest = oscillator.lever, -math.inf
    size = 2 * modes_of(lever)
    for i in range(modes_of(lever)):
        slowest = max(slowest, mode_of(lever, i).decay)
    motions = np.zeros((size, size))
    fill_monodromy(oscillator, nodes, state, motions)
    return spectral_radius(motions, SQUARINGS_WITHIN) < 1.0 + CLEARLY_HELD * math.expm1(2.0 * math.pi * slowest)


@kernel
def fill_monodromy(oscillator: Oscillator, nodes: Nodes, state: PassState, motions: np.ndarray) -> None:
    """Fill in the monodromy matrix, shape (2 modes, 2 modes) and zero at first: theory, Eq. (stability-7)."""
    lever = oscillator.lever
    modes = modes_of(lever)
    turns, workspace = np.empty((count_of(nodes), 3 * modes)), np.empty((2, 2 * modes))
    for i in range(modes):
        fill_mode(nodes, mode_of(lever, i))
        for j in range(count_of(nodes)):
            turns[j, 3 * i] = nodes.growth[j]
            turns[j, 3 * i + 1], turns[j, 3 * i + 2] = nodes.turn_cos[j], nodes.turn_sin[j]
        motions[2 * i, 2 * i] = motions[2 * i + 1, 2 * i + 1] = 1.0
    contact = N * parts_of(nodes)
    for k in range(2 * N + contact):
        j, in_contact = node_in_time(nodes, k), N <= k < N + contact
        if (nodes.touches if in_contact else nodes.outside) == 1:
            _kick(oscillator, nodes, state, j, in_contact, turns[j], workspace, motions)
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
    workspace: np.ndarray, motions: np.ndarray,
) -> None:  # fmt: skip
    """Kick small motions of each mode by the force with which the surface answers them at node j.

    `turns` (shape (3 modes,)): growth, cosine and sine of each mode there.
    `workspace` (shape (2, 2 modes)): workspace.
    `motions` (shape (2 modes, 2 modes)): x and y of each mode, a motion in each column.
    """
    law, p, lever = oscillator
    omega, modes = lever[OMEGA], modes_of(lever)
    d = depth_at_node(nodes, state.amplitude, state.centre, j)
    width = weight_of_node(nodes, j) / (omega * omega)
    if in_contact:
        kappa, gamma = surface_stiffness(oscillator, max(d, 0.0), rate_at_node(nodes, state.amplitude, j))
    else:
        kappa, gamma = longrange_slope(law, min(d, 0.0), p) / lever[STIFFNESS], 0.0
    if width * (abs(kappa) + gamma) < FAINT_KICK:
        return
    for i in range(modes):
        mode = mode_of(lever, i)
        c, s, grow = turns[3 * i + 1], turns[3 * i + 2], turns[3 * i]
        workspace[0, 2 * i] = (kappa * c + gamma * (mode.decay * c - mode.turn * s)) / grow
        workspace[0, 2 * i + 1] = (kappa * s + gamma * (mode.decay * s + mode.turn * c)) / grow
        workspace[1, 2 * i] = width * mode.share / mode.turn * grow * s
        workspace[1, 2 * i + 1] = -width * mode.share / mode.turn * grow * c
    within = 1.0 / (1.0 + 0.5 * width * gamma * all_shares(lever))  # damping acts on the mean of the velocities
    for k in range(2 * modes):
        force = 0.0
        for i in range(2 * modes):
            force += workspace[0, i] * motions[i, k]
        for i in range(2 * modes):
            motions[i, k] += within * force * workspace[1, i]
