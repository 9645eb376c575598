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
from phasemap._kernels.tables import (
    NODES,
    T_END1,
    T_END2,
    T_M1,
    T_M2,
    T_NUMBERS,
    T_SUM1,
    T_TOTAL,
)

MOST_ELEMENTS = 96
MOST_CONTACTS = 8

# What is held while solving.
HOLD_AMPLITUDE, HOLD_OFFSET, HOLD_ARC = 0, 1, 2

# Fields of Orbit.elements. At the nodes: angle, its cosine and sine, w, w'. PLACE: the element's number in the tables,
# 1 in contact and 0 outside, origin and scale of its map, and angle, w and w' at its start. LOCAL: six rows, w'' at the
# nodes as affine function of (w, w') at the start, (P, S, z0) and one. CHAIN: two rows, (w, w') at the start as affine
# function of the same six at the start of the period.
THETA, COS, SIN, W, U, PLACE, LOCAL, CHAIN, FIELDS = 0, 1, 2, 3, 4, 5, 6, 12, 14
TABLE, SIDE, ORIGIN, SCALE, EDGE, EDGE_W, EDGE_U = 0, 1, 2, 3, 4, 5, 6
# Rows of Orbit.head. VALUE: P, S, z0, A. COUNT: elements, contacts, level of refinement. TRANSFER: monodromy matrix.
# CONTACT: first and last angle of each contact. OPEN: the chained equations, six rows of seven. SYSTEM: the same,
# solved with what is held.
VALUE, COUNT, TRANSFER, CONTACT, OPEN, SYSTEM, HEAD = 0, 1, 2, 3, 12, 18, 24
P, S, Z0, A = 0, 1, 2, 3
ELEMENTS, CONTACTS, LEVEL = 0, 1, 2
# Columns of OPEN and SYSTEM, and the order of the six: w and w' at the start, P, S, z0; then the change of A and the
# right-hand side in the equations, one in an affine function.
W0, U0, RP, RS, RZ, ONE, RA, RIGHT = 0, 1, 2, 3, 4, 5, 5, 6
WIDTH = 16  # of an element's matrix with its right-hand sides, padded for vector instructions


class Orbit(NamedTuple):
    """A periodic orbit and the room to work on it, in two arrays so that calls stay cheap.

    elements : ndarray, shape (MOST_ELEMENTS + 1, FIELDS, NODES). head : ndarray, shape (HEAD, NODES).
    """

    elements: np.ndarray
    head: np.ndarray


@njit(**OPTIONS)
def new_orbit() -> Orbit:
    """Return an orbit's room."""
    return Orbit(np.zeros((MOST_ELEMENTS + 1, FIELDS, NODES)), np.zeros((HEAD, NODES)))


@njit(**OPTIONS)
def eliminate(m: np.ndarray, n: int) -> bool:
    """Solve for the first n columns in place (Gauss-Jordan, row pivoting); the other columns become solutions."""
    width = m.shape[1]
    for k in range(n):
        best, size = k, abs(m[k, k])
        for i in range(k + 1, n):
            if abs(m[i, k]) > size:
                best, size = i, abs(m[i, k])
        if not size > 0.0:
            return False
        if best != k:
            for j in range(width):
                m[k, j], m[best, j] = m[best, j], m[k, j]
        inverse = 1.0 / m[k, k]
        for j in range(width):
            m[k, j] *= inverse
        for i in range(n):
            if i != k:
                factor = m[i, k]
                for j in range(width):
                    m[i, j] -= factor * m[k, j]
    return True


