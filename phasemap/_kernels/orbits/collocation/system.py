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

from phasemap._kernels.columns import ALPHA0, DAMPING, DRIVE, LONGRANGE, OMEGA, RELEASE, ROW, STIFFNESS
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
from phasemap._kernels.records import column, record, rows_of, words_of

MOST_ELEMENTS = 96
MOST_CONTACTS = 8

# What is held while solving.
HOLD_AMPLITUDE = 0
HOLD_OFFSET = 1
HOLD_ARC = 2  # a plane, on the way along a curve: less exactly
HOLD_PLANE = 3

# Where the tip is.
OUT_OF_CONTACT = 0
IN_CONTACT = 1
IN_NECK = 2  # that a law with hysteresis draws out below d = 0

# What the chained equations of an orbit, its elements' included, are equations of.
EQUATIONS_OTHER = 0  # of another orbit
EQUATIONS_CURRENT = 1  # of the orbit as it stands
EQUATIONS_KEPT = 2  # of where the orbit was before a last small step

# Columns of the chained equations and of the system, and the order of the seven numbers of which w and w' are affine
# functions: w and w' at the start of the period, P, S and z0, the number one, the change of m.
W0 = 0
U0 = 1
RP = 2
RS = 3
RZ = 4
ONE = 5  # in an affine function
RA = 5  # the change of A, in the equations
RM = 6
RIGHT = 7  # the right-hand side
SEVEN = 7
EIGHT = 8
ELEMENT_COLUMNS = NODES + SEVEN  # columns of an element's matrix with its right-hand sides


# Where a parameter m moves, `drift`, shape (2, ROW + len(lever)), has the law's parameters and the lever at
# m + DRIFT_STEP and m - DRIFT_STEP; elsewhere it has no rows.
DRIFT_STEP = 1e-5


class Held(NamedTuple):
    """Line in the plane of tip offset and amplitude that is held while solving: normal (z0, A) = normal through."""

    hold: int  # HOLD_AMPLITUDE (with the amplitude that the orbit has), HOLD_OFFSET, HOLD_ARC or HOLD_PLANE
    normal_z: float
    normal_a: float
    through_z: float  # [m]
    through_a: float


class Equation(NamedTuple):
    """A linear equation that is held: normal (z0, A, m) = equals."""

    normal_z: float
    normal_a: float
    normal_m: float
    equals: float


@record
class Element:
    """An element of an orbit: its place, the motion at its nodes, and how that depends on the seven numbers."""

    table: int  # number in `phasemap._kernels.quadrature.TABLES`
    side: int  # OUT_OF_CONTACT, IN_CONTACT or IN_NECK
    origin: float  # theta = origin + scale x [rad]
    scale: float
    edge: float  # angle at its start [rad]
    edge_w: float  # w [m] and w' [m] there
    edge_u: float
    theta: np.ndarray = column(NODES)  # angle of the first harmonic [rad]
    cos: np.ndarray = column(NODES)
    sin: np.ndarray = column(NODES)
    w: np.ndarray = column(NODES)  # motion beyond the first harmonic [m]
    u: np.ndarray = column(NODES)  # w' [m]
    bend: np.ndarray = column(NODES)  # w'' [m] after a full step
    local: np.ndarray = column(SEVEN * NODES)  # w'' of (w, w') at its start, (P, S, z0), one, the change of m
    chain_w: np.ndarray = column(SEVEN)  # w and w' at its start of the seven at the start of the period
    chain_u: np.ndarray = column(SEVEN)


@record
class Head:
    """Numbers of a whole orbit: its values, its contacts, and how its last step went."""

    push: float  # P [m]
    drag: float  # S [m]
    tip_offset: float  # z0 [m]
    amplitude: float  # A [m]
    parameter: float  # m
    count: int  # of elements
    contacts: int  # in a period; PERMANENT where the tip never leaves contact
    level: int  # of refinement
    equations: int  # EQUATIONS_OTHER, EQUATIONS_CURRENT or EQUATIONS_KEPT: of what the chained ones are
    change: float  # by which the last step changed the depth [m]
    turn: float  # and P and S [m]
    nearest_angle: float  # where an orbit without a border is nearest to one [rad]
    nearest_depth: float  # d there [m]
    transfer: np.ndarray = column(4)  # monodromy matrix
    contact_start: np.ndarray = column(MOST_CONTACTS + 1)  # angles [rad] where d rises and falls through 0
    contact_end: np.ndarray = column(MOST_CONTACTS + 1)
    neck_end: np.ndarray = column(MOST_CONTACTS + 1)  # and where the neck breaks


