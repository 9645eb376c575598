"""One Newton step for a periodic orbit, by Gauss collocation on elements split at the contact points.

With the time origin at the first harmonic, z = A cos(theta) + w(theta), theta = omega tau, and

    omega^2 w'' + 2 alpha0 omega w' + w + g(d, zdot) = P cos(theta) + S sin(theta),     g = F/k + 2 alpha_s zdot,

where (P, S) are the first harmonic of g, so that w has none; the drive closes the system,
(P + A (1 - omega^2))^2 + (2 alpha0 omega A - S)^2 = u0^2. Unknown are w, P, S and z0 (or A). The equation is
linearised about the present orbit, each element is solved for w'' at its Gauss nodes as an affine function of the
state at its start and of (P, S, z0), and the elements are chained round the period. The product of their transfer
matrices is the monodromy matrix, so the Floquet multipliers come with the orbit.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from phasemap._kernels.columns import ALPHA0, BASE, OMEGA, STIFFNESS
from phasemap._kernels.law import (
    OPTIONS,
    Law,
    contact_force,
    contact_slope,
    damping,
    damping_slope,
    longrange_force,
    longrange_slope,
)
from phasemap._kernels.tables import NODES, Tables

MOST_ELEMENTS = 96
MOST_CONTACTS = 8
WIDTH = NODES + 6  # an element's matrix and its right-hand sides

# What is held while solving.
HOLD_AMPLITUDE, HOLD_OFFSET, HOLD_ARC = 0, 1, 2

# Entries of Orbit.value.
P, S, Z0, A = 0, 1, 2, 3
# Entries of Orbit.count.
ELEMENTS, CONTACTS, LEVEL = 0, 1, 2
# Right-hand sides of an element, entries of the global unknown.
W0, U0, RP, RS, RZ, ONE = 0, 1, 2, 3, 4, 5


class Orbit(NamedTuple):
    """A periodic orbit on its elements, and the room to work on it.

    table, side : number in `Tables` and 1 in contact, 0 outside, shape (MOST_ELEMENTS,).
    origin, scale : of the map theta = origin + scale S.
    theta, cos, sin, w, u, a : angle, its cosine and sine, w, w' and w'' at the nodes, shape (MOST_ELEMENTS, NODES).
    edge, edge_w, edge_u : angle, w and w' at the element's ends, shape (MOST_ELEMENTS + 1,).
    contact : first and last angle of each contact, shape (MOST_CONTACTS + 1, 2).
    value : P, S, z0, A. count : elements, contacts, level of refinement.
    local : each element's w'' as affine function, shape (MOST_ELEMENTS, NODES, 6).
    chain : state at the element's start as affine function of the global unknown, shape (MOST_ELEMENTS + 1, 2, 6).
    matrix : (NODES, WIDTH). system : (6, 7). transfer : monodromy matrix, (2, 2).
    """

    table: np.ndarray
    side: np.ndarray
    origin: np.ndarray
    scale: np.ndarray
    theta: np.ndarray
    cos: np.ndarray
    sin: np.ndarray
    w: np.ndarray
    u: np.ndarray
    a: np.ndarray
    edge: np.ndarray
    edge_w: np.ndarray
    edge_u: np.ndarray
    contact: np.ndarray
    value: np.ndarray
    count: np.ndarray
    local: np.ndarray
    chain: np.ndarray
    matrix: np.ndarray
    system: np.ndarray
    transfer: np.ndarray


@njit(**OPTIONS)
def new_orbit() -> Orbit:
    """Return an orbit's room."""
    n = MOST_ELEMENTS
    return Orbit(
        np.zeros(n, np.int64), np.zeros(n, np.int64), np.zeros(n), np.zeros(n),
        np.zeros((n, NODES)), np.zeros((n, NODES)), np.zeros((n, NODES)),
        np.zeros((n, NODES)), np.zeros((n, NODES)), np.zeros((n, NODES)),
        np.zeros(n + 1), np.zeros(n + 1), np.zeros(n + 1), np.zeros((MOST_CONTACTS + 1, 2)),
        np.zeros(4), np.zeros(4, np.int64), np.zeros((n, NODES, 6)), np.zeros((n + 1, 2, 6)),
        np.zeros((NODES, WIDTH)), np.zeros((6, 7)), np.zeros((2, 2)),
    )  # fmt: skip


