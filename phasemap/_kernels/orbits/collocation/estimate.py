"""How far a converged orbit is from the exact one: one step of Newton's method with every element cut in two.

On elements of half the length the error of Gauss collocation is 2^16 times smaller where it counts, in P, S and z0:
what the step changes there is the error of the orbit: that of the elements, of the last step, and of elements that lie
beside the contacts, for the halves are laid where the contacts are: theory, Eq. (errors-4).

The step itself leaves the square of what its start is wrong by. Between its nodes the orbit is a polynomial of xi, not
of the angle (see `quadrature`): carried over by that polynomial it is about as exact as at the nodes.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.arrays import copy, copy_rows
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator
from phasemap._kernels.lever import phase_of
from phasemap._kernels.orbits.collocation.closing import close
from phasemap._kernels.orbits.collocation.contacts import find_contacts
from phasemap._kernels.orbits.collocation.elements import lay, put
from phasemap._kernels.orbits.collocation.system import (
    COUNT,
    EDGE,
    EDGE_U,
    EDGE_W,
    ELEMENTS,
    FIELDS,
    HOLD_AMPLITUDE,
    LEVEL,
    ORIGIN,
    PLACE,
    RIGHT,
    RP,
    RS,
    RZ,
    SCALE,
    SIDE,
    SYSTEM,
    TABLE,
    VALUE,
    Z0,
    A,
    Orbit,
    U,
    W,
    linearise,
    no_drift,
)
from phasemap._kernels.quadrature import HALVES, INTO_HALVES, NODES, T_S

SAFETY = 2.0  # over the change in the step; of 7,000 orbits drawn at random none was farther off than 1.4 times that
FLOOR_PHASE, FLOOR_HEIGHT = 4e-11, 1e-19  # [rad, m], least error to be expected
ROUNDING = 2e-13  # of the tip offset, in the amplitude: what is rounded where a lever is pressed deep into the surface
ASIDE = 1e-3  # [rad] by which elements may lie beside the contacts and still be the same ones


@kernel
def state_errors(oscillator: Oscillator, tables: np.ndarray, orbit: Orbit, spare: Orbit, row: np.ndarray) -> None:
    """Fill in the errors of phase and tip offset in the row of a converged orbit, at its amplitude.

    The slope of its feedback is known already. Errors are NaN where the equations cannot be solved. The orbit stays as
    it is, the spare room does not.
    """
    p, lever = oscillator.p, oscillator.lever
    row[col.ERROR_PHASE], row[col.ERROR_HEIGHT] = math.nan, math.nan
    head = orbit.head.copy()
    laid = find_contacts(p, tables, orbit) and lay(oscillator, tables, spare, orbit, int(head[COUNT, LEVEL]))
    copy_rows(head, orbit.head)
    halves = _halve(tables, orbit, spare if laid and _same(orbit, spare) else orbit)
    chained = linearise(oscillator, tables, halves, no_drift())
    if not chained or not close(lever, halves, HOLD_AMPLITUDE, np.zeros(4)):
        return
    solved = halves.head[SYSTEM:, RIGHT]
    phase = phase_of(lever, head[VALUE, A], solved[RP], solved[RS])
    row[col.ERROR_PHASE] = SAFETY * abs(phase - row[col.PHASE]) + FLOOR_PHASE
    rounded = ROUNDING * abs(head[VALUE, Z0] / row[col.SLOPE])
    row[col.ERROR_HEIGHT] = SAFETY * abs(solved[RZ] - head[VALUE, Z0]) + FLOOR_HEIGHT + rounded


@kernel
def _same(orbit: Orbit, places: Orbit) -> bool:
    """Whether both have the same elements, at almost the same places."""
    count = int(orbit.head[COUNT, ELEMENTS])
    if int(places.head[COUNT, ELEMENTS]) != count:
        return False
    for e in range(count):
        one, place = orbit.elements[e, PLACE], places.elements[e, PLACE]
        if one[TABLE] != place[TABLE] or not abs(one[EDGE] - place[EDGE]) < ASIDE:
            return False
    return True


@kernel
def _halve(tables: np.ndarray, orbit: Orbit, places: Orbit) -> Orbit:
    """The orbit on elements cut in two, which lie where those of `places` do."""
    count = int(orbit.head[COUNT, ELEMENTS])
    halves = Orbit(np.empty((2 * count + 1, FIELDS, NODES)), orbit.head.copy())
    halves.head[COUNT, ELEMENTS] = 0
    w, u = np.empty(NODES + 2), np.empty(NODES + 2)
    for e in range(count):
        one, following, place = orbit.elements[e], orbit.elements[e + 1], places.elements[e, PLACE]
        w[0], u[0] = one[PLACE, EDGE_W], one[PLACE, EDGE_U]
        copy(one[W], w[1:])
        copy(one[U], u[1:])
        w[-1], u[-1] = following[PLACE, EDGE_W], following[PLACE, EDGE_U]
        for part in range(2):
            n = HALVES + 2 * int(place[TABLE]) + part
            put(tables, halves, n, place[SIDE], place[ORIGIN], place[SCALE])
            half = halves.elements[2 * e + part]
            half[PLACE, EDGE_U] = one[PLACE, EDGE_U]  # asked for where a side begins
            for j in range(NODES):
                at_w, at_u = 0.0, 0.0
                for k in range(NODES + 2):
                    at_w += INTO_HALVES[part * NODES + j, k] * w[k]
                    at_u += INTO_HALVES[part * NODES + j, k] * u[k]
                moved = place[ORIGIN] - one[PLACE, ORIGIN] + (place[SCALE] - one[PLACE, SCALE]) * tables[n, T_S, j]
                half[W, j], half[U, j] = at_w + at_u * moved, at_u
    return halves
