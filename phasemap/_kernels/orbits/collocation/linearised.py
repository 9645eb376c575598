"""The equations of a periodic orbit, linearised: Gauss collocation on elements split at the contact points.

Unknown in an element is the force at its Gauss nodes: the motion there follows from the states of the modes at the
element's start and the force by the lever's answer to a kick. The force is linearised about the present orbit, so that
it is an affine function of these states and of (P, S, z0, A), and the elements are chained round the period. The
product of their transfer matrices is the monodromy matrix, so the Floquet multipliers come with the orbit.

Anything else that the orbit depends on may be unknown too: the law's parameters and the lever are then functions of
one number m (see `phasemap._kernels.continuation.point`), and a column of the equations says what a change of m does.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels.columns import DRIVE, MOST_MODES, OMEGA, RELEASE, ROW, STIFFNESS
from phasemap._kernels.compilation import ANY_ORDER, kernel
from phasemap._kernels.law import Oscillator, has_longrange, parameters
from phasemap._kernels.lever_modes import mode_of, modes_of
from phasemap._kernels.numerics import eliminate_columns
from phasemap._kernels.orbits.collocation.lever_over_element import add_response, fill_turns, free_transfer
from phasemap._kernels.orbits.collocation.system import (
    DRIFT_STEP,
    EQUATIONS_CURRENT,
    IN_NECK,
    OUT_OF_CONTACT,
    RA,
    RM,
    RP,
    RS,
    RZ,
    STATE,
    Element,
    Orbit,
    depth_on_side,
    element_of,
    head_of,
    motion_of_mode,
    surface_force,
)
from phasemap._kernels.quadrature import NODES, T_END1, T_UPTO
from phasemap._kernels.records import column, record

NO_JUMP_AT_EDGE = 1e-13  # of the drive's force: a difference of two forces as small is rounding
LEAST_SLOPE_AT_EDGE = 1e-9  # of the amplitude, dd/dtheta with which a tip that grazes is taken to cross


@kernel
def _fill_drift_of_motion(oscillator: Oscillator, orbit: Orbit, e: int, drift: np.ndarray, by_m: np.ndarray) -> None:
    """Fill the forces that would change the motion over an element as the path's parameter m does at a given force.

    by_m[i] (shape (modes, NODES)) becomes the force on mode i.
    """
    law, p, lever = oscillator
    head, element, f = head_of(orbit), element_of(orbit, e), np.empty(NODES)
    omega, scale = lever[OMEGA], 1.0 / (2.0 * DRIFT_STEP)
    up, down = drift[0, ROW:], drift[1, ROW:]
    for j in range(NODES):
        c, s = element.cos[j], element.sin[j]
        d, turn = head.amplitude * c + element.w[j] - head.tip_offset, element.u[j] - head.amplitude * s
        g = surface_force(law, p, 1.0 / lever[STIFFNESS], element.side, d, omega * turn)[0]
        f[j] = head.push * c + head.drag * s - g
    of_bend = scale * (up[OMEGA] ** 2 - down[OMEGA] ** 2)
    for i in range(modes_of(lever)):
        mode, more, less = mode_of(lever, i), mode_of(up, i), mode_of(down, i)
        of_u = 2.0 * scale * (more.rate * up[OMEGA] - less.rate * down[OMEGA])
        of_w, of_force = scale * (more.square - less.square), scale * (more.share - less.share)
        motion = motion_of_mode(orbit, e, i)
        for k in range(NODES):
            w, u = motion.w[k], motion.u[k]
            bend = (mode.share * f[k] - 2.0 * mode.rate * omega * u - mode.square * w) / (omega * omega)
            by_m[i, k] = (of_force * f[k] - of_u * u - of_w * w - of_bend * bend) / mode.share
            motion.w_by_m[k], motion.u_by_m[k] = 0.0, 0.0
        add_response(lever, orbit, e, i, 1.0, by_m[i], motion.w_by_m, motion.u_by_m)


@record
class Slopes:
    """Change of the force over k with w and w' at the nodes of an element."""

    of_w: np.ndarray = column(NODES)
    of_u: np.ndarray = column(NODES)


@kernel
def _fill_drift_of_force(
    oscillator: Oscillator, orbit: Orbit, e: int, drift: np.ndarray, slopes: Slopes, by_m: np.ndarray
) -> None:
    """Fill the change of the force at an element's nodes with the path's parameter m, directly and by the motion."""
    law, lever, head, element = oscillator.law, oscillator.lever, head_of(orbit), element_of(orbit, e)
    up, down = drift[0, ROW:], drift[1, ROW:]
    for j in range(NODES):
        d = head.amplitude * element.cos[j] + element.w[j] - head.tip_offset
        turn = element.u[j] - head.amplitude * element.sin[j]
        more = surface_force(law, parameters(drift[0]), 1.0 / up[STIFFNESS], element.side, d, up[OMEGA] * turn)[0]
        more -= surface_force(law, parameters(drift[1]), 1.0 / down[STIFFNESS], element.side, d, down[OMEGA] * turn)[0]
        by_m[j] = more / (2.0 * DRIFT_STEP)
        for i in range(modes_of(lever)):
            motion = motion_of_mode(orbit, e, i)
            by_m[j] += slopes.of_w[j] * motion.w_by_m[j] + slopes.of_u[j] * motion.u_by_m[j]


