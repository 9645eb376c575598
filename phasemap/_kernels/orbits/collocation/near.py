"""The exact orbit beside a harmonic one: Newton's method from there, on finer elements until its energy closes."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator
from phasemap._kernels.lever import free_amplitude, low_q, scale_of
from phasemap._kernels.orbits.collocation.elements import lay_again
from phasemap._kernels.orbits.collocation.impact import begin_impact
from phasemap._kernels.orbits.collocation.newton import (
    MOST_NEWTON_STEPS,
    begin_harmonic,
    fill_row_of_orbit,
    solve_at_amplitude,
)
from phasemap._kernels.orbits.collocation.system import Orbit, element_of, head_of
from phasemap._kernels.orbits.result_row import feedback_status
from phasemap._kernels.quadrature import NODES

LAST_CHANGE = 2e-14  # [m], last change of an orbit; the error left is its square over the depth of the contact
LAST_CHANGE_RELATIVE = 1e-4  # of the free amplitude, the same for amplitudes of picometres
FINEST_LEVEL = 2  # level of refinement
MOST_IMBALANCE = 1e-7  # largest energy imbalance accepted from a coarser level
WORST_IMBALANCE = 1e-5  # of an orbit that is an answer
MOST_STEPS_NEARBY = 12  # of Newton's method


@kernel
def tolerance_of(oscillator: Oscillator) -> float:
    """Last change [m] of an orbit that is converged."""
    lever = oscillator.lever
    free = free_amplitude(lever)
    return min(min(LAST_CHANGE, LAST_CHANGE_RELATIVE * free), 1e-3 * scale_of(oscillator))


@kernel(shared=True)
def refine_orbit(oscillator: Oscillator, orbit: Orbit, row: np.ndarray) -> int:
    """Fill the row of a converged orbit, on finer elements if the energy does not close."""
    status = fill_row_of_orbit(oscillator, orbit, row)
    level, tolerance = head_of(orbit).level, tolerance_of(oscillator)
    while status == col.GOOD and abs(row[col.CLOSURE]) > MOST_IMBALANCE and level < FINEST_LEVEL:
        level += 1
        if not lay_again(oscillator, orbit, level):
            break
        fine = solve_at_amplitude(oscillator, orbit, level, tolerance, MOST_NEWTON_STEPS)
        if fine != col.GOOD:
            break
        status = fill_row_of_orbit(oscillator, orbit, row)
    if status == col.GOOD and abs(row[col.CLOSURE]) > WORST_IMBALANCE:
        status = col.NOT_CONVERGED
    return status


@kernel
def depth_at_nodes(orbit: Orbit) -> float:
    """Largest depth at the nodes [m]."""
    deepest, head = -math.inf, head_of(orbit)
    for e in range(head.count):
        one = element_of(orbit, e)
        for j in range(NODES):
            deepest = max(deepest, head.amplitude * one.cos[j] + one.w[j])
    return deepest - head.tip_offset


@kernel(shared=True)
def orbit_near(oscillator: Oscillator, guess: np.ndarray, orbit: Orbit, row: np.ndarray) -> tuple[int, float]:
    """Exact orbit from a harmonic one, guess = (z0, mean deflection, A, P, S): its row, and how far it is from it [m].

    The status is that under feedback; which orbit it is, is for the caller to see. It is as near as tip offset or depth
    are: harmonics that lift the tip do not bring it to another branch.
    """
    tolerance, done, start, deep = tolerance_of(oscillator), col.NOT_CONVERGED, math.nan, math.nan
    # A lever of low Q that is thrown back begins with the motion after a kick; finer elements change less by a step.
    thrown = low_q(oscillator.lever) and guess[col.G_P] > 0.0
    for attempt in range(2 if thrown else FINEST_LEVEL + 1):
        level = 0 if thrown else attempt
        if not (thrown and attempt == 0 and begin_impact(oscillator, orbit, guess[col.G_A], level)):
            if not begin_harmonic(oscillator, orbit, guess, level):
                break
        start, deep = head_of(orbit).tip_offset, depth_at_nodes(orbit)
        done = solve_at_amplitude(oscillator, orbit, level, tolerance, MOST_STEPS_NEARBY)
        if done == col.GOOD:
            done = refine_orbit(oscillator, orbit, row)
            break
    harmonic = guess[col.G_A] - guess[col.G_Z0] + guess[col.G_MEAN]
    deeper = min(abs(row[col.INDENTATION] - deep), abs(row[col.INDENTATION] - harmonic))
    away = min(abs(row[col.TIP_OFFSET] - start), deeper)
    return feedback_status(row) if done == col.GOOD else done, away


@kernel
def orbit_from(oscillator: Oscillator, guess: np.ndarray, orbit: Orbit, row: np.ndarray) -> int:
    """Exact orbit from another one, with amplitude, tip offset, P and S of a guess: its status and row."""
    head = head_of(orbit)
    head.amplitude, head.tip_offset = guess[col.G_A], guess[col.G_Z0]
    head.push, head.drag = guess[col.G_P], guess[col.G_S]
    if not lay_again(oscillator, orbit, head.level):
        return col.NOT_CONVERGED
    done = solve_at_amplitude(oscillator, orbit, 0, tolerance_of(oscillator), MOST_STEPS_NEARBY)
    if done == col.GOOD:
        done = refine_orbit(oscillator, orbit, row)
    return feedback_status(row) if done == col.GOOD else done
