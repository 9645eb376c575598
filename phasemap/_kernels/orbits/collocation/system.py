"""The equations of a periodic orbit, linearised: Gauss collocation on elements split at the contact points.

With the time origin at the first harmonic, z = A cos(theta) + w(theta), theta = omega tau, and

    omega^2 w'' + 2 alpha0 omega w' + w + g(d, zdot) = P cos(theta) + S sin(theta),     g = F/k + 2 alpha_s zdot,

where (P, S) are the first harmonic of g, so that w has none; the drive closes the system,
(P + A (1 - omega^2))^2 + (2 alpha0 omega A - S)^2 = u0^2 (theory, Eqs. (collocation-1), (collocation-2) and
(averaging-4)). Unknown are w, P, S and z0 (or A). The equation is
linearised about the present orbit, each element is solved for w'' at its Gauss nodes as an affine function of the
state at its start and of (P, S, z0), and the elements are chained round the period. The product of their transfer
matrices is the monodromy matrix, so the Floquet multipliers come with the orbit.

Anything else that the orbit depends on may be unknown too: the law's parameters and the lever are then functions of
one number m (see `phasemap._kernels.continuation.path`), and a column of the equations says what a change of m does.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels.columns import ALPHA0, BASE, DAMPING, LONGRANGE, OMEGA, RELEASE, ROW, STIFFNESS
from phasemap._kernels.compilation import ANY_ORDER, kernel
from phasemap._kernels.dense import eliminate_columns
from phasemap._kernels.law import (
    Law,
    Oscillator,
    contact_force,
    contact_slope,
    damping,
    damping_slope,
    longrange_force,
    longrange_slope,
    parameters,
)
from phasemap._kernels.quadrature import NODES, T_END1, T_END2, T_M1, T_M2, T_NUMBERS, T_SUM1, T_TOTAL

MOST_ELEMENTS = 96
MOST_CONTACTS = 8

# What is held while solving.
HOLD_AMPLITUDE, HOLD_OFFSET, HOLD_ARC, HOLD_PLANE = 0, 1, 2, 3  # ARC: on the way, less exactly

# Where the tip is: outside, in contact, or in the neck that a law with hysteresis draws out below d = 0.
OUTSIDE, INSIDE, NECK = 0.0, 1.0, 2.0

# Fields of Orbit.elements. At the nodes: angle, its cosine and sine, w, w'. PLACE: the element's number in the tables,
# its side, origin and scale of its map, and angle, w and w' at its start. LOCAL: seven rows, w'' at the nodes as affine
# function of (w, w') at the start, (P, S, z0), one, and the change of m. CHAIN: two rows, (w, w') at the start as
# affine function of the same seven at the start of the period. BEND: w'' at the nodes after a full step.
THETA, COS, SIN, W, U, PLACE, LOCAL, CHAIN, BEND, FIELDS = 0, 1, 2, 3, 4, 5, 6, 13, 15, 16
TABLE, SIDE, ORIGIN, SCALE, EDGE, EDGE_W, EDGE_U = 0, 1, 2, 3, 4, 5, 6
# Rows of Orbit.head. VALUE: P, S, z0, A, m. COUNT: elements, contacts, level of refinement; whether OPEN and what it
# was chained from are of the orbit as it stands (1), of where it was before a last small step (KEPT), or neither (0);
# by how much the last step changed the depth [m], and P and S [m].
# TRANSFER: monodromy matrix.
# CONTACT: first and last angle of each contact, and the end of its neck. OPEN: the chained equations, four rows of
# eight. SYSTEM: the same, solved with the drive's equation and what is held.
VALUE, COUNT, TRANSFER, CONTACT, OPEN, SYSTEM, HEAD = 0, 1, 2, 3, 12, 16, 23
P, S, Z0, A, M = 0, 1, 2, 3, 4
ELEMENTS, CONTACTS, LEVEL, LINEAR, CHANGE, TURN = 0, 1, 2, 3, 4, 5
KEPT = 0.5  # of LINEAR
FIRST, LAST, BROKEN = 0, 1, 2  # of a contact
AT, GAP = 0, 1  # of an orbit that nowhere enters or leaves contact: angle and d [m] where it comes nearest to doing so
# Columns of OPEN and SYSTEM, and the order of the seven: w and w' at the start, P, S, z0; then the change of A in the
# equations, one in an affine function; the change of m; the right-hand side.
W0, U0, RP, RS, RZ, ONE, RA, RM, RIGHT = 0, 1, 2, 3, 4, 5, 5, 6, 7
SEVEN = 7
WIDTH = 15  # columns of an element's matrix with its right-hand sides


# Where a parameter m moves, `drift`, shape (2, STANDING), has the law's parameters and the lever at m + SMALL and at
# m - SMALL; elsewhere it has no rows.
STANDING = ROW + 5
SMALL = 1e-5


class Orbit(NamedTuple):
    """A periodic orbit and the room to work on it, in two arrays so that calls stay cheap.

    elements : ndarray, shape (MOST_ELEMENTS + 1, FIELDS, NODES). head : ndarray, shape (HEAD, NODES).
    """

    elements: np.ndarray
    head: np.ndarray


@kernel(light=True)
def new_orbit() -> Orbit:
    """Return an orbit's room."""
    return Orbit(np.zeros((MOST_ELEMENTS + 1, FIELDS, NODES)), np.zeros((HEAD, NODES)))