@njit(**OPTIONS)
def surface_force(
    law: Law, p: np.ndarray, inverse_k: float, side: float, d: float, v: float
) -> tuple[float, float, float]:
    """g = F/k + 2 alpha_s v [m], dg/dd [1] and dg/dv [1] on one side of the contact point."""
    if side == 1.0:
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
def _element(
    law: Law, p: np.ndarray, lever: np.ndarray, tables: np.ndarray, one: np.ndarray, value: np.ndarray, m: np.ndarray
) -> bool:
    """Fill the LOCAL rows of an element; m is scratch, shape (NODES, WIDTH)."""
    omega, inverse_k = lever[OMEGA], 1.0 / lever[STIFFNESS]
    viscous = 2.0 * lever[ALPHA0]
    z0, amplitude = value[Z0], value[A]
    h, side = one[PLACE, SCALE], one[PLACE, SIDE]
    table = tables[int(one[PLACE, TABLE])]
    for j in range(NODES):
        c, s = one[COS, j], one[SIN, j]
        d = amplitude * c + one[W, j] - z0
        v = omega * (one[U, j] - amplitude * s)
        g, gd, gv = surface_force(law, p, inverse_k, side, d, v)
        d = max(d, 0.0) if side == 1.0 else min(d, 0.0)
        first = h * omega * (viscous + gv)
        second = h * h * (1.0 + gd)
        for k in range(NODES):
            m[j, k] = first * table[T_M1 + j, k] + second * table[T_M2 + j, k]
        m[j, j] += omega * omega
        m[j, NODES + W0] = -(1.0 + gd)
        m[j, NODES + U0] = -(1.0 + gd) * h * table[T_SUM1, j] - omega * (viscous + gv)
        m[j, NODES + RP] = c
        m[j, NODES + RS] = s
        m[j, NODES + RZ] = gd
        m[j, NODES + ONE] = -(g - gd * d - gv * v) - gd * amplitude * c + gv * omega * amplitude * s
    if not eliminate(m, NODES):
        return False
    for q in range(6):
        for j in range(NODES):
            one[LOCAL + q, j] = m[j, NODES + q]
    return True


@njit(**OPTIONS)
def jump_rate(law: Law, p: np.ndarray, lever: np.ndarray, one: np.ndarray, amplitude: float) -> float:
    """Return how w' jumps per metre of depth at the start of an element, where the force itself may jump.

    A contact that starts earlier by d / |d'| feels the difference of the two accelerations for so long.
    """
    omega = lever[OMEGA]
    slope = one[PLACE, EDGE_U] - amplitude * math.sin(one[PLACE, EDGE])
    v = omega * slope
    inverse_k = 1.0 / lever[STIFFNESS]
    jump = surface_force(law, p, inverse_k, 1.0, 0.0, v)[0] - surface_force(law, p, inverse_k, 0.0, 0.0, v)[0]
    if abs(jump) < 1e-13 * lever[BASE]:
        return 0.0
    return jump / (omega * omega * max(abs(slope), 1e-9 * amplitude))


