"""Newton step of an orbit: the chained equations with those of the drive and of what is held, solved and applied."""

from __future__ import annotations

import numpy as np

from phasemap._kernels.columns import DRIVE, DYNAMIC_LOSS, DYNAMIC_STIFFNESS, ROW
from phasemap._kernels.compilation import ANY_ORDER, kernel
from phasemap._kernels.lever import drive_needed
from phasemap._kernels.lever_modes import mode_of, modes_of
from phasemap._kernels.numerics import copy_rows, solve_equations
from phasemap._kernels.orbits.collocation.held_equation import Equation
from phasemap._kernels.orbits.collocation.lever_over_element import add_response, free_transfer
from phasemap._kernels.orbits.collocation.linearised import add_times
from phasemap._kernels.orbits.collocation.system import (
    DRIFT_STEP,
    EQUATIONS_OTHER,
    PLACES,
    RA,
    RIGHT,
    RM,
    RP,
    RS,
    RZ,
    STATE,
    Head,
    Orbit,
    close_ring,
    element_of,
    head_of,
    motion_of_mode,
)
from phasemap._kernels.quadrature import NODES


@kernel
def _drive_surplus(lever: np.ndarray, head: Head) -> float:
    """Drive needed, squared, over the base amplitude u0, less u0 [m]: zero on an orbit."""
    base = lever[DRIVE]
    x, y = drive_needed(lever, head.amplitude, head.push, head.drag)
    return (x * x + y * y) / base - base


@kernel(shared=True)
def _append_drive(lever: np.ndarray, orbit: Orbit, drift: np.ndarray) -> int:
    """Add the drive's equation, linearised, to the chained ones; returns the row of the next equation."""
    head, system, base = head_of(orbit), orbit.system, lever[DRIVE]
    states = 2 * modes_of(lever)
    row = states + 2
    copy_rows(orbit.chained, system)
    system[row:] = 0.0
    x, y = drive_needed(lever, head.amplitude, head.push, head.drag)
    system[row, RP], system[row, RS] = 2 * x / base, -2 * y / base
    system[row, RA] = 2 * (x * lever[DYNAMIC_STIFFNESS] + y * lever[DYNAMIC_LOSS]) / base
    system[row, RIGHT] = (x * x + y * y) / base + base
    if len(drift) > 0:
        system[row, RM] = (_drive_surplus(drift[0][ROW:], head) - _drive_surplus(drift[1][ROW:], head)) / (
            2.0 * DRIFT_STEP
        )
    return row + 1


@kernel
def _fill_held_equations(held: tuple[Equation, Equation], row: int, system: np.ndarray) -> None:
    """Fill in the coefficients of two equations for what is held, from a row of the system on."""
    for i in range(2):
        equation = held[i]
        system[row + i, RZ], system[row + i, RA], system[row + i, RM] = (
            equation.normal_z,
            equation.normal_a,
            equation.normal_m,
        )
        system[row + i, RP], system[row + i, RS] = equation.normal_p, equation.normal_s


@kernel
def solve_step(lever: np.ndarray, orbit: Orbit, drift: np.ndarray, held: tuple[Equation, Equation]) -> bool:
    """Solve the chained equations, that of the drive, and two that hold something, for the unknowns; False if singular.

    Where no parameter moves, the second equation that holds something is `hold_parameter`.
    """
    head, system, row = head_of(orbit), orbit.system, _append_drive(lever, orbit, drift)
    _fill_held_equations(held, row, system)
    for i in range(2):
        system[row + i, RIGHT] = held[i].equals - held[i].normal_m * head.parameter
    return solve_equations(system)


@kernel
def curve_derivative(lever: np.ndarray, orbit: Orbit, drift: np.ndarray, held: tuple[Equation, Equation]) -> bool:
    """Solve for the derivative along a curve of orbits, left in the last column of the system.

    Along it the first held equation stays satisfied, and the right side of the second grows by one.
    """
    system, row = orbit.system, _append_drive(lever, orbit, drift)
    _fill_held_equations(held, row, system)
    system[:, RIGHT] = 0.0
    system[row + 1, RIGHT] = 1.0
    return solve_equations(system)


@kernel(shared=True, vectors=True, fastmath=ANY_ORDER)
def apply_step(lever: np.ndarray, orbit: Orbit, share: float) -> float:
    """Move the orbit by `share` of the step just solved; return the largest change of the depth [m] over the nodes."""
    count = modes_of(lever)
    head, forces, chain = head_of(orbit), orbit.forces, orbit.chain
    x = orbit.system[:, RIGHT]
    last = len(x)
    gain, shift = x[RA] - head.amplitude, x[RZ] - head.tip_offset
    largest, states, f, old = 0.0, np.empty(2 * count), np.empty(NODES), np.empty(NODES)
    for e in range(head.count):
        element = element_of(orbit, e)
        for r in range(2 * count):  # of the modes where the element begins, by the unknowns x
            states[r] = chain[e, r, last]
            for q in range(last):
                states[r] += chain[e, r, q] * x[q]
        by = forces[e, last]  # P cos + S sin - g moves the modes, and g is affine in x and these states
        for j in range(NODES):
            f[j] = x[RP] * element.cos[j] + x[RS] * element.sin[j] - by[j]
        for q in range(STATE + 2 * count):
            by, much = forces[e, q], x[q] if q < STATE else states[q - STATE]
            add_times(-much, by, f)
        for j in range(NODES):
            old[j] = element.w[j]
        move_modes(lever, orbit, e, states, f, x[RM], share)
        for j in range(NODES):
            largest = max(largest, abs((element.w[j] - old[j]) / share + gain * element.cos[j] - shift))
    close_ring(orbit)
    head.equations = EQUATIONS_OTHER
    head.push += share * (x[RP] - head.push)
    head.drag += share * (x[RS] - head.drag)
    head.tip_offset += share * shift
    head.amplitude += share * gain
    head.parameter += share * x[RM]
    return largest


@kernel(fastmath=ANY_ORDER)
def move_modes(
    lever: np.ndarray, orbit: Orbit, e: int, states: np.ndarray, f: np.ndarray, m: float, share: float
) -> None:
    """Move each mode in an element, by `share`, towards its motion under a force f from these states at its start."""
    element = element_of(orbit, e)
    element.edge_w, element.edge_u = 0.0, 0.0
    for j in range(NODES):
        element.w[j], element.u[j] = 0.0, 0.0
    for i in range(modes_of(lever)):
        w0, u0 = states[2 * i], states[2 * i + 1]
        mode, motion = mode_of(lever, i), motion_of_mode(orbit, e, i)
        a, nu, inverse = mode.decay, mode.turn, 1.0 / mode.turn
        w, u, grow, cosine, sine = motion.w, motion.u, motion.growth, motion.cos, motion.sin
        for j in range(PLACES):
            w[j] *= 1.0 - share
            u[j] *= 1.0 - share
        w[NODES] += share * w0
        u[NODES] += share * u0
        for j in range(NODES):
            ww, wu, uw, uu = free_transfer(a, nu, inverse, grow[j], cosine[j], sine[j])
            w[j] += share * (ww * w0 + wu * u0)
            u[j] += share * (uw * w0 + uu * u0)
        if m != 0.0:
            for j in range(NODES):
                w[j] += share * m * motion.w_by_m[j]
                u[j] += share * m * motion.u_by_m[j]
        add_response(lever, orbit, e, i, share, f, w, u)
        for j in range(NODES):
            element.w[j] += w[j]
            element.u[j] += u[j]
        element.edge_w += w[NODES]
        element.edge_u += u[NODES]