@njit(**OPTIONS)
def eliminate(m: np.ndarray, n: int, width: int) -> bool:
    """Solve the n x n system in place by elimination with row pivoting; the right-hand sides become the solutions."""
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(m[i, k]) > abs(m[best, k]):
                best = i
        if not abs(m[best, k]) > 0.0:
            return False
        if best != k:
            for j in range(k, width):
                m[k, j], m[best, j] = m[best, j], m[k, j]
        inverse = 1.0 / m[k, k]
        for i in range(k + 1, n):
            factor = m[i, k] * inverse
            if factor != 0.0:
                for j in range(k + 1, width):
                    m[i, j] -= factor * m[k, j]
    for k in range(n - 1, -1, -1):
        inverse = 1.0 / m[k, k]
        for j in range(n, width):
            m[k, j] *= inverse
        for i in range(k):
            factor = m[i, k]
            for j in range(n, width):
                m[i, j] -= factor * m[k, j]
    return True


@njit(**OPTIONS)
def surface_force(law: Law, p: np.ndarray, inverse_k: float, side: int, d: float, v: float) -> tuple[float, float, float]:
    """g = F/k + 2 alpha_s v [m], dg/dd [1] and dg/dv [1] on one side of the contact point."""
    if side == 1:
        d = max(d, 0.0)
        g = inverse_k * contact_force(law, d, p)
        slope = inverse_k * contact_slope(law, d, p)
        if p[8] == 0.0:
            return g, slope, 0.0
        alpha = damping(law, d, p)
        return g + 2.0 * alpha * v, slope + 2.0 * damping_slope(law, d, p) * v, 2.0 * alpha
    if p[4] == 0.0:
        return 0.0, 0.0, 0.0
    d = min(d, 0.0)
    return inverse_k * longrange_force(law, d, p), inverse_k * longrange_slope(law, d, p), 0.0


@njit(**OPTIONS)
def _element(law: Law, p: np.ndarray, lever: np.ndarray, tables: Tables, orbit: Orbit, e: int) -> bool:
    """Fill orbit.local[e]: w'' at the nodes for unit (w_a, w'_a, P, S, z0) and for the rest of the equation."""
    omega, inverse_k = lever[OMEGA], 1.0 / lever[STIFFNESS]
    viscous = 2.0 * lever[ALPHA0]
    z0, amplitude = orbit.value[Z0], orbit.value[A]
    n, h, side = orbit.table[e], orbit.scale[e], orbit.side[e]
    m1, m2, r1 = tables.m1[n], tables.m2[n], tables.r1[n]
    m = orbit.matrix
    for j in range(NODES):
        c, s = orbit.cos[e, j], orbit.sin[e, j]
        d = amplitude * c + orbit.w[e, j] - z0
        v = omega * (orbit.u[e, j] - amplitude * s)
        g, gd, gv = surface_force(law, p, inverse_k, side, d, v)
        d = max(d, 0.0) if side == 1 else min(d, 0.0)
        first = h * omega * (viscous + gv)
        second = h * h * (1.0 + gd)
        for k in range(NODES):
            m[j, k] = first * m1[j, k] + second * m2[j, k]
        m[j, j] += omega * omega
        m[j, NODES + W0] = -(1.0 + gd)
        m[j, NODES + U0] = -(1.0 + gd) * h * r1[j] - omega * (viscous + gv)
        m[j, NODES + RP] = c
        m[j, NODES + RS] = s
        m[j, NODES + RZ] = gd
        m[j, NODES + ONE] = -(g - gd * d - gv * v) - gd * amplitude * c + gv * omega * amplitude * s
    if not eliminate(m, NODES, WIDTH):
        return False
    for j in range(NODES):
        for q in range(6):
            orbit.local[e, j, q] = m[j, NODES + q]
    return True


@njit(**OPTIONS)
def jump_rate(law: Law, p: np.ndarray, lever: np.ndarray, orbit: Orbit, e: int) -> float:
    """Return how w' jumps per metre of depth at the start of element e, where the force itself may jump.

    A contact that starts earlier by d / |d'| feels the difference of the two accelerations for so long.
    """
    omega = lever[OMEGA]
    slope = orbit.edge_u[e] - orbit.value[A] * math.sin(orbit.edge[e])
    v = omega * slope
    inverse_k = 1.0 / lever[STIFFNESS]
    jump = surface_force(law, p, inverse_k, 1, 0.0, v)[0] - surface_force(law, p, inverse_k, 0, 0.0, v)[0]
    if abs(jump) < 1e-13 * lever[BASE]:
        return 0.0
    return jump / (omega * omega * max(abs(slope), 1e-9 * orbit.value[A]))


