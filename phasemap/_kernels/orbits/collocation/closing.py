"""Newton step of an orbit: the chained equations with those of the drive and of what is held, solved and applied."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels.arrays import copy_rows
from phasemap._kernels.columns import ALPHA0, DRIVE, DYNAMIC_LOSS, DYNAMIC_STIFFNESS, OMEGA, ROW
from phasemap._kernels.compilation import kernel
from phasemap._kernels.dense import eliminate
from phasemap._kernels.lever import drive_needed
from phasemap._kernels.orbits.collocation.system import (
    DRIFT_STEP,
    EQUATIONS_OTHER,
    HOLD_AMPLITUDE,
    ONE,
    RA,
    RIGHT,
    RM,
    RP,
    RS,
    RZ,
    SEVEN,
    U0,
    W0,
    Equation,
    Head,
    Held,
    Orbit,
    element_of,
    head_of,
    no_drift,
)
from phasemap._kernels.quadrature import NODES, T_M1, T_M2, T_SUM1


@kernel
def _drive(lever: np.ndarray, head: Head) -> float:
    """Drive needed, squared, over the base amplitude, less the base amplitude [m]."""
    base = lever[DRIVE]
    x, y = drive_needed(lever, head.amplitude, head.push, head.drag)
    return (x * x + y * y) / base - base


@kernel(shared=True)
def _with_drive(lever: np.ndarray, orbit: Orbit, drift: np.ndarray) -> None:
    """Put the chained equations into the system, and the drive's, linearised, into its row 4."""
    base = lever[DRIVE]
    head = head_of(orbit)
    copy_rows(orbit.chained, orbit.system)
    orbit.system[4:] = 0.0
    row = orbit.system[4]
    amplitude, push, drag = head.amplitude, head.push, head.drag
    x, y = drive_needed(lever, amplitude, push, drag)
    row[RP] = 2 * x / base
    row[RS] = -2 * y / base
    row[RA] = (2 * x * lever[DYNAMIC_STIFFNESS] + 2 * y * lever[DYNAMIC_LOSS]) / base
    row[RIGHT] = (base * base - x * x - y * y + 2 * x * push - 2 * y * drag) / base
    if len(drift) > 0:
        row[RM] = (_drive(drift[0][ROW:], head) - _drive(drift[1][ROW:], head)) / (2.0 * DRIFT_STEP)


@kernel
def solve_step(lever: np.ndarray, orbit: Orbit, held: Held) -> bool:
    """Add the drive's equation and what is held, and solve for (w, w', P, S, z0, change of A); True if solvable."""
    _with_drive(lever, orbit, no_drift())
    row = orbit.system[5]
    row[RZ], row[RA] = held.normal_z, held.normal_a
    if held.hold != HOLD_AMPLITUDE:
        change = held.through_a - head_of(orbit).amplitude
        row[RIGHT] = held.normal_z * held.through_z + held.normal_a * change
    return eliminate(orbit.system[:6], 6)


@kernel(shared=True)
def curve_derivative(lever: np.ndarray, orbit: Orbit, r_z: float, r_a: float) -> bool:
    """Leave the derivative along the curve of orbits in the system's last column, with r_z dz0 + r_A dA = 1."""
    _with_drive(lever, orbit, no_drift())
    orbit.system[:6, RIGHT] = 0.0
    orbit.system[5, RZ] = r_z
    orbit.system[5, RA] = r_a
    orbit.system[5, RIGHT] = 1.0
    return eliminate(orbit.system[:6], 6)


@kernel
def solve_swept_step(lever: np.ndarray, orbit: Orbit, drift: np.ndarray, held: tuple[Equation, Equation]) -> bool:
    """Solve for the step where m may change too, and two equations hold; True if solvable."""
    head = head_of(orbit)
    _with_drive(lever, orbit, drift)
    for i in range(2):
        row, one = orbit.system[5 + i], held[i]
        row[RZ], row[RA], row[RM] = one.normal_z, one.normal_a, one.normal_m
        row[RIGHT] = one.equals - one.normal_a * head.amplitude - one.normal_m * head.parameter
    return eliminate(orbit.system[:SEVEN], SEVEN)


