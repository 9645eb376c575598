"""Types of an orbit by collocation: its elements, what is unknown of it, the workspace for it, the surface's force.

With the time origin at the first harmonic of the tip, z = A cos(theta) + sum w_i(theta), theta = omega tau, and for
each mode of the lever

    omega^2 w_i'' + 2 alpha_i omega w_i' + w_i^2 w_i = c_i (P cos(theta) + S sin(theta) - g),

with g = F/k + 2 alpha_s zdot, whose first harmonic is (P, S), so that no w_i has one. The dynamic stiffness kappa at
the tip and the drive close the system, |kappa A + P - i S| = u0 (theory, Eqs. (collocation-1), (collocation-2),
(averaging-4), (lever-4)). Unknown are the motion of each mode at the start of the period, P, S and z0 (or A).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phasemap._kernels.columns import DAMPING, MOST_MODES, RELEASE
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import (
    Law,
    contact_force,
    contact_slope,
    damping,
    damping_slope,
    has_longrange,
    longrange_force,
    longrange_slope,
)
from phasemap._kernels.lever_modes import modes_of
from phasemap._kernels.quadrature import NODES
from phasemap._kernels.records import column, record, rows_of, words_of

MOST_ELEMENTS = 96
MOST_CONTACTS = 8

# Where the tip is.
OUT_OF_CONTACT = 0
IN_CONTACT = 1
IN_NECK = 2  # that a law with hysteresis draws out below d = 0

# What the chained equations of an orbit, its elements' included, are equations of.
EQUATIONS_OTHER = 0  # of another orbit
EQUATIONS_CURRENT = 1  # of the orbit as it stands
EQUATIONS_KEPT = 2  # of where the orbit was before a last small step

# Unknowns, and columns of the equations: P, S, z0, A, the change of m, and from STATE on w_i and w_i' of each mode at
# the start of the period, or of an element; the last column is the number one of an affine function, or the right-hand
# side.
RP = 0
RS = 1
RZ = 2
RA = 3
RM = 4
STATE = 5
RIGHT = -1

PLACES = NODES + 1  # the nodes of an element, and its start or end

# Where a parameter m moves, `drift`, shape (2, ROW + len(lever)), has the law's parameters and the lever at
# m + DRIFT_STEP and m - DRIFT_STEP; elsewhere it has no rows.
DRIFT_STEP = 1e-5


@record
class Element:
    """An element of an orbit: its place, and the motion at its nodes."""

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


@record
class ModeMotion:
    """Motion of a mode over an element, at its nodes and one place more."""

    growth: np.ndarray = column(PLACES)  # |exp(lambda theta)| from the element's start to its nodes and its end
    cos: np.ndarray = column(PLACES)  # cosine and sine of Im(lambda) theta there
    sin: np.ndarray = column(PLACES)
    w: np.ndarray = column(PLACES)  # w_i [m] at the nodes, and at the start
    u: np.ndarray = column(PLACES)  # w_i' [m]
    w_by_m: np.ndarray = column(PLACES)  # change of w_i and w_i' with m, the force as it is
    u_by_m: np.ndarray = column(PLACES)


@record
class Head:
    """Numbers of a whole orbit: its values, its contacts, and how its last step went."""

    push: float  # P [m]
    drag: float  # S [m]
    tip_offset: float  # z0 [m]
    amplitude: float  # A [m]
    parameter: float  # m
    swept: int  # 1 where m moves
    count: int  # of elements
    contacts: int  # in a period; PERMANENT where the tip never leaves contact
    level: int  # of refinement
    equations: int  # EQUATIONS_OTHER, EQUATIONS_CURRENT or EQUATIONS_KEPT: of what the chained ones are
    change: float  # by which the last step changed the depth [m]
    turn: float  # and P and S [m]
    nearest_angle: float  # where an orbit without a border is nearest to one [rad]
    nearest_depth: float  # d there [m]
    transfer: np.ndarray = column(4 * MOST_MODES * MOST_MODES)  # monodromy matrix, row by row
    contact_start: np.ndarray = column(MOST_CONTACTS + 1)  # angles [rad] where d rises and falls through 0
    contact_end: np.ndarray = column(MOST_CONTACTS + 1)
    neck_end: np.ndarray = column(MOST_CONTACTS + 1)  # and where the neck breaks


class Orbit(NamedTuple):
    """A periodic orbit and the workspace for it: arrays, for it is too large for a stack."""

    elements: np.ndarray  # a row of words for each, and one for the end of the last; see `element_of`
    head: np.ndarray  # shape (1, words); see `head_of`
    modes: np.ndarray  # a row of words for each mode over each element; see `motion_of_mode`
    # shape (elements, unknowns + 1, NODES); g at its nodes by the unknowns, with the states at its start
    forces: np.ndarray
    chain: np.ndarray  # shape (elements + 1, states, unknowns + 1); states at its start by the unknowns
    chained: np.ndarray  # shape (states + 2, unknowns + 1); the chained equations
    system: np.ndarray  # shape (unknowns, unknowns + 1); the same with those of the drive and of what is held, solved
    tables: np.ndarray  # `phasemap._kernels.quadrature.TABLES`
    other_elements: np.ndarray  # to lay the elements anew, see `spare_orbit`
    other_head: np.ndarray
    other_modes: np.ndarray


ELEMENT_WORDS = words_of(Element)
HEAD_WORDS = words_of(Head)
MOTION_WORDS = words_of(ModeMotion)
element_of = rows_of(Element, Orbit, "elements")
head_of = rows_of(Head, Orbit, "head")
_motion_in_row = rows_of(ModeMotion, Orbit, "modes")


@kernel(inline=True)
def mode_count(orbit: Orbit) -> int:
    """Number of modes of the lever that an orbit is of."""
    return orbit.chain.shape[1] // 2


@kernel(inline=True)
def motion_of_mode(orbit: Orbit, e: int, i: int) -> ModeMotion:
    """Motion of mode i over element e; with e the number of elements, at the end of the last one."""
    return _motion_in_row(orbit, e * mode_count(orbit) + i)


@kernel(light=True)
def new_orbit_of_size(elements: int, modes: int, tables: np.ndarray) -> Orbit:
    """Return an orbit of so many elements at most, and of a lever of so many modes."""
    unknowns = STATE + 2 * modes
    laid = np.zeros((elements + 1, ELEMENT_WORDS)), np.zeros((1, HEAD_WORDS))
    motion = np.zeros(((elements + 1) * modes, MOTION_WORDS))
    return Orbit(
        laid[0], laid[1], motion,
        np.empty((elements, unknowns + 1, NODES)),
        np.empty((elements + 1, 2 * modes, unknowns + 1)),
        np.zeros((2 * modes + 2, unknowns + 1)),
        np.zeros((unknowns, unknowns + 1)),
        tables, laid[0].copy(), laid[1].copy(), motion.copy(),
    )  # fmt: skip


@kernel(light=True)
def new_orbit(lever: np.ndarray, tables: np.ndarray) -> Orbit:
    """Return an orbit of this lever, to be filled."""
    return new_orbit_of_size(MOST_ELEMENTS, modes_of(lever), tables)


@kernel(light=True)
def new_orbit_like(orbit: Orbit) -> Orbit:
    """Return another orbit of the same lever, to be filled."""
    return new_orbit_of_size(MOST_ELEMENTS, mode_count(orbit), orbit.tables)


@kernel(light=True)
def spare_orbit(orbit: Orbit) -> Orbit:
    """Return the orbit whose elements, head and motion are the spare arrays of this one."""
    elements, head, modes, forces, chain, chained, system, tables, other, other_head, other_modes = orbit
    return Orbit(other, other_head, other_modes, forces, chain, chained, system, tables, elements, head, modes)


@kernel
def no_drift() -> np.ndarray:
    """Empty drift, where no parameter moves."""
    return np.empty((0, 0))


@kernel
def depth_on_side(p: np.ndarray, side: int, d: float) -> float:
    """Depth on this side of the surface that is nearest to d: elements may lie a little beside it.

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
    if not has_longrange(p):
        return 0.0, 0.0, 0.0
    return inverse_k * longrange_force(law, d, p), inverse_k * longrange_slope(law, d, p), 0.0


@kernel
def close_ring(orbit: Orbit) -> None:
    """Set the motion at the end of the last element to that at the start of the first."""
    count = head_of(orbit).count
    first, last = element_of(orbit, 0), element_of(orbit, count)
    last.edge_w, last.edge_u = first.edge_w, first.edge_u
    for i in range(mode_count(orbit)):
        start, end = motion_of_mode(orbit, 0, i), motion_of_mode(orbit, count, i)
        end.w[NODES], end.u[NODES] = start.w[NODES], start.u[NODES]
