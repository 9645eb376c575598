"""Newton's method on the force in contact, in place of plain passes where a contact is stiff or long.

A pass changes the motion by r = -G g - w, of which a stiff contact makes a force that the next pass throws back. With
kappa and gamma the change of g with d and with d', and R the part of -G between nodes in contact, the force changes by

    dg = (1 - kappa R - gamma R')^-1 (kappa r + gamma r' - kappa de + (kappa cos - gamma sin) dA),

where de makes the mismatch zero to first order, and dA, if A is not held, the amplitude that the detector sees the one
asked for: theory, Eq. (response-8). Forces outside contact follow from pass to pass.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels.columns import DAMPING, DRIVE, OMEGA, STIFFNESS
from phasemap._kernels.compilation import ANY_ORDER, kernel
from phasemap._kernels.excitation import detected_amplitude_of_orbit, detected_amplitude_rate
from phasemap._kernels.law import Oscillator, contact_slope, damping, damping_slope
from phasemap._kernels.lever import drive_needed, phase_rate
from phasemap._kernels.lever_modes import mode_of, modes_of, static_compliance
from phasemap._kernels.numerics import factor, substitute
from phasemap._kernels.orbits.response.motion import fill_response
from phasemap._kernels.orbits.response.nodes import (
    GAUSS_WEIGHTS,
    GAUSS_X,
    N,
    Nodes,
    contact_node,
    count_of,
    fill_mode,
    first_of,
    move_nodes,
    parts_of,
    periods_before,
    response_to_first_harmonic,
    weight_of_node,
)
from phasemap._kernels.orbits.response.state import PassState, evaluate_nodes
from phasemap._kernels.quadrature import integration_matrix

RUNNING = np.ascontiguousarray(integration_matrix(GAUSS_X))  # [j, k]: integral of the k-th polynomial up to node j
MOST_OF_DEPTH = 0.4  # that a step may change the depth by
BY_PASS, BY_CENTRE, BY_AMPLITUDE, CAUSES = 0, 1, 2, 3  # of changes of g: r, and e and A by one


class NewtonWorkspace(NamedTuple):
    """Workspace for the equations of n nodes in contact."""

    w: np.ndarray  # shape (ALL_CUT,); the motion before the pass [m]
    u: np.ndarray
    answer: np.ndarray  # shape (2, n); kappa and gamma
    system: np.ndarray  # shape (n, n)
    order: np.ndarray  # shape (n,); of its rows
    changes: np.ndarray  # shape (CAUSES, n); of g [m], or over e or A
    rates: np.ndarray  # shape (CAUSES, 3); of its mean, P and S


@kernel
def new_newton_workspace(nodes: Nodes, wanted: bool) -> NewtonWorkspace:
    """A workspace for the nodes of a contact, or an empty one."""
    n, all_nodes = N * parts_of(nodes) if wanted else 0, len(nodes.w)
    return NewtonWorkspace(
        np.empty(all_nodes), np.empty(all_nodes), np.empty((2, n)), np.empty((n, n)), np.empty(n, np.int64),
        np.empty((CAUSES, n)), np.empty((CAUSES, 3)),
    )  # fmt: skip


@kernel
def surface_stiffness(oscillator: Oscillator, d: float, rate: float) -> tuple[float, float]:
    """Derivatives (kappa, gamma) of g = F/k + 2 alpha omega d' in contact, by depth d and by its rate d'."""
    law, p, lever = oscillator
    kappa, gamma = contact_slope(law, d, p) / lever[STIFFNESS], 0.0
    if p[DAMPING] != 0.0:
        gamma = 2.0 * lever[OMEGA] * damping(law, d, p)
        if d > 0.0:
            kappa += 2.0 * lever[OMEGA] * damping_slope(law, d, p) * rate
    return kappa, gamma


@kernel(fastmath=ANY_ORDER)
def _fill_system(lever: np.ndarray, nodes: Nodes, workspace: NewtonWorkspace) -> None:
    """Fill in the matrix 1 - kappa R - gamma R' of the changes of g at the nodes, R the lever's response."""
    omega, parts, m, (kappa, gamma) = lever[OMEGA], parts_of(nodes), workspace.system, workspace.answer
    n, mean, along, across = N * parts, 0.0, 0.0, 0.0
    m[:, :] = 0.0
    for i in range(modes_of(lever)):
        mode = mode_of(lever, i)
        share, h = mode.share / (omega * omega * mode.turn), response_to_first_harmonic(omega, mode, 1.0, 0.0)
        mean, along, across = mean + mode.share / mode.square, along + h[0], across - h[1]
        e_re, e_im = periods_before(mode.decay, mode.turn)
        fill_mode(nodes, mode)
        for k in range(n):
            j = contact_node(k)
            # exp(-lambda phi) times the weight of the node, without the force that `Nodes` says
            nodes.re[j], nodes.im[j] = (
                nodes.weight[j] * nodes.growth[j] * nodes.turn_cos[j],
                -nodes.weight[j] * nodes.growth[j] * nodes.turn_sin[j],
            )
        for j in range(n):
            at, part_of_j = contact_node(j), j // N
            by_w, by_u = kappa[j] + mode.decay * gamma[j], mode.turn * gamma[j]
            shrink = share / nodes.growth[at]
            t_re, t_im = shrink * nodes.turn_cos[at], shrink * nodes.turn_sin[at]
            # what a force makes of w and w' here, over exp(-lambda phi) and the part of it that has passed
            t_re, t_im = by_w * t_re - by_u * t_im, by_w * t_im + by_u * t_re
            b_re, b_im = t_re * e_re - t_im * e_im, t_re * e_im + t_im * e_re
            row = m[j]
            for part in range(parts):
                first, start = first_of(part), N * part
                if part == part_of_j:  # the running integral of it has passed
                    for k in range(N):
                        passed, weight = RUNNING[j - N * part_of_j, k], GAUSS_WEIGHTS[k]
                        row[start + k] += (b_re * weight + t_re * passed) * nodes.im[first + k] + (
                            b_im * weight + t_im * passed
                        ) * nodes.re[first + k]
                else:  # all of it has passed, or none has: E + 1 or E, as H in `nodes`
                    p_re, p_im = (b_re + t_re, b_im + t_im) if part < part_of_j else (b_re, b_im)
                    for k in range(N):
                        row[start + k] += GAUSS_WEIGHTS[k] * (p_re * nodes.im[first + k] + p_im * nodes.re[first + k])
    for j in range(n):
        at = contact_node(j)
        c, s = nodes.cos[at], nodes.sin[at]
        x, y = along * c + across * s, along * s - across * c
        by_cos, by_sin = (kappa[j] * x - gamma[j] * y) / math.pi, (kappa[j] * y + gamma[j] * x) / math.pi
        by_mean, row = kappa[j] * mean / (2.0 * math.pi), m[j]
        for part in range(parts):
            first, start = first_of(part), N * part
            for k in range(N):
                weight = GAUSS_WEIGHTS[k] * nodes.weight[first + k]
                row[start + k] -= weight * (by_mean + by_cos * nodes.cos[first + k] + by_sin * nodes.sin[first + k])
        row[j] += 1.0


@kernel(fastmath=ANY_ORDER)
def _fill_rates(nodes: Nodes, workspace: NewtonWorkspace) -> None:
    """Fill in mean, P and S of the changes of g."""
    for i in range(CAUSES):
        mean, push, drag, change = 0.0, 0.0, 0.0, workspace.changes[i]
        for k in range(N * parts_of(nodes)):
            j = contact_node(k)
            share = weight_of_node(nodes, j) * change[k]
            mean += share
            push += share * nodes.cos[j]
            drag += share * nodes.sin[j]
        workspace.rates[i, 0], workspace.rates[i, 1], workspace.rates[i, 2] = (
            mean / (2.0 * math.pi),
            push / math.pi,
            drag / math.pi,
        )


@kernel
def _fill_changes(oscillator: Oscillator, nodes: Nodes, state: PassState, workspace: NewtonWorkspace) -> bool:
    """Solve for the changes of g with e, A and the pass, and of its harmonics; False where equations are singular."""
    n, (kappa, gamma), changes = N * parts_of(nodes), workspace.answer, workspace.changes
    for k in range(n):
        j = contact_node(k)
        d = max(state.amplitude * nodes.cos[j] + workspace.w[j] - state.centre, 0.0)
        kappa[k], gamma[k] = surface_stiffness(oscillator, d, workspace.u[j] - state.amplitude * nodes.sin[j])
        changes[BY_PASS, k] = kappa[k] * (nodes.w[j] - workspace.w[j]) + gamma[k] * (nodes.u[j] - workspace.u[j])
        changes[BY_CENTRE, k] = -kappa[k]
        changes[BY_AMPLITUDE, k] = kappa[k] * nodes.cos[j] - gamma[k] * nodes.sin[j]
    _fill_system(oscillator.lever, nodes, workspace)
    if not factor(workspace.system, n, workspace.order):
        return False
    for i in range(CAUSES):
        substitute(workspace.system, n, workspace.order, changes[i])
    _fill_rates(nodes, workspace)
    return True


@kernel
def _newton_step(lever: np.ndarray, state: PassState, h: float, hold: bool, rates: np.ndarray) -> tuple[float, float]:
    """Changes of e and A [m] that remove the mismatch h and the error of the amplitude seen; sets slopes in `state`."""
    orbit = (state.amplitude, state.push, state.drag)
    x, y = drive_needed(lever, *orbit)
    twice = 2.0 / (lever[DRIVE] * lever[DRIVE])
    by_e, by_a = rates[BY_CENTRE], rates[BY_AMPLITUDE]
    h += twice * (x * rates[BY_PASS, 1] - y * rates[BY_PASS, 2])
    h_by_e = twice * (x * by_e[1] - y * by_e[2])
    if hold:
        return 0.0, 0.0
    state.slope, state.mean_slope, state.push_slope, state.drag_slope = h_by_e, by_e[0], by_e[1], by_e[2]
    if state.seen == 0.0:
        return -h / h_by_e, 0.0
    x_by_a, y_by_a = drive_needed(lever, 1.0, by_a[1], by_a[2])
    h_by_a = twice * (x * x_by_a + y * y_by_a)
    miss = detected_amplitude_of_orbit(lever, *orbit) - state.seen
    miss += detected_amplitude_rate(lever, orbit, (0.0, rates[BY_PASS, 1], rates[BY_PASS, 2]))
    by_centre, by_amplitude = (
        detected_amplitude_rate(lever, orbit, (0.0, by_e[1], by_e[2])),
        detected_amplitude_rate(lever, orbit, (1.0, by_a[1], by_a[2])),
    )
    # along the curve, on which e changes so with A
    turn = -h_by_a / h_by_e
    state.seen_by_a = by_amplitude + turn * by_centre
    state.phase_by_a = phase_rate(x, y, x_by_a + turn * by_e[1], y_by_a - turn * by_e[2])
    state.offset_by_a = turn - static_compliance(lever) * (by_a[0] + turn * by_e[0])
    amplitude = (by_centre * h / h_by_e - miss) / state.seen_by_a
    return turn * amplitude - h / h_by_e, amplitude


@kernel
def cut_short(nodes: Nodes, state: PassState, lift: float, growth: float, workspace: NewtonWorkspace) -> float:
    """Share of a Newton step that is taken, less than all where it changes the depth by too much; cut the motion to it.

    `nodes` has the motion after the step, the workspace that before. The caller cuts `lift` of e and `growth` of A.
    """
    deepest, most = 0.0, 0.0
    for k in range(N * parts_of(nodes)):
        j = contact_node(k)
        deepest = max(deepest, state.amplitude * nodes.cos[j] + workspace.w[j] - state.centre)
        most = max(most, abs(nodes.w[j] - workspace.w[j] + growth * nodes.cos[j] - lift))
    share = min(MOST_OF_DEPTH * deepest / most, 1.0)
    for j in range(count_of(nodes) if share < 1.0 else 0):
        nodes.w[j] = workspace.w[j] + share * (nodes.w[j] - workspace.w[j])
        nodes.u[j] = workspace.u[j] + share * (nodes.u[j] - workspace.u[j])
    return share


@kernel
def newton_pass(
    oscillator: Oscillator, nodes: Nodes, state: PassState, h: float, hold: bool, workspace: NewtonWorkspace
) -> tuple[bool, float]:
    """Step of Newton's method in place of a pass, with the mismatch h; False if there is none, else what is left of h.

    With `hold` the centre e stays, and A.
    """
    lever, rates, changes = oscillator.lever, workspace.rates, workspace.changes
    fill_response(nodes, lever, state.mean_force, state.push, state.drag)
    if not _fill_changes(oscillator, nodes, state, workspace):
        return False, h
    centre, amplitude = _newton_step(lever, state, h, hold, rates)
    for k in range(N * parts_of(nodes)):
        nodes.g[contact_node(k)] += (
            changes[BY_PASS, k] + centre * changes[BY_CENTRE, k] + amplitude * changes[BY_AMPLITUDE, k]
        )
    mean, push, drag = rates[BY_PASS] + centre * rates[BY_CENTRE] + amplitude * rates[BY_AMPLITUDE]
    fill_response(nodes, lever, state.mean_force + mean, state.push + push, state.drag + drag)
    share = cut_short(nodes, state, centre, amplitude, workspace)
    state.centre += share * centre
    state.amplitude += share * amplitude
    move_nodes(nodes, state.amplitude, state.centre)
    return True, evaluate_nodes(oscillator, nodes, state)