@kernel
def swept_curve_derivative(lever: np.ndarray, orbit: Orbit, drift: np.ndarray, held: tuple[Equation, Equation]) -> bool:
    """Leave the derivative where m may change too: the first equation stays, the second changes by one."""
    _with_drive(lever, orbit, drift)
    orbit.system[:SEVEN, RIGHT] = 0.0
    for i in range(2):
        row, one = orbit.system[5 + i], held[i]
        row[RZ], row[RA], row[RM] = one.normal_z, one.normal_a, one.normal_m
    orbit.system[SEVEN - 1, RIGHT] = 1.0
    return eliminate(orbit.system[:SEVEN], SEVEN)


@kernel
def apply_step(tables: np.ndarray, lever: np.ndarray, orbit: Orbit, share: float) -> float:
    """Move the orbit by `share` of the step just solved; return the largest change of the depth [m] over the nodes."""
    omega, alpha0 = lever[OMEGA], lever[ALPHA0]
    head = head_of(orbit)
    count = head.count
    x = orbit.system[:SEVEN, RIGHT]
    gain, shift, change = x[RA], x[RZ] - head.tip_offset, x[RM]
    # The chain knows the orbit as if A had stayed: w + gain cos(theta), with these starts and forces.
    c, s = math.cos(element_of(orbit, 0).edge), math.sin(element_of(orbit, 0).edge)
    w0, u0 = x[W0] + gain * c, x[U0] - gain * s
    push, drag, z0 = x[RP] + gain * (1 - omega**2), x[RS] - gain * 2 * alpha0 * omega, x[RZ]
    largest = 0.0
    a = np.empty(NODES)
    for e in range(count):
        one = element_of(orbit, e)
        at_w, at_u = one.chain_w, one.chain_u
        start_w = at_w[W0] * w0 + at_w[U0] * u0 + at_w[RP] * push + at_w[RS] * drag + at_w[RZ] * z0 + at_w[ONE]
        start_w += at_w[RM] * change
        start_u = at_u[W0] * w0 + at_u[U0] * u0 + at_u[RP] * push + at_u[RS] * drag + at_u[RZ] * z0 + at_u[ONE]
        start_u += at_u[RM] * change
        h = one.scale
        table = tables[one.table]
        for j in range(NODES):
            a[j] = (
                one.local[j] * start_w + one.local[NODES * U0 + j] * start_u + one.local[NODES * RP + j] * push
                + one.local[NODES * RS + j] * drag + one.local[NODES * RZ + j] * z0 + one.local[NODES * ONE + j]
                + one.local[NODES * RM + j] * change
            )  # fmt: skip
        for j in range(NODES):
            sum_w, sum_u = 0.0, 0.0
            for k in range(NODES):
                sum_w += table[T_M2 + j, k] * a[k]
                sum_u += table[T_M1 + j, k] * a[k]
            step_w = start_w + h * (start_u * table[T_SUM1, j] + h * sum_w) - one.w[j]
            step_u = start_u + h * sum_u + gain * one.sin[j] - one.u[j]
            largest = max(largest, abs(step_w - shift))
            one.w[j] += share * (step_w - gain * one.cos[j])
            one.u[j] += share * step_u
            one.bend[j] = a[j] + gain * one.cos[j]
        c, s = math.cos(one.edge), math.sin(one.edge)
        one.edge_w += share * (start_w - gain * c - one.edge_w)
        one.edge_u += share * (start_u + gain * s - one.edge_u)
    element_of(orbit, count).edge_w = element_of(orbit, 0).edge_w
    element_of(orbit, count).edge_u = element_of(orbit, 0).edge_u
    head.equations = EQUATIONS_OTHER
    head.push += share * (x[RP] - head.push)
    head.drag += share * (x[RS] - head.drag)
    head.tip_offset += share * shift
    head.amplitude += share * gain
    head.parameter += share * change
    return largest