@njit(**OPTIONS)
def linearise(law: Law, p: np.ndarray, lever: np.ndarray, tables: Tables, orbit: Orbit) -> bool:
    """Chain the elements round the period; leaves rows 0-3 of orbit.system and the monodromy matrix.

    Columns of the system: w and w' at the start, P, S, z0, the change of A, and the right-hand side.
    """
    omega, alpha0 = lever[OMEGA], lever[ALPHA0]
    count = orbit.count[ELEMENTS]
    y = orbit.chain
    along_cos, along_sin = orbit.system[2], orbit.system[3]
    orbit.system[:] = 0.0
    y[0] = 0.0
    y[0, 0, W0] = 1.0
    y[0, 1, U0] = 1.0
    state_w, state_u = np.zeros(6), np.zeros(6)
    local = np.zeros(6)
    for e in range(count):
        if not _element(law, p, lever, tables, orbit, e):
            return False
        state_w[:] = y[e, 0]
        state_u[:] = y[e, 1]
        if orbit.side[e] != orbit.side[e - 1 if e > 0 else count - 1]:
            rate = jump_rate(law, p, lever, orbit, e)
            if rate != 0.0:
                c, s = math.cos(orbit.edge[e]), math.sin(orbit.edge[e])
                for q in range(6):
                    depth = state_w[q]
                    if q == RZ:
                        depth -= 1.0
                    elif q == ONE:
                        depth += orbit.value[A] * c
                    state_u[q] -= rate * depth
                    along_cos[q] -= rate * depth * c
                    along_sin[q] -= rate * depth * s
                y[e, 1] = state_u
        n, h = orbit.table[e], orbit.scale[e]
        e1, e2 = tables.e1[n], tables.e2[n]
        for q in range(6):
            y[e + 1, 0, q] = state_w[q] + h * tables.f1[n] * state_u[q]
            y[e + 1, 1, q] = state_u[q]
        for j in range(NODES):
            row = orbit.local[e, j]
            for q in range(6):
                local[q] = row[W0] * state_w[q] + row[U0] * state_u[q]
            for q in range(RP, 6):
                local[q] += row[q]
            to_w, to_u = h * h * e2[j], h * e1[j]
            to_cos, to_sin = to_u * orbit.cos[e, j], to_u * orbit.sin[e, j]
            for q in range(6):
                y[e + 1, 0, q] += to_w * local[q]
                y[e + 1, 1, q] += to_u * local[q]
                along_cos[q] += to_cos * local[q]
                along_sin[q] += to_sin * local[q]
    for i in range(2):
        for q in range(5):
            orbit.system[i, q] = y[count, i, q]
        orbit.transfer[i, 0] = y[count, i, W0]
        orbit.transfer[i, 1] = y[count, i, U0]
        orbit.system[i, 5] = y[count, i, ONE]
    # A moves like this: z = A cos + w stays the same if w loses what A cos gains.
    c, s = math.cos(orbit.edge[0]), math.sin(orbit.edge[0])
    for i in range(4):
        row = orbit.system[i]
        row[6] = -row[5]
        row[5] = c * row[W0] - s * row[U0] + (1 - omega**2) * row[RP] - 2 * alpha0 * omega * row[RS]
    orbit.system[0, 5] -= c
    orbit.system[1, 5] += s
    orbit.system[2, 5] += math.pi
    orbit.system[0, W0] -= 1.0
    orbit.system[1, U0] -= 1.0
    return True


@njit(**OPTIONS)
def _drive_row(lever: np.ndarray, orbit: Orbit) -> None:
    """Row 4 of the system: the drive's equation, linearised."""
    omega, alpha0, base = lever[OMEGA], lever[ALPHA0], lever[BASE]
    row = orbit.system[4]
    amplitude = orbit.value[A]
    x = orbit.value[P] + amplitude * (1 - omega**2)
    y = 2 * alpha0 * omega * amplitude - orbit.value[S]
    row[RP] = 2 * x / base
    row[RS] = -2 * y / base
    row[5] = (2 * x * (1 - omega**2) + 4 * y * alpha0 * omega) / base
    row[6] = (base * base - x * x - y * y + 2 * x * orbit.value[P] - 2 * y * orbit.value[S]) / base