class Orbit(NamedTuple):
    """A periodic orbit and the room to work on it: arrays, for it is too large for a stack and is returned."""

    elements: np.ndarray  # a row of words for each, and one for the end of the last; see `element_of`
    head: np.ndarray  # shape (1, words); see `head_of`
    chained: np.ndarray  # shape (4, EIGHT); the chained equations
    system: np.ndarray  # shape (SEVEN, EIGHT); the same, solved with the drive's equation and what is held


ELEMENT_WORDS = words_of(Element)
HEAD_WORDS = words_of(Head)
element_of = rows_of(Element, Orbit, "elements")
head_of = rows_of(Head, Orbit, "head")


@kernel(light=True)
def room_for(elements: int) -> Orbit:
    """Return an orbit's room for so many elements."""
    return Orbit(
        np.zeros((elements + 1, ELEMENT_WORDS)),
        np.zeros((1, HEAD_WORDS)),
        np.zeros((4, EIGHT)),
        np.zeros((SEVEN, EIGHT)),
    )


@kernel(light=True)
def new_orbit() -> Orbit:
    """Return an orbit's room."""
    return room_for(MOST_ELEMENTS)


@kernel(light=True)
def the_amplitude() -> Held:
    """Hold the amplitude that the orbit has."""
    return Held(HOLD_AMPLITUDE, 0.0, 1.0, 0.0, 0.0)


@kernel(light=True)
def the_offset(z0: float) -> Held:
    """Hold a tip offset."""
    return Held(HOLD_OFFSET, 1.0, 0.0, z0, 0.0)


@kernel
def no_drift() -> np.ndarray:
    """`drift` where no parameter moves."""
    return np.empty((0, 0))


@kernel
def depth_on_side(p: np.ndarray, side: int, d: float) -> float:
    """The depth on this side of the surface that is nearest to d: elements may lie a little beside it.

    Where a neck breaks the force may fall like a root, so the neck is kept a millionth of its length away.
    """
    if side == IN_CONTACT:
        return max(d, 0.0)
    if side == IN_NECK:
        return max(d, p[RELEASE] * (1.0 - 1e-6))
    return min(d, 0.0)


@kernel
def surface_force(
    law: Law, p: np.ndarray, inverse_k: float, side: int, d: float, v: float
) -> tuple[float, float, float]:
    """g = F/k + 2 alpha_s v [m], dg/dd [1] and dg/dv [1] on one side of the contact point, or in the neck."""
    d = depth_on_side(p, side, d)
    if side == IN_NECK:
        return inverse_k * contact_force(law, d, p), inverse_k * contact_slope(law, d, p), 0.0
    if side == IN_CONTACT:
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
def _residual(
    law: Law, standing: np.ndarray, side: int, d: float, w: float, u: float, acceleration: float, speed: float
) -> float:
    """Left side of the equation of motion at a node: omega^2 w'' + 2 alpha0 omega w' + w + g; `speed` = dz/d(theta)."""
    lever = standing[ROW:]
    omega = lever[OMEGA]
    g = surface_force(law, parameters(standing), 1.0 / lever[STIFFNESS], side, d, omega * speed)[0]
    return omega * omega * acceleration + 2.0 * lever[ALPHA0] * omega * u + w + g


@kernel
def _element(
    oscillator: Oscillator, tables: np.ndarray, one: Element, head: Head, drift: np.ndarray, m: np.ndarray
) -> bool:
    """Fill `local` of an element: theory, Eq. (collocation-4); m is scratch, shape (ELEMENT_COLUMNS, NODES)."""
    law, p, lever = oscillator
    omega, inverse_k = lever[OMEGA], 1.0 / lever[STIFFNESS]
    viscous = 2.0 * lever[ALPHA0]
    z0, amplitude = head.tip_offset, head.amplitude
    h, side = one.scale, one.side
    table = tables[one.table]
    for j in range(NODES):
        c, s = one.cos[j], one.sin[j]
        d = amplitude * c + one.w[j] - z0
        v = omega * (one.u[j] - amplitude * s)
        g, gd, gv = surface_force(law, p, inverse_k, side, d, v)
        d = depth_on_side(p, side, d)
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
            w, u = one.w[j], one.u[j]
            force = head.push * c + head.drag * s
            acceleration = (force - viscous * omega * u - w - g) / (omega * omega)
            up = _residual(law, drift[0], side, d, w, u, acceleration, u - amplitude * s)
            down = _residual(law, drift[1], side, d, w, u, acceleration, u - amplitude * s)
            m[NODES + RM, j] = (down - up) / (2.0 * DRIFT_STEP)
    if not eliminate_columns(m):
        return False
    for q in range(SEVEN):
        for j in range(NODES):
            one.local[NODES * q + j] = m[NODES + q, j]
    return True


@kernel
def border_between(p: np.ndarray, before: int, after: int) -> float:
    """The depth [m] at which one side becomes another."""
    return p[RELEASE] if before == IN_NECK and after == OUT_OF_CONTACT else 0.0