@njit(**OPTIONS)
def linearise(law: Law, p: np.ndarray, lever: np.ndarray, tables: np.ndarray, orbit: Orbit) -> bool:
    """Chain the elements round the period; fills rows 0-3 of OPEN and the monodromy matrix."""
    omega, alpha0 = lever[OMEGA], lever[ALPHA0]
    elements, head = orbit.elements, orbit.head
    count = int(head[COUNT, ELEMENTS])
    amplitude = head[VALUE, A]
    head[OPEN : OPEN + 6] = 0.0
    along_cos, along_sin = head[OPEN + 2], head[OPEN + 3]
    elements[0, CHAIN : CHAIN + 2] = 0.0
    elements[0, CHAIN, W0] = 1.0
    elements[0, CHAIN + 1, U0] = 1.0
    m = np.zeros((NODES, WIDTH))
    for e in range(count):
        one = elements[e]
        if not _element(law, p, lever, tables, one, head[VALUE], m):
            return False
        at_w, at_u = one[CHAIN], one[CHAIN + 1]
        if one[PLACE, SIDE] != elements[e - 1 if e > 0 else count - 1, PLACE, SIDE]:
            rate = jump_rate(law, p, lever, one, amplitude)
            if rate != 0.0:
                c, s = math.cos(one[PLACE, EDGE]), math.sin(one[PLACE, EDGE])
                for q in range(6):
                    depth = at_w[q]
                    if q == RZ:
                        depth -= 1.0
                    elif q == ONE:
                        depth += amplitude * c
                    at_u[q] -= rate * depth
                    along_cos[q] -= rate * depth * c
                    along_sin[q] -= rate * depth * s
        h = one[PLACE, SCALE]
        table = tables[int(one[PLACE, TABLE])]
        following = elements[e + 1]
        for q in range(6):
            state_w, state_u = at_w[q], at_u[q]
            add = 1.0 if q >= RP else 0.0
            sum_w, sum_u, sum_c, sum_s = 0.0, 0.0, 0.0, 0.0
            for j in range(NODES):
                a = one[LOCAL + W0, j] * state_w + one[LOCAL + U0, j] * state_u + add * one[LOCAL + q, j]
                to_u = table[T_END1, j] * a
                sum_w += table[T_END2, j] * a
                sum_u += to_u
                sum_c += to_u * one[COS, j]
                sum_s += to_u * one[SIN, j]
            following[CHAIN, q] = state_w + h * table[T_NUMBERS, T_TOTAL] * state_u + h * h * sum_w
            following[CHAIN + 1, q] = state_u + h * sum_u
            along_cos[q] += h * sum_c
            along_sin[q] += h * sum_s
    last = elements[count]
    for i in range(2):
        for q in range(6):
            head[OPEN + i, q] = last[CHAIN + i, q]
        head[TRANSFER, 2 * i] = last[CHAIN + i, W0]
        head[TRANSFER, 2 * i + 1] = last[CHAIN + i, U0]
    # A moves like this: z = A cos + w stays the same if w loses what A cos gains.
    c, s = math.cos(elements[0, PLACE, EDGE]), math.sin(elements[0, PLACE, EDGE])
    for i in range(4):
        row = head[OPEN + i]
        row[RIGHT] = -row[ONE]
        row[RA] = c * row[W0] - s * row[U0] + (1 - omega**2) * row[RP] - 2 * alpha0 * omega * row[RS]
    head[OPEN, RA] -= c
    head[OPEN + 1, RA] += s
    head[OPEN + 2, RA] += math.pi
    head[OPEN, W0] -= 1.0
    head[OPEN + 1, U0] -= 1.0
    return True


@njit(**OPTIONS)
def _drive_row(lever: np.ndarray, head: np.ndarray) -> None:
    """Row 4 of the system: the drive's equation, linearised."""
    omega, alpha0, base = lever[OMEGA], lever[ALPHA0], lever[BASE]
    row = head[SYSTEM + 4]
    amplitude, push, drag = head[VALUE, A], head[VALUE, P], head[VALUE, S]
    x = push + amplitude * (1 - omega**2)
    y = 2 * alpha0 * omega * amplitude - drag
    row[RP] = 2 * x / base
    row[RS] = -2 * y / base
    row[RA] = (2 * x * (1 - omega**2) + 4 * y * alpha0 * omega) / base
    row[RIGHT] = (base * base - x * x - y * y + 2 * x * push - 2 * y * drag) / base


@njit(**OPTIONS)
def close(lever: np.ndarray, orbit: Orbit, hold: int, target: np.ndarray) -> bool:
    """Add the drive's equation and what is held, and solve for (w, w', P, S, z0, change of A); True if solvable.

    `target` is (z0, ...) with HOLD_OFFSET; with HOLD_ARC it is (r_z, r_A, z0, A), the plane
    r_z (new z0 - z0) + r_A (new A - A) = 0.
    """
    head = orbit.head
    head[SYSTEM : SYSTEM + 6] = head[OPEN : OPEN + 6]
    _drive_row(lever, head)
    row = head[SYSTEM + 5]
    if hold == HOLD_AMPLITUDE:
        row[RA] = 1.0
    elif hold == HOLD_OFFSET:
        row[RZ] = 1.0
        row[RIGHT] = target[0]
    else:
        row[RZ] = target[0]
        row[RA] = target[1]
        row[RIGHT] = target[0] * target[2] + target[1] * (target[3] - head[VALUE, A])
    return eliminate(head[SYSTEM : SYSTEM + 6], 6)


