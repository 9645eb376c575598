"""The contact of a solid that relaxes, at the nodes of the lever's response: Ting's for one tap on a surface at rest.

An element from the first touch to the turn, where the contact is widest, and one from there to its end. With T = omega
tau the depth D that a dashpot sees and the integral Y follow d by

    T D' = d - D,    T Y' = (2/3) d^(3/2) - Y                                       (theory, Eq. (memory-8))

of which the second is needed up to the turn only. At nodes both are a linear system with the spectral integration
matrix, whose eigenvectors are known beforehand. Past the turn the edge is where it was at an earlier angle, which each
node remembers and corrects by a step of Newton's method (theory, Eq. (memory-9)); the force at a node does not change
to first order with that angle.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.columns import OMEGA, STIFFNESS
from phasemap._kernels.compilation import ANY_ORDER, kernel
from phasemap._kernels.law import Oscillator, contact_force, longrange_force
from phasemap._kernels.numerics import copy
from phasemap._kernels.orbits.response.apex import BARYCENTRIC
from phasemap._kernels.orbits.response.nodes import (
    EARLY_S,
    EARLY_W,
    ENTRY,
    EXIT,
    GAUSS_WEIGHTS,
    GAUSS_X,
    IN,
    LATE,
    LATE_S,
    LATE_W,
    OUT,
    TOUCH,
    UPTO,
    N,
    Nodes,
    depth_at_node,
    fill_angles,
    rate_at_node,
)
from phasemap._kernels.orbits.response.state import PassState
from phasemap._kernels.records import column, record

NodeSums = tuple[float, float, float, float, float]

TURN_NODE, END_NODE = EXIT + 1, 2 * N  # the node at which the contact turns, and the place of its end in the following


@record
class ContactMemory:
    """What a contact remembers at the nodes of both its elements, and at its end."""

    depth: np.ndarray = column(2 * N + 1)  # d [m]
    dashpot_depth: np.ndarray = column(2 * N + 1)  # D [m]
    inside: np.ndarray = column(2 * N + 1)  # Y [m^1.5]
    rate: np.ndarray = column(2 * N + 1)  # d', at the early nodes [m]
    place: np.ndarray = column(2 * N + 1)  # of the early instant with the same edge, in the early element
    early_depth: np.ndarray = column(2 * N + 1)  # d, D and Y at that instant
    early_dashpot_depth: np.ndarray = column(2 * N + 1)
    early_inside: np.ndarray = column(2 * N + 1)
    kept: np.ndarray = column(2 * N + 1)  # exp(-angle between / T)


class TapWorkspace(NamedTuple):
    """Workspace of passes: nodes of a contact in two elements, what it remembers, and the state."""

    nodes: Nodes
    memory: ContactMemory
    state: PassState


LONGEST_SEARCH_STEP = 0.7  # of the way to either end of an element, the longest step to the early angle


def _modes(widths: np.ndarray) -> tuple[np.ndarray, ...]:
    """Integration matrix of an element, its eigenvalues, and the matrices to its eigenvectors and back.

    Of each complex pair one, counted twice.
    """
    upto = UPTO * widths[:, None]
    values, vectors = np.linalg.eig(upto.T)
    one = values.imag >= 0
    back = (np.where(values.imag[one] > 0, 2.0, 1.0) * vectors[:, one]).T
    to = np.linalg.inv(vectors)[one]
    parts = (upto, values[one].real, values[one].imag, to.real, to.imag, back.real, back.imag)
    return tuple(np.ascontiguousarray(part) for part in parts)


_EARLY_UPTO, _EARLY_RE, _EARLY_IM, _EARLY_TO_RE, _EARLY_TO_IM, _EARLY_BACK_RE, _EARLY_BACK_IM = _modes(EARLY_W)
_LATE_UPTO, _LATE_RE, _LATE_IM, _LATE_TO_RE, _LATE_TO_IM, _LATE_BACK_RE, _LATE_BACK_IM = _modes(LATE_W)
_EARLY_ALL, _LATE_ALL = EARLY_W * GAUSS_WEIGHTS, LATE_W * GAUSS_WEIGHTS


@kernel(fastmath=ANY_ORDER, inline=True)
def _solve(
    upto: np.ndarray, values: tuple[np.ndarray, np.ndarray], to: tuple[np.ndarray, np.ndarray],
    back: tuple[np.ndarray, np.ndarray], share: float, given: np.ndarray, x: np.ndarray,
) -> None:  # fmt: skip
    """Solve x + share (integral of x up to each node) = given; twice, for the eigenvectors are nearly dependent."""
    left = np.empty(N)
    for j in range(N):
        left[j], x[j] = given[j], 0.0
    for again in range(2):
        for k in range(len(values[0])):
            re, im, a, b = 0.0, 0.0, 1.0 + share * values[0][k], share * values[1][k]
            for j in range(N):
                re += to[0][k, j] * left[j]
                im += to[1][k, j] * left[j]
            below = 1.0 / (a * a + b * b)
            re, im = (re * a + im * b) * below, (im * a - re * b) * below
            for j in range(N):
                x[j] += back[0][k, j] * re - back[1][k, j] * im
        if again == 0:
            for j in range(N):
                left[j] = given[j] - x[j]
            for k in range(N):
                for j in range(N):
                    left[j] -= share * x[k] * upto[k, j]


@kernel
def lag_before_turn(share: float, given: np.ndarray, x: np.ndarray) -> None:
    """Solve x' = given' - x/T, x = 0 at first, at the nodes before the turn; share = their angle over T."""
    values, to, back = (_EARLY_RE, _EARLY_IM), (_EARLY_TO_RE, _EARLY_TO_IM), (_EARLY_BACK_RE, _EARLY_BACK_IM)
    _solve(_EARLY_UPTO, values, to, back, share, given, x)


@kernel
def lag_after_turn(share: float, given: np.ndarray, x: np.ndarray) -> None:
    """Solve x' = given' - x/T, x = 0 at first, at the nodes after the turn; share = their angle over T."""
    values, to, back = (_LATE_RE, _LATE_IM), (_LATE_TO_RE, _LATE_TO_IM), (_LATE_BACK_RE, _LATE_BACK_IM)
    _solve(_LATE_UPTO, values, to, back, share, given, x)


@kernel(fastmath=ANY_ORDER)
def lay_relaxing(nodes: Nodes, entry: float, turn: float, exit_: float) -> None:
    """Place the nodes: contact from entry to its turn and on to its end, and outside, the finer the nearer."""
    theta, weight = nodes.theta, nodes.weight
    before, after = math.pi + entry, math.pi - exit_
    for j in range(N):
        theta[TOUCH + j], weight[TOUCH + j] = turn + (turn - entry) * EARLY_S[j], (turn - entry) * EARLY_W[j]
        theta[LATE + j], weight[LATE + j] = turn + (exit_ - turn) * LATE_S[j], (exit_ - turn) * LATE_W[j]
        if nodes.outside == 1:
            theta[IN + j], weight[IN + j] = entry - before * nodes.far[j], before * nodes.far_weight[j]
            theta[OUT + j], weight[OUT + j] = exit_ + after * nodes.far[j], after * nodes.far_weight[j]
    theta[ENTRY], theta[EXIT], theta[TURN_NODE] = entry, exit_, turn
    fill_angles(nodes)


@kernel(fastmath=ANY_ORDER)
def follow_contact(p: np.ndarray, lever: np.ndarray, workspace: TapWorkspace) -> None:
    """Fill d, D and Y at the nodes in contact, and d' at the early ones."""
    nodes, memory, state = workspace
    amplitude, centre = state.amplitude, state.centre
    time, turn = lever[OMEGA] * p[col.RELAXATION], nodes.theta[TURN_NODE]
    early, late = (turn - nodes.theta[ENTRY]) / time, (nodes.theta[EXIT] - turn) / time
    depth, crept, inside = memory.depth, memory.dashpot_depth, memory.inside
    given, x = memory.early_dashpot_depth, memory.early_inside
    for j in range(N):
        depth[j] = depth_at_node(nodes, amplitude, centre, TOUCH + j)
        depth[N + j] = depth_at_node(nodes, amplitude, centre, LATE + j)
        memory.rate[j] = rate_at_node(nodes, amplitude, TOUCH + j)
    depth[END_NODE] = depth_at_node(nodes, amplitude, centre, EXIT)
    lag_before_turn(early, depth, x)
    at_turn = 0.0
    for j in range(N):
        crept[j] = depth[j] - x[j]
        at_turn += early * _EARLY_ALL[j] * x[j]
        given[j] = 2.0 / 3.0 * max(depth[j], 0.0) ** 1.5
    lag_before_turn(early, given, x)
    for j in range(N):
        inside[j] = given[j] - x[j]
        given[j] = depth[N + j] - at_turn
    lag_after_turn(late, given, x)
    crept[END_NODE] = at_turn
    for j in range(N):
        crept[N + j] = depth[N + j] - x[j]
        crept[END_NODE] += late * _LATE_ALL[j] * x[j]