@kernel
def jump_rate(oscillator: Oscillator, before: int, one: Element, amplitude: float) -> float:
    """Return how w' jumps per metre of depth at the start of an element, where the force itself may jump.

    A contact that starts earlier by d / |d'| feels the difference of the two accelerations for so long: theory,
    Eq. (collocation-5).
    """
    law, p, lever = oscillator
    omega, after = lever[OMEGA], one.side
    border = border_between(p, before, after)
    slope = one.edge_u - amplitude * math.sin(one.edge)
    v = omega * slope
    inverse_k = 1.0 / lever[STIFFNESS]
    deeper, higher = (after, before) if slope > 0.0 else (before, after)
    jump = surface_force(law, p, inverse_k, deeper, border, v)[0]
    jump -= surface_force(law, p, inverse_k, higher, border, v)[0]
    if abs(jump) < 1e-13 * lever[DRIVE]:
        return 0.0
    return jump / (omega * omega * max(abs(slope), 1e-9 * amplitude))


@kernel(shared=True, vectors=True, fastmath=ANY_ORDER)
def linearise_orbit(oscillator: Oscillator, tables: np.ndarray, orbit: Orbit, drift: np.ndarray) -> bool:
    """Chain the elements round the period; fills `chained` and the monodromy matrix."""
    p, lever = oscillator.p, oscillator.lever
    omega, alpha0 = lever[OMEGA], lever[ALPHA0]
    head, chained = head_of(orbit), orbit.chained
    count = head.count
    amplitude = head.amplitude
    chained[:] = 0.0
    along_cos, along_sin = chained[2], chained[3]
    start = element_of(orbit, 0)
    for q in range(SEVEN):
        start.chain_w[q] = 1.0 if q == W0 else 0.0
        start.chain_u[q] = 1.0 if q == U0 else 0.0
    m = np.zeros((ELEMENT_COLUMNS, NODES))
    for e in range(count):
        one = element_of(orbit, e)
        if not _element(oscillator, tables, one, head, drift, m):
            return False
        at_w, at_u = one.chain_w, one.chain_u
        before = element_of(orbit, e - 1 if e > 0 else count - 1).side
        if one.side != before:
            rate = jump_rate(oscillator, before, one, amplitude)
            if rate != 0.0:
                c, s = math.cos(one.edge), math.sin(one.edge)
                border = border_between(p, before, one.side)
                for q in range(SEVEN):
                    depth = at_w[q]
                    if q == RZ:
                        depth -= 1.0
                    elif q == ONE:
                        depth += amplitude * c - border
                    at_u[q] -= rate * depth
                    along_cos[q] -= rate * depth * c
                    along_sin[q] -= rate * depth * s
        h = one.scale
        table = tables[one.table]
        following = element_of(orbit, e + 1)
        for q in range(SEVEN):
            state_w, state_u = at_w[q], at_u[q]
            add = 1.0 if q >= RP else 0.0
            sum_w, sum_u, sum_c, sum_s = 0.0, 0.0, 0.0, 0.0
            for j in range(NODES):
                a = one.local[j] * state_w + one.local[NODES * U0 + j] * state_u + add * one.local[NODES * q + j]
                to_u = table[T_END1, j] * a
                sum_w += table[T_END2, j] * a
                sum_u += to_u
                sum_c += to_u * one.cos[j]
                sum_s += to_u * one.sin[j]
            following.chain_w[q] = state_w + h * table[T_NUMBERS, T_TOTAL] * state_u + h * h * sum_w
            following.chain_u[q] = state_u + h * sum_u
            along_cos[q] += h * sum_c
            along_sin[q] += h * sum_s
    last = element_of(orbit, count)
    for q in range(SEVEN):
        chained[0, q], chained[1, q] = last.chain_w[q], last.chain_u[q]
    head.transfer[0], head.transfer[1] = last.chain_w[W0], last.chain_w[U0]
    head.transfer[2], head.transfer[3] = last.chain_u[W0], last.chain_u[U0]
    # A moves like this: z = A cos + w stays the same if w loses what A cos gains.
    c, s = math.cos(element_of(orbit, 0).edge), math.sin(element_of(orbit, 0).edge)
    for i in range(4):
        row = chained[i]
        row[RIGHT] = -row[ONE]
        row[RA] = c * row[W0] - s * row[U0] + (1 - omega**2) * row[RP] - 2 * alpha0 * omega * row[RS]
    chained[0, RA] -= c
    chained[1, RA] += s
    chained[2, RA] += math.pi
    chained[0, W0] -= 1.0
    chained[1, U0] -= 1.0
    head.equations = EQUATIONS_CURRENT
    return True
