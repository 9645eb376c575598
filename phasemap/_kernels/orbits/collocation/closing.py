"""What closes the chained equations: the drive, and what is held; the step that they give, taken."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels.arrays import copy_rows
from phasemap._kernels.columns import ALPHA0, BASE, OMEGA, ROW
from phasemap._kernels.compilation import kernel
from phasemap._kernels.dense import eliminate
from phasemap._kernels.lever import drive_needed
from phasemap._kernels.orbits.collocation.system import (
    BEND,
    CHAIN,
    COS,
    COUNT,
    EDGE,
    EDGE_U,
    EDGE_W,
    ELEMENTS,
    HOLD_AMPLITUDE,
    HOLD_OFFSET,
    LINEAR,
    LOCAL,
    ONE,
    OPEN,
    PLACE,
    RA,
    RIGHT,
    RM,
    RP,
    RS,
    RZ,
    SCALE,
    SEVEN,
    SIN,
    SMALL,
    SYSTEM,
    TABLE,
    U0,
    VALUE,
    W0,
    Z0,
    A,
    M,
    Orbit,
    P,
    S,
    U,
    W,
    no_drift,
)
from phasemap._kernels.quadrature import NODES, T_M1, T_M2, T_SUM1

# An equation NORMAL (z0, A, m) = EQUALS that is held; and the plane through (z0, A) that `close` holds.
NORMAL_Z, NORMAL_A, NORMAL_M, EQUALS = 0, 1, 2, 3
PLANE_Z, PLANE_A, THROUGH_Z, THROUGH_A = 0, 1, 2, 3


@kernel
def _drive(lever: np.ndarray, head: np.ndarray) -> float:
    """Drive needed, squared, over the base amplitude, less the base amplitude [m]."""
    base = lever[BASE]
    x, y = drive_needed(lever, head[VALUE, A], head[VALUE, P], head[VALUE, S])
    return (x * x + y * y) / base - base


@kernel(shared=True)
def _with_drive(lever: np.ndarray, head: np.ndarray, drift: np.ndarray) -> None:
    """Put the chained equations into the system, and the drive's, linearised, into its row 4."""
    omega, alpha0, base = lever[OMEGA], lever[ALPHA0], lever[BASE]
    copy_rows(head[OPEN : OPEN + 4], head[SYSTEM:])
    head[SYSTEM + 4 : SYSTEM + SEVEN] = 0.0
    row = head[SYSTEM + 4]
    amplitude, push, drag = head[VALUE, A], head[VALUE, P], head[VALUE, S]
    x, y = drive_needed(lever, amplitude, push, drag)
    row[RP] = 2 * x / base
    row[RS] = -2 * y / base
    row[RA] = (2 * x * (1 - omega**2) + 4 * y * alpha0 * omega) / base
    row[RIGHT] = (base * base - x * x - y * y + 2 * x * push - 2 * y * drag) / base
    if len(drift) > 0:
        row[RM] = (_drive(drift[0][ROW:], head) - _drive(drift[1][ROW:], head)) / (2.0 * SMALL)


@kernel
def close(lever: np.ndarray, orbit: Orbit, hold: int, target: np.ndarray) -> bool:
    """Add the drive's equation and what is held, and solve for (w, w', P, S, z0, change of A); True if solvable.

    `target` is (z0, ...) with HOLD_OFFSET; with the others it is (r_z, r_A, z0, A), the plane
    r_z (new z0 - z0) + r_A (new A - A) = 0.
    """
    head = orbit.head
    _with_drive(lever, head, no_drift())
    row = head[SYSTEM + 5]
    if hold == HOLD_AMPLITUDE:
        row[RA] = 1.0
    elif hold == HOLD_OFFSET:
        row[RZ] = 1.0
        row[RIGHT] = target[0]
    else:
        row[RZ] = target[PLANE_Z]
        row[RA] = target[PLANE_A]
        row[RIGHT] = target[PLANE_Z] * target[THROUGH_Z] + target[PLANE_A] * (target[THROUGH_A] - head[VALUE, A])
    return eliminate(head[SYSTEM : SYSTEM + 6], 6)


@kernel(shared=True)
def along(lever: np.ndarray, orbit: Orbit, r_z: float, r_a: float) -> bool:
    """Leave the derivative along the curve of orbits in the system's last column, with r_z dz0 + r_A dA = 1."""
    head = orbit.head
    _with_drive(lever, head, no_drift())
    head[SYSTEM : SYSTEM + 6, RIGHT] = 0.0
    head[SYSTEM + 5, RZ] = r_z
    head[SYSTEM + 5, RA] = r_a
    head[SYSTEM + 5, RIGHT] = 1.0
    return eliminate(head[SYSTEM : SYSTEM + 6], 6)