@kernel(fastmath=ANY_ORDER)
def look_back(p: np.ndarray, lever: np.ndarray, workspace: TapWorkspace) -> None:
    """Correct by a Newton step at which early instants the edge was as at late nodes; fill in d, D and Y there."""
    nodes, memory, _ = workspace
    time, kappa, turn = lever[OMEGA] * p[col.RELAXATION], p[col.RELAXING], nodes.theta[TURN_NODE]
    half = turn - nodes.theta[ENTRY]
    for j in range(N, 2 * N):
        at, below = memory.place[j], 0.0
        d, crept, inside, rate = 0.0, 0.0, 0.0, 0.0
        for k in range(N):
            gap = at - GAUSS_X[k]
            share = BARYCENTRIC[k] / (gap if gap != 0.0 else 1e-30)
            below += share
            d += share * memory.depth[k]
            crept += share * memory.dashpot_depth[k]
            inside += share * memory.inside[k]
            rate += share * memory.rate[k]
        d, crept, inside, rate = d / below, crept / below, inside / below, rate / below
        back = 0.5 * math.pi * (1.0 - at)
        kept = math.exp((turn - half * math.sin(back) - nodes.theta[LATE + j - N]) / time)
        off = (1.0 - kappa) * d + kappa * (memory.dashpot_depth[j] - (crept - d) * kept) - memory.depth[j]
        wide = half * 0.5 * math.pi * math.cos(back)
        move = -off / (rate * (1.0 - kappa + kappa * kept) * wide)
        move = min(max(move, -LONGEST_SEARCH_STEP * at), LONGEST_SEARCH_STEP * (1.0 - at))
        memory.place[j] = at + move
        move *= wide
        memory.early_depth[j], memory.early_dashpot_depth[j] = d + move * rate, crept + move * (d - crept) / time
        memory.early_inside[j] = inside + move * (2.0 / 3.0 * max(d, 0.0) ** 1.5 - inside) / time
        memory.kept[j] = kept * (1.0 + move / time)


