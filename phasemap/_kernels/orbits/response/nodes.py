"""Exact orbits from the lever's response to the force it meets: the cheap path.

With the time origin at the first harmonic, d = A cos(theta) + w(theta) - e, where w has neither mean nor first harmonic
and e = z0 - mean deflection. The lever turns g at an angle phi into motion at theta by the periodic Green's function of
omega^2 w'' + 2 alpha0 omega w' + w = -g, less its harmonics 0 and 1. With lambda = (-alpha0 + i (1 - alpha0^2)^(1/2)) /
omega and nu = Im lambda the sum over all harmonics is

    G(theta - phi) = Im[exp(lambda (theta - phi)) (E + H(theta - phi))] / (omega^2 nu),   E = 1/(exp(-2 pi lambda) - 1),

H the unit step, so that w at every node follows from running integrals of g exp(-lambda phi): theory,
Eqs. (response-4), (response-5) and (response-6). In air w is some
hundredths of the indentation, and the passes w -> -G g converge fast; each also moves e to where the drive is the one
given (`mismatch`; averaging is the pass with w = 0). This file has one pass; `passes` repeats it.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels.arrays import copy
from phasemap._kernels.columns import ALPHA0, DAMPING, LONGRANGE, OMEGA, STIFFNESS
from phasemap._kernels.compilation import ANY_ORDER, kernel
from phasemap._kernels.law import Oscillator, contact_force, damping, longrange_force
from phasemap._kernels.quadrature import gauss, integration_matrix
from phasemap._kernels.records import column, record

N = 16  # nodes in an element; elements: before contact (counted backwards in time), in contact, after contact
GAUSS_X, GAUSS_WEIGHTS = gauss(N)
UPTO = np.ascontiguousarray(integration_matrix(GAUSS_X).T)  # [k, j]: integral of the k-th polynomial up to node j
_CONTACT_S, _CONTACT_W = np.sin(np.pi * (GAUSS_X - 0.5)), np.pi * np.cos(np.pi * (GAUSS_X - 0.5))
EARLY_S, EARLY_W = np.sin(0.5 * np.pi * (GAUSS_X - 1.0)), 0.5 * np.pi * np.cos(0.5 * np.pi * (GAUSS_X - 1.0))
LATE_S, LATE_W = np.sin(0.5 * np.pi * GAUSS_X), 0.5 * np.pi * np.cos(0.5 * np.pi * GAUSS_X)
IN, TOUCH, OUT, ENTRY, EXIT, ALL = 0, N, 2 * N, 3 * N, 3 * N + 1, 3 * N + 4
LATE, ALL_CUT = ALL, ALL + N  # the later half of a contact that is cut in two, where there is room for it


@record
class Nodes:
    """Nodes of an orbit before, in and after contact, with the motion and the force at each."""

    cut: int  # 1 where the contact is cut in two elements, else 0
    theta: np.ndarray = column(ALL_CUT)  # angle of the first harmonic [rad]
    cos: np.ndarray = column(ALL_CUT)
    sin: np.ndarray = column(ALL_CUT)
    weight: np.ndarray = column(ALL_CUT)  # d(theta)/dx of an element [rad]
    w: np.ndarray = column(ALL_CUT)  # motion beyond mean and first harmonic [m]
    u: np.ndarray = column(ALL_CUT)  # dw/d(theta) [m]
    g: np.ndarray = column(ALL_CUT)  # force over stiffness [m]
    growth: np.ndarray = column(ALL_CUT)  # |exp(-lambda theta)|
    turn_cos: np.ndarray = column(ALL_CUT)  # cosine and sine of Im(lambda) theta
    turn_sin: np.ndarray = column(ALL_CUT)
    re: np.ndarray = column(ALL_CUT)  # g exp(-lambda theta) and its running integral
    im: np.ndarray = column(ALL_CUT)
    sum_re: np.ndarray = column(ALL_CUT)
    sum_im: np.ndarray = column(ALL_CUT)
    far: np.ndarray = column(N)  # places of the nodes out of contact, and their weights, on (0, 1)
    far_weight: np.ndarray = column(N)


@kernel(fastmath=ANY_ORDER)
def _turn(angle: np.ndarray, factor: float, sine: np.ndarray, cosine: np.ndarray) -> None:
    """Sine and cosine of factor * angle, to 1e-11 up to 2 pi: polynomials at an eighth, doubled three times."""
    for j in range(len(angle)):
        x = 0.125 * factor * angle[j]
        q = x * x
        s = x * (1.0 + q * (-1 / 6 + q * (1 / 120 + q * (-1 / 5040 + q * (1 / 362880 - q / 39916800)))))
        less = q * (-0.5 + q * (1 / 24 + q * (-1 / 720 + q * (1 / 40320 + q * (-1 / 3628800 + q / 479001600)))))
        s, less = 2.0 * s * (1.0 + less), 2.0 * less * (2.0 + less)
        s, less = 2.0 * s * (1.0 + less), 2.0 * less * (2.0 + less)
        sine[j], cosine[j] = 2.0 * s * (1.0 + less), 1.0 + 2.0 * less * (2.0 + less)


@kernel
def grade_outer_nodes(f: Nodes, amplitude: float, e: float, reach: float, edge: float) -> None:
    """Where the nodes outside contact lie, over the angle from its edge to the far end: sinh(X x)/sinh(X).

    The long-range force has its pole at a distance that sinh then takes away from the nodes.
    """
    near = (reach + max(e - amplitude, 0.0)) / amplitude
    sine = math.sin(edge)
    width = 2.0 * near / (sine + math.sqrt(sine * sine + 2.0 * near * max(math.cos(edge), 0.1)))
    most = math.asinh((math.pi - edge) / width)
    share = 1.0 / math.sinh(most)
    for j in range(N):
        large = math.exp(most * GAUSS_X[j])
        f.far[j], f.far_weight[j] = 0.5 * share * (large - 1.0 / large), 0.5 * most * share * (large + 1.0 / large)


@kernel(fastmath=ANY_ORDER)
def lay_nodes(f: Nodes, lever: np.ndarray, entry: float, exit_: float, longrange: bool) -> None:
    """Place the nodes: contact from entry to exit, and outside, the finer the nearer."""
    theta, weight = f.theta, f.weight
    centre, half = 0.5 * (entry + exit_), 0.5 * (exit_ - entry)
    before, after = math.pi + entry, math.pi - exit_
    for j in range(N):
        theta[TOUCH + j] = centre + half * _CONTACT_S[j]
        weight[TOUCH + j] = half * _CONTACT_W[j]
        if longrange:
            theta[IN + j], weight[IN + j] = entry - before * f.far[j], before * f.far_weight[j]
            theta[OUT + j], weight[OUT + j] = exit_ + after * f.far[j], after * f.far_weight[j]
    if f.cut:
        for j in range(N):
            theta[TOUCH + j], weight[TOUCH + j] = centre + half * EARLY_S[j], half * EARLY_W[j]
            theta[LATE + j], weight[LATE + j] = centre + half * LATE_S[j], half * LATE_W[j]
    theta[ENTRY], theta[EXIT] = entry, exit_
    fill_angles(f, lever)


@kernel(fastmath=ANY_ORDER)
def fill_angles(f: Nodes, lever: np.ndarray) -> None:
    """Fill in what goes with the angles of the nodes: sines and cosines, and exp(-lambda theta)."""
    count, omega, alpha0 = count_of(f), lever[OMEGA], lever[ALPHA0]
    theta = f.theta[:count]
    _turn(theta, 1.0, f.sin, f.cos)
    nu = math.sqrt(1.0 - alpha0 * alpha0) / omega
    if abs(nu - 1.0) < 3e-4:
        for j in range(count):  # a small angle more, to third order
            more = (nu - 1.0) * theta[j]
            less = 1.0 - 0.5 * more * more
            f.turn_sin[j] = f.sin[j] * less + f.cos[j] * more
            f.turn_cos[j] = f.cos[j] * less - f.sin[j] * more
    else:
        _turn(theta, nu, f.turn_sin, f.turn_cos)
    for j in range(count):
        x = 0.125 * alpha0 / omega * theta[j]
        grow = 1.0 + x * (1.0 + x * (1 / 2 + x * (1 / 6 + x * (1 / 24 + x * (1 / 120 + x * (1 / 720 + x / 5040))))))
        grow *= grow
        grow *= grow
        f.growth[j] = grow * grow


@kernel
def parts_of(f: Nodes) -> int:
    """Number of elements in contact."""
    return 2 if f.cut else 1


@kernel
def count_of(f: Nodes) -> int:
    """Number of nodes, the two edges of the contact included."""
    return ALL_CUT if f.cut else ALL


@kernel
def middle_of(f: Nodes) -> int:
    """A node in the middle of the contact."""
    return TOUCH + N // 2 if parts_of(f) == 1 else LATE


@kernel
def clear_motion(f: Nodes) -> None:
    """Set the motion beyond the first harmonic to zero."""
    for j in range(count_of(f)):
        f.w[j], f.u[j] = 0.0, 0.0


@kernel
def contact_node(k: int) -> int:
    """The k-th node in contact."""
    return TOUCH + k if k < N else LATE + k - N


@kernel(fastmath=ANY_ORDER, inline=True)
def _upto(g: np.ndarray, to: np.ndarray) -> None:
    """Integrals of g from an element's start to its nodes; eight nodes at once, which stay in registers."""
    for j in range(N):
        to[j] = 0.0
    for k in range(0, N, 8):
        g0, g1, g2, g3, g4, g5, g6, g7 = g[k], g[k + 1], g[k + 2], g[k + 3], g[k + 4], g[k + 5], g[k + 6], g[k + 7]
        for j in range(N):
            to[j] += (
                UPTO[k, j] * g0 + UPTO[k + 1, j] * g1 + UPTO[k + 2, j] * g2 + UPTO[k + 3, j] * g3
                + UPTO[k + 4, j] * g4 + UPTO[k + 5, j] * g5 + UPTO[k + 6, j] * g6 + UPTO[k + 7, j] * g7
            )  # fmt: skip


