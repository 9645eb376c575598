"""Exact orbits by Newton's method on the lever's response, where passes do not converge.

Passes find the force from the motion, then the motion from the force. Where a contact is so stiff that it turns the tip
round within it, or lasts for long, each pass does again what the one before had done too much of. Here force and motion
at the nodes in contact change together. With kappa = dg/dd, gamma = dg/dd', R the response of w to g, R' that of w',
and (r, r') what a pass would change, the change of g solves

    (1 - kappa R - gamma R') dg = kappa (r - de) + gamma r',

and the change of e follows from the drive: theory, Eq. (response-9). The force outside contact follows a step behind.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels.arrays import copy
from phasemap._kernels.columns import DAMPING, DRIVE, LONGRANGE, OMEGA, STIFFNESS
from phasemap._kernels.compilation import ANY_ORDER, kernel
from phasemap._kernels.dense import factor, substitute
from phasemap._kernels.law import Oscillator, contact_slope, damping, damping_slope
from phasemap._kernels.lever import Mode, drive_needed, mode_of, modes_of
from phasemap._kernels.orbits.response.motion import respond
from phasemap._kernels.orbits.response.nodes import (
    ALL,
    ENTRY,
    EXIT,
    GAUSS_WEIGHTS,
    GAUSS_X,
    UPTO,
    N,
    Nodes,
    contact_node,
    count_of,
    fill_mode,
    first_harmonic,
    first_of,
    lay_nodes,
    middle_of,
    move_nodes,
    parts_of,
    periods_before,
)
from phasemap._kernels.orbits.response.passes import (
    ENERGY_LEFT,
    FOUND,
    NO_ORBIT,
    UNRESOLVED,
    PassState,
    after_pass,
    evaluate_nodes,
    first_pass,
    quadrature_error,
    relative_energy_defect,
)

MOST_RESPONSE_STEPS = 16
MOST_STEP_HALVINGS = 6
REUSED = 0.1  # ratio of changes with which a step may do with the stiffness of the one before
SETTLED_PHASE = 0.02  # [rad], change of the phase that leaves the nodes about where they will be
LONGEST_RESPONSE_STEP = 0.5  # step, over the depth of the contact or
AT_LEAST = 0.3  # of the reach
NARROWEST_CONTACT, WIDEST_CONTACT = 0.4, 2.5  # contact after a step, over the one before
_LEGENDRE = np.polynomial.legendre.legvander(np.concatenate([2 * GAUSS_X - 1, GAUSS_X - 1, GAUSS_X]), N - 1)
INTO_PARTS = _LEGENDRE[N:] @ np.linalg.inv(_LEGENDRE[:N])  # from the nodes of a contact to those of its halves


class Bench(NamedTuple):
    """Scratch arrays: nodes, state, two motions, the system with kappa and gamma, and what it is solved for."""

    nodes: Nodes
    state: PassState
    motions: np.ndarray
    system: np.ndarray
    order: np.ndarray
    right: np.ndarray
    per_e: np.ndarray


@kernel
def new_bench(nodes: Nodes, state: PassState) -> Bench:
    """Return empty scratch arrays for these nodes and this state."""
    width, n = count_of(nodes), parts_of(nodes) * N
    motions, system = np.zeros((4, width)), np.zeros((n, n + 2))
    return Bench(nodes, state, motions, system, np.zeros(n, np.int64), np.zeros(n), np.zeros(n))


@kernel
def copy_motion(f: Nodes, to: np.ndarray) -> None:
    """Copy w and w' at the nodes into two rows."""
    for j in range(count_of(f)):
        to[0, j], to[1, j] = f.w[j], f.u[j]


@kernel
def stiffness(oscillator: Oscillator, d: float, turn: float) -> tuple[float, float]:
    """(kappa, gamma): change of g with depth d and with d', in contact."""
    law, p, lever = oscillator
    kappa, gamma = contact_slope(law, d, p) / lever[STIFFNESS], 0.0
    if p[DAMPING] != 0.0:
        gamma = 2.0 * lever[OMEGA] * damping(law, d, p)
        if d > 0.0:
            kappa += 2.0 * lever[OMEGA] * damping_slope(law, d, p) * turn
    return kappa, gamma


@kernel(fastmath=ANY_ORDER)
def fill_system(
    oscillator: Oscillator, f: Nodes, state: PassState, motion: np.ndarray, periodic: bool, m: np.ndarray
) -> None:
    """Fill the left side of the system for dg at the nodes in contact, and behind it kappa and gamma.

    `motion` is (w, w') at the nodes. If not `periodic`, a force is felt only after it, and by all of the motion.
    """
    lever, amplitude, e, n = oscillator.lever, state.amplitude, state.centre, N * parts_of(f)
    for j in range(n):
        i = contact_node(j)
        d = max(amplitude * f.cos[i] + motion[0, i] - e, 0.0)
        m[j, n], m[j, n + 1] = stiffness(oscillator, d, motion[1, i] - amplitude * f.sin[i])
        for k in range(n):
            m[j, k] = 0.0
        m[j, j] = 1.0
    for i in range(modes_of(lever)):
        mode = mode_of(lever, i)
        fill_mode(f, mode)
        _add_mode(f, lever[OMEGA], mode, periodic, m)