@kernel(fastmath=ANY_ORDER)
def relay_relaxing(p: np.ndarray, lever: np.ndarray, workspace: TapWorkspace) -> None:
    """Move the nodes to where the contact begins, turns and ends now, and the response w [m] with them.

    It begins where the depth amplitude cos + w - e is 0, turns where that is largest, and ends where the depth is that
    of the dent, RELAXING times the depth that the dashpot has crept to: one step of Newton's method each.
    """
    nodes, memory, state = workspace
    amplitude, centre = state.amplitude, state.centre
    theta, i, j = nodes.theta, TOUCH + N - 1, LATE
    before = nodes.re
    copy(theta, before)
    time, kappa = lever[OMEGA] * p[col.RELAXATION], p[col.RELAXING]
    entry = theta[ENTRY] - depth_at_node(nodes, amplitude, centre, ENTRY) / rate_at_node(nodes, amplitude, ENTRY)
    rise, fall = rate_at_node(nodes, amplitude, i), rate_at_node(nodes, amplitude, j)
    turn = theta[i] + rise * (theta[j] - theta[i]) / (rise - fall)
    d, crept = depth_at_node(nodes, amplitude, centre, EXIT), memory.dashpot_depth[END_NODE]
    exit_ = theta[EXIT] - (d - kappa * crept) / (rate_at_node(nodes, amplitude, EXIT) - kappa * (d - crept) / time)
    lay_relaxing(nodes, entry, turn, exit_)
    for j in range(len(theta)):
        nodes.w[j] += nodes.u[j] * (theta[j] - before[j])