@kernel
def no_drift() -> np.ndarray:
    """`drift` where no parameter moves."""
    return np.empty((0, STANDING))


@kernel
def into(p: np.ndarray, side: float, d: float) -> float:
    """The depth on this side of the surface that is nearest to d: elements may lie a little beside it.

    Where a neck breaks the force may fall like a root, so the neck is kept a millionth of its length away.
    """
    if side == INSIDE:
        return max(d, 0.0)
    if side == NECK:
        return max(d, p[RELEASE] * (1.0 - 1e-6))
    return min(d, 0.0)


@kernel
def surface_force(
    law: Law, p: np.ndarray, inverse_k: float, side: float, d: float, v: float
) -> tuple[float, float, float]:
    """g = F/k + 2 alpha_s v [m], dg/dd [1] and dg/dv [1] on one side of the contact point, or in the neck."""
    d = into(p, side, d)
    if side == NECK:
        return inverse_k * contact_force(law, d, p), inverse_k * contact_slope(law, d, p), 0.0
    if side == INSIDE:
        g = inverse_k * contact_force(law, d, p)
        slope = inverse_k * contact_slope(law, d, p)
        if p[DAMPING] == 0.0:
            return g, slope, 0.0
        alpha = damping(law, d, p)
        return g + 2.0 * alpha * v, slope + 2.0 * damping_slope(law, d, p) * v, 2.0 * alpha
    if p[LONGRANGE] == 0.0:
        return 0.0, 0.0, 0.0
    return inverse_k * longrange_force(law, d, p), inverse_k * longrange_slope(law, d, p), 0.0


@kernel
def _pushed(
    law: Law, standing: np.ndarray, side: float, d: float, w: float, u: float, acceleration: float, speed: float
) -> float:
    """omega^2 w'' + 2 alpha0 omega w' + w + g at a node, `speed` the change of z by the angle."""
    lever = standing[ROW:]
    omega = lever[OMEGA]
    g = surface_force(law, parameters(standing), 1.0 / lever[STIFFNESS], side, d, omega * speed)[0]
    return omega * omega * acceleration + 2.0 * lever[ALPHA0] * omega * u + w + g


@kernel
def _element(
    oscillator: Oscillator, tables: np.ndarray, one: np.ndarray, value: np.ndarray, drift: np.ndarray, m: np.ndarray
) -> bool:
    """Fill the LOCAL rows of an element, theory, Eq. (collocation-4); m is scratch, shape (WIDTH, NODES)."""
    law, p, lever = oscillator
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
        d = into(p, side, d)
        first = h * omega * (viscous + gv)
        second = h * h * (1.0 + gd)
        for k in range(NODES):
            m[k, j] = first * table[T_M1 + j, k] + second * table[T_M2 + j, k]
        m[j, j] += omega * omega
        m[NODES + W0, j] = -(1.0 + gd)
        m[NODES + U0, j] = -(1.0 + gd) * h * table[T_SUM1, j] - omega * (viscous + gv)
        m[NODES + RP, j] = c
        m[NODES + RS, j] = s
        m[NODES + RZ, j] = gd
        m[NODES + ONE, j] = -(g - gd * d - gv * v) - gd * amplitude * c + gv * omega * amplitude * s
        if len(drift) > 0:
            w, u = one[W, j], one[U, j]
            force = value[P] * c + value[S] * s
            acceleration = (force - viscous * omega * u - w - g) / (omega * omega)
            up = _pushed(law, drift[0], side, d, w, u, acceleration, u - amplitude * s)
            down = _pushed(law, drift[1], side, d, w, u, acceleration, u - amplitude * s)
            m[NODES + RM, j] = (down - up) / (2.0 * SMALL)
    if not eliminate_columns(m):
        return False
    for q in range(SEVEN):
        for j in range(NODES):
            one[LOCAL + q, j] = m[NODES + q, j]
    return True


