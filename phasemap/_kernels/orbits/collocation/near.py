"""The exact orbit beside a harmonic one: Newton's method from there, on finer elements until its energy closes."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator
from phasemap._kernels.lever import free_amplitude, scale_of
from phasemap._kernels.orbits.collocation.elements import lay_again
from phasemap._kernels.orbits.collocation.held_equation import HOLD_AMPLITUDE, HOLD_OFFSET, hold_amplitude, hold_offset
from phasemap._kernels.orbits.collocation.newton import (
    MOST_NEWTON_STEPS,
    NewtonLimits,
    begin_harmonic,
    solve_at_amplitude,
    solve_orbit,
)
from phasemap._kernels.orbits.collocation.observables import fill_row_of_orbit
from phasemap._kernels.orbits.collocation.path import Path, fixed_path, oscillator_at
from phasemap._kernels.orbits.collocation.system import Orbit, element_of, head_of
from phasemap._kernels.orbits.harmonic_orbit import HarmonicOrbit
from phasemap._kernels.orbits.result_row import feedback_status
from phasemap._kernels.quadrature import NODES

LAST_CHANGE = 2e-14  # [m], last change of an orbit; the error left is its square over the depth of the contact
LAST_CHANGE_RELATIVE = 1e-4  # of the free amplitude, the same for amplitudes of picometres
LAST_CHANGE_OF_SCALE = 1e-3  # the same, over the length on which forces change
FINEST_LEVEL = 2  # level of refinement
FINE_CLOSURE = 1e-7  # largest energy closure accepted from a coarser level
WORST_ORBIT_CLOSURE = 1e-5  # largest one of an orbit that is an answer
MOST_STEPS_NEARBY = 12  # of Newton's method


@kernel
def tolerance_of(oscillator: Oscillator) -> float:
    """Largest last change [m] of a converged orbit."""
    lever = oscillator.lever
    free = free_amplitude(lever)
    return min(min(LAST_CHANGE, LAST_CHANGE_RELATIVE * free), LAST_CHANGE_OF_SCALE * scale_of(oscillator))


@kernel(shared=True)
def refine_orbit(oscillator: Oscillator, orbit: Orbit, row: np.ndarray) -> int:
    """Fill the row of a converged orbit, on finer elements if the energy does not close."""
    status = fill_row_of_orbit(oscillator, orbit, row)
    level, tolerance = head_of(orbit).level, tolerance_of(oscillator)
    while status == col.GOOD and abs(row[col.CLOSURE]) > FINE_CLOSURE and level < FINEST_LEVEL:
        level += 1
        if not lay_again(oscillator, orbit, level):
            break
        fine = solve_at_amplitude(oscillator, orbit, level, tolerance, MOST_NEWTON_STEPS)
        if fine != col.GOOD:
            break
        status = fill_row_of_orbit(oscillator, orbit, row)
    if status == col.GOOD and abs(row[col.CLOSURE]) > WORST_ORBIT_CLOSURE:
        status = col.NOT_CONVERGED
    return status


@kernel
def depth_at_nodes(orbit: Orbit) -> float:
    """Largest depth at the nodes [m]."""
    deepest, head = -math.inf, head_of(orbit)
    for e in range(head.count):
        element = element_of(orbit, e)
        for j in range(NODES):
            deepest = max(deepest, head.amplitude * element.cos[j] + element.w[j])
    return deepest - head.tip_offset


@kernel
def solve_near(
    path: Path, harmonic: HarmonicOrbit, m: float, hold: int, fine: bool, tolerance: float, most_steps: int,
    orbit: Orbit,
) -> tuple[int, float, float]:  # fmt: skip
    """Solve from a harmonic orbit for the exact one at a path's parameter m.

    `hold`: HOLD_OFFSET or HOLD_AMPLITUDE. Returns a status, and tip offset and depth [m] of where the solver began.
    Where elements may be `fine`, finer ones are tried, which change less by a step.
    """
    oscillator, head, done, start, deep = oscillator_at(path, m), head_of(orbit), col.NOT_CONVERGED, math.nan, math.nan
    for level in range(FINEST_LEVEL + 1 if fine else 1):
        head.parameter = m
        if not begin_harmonic(oscillator, orbit, harmonic, level):
            continue
        start, deep = head.tip_offset, depth_at_nodes(orbit)
        held = hold_offset(harmonic.tip_offset) if hold == HOLD_OFFSET else hold_amplitude(orbit)
        limits = NewtonLimits(level, tolerance, most_steps, coarse=False, along=False, seen=0.0)
        done, _ = solve_orbit(path, orbit, held, limits)
        if done == col.GOOD:
            break
    return done, start, deep


@kernel(shared=True)
def collocation_orbit_from_harmonic(
    oscillator: Oscillator, harmonic: HarmonicOrbit, orbit: Orbit, row: np.ndarray
) -> tuple[int, float]:
    """Exact orbit from a harmonic one: fills its row; returns a status, and how far apart the two are [m].

    The status is that under feedback; the caller judges by the distance if it is the orbit meant: that of the tip
    offsets or of the depths, the smaller one, for harmonics that lift the tip do not bring it to another branch.
    """
    done, start, deep = solve_near(
        fixed_path(oscillator), harmonic, 0.0, HOLD_AMPLITUDE, True, tolerance_of(oscillator), MOST_STEPS_NEARBY, orbit
    )
    if done == col.GOOD:
        done = refine_orbit(oscillator, orbit, row)
    if done != col.GOOD:
        return done, math.inf
    depth = harmonic.amplitude - harmonic.tip_offset + harmonic.mean_deflection
    deeper = min(abs(row[col.INDENTATION] - deep), abs(row[col.INDENTATION] - depth))
    return feedback_status(row), min(abs(row[col.TIP_OFFSET] - start), deeper)


@kernel
def collocation_orbit_from_near(oscillator: Oscillator, harmonic: HarmonicOrbit, orbit: Orbit, row: np.ndarray) -> int:
    """Exact orbit from a near one, with amplitude, tip offset, P and S of a harmonic one; fills its row. Status."""
    head = head_of(orbit)
    head.amplitude, head.tip_offset = harmonic.amplitude, harmonic.tip_offset
    head.push, head.drag = harmonic.push, harmonic.drag
    if not lay_again(oscillator, orbit, 0):
        return col.NOT_CONVERGED
    done = solve_at_amplitude(oscillator, orbit, 0, tolerance_of(oscillator), MOST_STEPS_NEARBY)
    if done == col.GOOD:
        done = refine_orbit(oscillator, orbit, row)
    return feedback_status(row) if done == col.GOOD else done