@kernel
def close_swept(lever: np.ndarray, orbit: Orbit, drift: np.ndarray, holds: np.ndarray) -> bool:
    """`close` where m may change too. holds, shape (2, 4): rows (r_z, r_A, r_m, h), r (z0, A, m) = h."""
    head = orbit.head
    _with_drive(lever, head, drift)
    for i in range(2):
        row, hold = head[SYSTEM + 5 + i], holds[i]
        row[RZ], row[RA], row[RM] = hold[NORMAL_Z], hold[NORMAL_A], hold[NORMAL_M]
        row[RIGHT] = hold[EQUALS] - hold[NORMAL_A] * head[VALUE, A] - hold[NORMAL_M] * head[VALUE, M]
    return eliminate(head[SYSTEM : SYSTEM + SEVEN], SEVEN)


@kernel
def along_swept(lever: np.ndarray, orbit: Orbit, drift: np.ndarray, holds: np.ndarray) -> bool:
    """`along` where m may change too: the first row of `holds` stays, the second changes by one."""
    head = orbit.head
    _with_drive(lever, head, drift)
    head[SYSTEM : SYSTEM + SEVEN, RIGHT] = 0.0
    for i in range(2):
        row, hold = head[SYSTEM + 5 + i], holds[i]
        row[RZ], row[RA], row[RM] = hold[NORMAL_Z], hold[NORMAL_A], hold[NORMAL_M]
    head[SYSTEM + SEVEN - 1, RIGHT] = 1.0
    return eliminate(head[SYSTEM : SYSTEM + SEVEN], SEVEN)


@kernel
def accept(tables: np.ndarray, lever: np.ndarray, orbit: Orbit, share: float) -> float:
    """Move the orbit by `share` of the step just solved; return the largest change of the depth [m] over the nodes."""
    omega, alpha0 = lever[OMEGA], lever[ALPHA0]
    elements, head = orbit.elements, orbit.head
    count = int(head[COUNT, ELEMENTS])
    x = head[SYSTEM : SYSTEM + SEVEN, RIGHT]
    gain, shift, change = x[RA], x[RZ] - head[VALUE, Z0], x[RM]
    # The chain knows the orbit as if A had stayed: w + gain cos(theta), with these starts and forces.
    c, s = math.cos(elements[0, PLACE, EDGE]), math.sin(elements[0, PLACE, EDGE])
    w0, u0 = x[W0] + gain * c, x[U0] - gain * s
    push, drag, z0 = x[RP] + gain * (1 - omega**2), x[RS] - gain * 2 * alpha0 * omega, x[RZ]
    largest = 0.0
    a = np.empty(NODES)
    for e in range(count):
        one = elements[e]
        at_w, at_u = one[CHAIN], one[CHAIN + 1]
        start_w = at_w[W0] * w0 + at_w[U0] * u0 + at_w[RP] * push + at_w[RS] * drag + at_w[RZ] * z0 + at_w[ONE]
        start_w += at_w[RM] * change
        start_u = at_u[W0] * w0 + at_u[U0] * u0 + at_u[RP] * push + at_u[RS] * drag + at_u[RZ] * z0 + at_u[ONE]
        start_u += at_u[RM] * change
        h = one[PLACE, SCALE]
        table = tables[int(one[PLACE, TABLE])]
        for j in range(NODES):
            a[j] = (
                one[LOCAL + W0, j] * start_w + one[LOCAL + U0, j] * start_u + one[LOCAL + RP, j] * push
                + one[LOCAL + RS, j] * drag + one[LOCAL + RZ, j] * z0 + one[LOCAL + ONE, j]
                + one[LOCAL + RM, j] * change
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
            one[BEND, j] = a[j] + gain * one[COS, j]
        c, s = math.cos(one[PLACE, EDGE]), math.sin(one[PLACE, EDGE])
        one[PLACE, EDGE_W] += share * (start_w - gain * c - one[PLACE, EDGE_W])
        one[PLACE, EDGE_U] += share * (start_u + gain * s - one[PLACE, EDGE_U])
    elements[count, PLACE, EDGE_W] = elements[0, PLACE, EDGE_W]
    elements[count, PLACE, EDGE_U] = elements[0, PLACE, EDGE_U]
    head[COUNT, LINEAR] = 0.0
    head[VALUE, P] += share * (x[RP] - head[VALUE, P])
    head[VALUE, S] += share * (x[RS] - head[VALUE, S])
    head[VALUE, Z0] += share * shift
    head[VALUE, A] += share * gain
    head[VALUE, M] += share * change
    return largest