@kernel(fastmath=ANY_ORDER, inline=True)
def add_times(factor: float, x: np.ndarray, to: np.ndarray) -> None:
    """Add a multiple of a row at the nodes to another; written out, and read before any is written: in vectors."""
    a, b, c, d, e, f, g, h = x[0], x[1], x[2], x[3], x[4], x[5], x[6], x[7]
    to[0], to[1], to[2], to[3], to[4], to[5], to[6], to[7] = (
        to[0] + factor * a, to[1] + factor * b, to[2] + factor * c, to[3] + factor * d,
        to[4] + factor * e, to[5] + factor * f, to[6] + factor * g, to[7] + factor * h,
    )  # fmt: skip


@kernel(fastmath=ANY_ORDER)
def _add_response_at_all_nodes(lever: np.ndarray, orbit: Orbit, e: int, i: int, slopes: Slopes, m: np.ndarray) -> None:
    """Add to m[k] how the force at node k changes that at all nodes through the motion of mode i; mode 0 sets it.

    A mode answers a kick of one with Im exp(lambda theta) / (omega^2 nu): theory, Eq. (collocation-4).
    """
    element, omega, motion, to = element_of(orbit, e), lever[OMEGA], motion_of_mode(orbit, e, i), Slopes()
    a, nu, _, _, yields = mode_of(lever, i)
    table, grow, cosine, sine = orbit.tables[element.table], motion.growth, motion.cos, motion.sin
    p, q = to.of_w, to.of_u
    for j in range(NODES):
        by_w, by_u = grow[j] * (slopes.of_w[j] + a * slopes.of_u[j]), grow[j] * nu * slopes.of_u[j]
        p[j], q[j] = by_w * sine[j] + by_u * cosine[j], by_u * sine[j] - by_w * cosine[j]
    p0, p1, p2, p3, p4, p5, p6, p7 = p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7]
    q0, q1, q2, q3, q4, q5, q6, q7 = q[0], q[1], q[2], q[3], q[4], q[5], q[6], q[7]
    share = element.scale * yields / (omega * omega * nu)
    for k in range(NODES):
        back, x, t = share / grow[k], m[k], table[T_UPTO + k]
        c, s, old = back * cosine[k], back * sine[k], 1.0 if i > 0 else 0.0
        x[0], x[1], x[2], x[3], x[4], x[5], x[6], x[7] = (
            old * x[0] + t[0] * (c * p0 + s * q0), old * x[1] + t[1] * (c * p1 + s * q1),
            old * x[2] + t[2] * (c * p2 + s * q2), old * x[3] + t[3] * (c * p3 + s * q3),
            old * x[4] + t[4] * (c * p4 + s * q4), old * x[5] + t[5] * (c * p5 + s * q5),
            old * x[6] + t[6] * (c * p6 + s * q6), old * x[7] + t[7] * (c * p7 + s * q7),
        )  # fmt: skip