@kernel
def dent_of(p: np.ndarray, lever: np.ndarray, memory: ContactMemory) -> tuple[float, float]:
    """Dent [m] under the tip where the contact ends, and the rate over the angle at which it comes back."""
    kappa, crept = p[col.RELAXING], memory.dashpot_depth[END_NODE]
    return kappa * crept, (1.0 - kappa) / (lever[OMEGA] * p[col.RELAXATION])


@kernel(fastmath=ANY_ORDER, inline=True)
def _node_sums_with(sums: NodeSums, nodes: Nodes, i: int, weight: float, amplitude: float) -> NodeSums:
    """Sums of g over the nodes (mean, P, S, work, virial) with one more node."""
    mean, push, drag, work, virial = sums
    share = weight * nodes.weight[i] * nodes.g[i]
    return (
        mean + share, push + share * nodes.cos[i], drag + share * nodes.sin[i],
        work + share * rate_at_node(nodes, amplitude, i),
        virial + share * (amplitude * nodes.cos[i] + nodes.w[i]),
    )  # fmt: skip


@kernel(fastmath=ANY_ORDER)
def relaxing_force(oscillator: Oscillator, workspace: TapWorkspace) -> NodeSums:
    """Fill g at the nodes from what is remembered; mean, P, S of g, its work and the virial sum."""
    (law, p, lever), (nodes, memory, state) = oscillator, workspace
    amplitude, centre = state.amplitude, state.centre
    inverse_k, kappa, sums = 1.0 / lever[STIFFNESS], p[col.RELAXING], (0.0, 0.0, 0.0, 0.0, 0.0)
    pull, stiff = contact_force(law, 0.0, p) * inverse_k, 1.5 * p[col.CONTACT] * inverse_k
    for j in range(N):
        d = max(memory.depth[j], 0.0)
        nodes.g[TOUCH + j] = stiff * (2.0 / 3.0 * d * math.sqrt(d) - kappa * memory.inside[j]) + pull
        sums = _node_sums_with(sums, nodes, TOUCH + j, GAUSS_WEIGHTS[j], amplitude)
    for j in range(N, 2 * N):
        q2 = max(memory.early_depth[j], 0.0)
        q, third = math.sqrt(q2), q2 / 3.0
        y = q * (memory.dashpot_depth[j] - third) - memory.kept[j] * (
            q * (memory.early_dashpot_depth[j] - third) - memory.early_inside[j]
        )
        nodes.g[LATE + j - N] = stiff * (q * (memory.depth[j] - third) - kappa * y) + pull
        sums = _node_sums_with(sums, nodes, LATE + j - N, GAUSS_WEIGHTS[j - N], amplitude)
    if nodes.outside == 1:
        dent, recovery = dent_of(p, lever, memory)
        for j in range(N):
            d = depth_at_node(nodes, amplitude, centre, IN + j)
            nodes.g[IN + j] = inverse_k * longrange_force(law, min(d, 0.0), p)
            sums = _node_sums_with(sums, nodes, IN + j, GAUSS_WEIGHTS[j], amplitude)
            d = depth_at_node(nodes, amplitude, centre, OUT + j)
            d -= dent * math.exp((nodes.theta[EXIT] - nodes.theta[OUT + j]) * recovery)
            nodes.g[OUT + j] = inverse_k * longrange_force(law, min(d, 0.0), p)
            sums = _node_sums_with(sums, nodes, OUT + j, GAUSS_WEIGHTS[j], amplitude)
    mean, push, drag, work, virial = sums
    return mean / (2.0 * math.pi), push / math.pi, drag / math.pi, work, virial
