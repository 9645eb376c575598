"""Exact orbits from the lever's response to the force it meets: the cheap path.

With the time origin at the first harmonic, d = A cos(theta) + w(theta) - e, where w has neither mean nor first harmonic
and e = z0 - mean deflection. The lever turns g at an angle phi into motion at theta by the periodic Green's function of
omega^2 w'' + 2 alpha0 omega w' + w = -g, less its harmonics 0 and 1. With lambda = (-alpha0 + i (1 - alpha0^2)^(1/2)) /
omega and nu = Im lambda the sum over all harmonics is

    G(theta - phi) = Im[exp(lambda (theta - phi)) (E + H(theta - phi))] / (omega^2 nu),   E = 1/(exp(-2 pi lambda) - 1),

H the unit step, so that w at every node follows from running integrals of g exp(-lambda phi): theory,
Eqs. (response-4), (response-5) and (response-6). A lever of several modes adds up what each makes of the force, with a
lambda of its own. In air w is some hundredths of the indentation, and the passes w -> -G g converge fast; each also
moves e to where the drive is the one given (`mismatch`; averaging is the pass with w = 0). This file has the nodes and
the force at them, `motion` the lever's response to it; `passes` repeats both.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels.columns import DAMPING, OMEGA, STIFFNESS
from phasemap._kernels.compilation import ANY_ORDER, kernel
from phasemap._kernels.law import Oscillator, contact_force, contact_slope, damping, has_longrange, longrange_force
from phasemap._kernels.lever_modes import LeverMode, fastest_turn
from phasemap._kernels.numerics import copy, fill_growth, fill_turn
from phasemap._kernels.quadrature import gauss, integration_matrix
from phasemap._kernels.records import column, record

N = 16  # nodes in an element; elements: before contact (counted backwards in time), in contact, after contact
GAUSS_X, GAUSS_WEIGHTS = gauss(N)
UPTO = np.ascontiguousarray(integration_matrix(GAUSS_X).T)  # [k, j]: integral of the k-th polynomial up to node j
_LEGENDRE = np.polynomial.legendre.legvander(np.concatenate([2 * GAUSS_X - 1, GAUSS_X - 1, GAUSS_X]), N - 1)
INTO_PARTS = _LEGENDRE[N:] @ np.linalg.inv(_LEGENDRE[:N])  # from the nodes of a contact to those of its halves
HIGHEST = (_LEGENDRE[:N].T * GAUSS_WEIGHTS)[N - 2 :] * np.array(
    [[2 * N - 3], [2 * N - 1]]
)  # coefficients of the highest polynomials
IN, TOUCH, OUT, ENTRY, EXIT, ALL = 0, N, 2 * N, 3 * N, 3 * N + 1, 3 * N + 4
MOST_PARTS = 8  # of a contact, which is cut in 1, 2, 4 or 8
LATE, ALL_CUT = ALL, ALL + (MOST_PARTS - 1) * N  # the later parts of a contact that is cut, where there is room
_PLACES = np.concatenate([np.add.outer(np.arange(n), GAUSS_X).reshape(-1) / n for n in (1, 2, 4, 8)])
_CONTACT_S = np.sin(np.pi * (_PLACES - 0.5))  # of the nodes of a contact in n parts, from (n - 1) N
_CONTACT_W = np.pi * np.cos(np.pi * (_PLACES - 0.5)) / np.repeat([1, 2, 4, 8], N * np.array([1, 2, 4, 8]))
MOST_TURN = 6.0  # [rad] of the fastest mode in half an element


@record
class Nodes:
    """Nodes of an orbit before, in and after contact, with the motion and the force at each."""

    parts: int  # elements into which the contact is cut; 0 is 1
    touches: int  # 1 where the tip touches, so that the nodes in contact count
    outside: int  # 1 where a force acts out of contact, so that the nodes before and after contact count
    missed: float  # of the motion by the higher modes, which the nodes may be too few for [m]
    theta: np.ndarray = column(ALL_CUT)  # angle of the first harmonic [rad]
    cos: np.ndarray = column(ALL_CUT)
    sin: np.ndarray = column(ALL_CUT)
    weight: np.ndarray = column(ALL_CUT)  # d(theta)/dx of an element [rad]
    w: np.ndarray = column(ALL_CUT)  # motion beyond mean and first harmonic [m]
    u: np.ndarray = column(ALL_CUT)  # dw/d(theta) [m]
    g: np.ndarray = column(ALL_CUT)  # force over stiffness [m]
    growth: np.ndarray = column(ALL_CUT)  # |exp(-lambda theta)| of the mode that was looked at last
    turn_cos: np.ndarray = column(ALL_CUT)  # cosine and sine of Im(lambda) theta of it
    turn_sin: np.ndarray = column(ALL_CUT)
    re: np.ndarray = column(ALL_CUT)  # g exp(-lambda theta) and its running integral
    im: np.ndarray = column(ALL_CUT)
    sum_re: np.ndarray = column(ALL_CUT)
    sum_im: np.ndarray = column(ALL_CUT)
    far: np.ndarray = column(N)  # places of the nodes out of contact, and their weights, on (0, 1)
    far_weight: np.ndarray = column(N)


@kernel
def grade_outer_nodes(nodes: Nodes, amplitude: float, centre: float, reach: float, edge: float) -> None:
    """Place the nodes outside contact, over the angle from its edge to the far end: sinh(X x)/sinh(X).

    In x the pole of the long-range force, which is near the surface, lies farther from the nodes.
    """
    near = (reach + max(centre - amplitude, 0.0)) / amplitude
    sine = math.sin(edge)
    width = 2.0 * near / (sine + math.sqrt(sine * sine + 2.0 * near * max(math.cos(edge), 0.1)))
    most = math.asinh((math.pi - edge) / width)
    share = 1.0 / math.sinh(most)
    for j in range(N):
        large = math.exp(most * GAUSS_X[j])
        nodes.far[j], nodes.far_weight[j] = (
            0.5 * share * (large - 1.0 / large),
            0.5 * most * share * (large + 1.0 / large),
        )


@kernel(fastmath=ANY_ORDER)
def lay_nodes(nodes: Nodes, entry: float, exit_: float) -> None:
    """Place the nodes: contact from entry to exit, and outside, the finer the nearer."""
    theta, weight = nodes.theta, nodes.weight
    centre, half = 0.5 * (entry + exit_), 0.5 * (exit_ - entry)
    before, after = math.pi + entry, math.pi - exit_
    parts = parts_of(nodes)
    for part in range(parts):
        first, place = first_of(part), N * (parts - 1 + part)
        for j in range(N):
            theta[first + j] = centre + half * _CONTACT_S[place + j]
            weight[first + j] = half * _CONTACT_W[place + j]
    for j in range(N if nodes.outside == 1 else 0):
        theta[IN + j], weight[IN + j] = entry - before * nodes.far[j], before * nodes.far_weight[j]
        theta[OUT + j], weight[OUT + j] = exit_ + after * nodes.far[j], after * nodes.far_weight[j]
    theta[ENTRY], theta[EXIT] = entry, exit_
    fill_turn(nodes.theta[: count_of(nodes)], 1.0, nodes.sin, nodes.cos)


@kernel(fastmath=ANY_ORDER)
def fill_mode(nodes: Nodes, mode: LeverMode) -> None:
    """Fill in exp(-lambda theta) of a mode at the nodes."""
    count, nu = count_of(nodes), mode.turn
    theta = nodes.theta[:count]
    if abs(nu - 1.0) < 3e-4:
        for j in range(count):  # a small angle more, to third order
            more = (nu - 1.0) * theta[j]
            less = 1.0 - 0.5 * more * more
            nodes.turn_sin[j] = nodes.sin[j] * less + nodes.cos[j] * more
            nodes.turn_cos[j] = nodes.cos[j] * less - nodes.sin[j] * more
    else:
        fill_turn(theta, nu, nodes.turn_sin, nodes.turn_cos)
    fill_growth(theta, -mode.decay, nodes.growth)


@kernel
def parts_of(nodes: Nodes) -> int:
    """Number of elements in contact."""
    return max(nodes.parts, 1)


@kernel
def first_of(part: int) -> int:
    """The first node of a part of the contact."""
    return TOUCH if part == 0 else LATE + (part - 1) * N


@kernel
def first_of_element(element: int) -> int:
    """The first node of an element: before contact (0), in contact (1), after contact (2), later parts of contact."""
    return N * element if element < 3 else first_of(element - 2)


@kernel
def force_acts_on(nodes: Nodes, element: int) -> bool:
    """True if a force acts at the nodes of an element, counted as for `first_of_element`."""
    return (nodes.outside if element == 0 or element == 2 else nodes.touches) == 1


@kernel
def count_of(nodes: Nodes) -> int:
    """Number of nodes, the two edges of the contact included."""
    return ALL + (parts_of(nodes) - 1) * N


@kernel
def parts_needed(oscillator: Oscillator, half: float, depth: float) -> int:
    """Number of elements into which a contact is cut, for nodes to follow the fastest mode that the surface stiffens.

    `half`: of its length [rad].
    `depth`: [m].
    """
    law, p, lever = oscillator
    turn, parts = fastest_turn(lever, max(contact_slope(law, max(depth, 0.0), p), 0.0)) / lever[OMEGA], 1
    while parts <= MOST_PARTS and half * turn > MOST_TURN * parts:
        parts *= 2
    return parts


@kernel
def middle_of(nodes: Nodes) -> int:
    """A node in the middle of the contact."""
    return TOUCH + N // 2 if parts_of(nodes) == 1 else first_of(parts_of(nodes) // 2)


@kernel
def clear_motion(nodes: Nodes) -> None:
    """Set the motion beyond the first harmonic to zero."""
    for j in range(count_of(nodes)):
        nodes.w[j], nodes.u[j] = 0.0, 0.0


@kernel
def contact_node(k: int) -> int:
    """Index of the k-th node in contact."""
    return TOUCH + k if k < N else LATE + k - N


@kernel
def node_in_time(nodes: Nodes, k: int) -> int:
    """Index of the k-th node in the order of time; the element before contact runs backwards."""
    contact = N * parts_of(nodes)
    return N - 1 - k if k < N else contact_node(k - N) if k < N + contact else OUT + k - N - contact


@kernel(inline=True, fastmath=ANY_ORDER)
def weight_of_node(nodes: Nodes, i: int) -> float:
    """Weight [rad] of node i in an integral over the angle."""
    return GAUSS_WEIGHTS[i % N if i < LATE else (i - LATE) % N] * nodes.weight[i]


@kernel(inline=True, fastmath=ANY_ORDER)
def depth_at_node(nodes: Nodes, amplitude: float, centre: float, i: int) -> float:
    """Depth d [m] of the tip at node i: A cos(theta) + w - e."""
    return amplitude * nodes.cos[i] + nodes.w[i] - centre


@kernel(inline=True, fastmath=ANY_ORDER)
def rate_at_node(nodes: Nodes, amplitude: float, i: int) -> float:
    """Rate of the depth at node i over the angle of the first harmonic, dd/d(theta) [m]."""
    return nodes.u[i] - amplitude * nodes.sin[i]


@kernel(fastmath=ANY_ORDER)
def fill_force(
    oscillator: Oscillator, nodes: Nodes, amplitude: float, centre: float
) -> tuple[float, float, float, float, float, float]:
    """Fill in the force g at the nodes; returns its mean, P, S, work without damping, work of damping, and virial."""
    law, p, lever = oscillator
    inverse_k, omega = 1.0 / lever[STIFFNESS], lever[OMEGA]
    mean, push, drag, work, loss, virial = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    damped = p[DAMPING] != 0.0
    for part in range(parts_of(nodes) if nodes.touches == 1 else 0):
        first = first_of(part)
        for j in range(N):
            i = first + j
            d, turn = max(depth_at_node(nodes, amplitude, centre, i), 0.0), rate_at_node(nodes, amplitude, i)
            g = inverse_k * contact_force(law, d, p)
            weight = GAUSS_WEIGHTS[j] * nodes.weight[i]
            work += weight * g * turn
            if damped:
                drop = 2.0 * omega * damping(law, d, p) * turn
                loss += weight * drop * turn
                g += drop
            nodes.g[i] = g
            mean += weight * g
            push += weight * g * nodes.cos[i]
            drag += weight * g * nodes.sin[i]
            virial += weight * g * (amplitude * nodes.cos[i] + nodes.w[i])
    if has_longrange(p):
        for side in range(2):
            first = IN if side == 0 else OUT
            for j in range(N):
                i = first + j
                d = min(depth_at_node(nodes, amplitude, centre, i), 0.0)
                g = inverse_k * longrange_force(law, d, p)
                nodes.g[i] = g
                weight = GAUSS_WEIGHTS[j] * nodes.weight[i]
                work += weight * g * rate_at_node(nodes, amplitude, i)
                mean += weight * g
                push += weight * g * nodes.cos[i]
                drag += weight * g * nodes.sin[i]
                virial += weight * g * (amplitude * nodes.cos[i] + nodes.w[i])
    return mean / (2 * math.pi), push / math.pi, drag / math.pi, work, loss, virial


@kernel(fastmath=ANY_ORDER)
def periods_before(a: float, nu: float) -> tuple[float, float]:
    """E = 1/(exp(-2 pi lambda) - 1), lambda = a + i nu: sum of the effects of a kick in all periods before."""
    size = math.exp(-2 * math.pi * a)
    re, im = size * math.cos(2 * math.pi * nu) - 1.0, -size * math.sin(2 * math.pi * nu)
    below = 1.0 / (re * re + im * im)
    return re * below, -im * below


@kernel(fastmath=ANY_ORDER)
def response_to_first_harmonic(omega: float, mode: LeverMode, push: float, drag: float) -> tuple[float, float]:
    """A mode's response to the first harmonic of g: share (P - iS)/(square - omega^2 + 2 i rate omega)."""
    x, y = mode.square - omega * omega, 2.0 * mode.rate * omega
    below = mode.share / (x * x + y * y)
    return (push * x - drag * y) * below, (-drag * x - push * y) * below


