"""The exact orbit beside a harmonic one: Newton's method from there, on finer elements where it does not converge."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator
from phasemap._kernels.lever import low_q
from phasemap._kernels.orbits.collocation.elements import lay_again
from phasemap._kernels.orbits.collocation.impact import begin_impact
from phasemap._kernels.orbits.collocation.newton import begin_harmonic, solve_at_amplitude
from phasemap._kernels.orbits.collocation.polish import FINEST_LEVEL, feedback_status, refine_orbit, tolerance_of
from phasemap._kernels.orbits.collocation.system import Orbit, element_of, head_of
from phasemap._kernels.quadrature import NODES

MOST_STEPS_NEARBY = 12  # of Newton's method
SAME_ORBIT = 1e-4  # of the amplitude, and radians: nearer than this it is the same orbit


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


@kernel
def guess_of_row(lever: np.ndarray, row: np.ndarray, guess: np.ndarray) -> None:
    """Fill in the harmonic orbit of a result row of the tip."""
    amplitude = row[col.AMPLITUDE]
    guess[col.G_Z0], guess[col.G_MEAN], guess[col.G_A] = row[col.TIP_OFFSET], row[col.MEAN], amplitude
    guess[col.G_P] = lever[col.DRIVE] * math.sin(row[col.PHASE]) - amplitude * lever[col.DYNAMIC_STIFFNESS]
    guess[col.G_S] = amplitude * lever[col.DYNAMIC_LOSS] - lever[col.DRIVE] * math.cos(row[col.PHASE])


@kernel
def same_orbit(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two result rows are of the same orbit."""
    apart = abs(one[col.TIP_OFFSET] - other[col.TIP_OFFSET]) / one[col.AMPLITUDE]
    return max(apart, abs(one[col.PHASE] - other[col.PHASE])) < SAME_ORBIT