@kernel(fastmath=ANY_ORDER)
def _running(f: Nodes, first: int) -> tuple[float, float]:
    """Integrals of g exp(-lambda theta) from an element's start to its nodes; returns those over all of it."""
    re, im = f.re[first : first + N], f.im[first : first + N]
    _upto(re, f.sum_re[first : first + N])
    _upto(im, f.sum_im[first : first + N])
    total_re, total_im = 0.0, 0.0
    for k in range(N):
        total_re += GAUSS_WEIGHTS[k] * re[k]
        total_im += GAUSS_WEIGHTS[k] * im[k]
    return total_re, total_im


@kernel(fastmath=ANY_ORDER)
def force(
    oscillator: Oscillator, f: Nodes, amplitude: float, e: float, touching: bool
) -> tuple[float, float, float, float, float, float]:
    """Fill g at the nodes; mean, P, S of g, the work of its conservative part, that of damping, and the virial sum."""
    law, p, lever = oscillator
    inverse_k, omega = 1.0 / lever[STIFFNESS], lever[OMEGA]
    mean, push, drag, work, loss, virial = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    damped = p[DAMPING] != 0.0
    for part in range(parts_of(f) if touching else 0):
        first = TOUCH if part == 0 else LATE
        for j in range(N):
            i = first + j
            d = max(amplitude * f.cos[i] + f.w[i] - e, 0.0)
            turn = f.u[i] - amplitude * f.sin[i]
            g = inverse_k * contact_force(law, d, p)
            weight = GAUSS_WEIGHTS[j] * f.weight[i]
            work += weight * g * turn
            if damped:
                drop = 2.0 * omega * damping(law, d, p) * turn
                loss += weight * drop * turn
                g += drop
            f.g[i] = g
            mean += weight * g
            push += weight * g * f.cos[i]
            drag += weight * g * f.sin[i]
            virial += weight * g * (amplitude * f.cos[i] + f.w[i])
    if p[LONGRANGE] != 0.0:
        for side in range(2):
            first = IN if side == 0 else OUT
            for j in range(N):
                i = first + j
                d = min(amplitude * f.cos[i] + f.w[i] - e, 0.0)
                g = inverse_k * longrange_force(law, d, p)
                f.g[i] = g
                weight = GAUSS_WEIGHTS[j] * f.weight[i]
                work += weight * g * (f.u[i] - amplitude * f.sin[i])
                mean += weight * g
                push += weight * g * f.cos[i]
                drag += weight * g * f.sin[i]
                virial += weight * g * (amplitude * f.cos[i] + f.w[i])
    return mean / (2 * math.pi), push / math.pi, drag / math.pi, work, loss, virial