@kernel
def border_between(p: np.ndarray, before: float, after: float) -> float:
    """The depth [m] at which one side becomes another."""
    return p[RELEASE] if before == NECK and after == OUTSIDE else 0.0


@kernel
def jump_rate(oscillator: Oscillator, before: float, one: np.ndarray, amplitude: float) -> float:
    """Return how w' jumps per metre of depth at the start of an element, where the force itself may jump.

    A contact that starts earlier by d / |d'| feels the difference of the two accelerations for so long: theory,
    Eq. (collocation-5).
    """
    law, p, lever = oscillator
    omega, after = lever[OMEGA], one[PLACE, SIDE]
    border = border_between(p, before, after)
    slope = one[PLACE, EDGE_U] - amplitude * math.sin(one[PLACE, EDGE])
    v = omega * slope
    inverse_k = 1.0 / lever[STIFFNESS]
    deeper, higher = (after, before) if slope > 0.0 else (before, after)
    jump = surface_force(law, p, inverse_k, deeper, border, v)[0]
    jump -= surface_force(law, p, inverse_k, higher, border, v)[0]
    if abs(jump) < 1e-13 * lever[BASE]:
        return 0.0
    return jump / (omega * omega * max(abs(slope), 1e-9 * amplitude))


@kernel(shared=True, vectors=True, fastmath=ANY_ORDER)
def linearise(oscillator: Oscillator, tables: np.ndarray, orbit: Orbit, drift: np.ndarray) -> bool:
    """Chain the elements round the period; fills OPEN and the monodromy matrix."""
    p, lever = oscillator.p, oscillator.lever
    omega, alpha0 = lever[OMEGA], lever[ALPHA0]
    elements, head = orbit.elements, orbit.head
    count = int(head[COUNT, ELEMENTS])
    amplitude = head[VALUE, A]
    head[OPEN : OPEN + 4] = 0.0
    along_cos, along_sin = head[OPEN + 2], head[OPEN + 3]
    elements[0, CHAIN : CHAIN + 2] = 0.0
    elements[0, CHAIN, W0] = 1.0
    elements[0, CHAIN + 1, U0] = 1.0
    m = np.zeros((WIDTH, NODES))
    for e in range(count):
        one = elements[e]
        if not _element(oscillator, tables, one, head[VALUE], drift, m):
            return False
        at_w, at_u = one[CHAIN], one[CHAIN + 1]
        before = elements[e - 1 if e > 0 else count - 1, PLACE, SIDE]
        if one[PLACE, SIDE] != before:
            rate = jump_rate(oscillator, before, one, amplitude)
            if rate != 0.0:
                c, s = math.cos(one[PLACE, EDGE]), math.sin(one[PLACE, EDGE])
                border = border_between(p, before, one[PLACE, SIDE])
                for q in range(SEVEN):
                    depth = at_w[q]
                    if q == RZ:
                        depth -= 1.0
                    elif q == ONE:
                        depth += amplitude * c - border
                    at_u[q] -= rate * depth
                    along_cos[q] -= rate * depth * c
                    along_sin[q] -= rate * depth * s
        h = one[PLACE, SCALE]
        table = tables[int(one[PLACE, TABLE])]
        following = elements[e + 1]
        for q in range(SEVEN):
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
        for q in range(SEVEN):
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
    head[COUNT, LINEAR] = 1.0
    return True