@kernel(fastmath=ANY_ORDER)
def _force_in_element(oscillator: Oscillator, orbit: Orbit, e: int, drift: np.ndarray, m: np.ndarray) -> bool:
    """Fill the force at the nodes of an element as an affine function of the unknowns: theory, Eq. (collocation-5).

    m is scratch, shape (NODES + unknowns + 1, NODES), with column j of the equations in m[j].
    """
    law, p, lever = oscillator
    head, element, forces = head_of(orbit), element_of(orbit, e), orbit.forces
    omega, inverse_k, count = lever[OMEGA], 1.0 / lever[STIFFNESS], modes_of(lever)
    z0, amplitude, side, unknowns = head.tip_offset, head.amplitude, element.side, STATE + 2 * count
    slopes = Slopes()
    of_w, of_u = slopes.of_w, slopes.of_u
    for j in range(NODES):
        c, s = element.cos[j], element.sin[j]
        d = amplitude * c + element.w[j] - z0
        turn = element.u[j] - amplitude * s
        g, gd, gv = surface_force(law, p, inverse_k, side, d, omega * turn)
        d, gu = depth_on_side(p, side, d), omega * gv
        of_w[j], of_u[j] = gd, gu
        m[NODES + RP, j], m[NODES + RS, j] = 0.0, 0.0
        m[NODES + RZ, j], m[NODES + RA, j] = -gd, gd * c - gu * s
        m[NODES + RM, j] = g - gd * d - gu * turn
    for i in range(count):
        _add_response_at_all_nodes(lever, orbit, e, i, slopes, m)
    for k in range(NODES):
        add_times(element.cos[k], m[k], m[NODES + RP])
        add_times(element.sin[k], m[k], m[NODES + RS])
    for j in range(NODES):
        m[j, j] += 1.0
    for i in range(count):
        a, nu, _, _, _ = mode_of(lever, i)
        motion, inverse = motion_of_mode(orbit, e, i), 1.0 / nu
        grow, cosine, sine = motion.growth, motion.cos, motion.sin
        by_w0, by_u0 = m[NODES + STATE + 2 * i], m[NODES + STATE + 2 * i + 1]
        for j in range(NODES):
            ww, wu, uw, uu = free_transfer(a, nu, inverse, grow[j], cosine[j], sine[j])
            by_w0[j], by_u0[j] = of_w[j] * ww + of_u[j] * uw, of_w[j] * wu + of_u[j] * uu
    if len(drift) > 0:
        _fill_drift_of_force(oscillator, orbit, e, drift, slopes, m[NODES + unknowns])
    if not eliminate_columns(m, NODES + unknowns + (1 if len(drift) > 0 else 0)):
        return False
    for q in range(unknowns + 1):
        row = unknowns if q == RM else RM if q == unknowns else q  # what m moves stands last: mostly there is none
        for j in range(NODES):
            forces[e, q, j] = m[NODES + row, j]
    return True


@kernel
def border_between(p: np.ndarray, before: int, after: int) -> float:
    """Depth [m] of the border between two sides of the surface."""
    return p[RELEASE] if before == IN_NECK and after == OUT_OF_CONTACT else 0.0


@kernel
def jump_rate(oscillator: Oscillator, before: int, element: Element, amplitude: float) -> float:
    """Jump of w' per metre of depth at the start of an element, where the force itself may jump.

    A contact that starts earlier by d / |d'| feels the difference of the two accelerations for so long: theory,
    Eq. (collocation-5).
    """
    law, p, lever = oscillator
    omega, after = lever[OMEGA], element.side
    border = border_between(p, before, after)
    slope = element.edge_u - amplitude * math.sin(element.edge)
    v = omega * slope
    inverse_k = 1.0 / lever[STIFFNESS]
    deeper, higher = (after, before) if slope > 0.0 else (before, after)
    jump = surface_force(law, p, inverse_k, deeper, border, v)[0]
    jump -= surface_force(law, p, inverse_k, higher, border, v)[0]
    if abs(jump) < NO_JUMP_AT_EDGE * lever[DRIVE]:
        return 0.0
    return jump / (omega * omega * max(abs(slope), LEAST_SLOPE_AT_EDGE * amplitude))


@kernel
def _jump_at_start(oscillator: Oscillator, orbit: Orbit, e: int, integrals: np.ndarray) -> None:
    """Correct an element that starts a little beside the contact: the force begins where the contact does."""
    lever, element, chain, count = oscillator.lever, element_of(orbit, e), orbit.chain, modes_of(oscillator.lever)
    before = element_of(orbit, e - 1 if e > 0 else head_of(orbit).count - 1).side
    if element.side == before:
        return
    rate = jump_rate(oscillator, before, element, head_of(orbit).amplitude)
    if rate == 0.0:
        return
    c, s, border = math.cos(element.edge), math.sin(element.edge), border_between(oscillator.p, before, element.side)
    last = STATE + 2 * count
    for q in range(last + 1):
        depth = -1.0 if q == RZ else c if q == RA else -border if q == last else 0.0
        for i in range(count):
            depth += chain[e, 2 * i, q]
        for i in range(count):
            chain[e, 2 * i + 1, q] -= rate * mode_of(lever, i).share * depth
        kick = rate * lever[OMEGA] ** 2 * depth
        integrals[0, q] += kick * c
        integrals[1, q] += kick * s


@record
class Transfers:
    """Transfers of the modes over an element, left alone, see `free_transfer`."""

    ww: np.ndarray = column(MOST_MODES)
    wu: np.ndarray = column(MOST_MODES)
    uw: np.ndarray = column(MOST_MODES)
    uu: np.ndarray = column(MOST_MODES)