@kernel(fastmath=ANY_ORDER)
def periods_before(a: float, nu: float) -> tuple[float, float]:
    """E = 1/(exp(-2 pi lambda) - 1), lambda = a + i nu: what a kick of all periods before it adds up to."""
    size = math.exp(-2 * math.pi * a)
    re, im = size * math.cos(2 * math.pi * nu) - 1.0, -size * math.sin(2 * math.pi * nu)
    below = 1.0 / (re * re + im * im)
    return re * below, -im * below


@kernel(fastmath=ANY_ORDER)
def first_harmonic(omega: float, alpha0: float, push: float, drag: float) -> tuple[float, float]:
    """Return (P - iS)/(1 - omega^2 + 2 i alpha0 omega), the lever's response to the first harmonic of the force."""
    x, y = 1.0 - omega * omega, 2.0 * alpha0 * omega
    below = 1.0 / (x * x + y * y)
    return (push * x - drag * y) * below, (-drag * x - push * y) * below


@kernel(fastmath=ANY_ORDER)
def respond(
    f: Nodes, lever: np.ndarray, mean: float, push: float, drag: float, touching: bool, longrange: bool
) -> None:
    """Replace w and w' by the lever's response to g."""
    omega, alpha0 = lever[OMEGA], lever[ALPHA0]
    a, nu = -alpha0 / omega, math.sqrt(1.0 - alpha0 * alpha0) / omega
    for j in range(3 * N):
        share = f.g[j] * f.weight[j] * f.growth[j]
        f.re[j], f.im[j] = share * f.turn_cos[j], -share * f.turn_sin[j]
    in_re, in_im, at_re, at_im, out_re, out_im = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if longrange:
        in_re, in_im = _running(f, IN)
        out_re, out_im = _running(f, OUT)
    if touching:
        at_re, at_im = _running(f, TOUCH)
    if touching and parts_of(f) > 1:
        for j in range(LATE, LATE + N):
            share = f.g[j] * f.weight[j] * f.growth[j]
            f.re[j], f.im[j] = share * f.turn_cos[j], -share * f.turn_sin[j]
        late_re, late_im = _running(f, LATE)
        for j in range(LATE, LATE + N):
            f.sum_re[j] += in_re + at_re
            f.sum_im[j] += in_im + at_im
        at_re, at_im = at_re + late_re, at_im + late_im
    for j in range(N):
        # The element before contact was integrated backwards.
        f.sum_re[j], f.sum_im[j] = in_re - f.sum_re[j], in_im - f.sum_im[j]
        f.sum_re[TOUCH + j] += in_re
        f.sum_im[TOUCH + j] += in_im
        f.sum_re[OUT + j] += in_re + at_re
        f.sum_im[OUT + j] += in_im + at_im
    f.sum_re[ENTRY], f.sum_im[ENTRY] = in_re, in_im
    f.sum_re[EXIT], f.sum_im[EXIT] = in_re + at_re, in_im + at_im
    all_re, all_im = in_re + at_re + out_re, in_im + at_im + out_im
    e_re, e_im = periods_before(a, nu)
    round_re, round_im = e_re * all_re - e_im * all_im, e_re * all_im + e_im * all_re
    h_re, h_im = first_harmonic(omega, alpha0, push, drag)
    share = 1.0 / (omega * omega * nu)
    for j in range(count_of(f)):
        m_re, m_im = round_re + f.sum_re[j], round_im + f.sum_im[j]
        shrink = share / f.growth[j]
        t_re, t_im = shrink * f.turn_cos[j], shrink * f.turn_sin[j]
        g_im = t_re * m_im + t_im * m_re
        g_re = t_re * m_re - t_im * m_im
        c, s = f.cos[j], f.sin[j]
        f.w[j] = -g_im + mean + h_re * c - h_im * s
        f.u[j] = -(a * g_im + nu * g_re) - h_re * s - h_im * c


@kernel(fastmath=ANY_ORDER)
def move_nodes(f: Nodes, lever: np.ndarray, amplitude: float, e: float, touching: bool, longrange: bool) -> None:
    """Move the nodes to where the contact is now, and w with them."""
    count, before = count_of(f), f.re
    theta = f.theta[:count]
    copy(theta, before)
    entry, exit_ = 0.0, 0.0
    if touching:
        entry = theta[ENTRY] - (amplitude * f.cos[ENTRY] + f.w[ENTRY] - e) / (f.u[ENTRY] - amplitude * f.sin[ENTRY])
        exit_ = theta[EXIT] - (amplitude * f.cos[EXIT] + f.w[EXIT] - e) / (f.u[EXIT] - amplitude * f.sin[EXIT])
    lay_nodes(f, lever, entry, exit_, longrange)
    for j in range(count):
        f.w[j] += f.u[j] * (theta[j] - before[j])