@kernel(fastmath=ANY_ORDER)
def move_nodes(nodes: Nodes, amplitude: float, centre: float) -> None:
    """Move the nodes to where the contact is now, and w with them."""
    count, before = count_of(nodes), nodes.re
    theta = nodes.theta[:count]
    copy(theta, before)
    entry, exit_ = 0.0, 0.0
    if nodes.touches == 1:
        entry = theta[ENTRY] - depth_at_node(nodes, amplitude, centre, ENTRY) / rate_at_node(nodes, amplitude, ENTRY)
        exit_ = theta[EXIT] - depth_at_node(nodes, amplitude, centre, EXIT) / rate_at_node(nodes, amplitude, EXIT)
    lay_nodes(nodes, entry, exit_)
    for j in range(count):
        nodes.w[j] += nodes.u[j] * (theta[j] - before[j])


@kernel
def cut_contact(nodes: Nodes, finer: Nodes) -> None:
    """Carry an orbit over to nodes that cut each part of its contact in two."""
    finer.parts, finer.touches, finer.outside = 2 * parts_of(nodes), nodes.touches, nodes.outside
    copy(nodes.far, finer.far)
    copy(nodes.far_weight, finer.far_weight)
    lay_nodes(finer, nodes.theta[ENTRY], nodes.theta[EXIT])
    _carry_over(nodes.w, parts_of(nodes), finer.w)
    _carry_over(nodes.u, parts_of(nodes), finer.u)


@kernel
def _carry_over(row: np.ndarray, parts: int, finer: np.ndarray) -> None:
    """Interpolate the values in `row` to the nodes of `finer`, which has two parts for each part of the contact."""
    for j in range(ALL):
        finer[j] = row[j]
    for j in range(2 * N * parts):
        part, total = j // (2 * N), 0.0
        for k in range(N):
            total += INTO_PARTS[j % (2 * N), k] * row[first_of(part) + k]
        finer[contact_node(j)] = total