@kernel(fastmath=ANY_ORDER)
def _chain_element(
    lever: np.ndarray, orbit: Orbit, e: int, scratch: tuple[np.ndarray, np.ndarray, np.ndarray], integrals: np.ndarray
) -> None:
    """States at the end of an element by the unknowns, from those at its start; adds what its force does to (P, S).

    `scratch`: what a change of m does like a force (`_fill_drift_of_motion`), and arrays of shape (states, NODES) and
    (NODES,).
    """
    element, forces = element_of(orbit, e), orbit.forces[e]
    before, after, (by_m, to, felt) = orbit.chain[e], orbit.chain[e + 1], scratch
    omega, count, h, weights = lever[OMEGA], modes_of(lever), element.scale, orbit.tables[element.table, T_END1]
    last, alone = STATE + 2 * count, Transfers()
    for i in range(count):
        a, nu, _, _, yields = mode_of(lever, i)
        motion = motion_of_mode(orbit, e, i)
        grow, cosine, sine = motion.growth, motion.cos, motion.sin
        share = h * yields / (omega * omega * nu) * grow[NODES]
        c, s, to_w, to_u = cosine[NODES], sine[NODES], to[2 * i], to[2 * i + 1]
        ww, wu, uw, uu = free_transfer(a, nu, 1.0 / nu, grow[NODES], c, s)
        alone.ww[i], alone.wu[i], alone.uw[i], alone.uu[i] = ww, wu, uw, uu
        for k in range(NODES):
            weight = share * weights[k] / grow[k]
            to_w[k] = weight * (s * cosine[k] - c * sine[k])
            to_u[k] = a * to_w[k] + weight * nu * (c * cosine[k] + s * sine[k])
    for q in range(last + 1):
        if q == RM and head_of(orbit).swept == 0:
            for r in range(2 * count):
                after[r, q] = 0.0
            continue
        motion = 1.0 if q < STATE or q == last else 0.0
        for k in range(NODES):
            felt[k] = motion * forces[q, k]
        for r in range(2 * count):
            add_times(before[r, q], forces[STATE + r], felt)
        of_cos, of_sin = 0.0, 0.0
        for k in range(NODES):
            kick = h * weights[k] * felt[k]
            of_cos += kick * element.cos[k]
            of_sin += kick * element.sin[k]
            felt[k] = -felt[k]
        integrals[0, q] += of_cos
        integrals[1, q] += of_sin
        if q == RP or q == RS:
            for k in range(NODES):
                felt[k] += element.cos[k] if q == RP else element.sin[k]
        for i in range(count):
            w, u, to_w, to_u = before[2 * i, q], before[2 * i + 1, q], to[2 * i], to[2 * i + 1]
            more_w, more_u = alone.ww[i] * w + alone.wu[i] * u, alone.uw[i] * w + alone.uu[i] * u
            for k in range(NODES):
                more_w += to_w[k] * felt[k]
                more_u += to_u[k] * felt[k]
            if q == RM:
                for k in range(NODES):
                    more_w += to[2 * i, k] * by_m[i, k]
                    more_u += to[2 * i + 1, k] * by_m[i, k]
            after[2 * i, q], after[2 * i + 1, q] = more_w, more_u


@kernel(shared=True, vectors=True, fastmath=ANY_ORDER)
def linearise_orbit(oscillator: Oscillator, orbit: Orbit, drift: np.ndarray) -> bool:
    """Linearise an orbit's equations, chained round the period; fills `chained` and the monodromy matrix."""
    lever = oscillator.lever
    head, chain, chained, states = head_of(orbit), orbit.chain, orbit.chained, 2 * modes_of(lever)
    last = STATE + states
    integrals, by_m = np.zeros((2, last + 1)), np.zeros((states // 2, NODES))
    m = np.zeros((NODES + last + 1, NODES))
    to, felt = np.empty((states, NODES)), np.empty(NODES)
    head.swept = 1 if len(drift) > 0 else 0
    for r in range(states):
        for q in range(last + 1):
            chain[0, r, q] = 1.0 if q == STATE + r else 0.0
    for e in range(head.count):
        fill_turns(lever, orbit, e)
        if len(drift) > 0:
            _fill_drift_of_motion(oscillator, orbit, e, drift, by_m)
        if element_of(orbit, e).side == OUT_OF_CONTACT and not has_longrange(oscillator.p):
            orbit.forces[e] = 0.0
        else:
            if not _force_in_element(oscillator, orbit, e, drift, m):
                return False
        _jump_at_start(oscillator, orbit, e, integrals)
        _chain_element(lever, orbit, e, (by_m, to, felt), integrals)
    for r in range(states):
        for q in range(last + 1):
            chained[r, q] = chain[head.count, r, q]
        for q in range(states):
            head.transfer[r * states + q] = chained[r, STATE + q]
        chained[r, STATE + r] -= 1.0
    for r in range(2):
        for q in range(last + 1):
            chained[states + r, q] = integrals[r, q] / math.pi
        chained[states + r, RP + r] -= 1.0
    for r in range(states + 2):
        chained[r, last] = -chained[r, last]
    head.equations = EQUATIONS_CURRENT
    return True
