"""An orbit by collocation, refined until its error is what was asked for."""

from __future__ import annotations

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator
from phasemap._kernels.lever import free_amplitude, scale_of
from phasemap._kernels.orbits.collocation.elements import lay_again
from phasemap._kernels.orbits.collocation.newton import (
    MOST_NEWTON_STEPS,
    fill_row,
    solve_at_amplitude,
)
from phasemap._kernels.orbits.collocation.system import Orbit, head_of

LAST_CHANGE = 2e-14  # [m], last change of an orbit; the error left is its square over the depth of the contact
LAST_CHANGE_RELATIVE = 1e-4  # of the free amplitude, the same for amplitudes of picometres
FINEST_LEVEL = 2  # level of refinement
MOST_IMBALANCE = 1e-7  # largest energy imbalance accepted from a coarser level
WORST_IMBALANCE = 1e-5  # of an orbit that is an answer


@kernel
def tolerance_of(oscillator: Oscillator) -> float:
    """Last change [m] of an orbit that is converged."""
    lever = oscillator.lever
    free = free_amplitude(lever)
    return min(min(LAST_CHANGE, LAST_CHANGE_RELATIVE * free), 1e-3 * scale_of(oscillator, free))


@kernel
def feedback_status(row: np.ndarray) -> int:
    """Status of an orbit under feedback: GOOD if it is stable and its tip offset rises with the amplitude."""
    if not row[col.FLOQUET] < 1.0:
        return col.UNSTABLE
    return col.GOOD if row[col.SLOPE] > 0.0 else col.NO_STABLE_ORBIT


@kernel(shared=True)
def refine_orbit(oscillator: Oscillator, orbit: Orbit, row: np.ndarray) -> int:
    """Fill the row of a converged orbit, on finer elements if the energy does not close."""
    status = fill_row(oscillator, orbit, row)
    level, tolerance = head_of(orbit).level, tolerance_of(oscillator)
    while status == col.GOOD and abs(row[col.CLOSURE]) > MOST_IMBALANCE and level < FINEST_LEVEL:
        level += 1
        if not lay_again(oscillator, orbit, level):
            break
        fine = solve_at_amplitude(oscillator, orbit, level, tolerance, MOST_NEWTON_STEPS)
        if fine != col.GOOD:
            break
        status = fill_row(oscillator, orbit, row)
    if status == col.GOOD and abs(row[col.CLOSURE]) > WORST_IMBALANCE:
        status = col.NOT_CONVERGED
    return status