@njit(**OPTIONS)
def along(lever: np.ndarray, orbit: Orbit, r_z: float, r_a: float) -> bool:
    """Leave the derivative along the curve of orbits in the system's last column, with r_z dz0 + r_A dA = 1."""
    head = orbit.head
    head[SYSTEM : SYSTEM + 6] = head[OPEN : OPEN + 6]
    _drive_row(lever, head)
    head[SYSTEM : SYSTEM + 6, RIGHT] = 0.0
    head[SYSTEM + 5, RZ] = r_z
    head[SYSTEM + 5, RA] = r_a
    head[SYSTEM + 5, RIGHT] = 1.0
    return eliminate(head[SYSTEM : SYSTEM + 6], 6)


@njit(**OPTIONS)
def accept(tables: np.ndarray, lever: np.ndarray, orbit: Orbit, share: float) -> float:
    """Move the orbit by `share` of the step just solved; return the largest change of the depth [m] over the nodes."""
    omega, alpha0 = lever[OMEGA], lever[ALPHA0]
    elements, head = orbit.elements, orbit.head
    count = int(head[COUNT, ELEMENTS])
    x = head[SYSTEM : SYSTEM + 6, RIGHT]
    gain, shift = x[RA], x[RZ] - head[VALUE, Z0]
    # The chain knows the orbit as if A had stayed: w + gain cos(theta), with these starts and forces.
    c, s = math.cos(elements[0, PLACE, EDGE]), math.sin(elements[0, PLACE, EDGE])
    w0, u0 = x[W0] + gain * c, x[U0] - gain * s
    push, drag, z0 = x[RP] + gain * (1 - omega**2), x[RS] - gain * 2 * alpha0 * omega, x[RZ]
    largest = 0.0
    a = np.empty(NODES)
    for e in range(count):
        one = elements[e]
        at_w, at_u = one[CHAIN], one[CHAIN + 1]
        start_w = at_w[0] * w0 + at_w[1] * u0 + at_w[2] * push + at_w[3] * drag + at_w[4] * z0 + at_w[5]
        start_u = at_u[0] * w0 + at_u[1] * u0 + at_u[2] * push + at_u[3] * drag + at_u[4] * z0 + at_u[5]
        h = one[PLACE, SCALE]
        table = tables[int(one[PLACE, TABLE])]
        for j in range(NODES):
            a[j] = (
                one[LOCAL, j] * start_w + one[LOCAL + 1, j] * start_u + one[LOCAL + 2, j] * push
                + one[LOCAL + 3, j] * drag + one[LOCAL + 4, j] * z0 + one[LOCAL + 5, j]
            )  # fmt: skip
        for j in range(NODES):
            sum_w, sum_u = 0.0, 0.0
            for k in range(NODES):
                sum_w += table[T_M2 + j, k] * a[k]
                sum_u += table[T_M1 + j, k] * a[k]
            step_w = start_w + h * (start_u * table[T_SUM1, j] + h * sum_w) - one[W, j]
            step_u = start_u + h * sum_u + gain * one[SIN, j] - one[U, j]
            largest = max(largest, abs(step_w - shift))
            one[W, j] += share * (step_w - gain * one[COS, j])
            one[U, j] += share * step_u
        c, s = math.cos(one[PLACE, EDGE]), math.sin(one[PLACE, EDGE])
        one[PLACE, EDGE_W] += share * (start_w - gain * c - one[PLACE, EDGE_W])
        one[PLACE, EDGE_U] += share * (start_u + gain * s - one[PLACE, EDGE_U])
    elements[count, PLACE, EDGE_W] = elements[0, PLACE, EDGE_W]
    elements[count, PLACE, EDGE_U] = elements[0, PLACE, EDGE_U]
    head[VALUE, P] += share * (x[RP] - head[VALUE, P])
    head[VALUE, S] += share * (x[RS] - head[VALUE, S])
    head[VALUE, Z0] += share * shift
    head[VALUE, A] += share * gain
    return largest