@kernel(fastmath=ANY_ORDER)
def _add_mode(f: Nodes, omega: float, mode: Mode, periodic: bool, m: np.ndarray) -> None:
    """Add to the system what a mode makes of a force at each node in contact."""
    a, nu, n = mode.decay, mode.turn, N * parts_of(f)
    e_re, e_im = periods_before(a, nu)
    share = mode.share / (omega * omega * nu)
    at = np.empty((8, n))
    cosine, sine, back_re, back_im, kappa, gamma, to_w, to_u = at[0], at[1], at[2], at[3], at[4], at[5], at[6], at[7]
    for j in range(n):
        i = contact_node(j)
        kappa[j], gamma[j] = m[j, n], m[j, n + 1]
        shrink = share / f.growth[i]
        back_re[j], back_im[j] = shrink * f.turn_cos[i], shrink * f.turn_sin[i]
        cosine[j], sine[j] = f.cos[i], f.sin[i]
    for k in range(n):
        i, part = contact_node(k), k // N
        size, here = f.weight[i] * f.growth[i], GAUSS_WEIGHTS[k % N]
        q_re, q_im = size * f.turn_cos[i], -size * f.turn_sin[i]
        round_re, round_im, mean, h_re, h_im = 0.0, 0.0, 0.0, 0.0, 0.0
        if periodic:
            round_re, round_im = here * (e_re * q_re - e_im * q_im), here * (e_re * q_im + e_im * q_re)
            mean = here * f.weight[i] / (2 * math.pi)
            h_re, h_im = first_harmonic(omega, mode, 2.0 * mean * f.cos[i], 2.0 * mean * f.sin[i])
            mean *= mode.share / mode.square
        upto = UPTO[k % N]
        for other in range(n // N):
            inside, behind = 1.0 if other == part else 0.0, here if other > part else 0.0
            for i in range(N):
                j, felt = N * other + i, inside * upto[i] + behind
                at_re, at_im = round_re + felt * q_re, round_im + felt * q_im
                g_im = back_re[j] * at_im + back_im[j] * at_re
                g_re = back_re[j] * at_re - back_im[j] * at_im
                to_w[j] = -g_im + mean + h_re * cosine[j] - h_im * sine[j]
                to_u[j] = -(a * g_im + nu * g_re) - h_re * sine[j] - h_im * cosine[j]
        for j in range(n):
            m[j, k] -= kappa[j] * to_w[j] + gamma[j] * to_u[j]


@kernel
def drive_of(lever: np.ndarray, f: Nodes, state: PassState, k: int) -> float:
    """Change of the mismatch with g at the k-th node in contact."""
    i, (x, y) = contact_node(k), drive_needed(lever, state.amplitude, state.push, state.drag)
    share = 2.0 * GAUSS_WEIGHTS[k % N] * f.weight[i] / (math.pi * lever[DRIVE] * lever[DRIVE])
    return (x * f.cos[i] - y * f.sin[i]) * share


@kernel
def _mix(f: Nodes, old: np.ndarray, new: np.ndarray, share: float, amplitude: float, e: float) -> bool:
    """Go by `share` from the old motion to the new; whether the contact begins and ends, not too far from before."""
    for j in range(count_of(f)):
        f.w[j] = old[0, j] + share * (new[0, j] - old[0, j])
        f.u[j] = old[1, j] + share * (new[1, j] - old[1, j])
    down, up = f.u[ENTRY] - amplitude * f.sin[ENTRY], f.u[EXIT] - amplitude * f.sin[EXIT]
    if not down > 0.0 > up:
        return False
    entry = f.theta[ENTRY] - (amplitude * f.cos[ENTRY] + f.w[ENTRY] - e) / down
    exit_ = f.theta[EXIT] - (amplitude * f.cos[EXIT] + f.w[EXIT] - e) / up
    before = f.theta[EXIT] - f.theta[ENTRY]
    return NARROWEST_CONTACT * before < exit_ - entry < WIDEST_CONTACT * before and entry > -math.pi and exit_ < math.pi


@kernel
def _step(oscillator: Oscillator, reach: float, bench: Bench, h: float, anew: bool) -> float:
    """One step from a motion whose force is known, to the nodes where the contact then is; its share, 0 without one.

    If not `anew`, with the stiffness of the step before.
    """
    p, lever = oscillator.p, oscillator.lever
    f, state, m, order, right, per_e = bench.nodes, bench.state, bench.system, bench.order, bench.right, bench.per_e
    amplitude, e, longrange, n = state.amplitude, state.centre, p[LONGRANGE] != 0.0, N * parts_of(f)
    old, new, middle = bench.motions[:2], bench.motions[2:], middle_of(f)
    copy_motion(f, old)
    respond(f, lever, state.mean_force, state.push, state.drag, True, longrange)
    if anew:
        fill_system(oscillator, f, state, old, True, m)
        if not factor(m, n, order):
            return 0.0
        for j in range(n):
            per_e[j] = m[j, n]
        substitute(m, n, order, per_e)
    for j in range(n):
        i = contact_node(j)
        right[j] = m[j, n] * (f.w[i] - old[0, i]) + m[j, n + 1] * (f.u[i] - old[1, i])
    substitute(m, n, order, right)
    change, slope = h, 0.0
    for j in range(n):
        to_h = drive_of(lever, f, state, j)
        change += to_h * right[j]
        slope -= to_h * per_e[j]
    move = -change / slope
    state.slope = slope
    mean, push, drag = state.mean_force, state.push, state.drag
    for j in range(n):
        i = contact_node(j)
        more = right[j] - move * per_e[j]
        f.g[i] += more
        more *= GAUSS_WEIGHTS[j % N] * f.weight[i] / math.pi
        mean, push, drag = mean + 0.5 * more, push + more * f.cos[i], drag + more * f.sin[i]
    respond(f, lever, mean, push, drag, True, longrange)
    copy_motion(f, new)
    depth = amplitude * f.cos[middle] + old[0, middle] - e
    deeper = abs(new[0, middle] - old[0, middle] - move)
    share = min(1.0, LONGEST_RESPONSE_STEP * max(abs(depth), AT_LEAST * reach) / max(deeper, 1e-300))
    for _ in range(MOST_STEP_HALVINGS):
        if _mix(f, old, new, share, amplitude, e + share * move):
            state.centre = e + share * move
            move_nodes(f, amplitude, state.centre, True, longrange)
            return share
        share *= 0.5
    return 0.0


@kernel
def newton_on_response(oscillator: Oscillator, reach: float, limits: np.ndarray, bench: Bench) -> int:
    """Repeat steps from a motion that touches until errors are below the limits: FOUND, NO_ORBIT or UNRESOLVED.

    The error left is taken from the last two changes, as that of passes is.
    """
    p, lever = oscillator.p, oscillator.lever
    f, state, longrange, middle = bench.nodes, bench.state, p[LONGRANGE] != 0.0, middle_of(bench.nodes)
    h = evaluate_nodes(oscillator, f, state, True)
    phase, height, left_before, anew = state.phase, state.tip_offset, math.inf, True
    first_pass(state)
    state.last_w = f.w[middle]
    if state.passes > 0:
        state.phase, state.tip_offset = phase, height
    for _ in range(MOST_RESPONSE_STEPS):
        share = _step(oscillator, reach, bench, h, anew)
        if not share > 0.0:
            return NO_ORBIT
        h = evaluate_nodes(oscillator, f, state, True)
        state.passes += 1
        nodes, ratio_before = quadrature_error(lever, f, state, True, longrange), state.last_ratio
        ratio = after_pass(lever, state, h, f.w[middle], nodes)
        if not math.isfinite(state.phase + state.tip_offset):
            return NO_ORBIT
        anew = not ratio < REUSED
        if state.phase_change < SETTLED_PHASE and nodes > limits[0] * lever[DRIVE]:
            return UNRESOLVED
        if share < 1.0:
            state.last_ratio = ratio_before
        elif ratio >= 0.0:
            left = abs(relative_energy_defect(lever, state))
            small = state.phase_error < limits[0] and state.tip_offset_error < limits[1]
            if small and left < ENERGY_LEFT:
                return FOUND
            if small and left > 0.5 * left_before:
                return UNRESOLVED
            left_before = left
    return NO_ORBIT


@kernel
def cut_contact(f: Nodes, finer: Nodes, longrange: bool) -> None:
    """Carry an orbit over to nodes that cut each part of its contact in two."""
    finer.parts = 2 * parts_of(f)
    copy(f.far, finer.far)
    copy(f.far_weight, finer.far_weight)
    lay_nodes(finer, f.theta[ENTRY], f.theta[EXIT], longrange)
    _interpolate(f.w, parts_of(f), finer.w)
    _interpolate(f.u, parts_of(f), finer.u)


@kernel
def _interpolate(row: np.ndarray, parts: int, finer: np.ndarray) -> None:
    """Carry the values at nodes over to those that cut each part of the contact in two."""
    for j in range(ALL):
        finer[j] = row[j]
    for j in range(2 * N * parts):
        part, total = j // (2 * N), 0.0
        for k in range(N):
            total += INTO_PARTS[j % (2 * N), k] * row[first_of(part) + k]
        finer[contact_node(j)] = total