@njit(**OPTIONS)
def close(lever: np.ndarray, orbit: Orbit, hold: int, target: np.ndarray) -> bool:
    """Add the drive's equation and what is held, and solve for (w, w', P, S, z0, change of A); True if solvable.

    `target` is (z0, ...) with HOLD_OFFSET; with HOLD_ARC it is (r_z, r_A, z0, A), the plane
    r_z (new z0 - z0) + r_A (new A - A) = 0.
    """
    _drive_row(lever, orbit)
    row = orbit.system[5]
    if hold == HOLD_AMPLITUDE:
        row[5] = 1.0
    elif hold == HOLD_OFFSET:
        row[RZ] = 1.0
        row[6] = target[0]
    else:
        row[RZ] = target[0]
        row[5] = target[1]
        row[6] = target[0] * target[2] + target[1] * (target[3] - orbit.value[A])
    return eliminate(orbit.system, 6, 7)


@njit(**OPTIONS)
def along(lever: np.ndarray, orbit: Orbit, r_z: float, r_a: float) -> bool:
    """Leave the derivative along the curve of orbits in the system's last column, with r_z dz0 + r_A dA = 1."""
    _drive_row(lever, orbit)
    orbit.system[:, 6] = 0.0
    orbit.system[5, RZ] = r_z
    orbit.system[5, 5] = r_a
    orbit.system[5, 6] = 1.0
    return eliminate(orbit.system, 6, 7)


@njit(**OPTIONS)
def accept(tables: Tables, lever: np.ndarray, orbit: Orbit, share: float) -> float:
    """Move the orbit by `share` of the step just solved; return the largest change of w [m] over the nodes."""
    omega, alpha0 = lever[OMEGA], lever[ALPHA0]
    old_a = orbit.value[A]
    x = orbit.system[:, 6]
    gain = x[5]
    # The chain knows the orbit as if A had stayed: w + gain cos(theta), with these starts and forces.
    c0, s0 = math.cos(orbit.edge[0]), math.sin(orbit.edge[0])
    known = np.empty(6)
    known[W0] = x[W0] + gain * c0
    known[U0] = x[U0] - gain * s0
    known[RP] = x[RP] + gain * (1 - omega**2)
    known[RS] = x[RS] - gain * 2 * alpha0 * omega
    known[RZ] = x[RZ]
    known[ONE] = 1.0
    largest = 0.0
    a = np.empty(NODES)
    for e in range(orbit.count[ELEMENTS]):
        at_w, at_u = 0.0, 0.0
        for q in range(6):
            at_w += orbit.chain[e, 0, q] * known[q]
            at_u += orbit.chain[e, 1, q] * known[q]
        n, h = orbit.table[e], orbit.scale[e]
        for j in range(NODES):
            row = orbit.local[e, j]
            a[j] = row[W0] * at_w + row[U0] * at_u + row[RP] * known[RP] + row[RS] * known[RS] + row[RZ] * known[RZ] + row[ONE]
        for j in range(NODES):
            w = at_w + at_u * h * tables.r1[n, j]
            u = at_u
            for k in range(NODES):
                w += h * h * tables.m2[n, j, k] * a[k]
                u += h * tables.m1[n, j, k] * a[k]
            w -= gain * orbit.cos[e, j]
            u += gain * orbit.sin[e, j]
            largest = max(largest, abs(w + gain * orbit.cos[e, j] - orbit.w[e, j] - x[RZ] + orbit.value[Z0]))
            orbit.w[e, j] += share * (w - orbit.w[e, j])
            orbit.u[e, j] += share * (u - orbit.u[e, j])
            orbit.a[e, j] += share * (a[j] + gain * orbit.cos[e, j] - orbit.a[e, j])
        c, s = math.cos(orbit.edge[e]), math.sin(orbit.edge[e])
        orbit.edge_w[e] += share * (at_w - gain * c - orbit.edge_w[e])
        orbit.edge_u[e] += share * (at_u + gain * s - orbit.edge_u[e])
    last = orbit.count[ELEMENTS]
    orbit.edge_w[last] = orbit.edge_w[0]
    orbit.edge_u[last] = orbit.edge_u[0]
    orbit.value[P] += share * (x[RP] - orbit.value[P])
    orbit.value[S] += share * (x[RS] - orbit.value[S])
    orbit.value[Z0] += share * (x[RZ] - orbit.value[Z0])
    orbit.value[A] = old_a + share * gain
    return largest
