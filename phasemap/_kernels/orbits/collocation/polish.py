"""An orbit by collocation, refined until its error is what was asked for."""

from __future__ import annotations

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Oscillator
from phasemap._kernels.lever import free_amplitude, scale_of
from phasemap._kernels.orbits.collocation.contacts import find_contacts
from phasemap._kernels.orbits.collocation.elements import carry_over, lay
from phasemap._kernels.orbits.collocation.newton import MOST_STEPS, newton, report
from phasemap._kernels.orbits.collocation.system import COUNT, HOLD_AMPLITUDE, LEVEL, Orbit

TOLERANCE = 2e-14  # [m], last change of an orbit; the error left is its square over the depth of the contact
RELATIVE = 1e-4  # of the free amplitude, the same for amplitudes of picometres
FINEST = 2  # level of refinement
CLOSURE = 1e-7  # largest energy imbalance accepted from a coarser level


@kernel
def tolerance_of(oscillator: Oscillator) -> float:
    """Last change [m] of an orbit that is converged."""
    lever = oscillator.lever
    free = free_amplitude(lever)
    return min(min(TOLERANCE, RELATIVE * free), 1e-3 * scale_of(oscillator, free))


@kernel
def judge(row: np.ndarray) -> int:
    """Whether the controller can hold this orbit: it must be stable, and the feedback must have the right sign."""
    if not row[col.FLOQUET] < 1.0:
        return col.UNSTABLE
    return col.GOOD if row[col.SLOPE] > 0.0 else col.NO_STABLE_ORBIT


@kernel
def polish(
    oscillator: Oscillator, tables: np.ndarray, orbit: Orbit, spare: Orbit, row: np.ndarray
) -> tuple[int, Orbit, Orbit]:
    """Fill the row of a converged orbit, on finer elements if the energy does not close."""
    p = oscillator.p
    status = report(oscillator, tables, orbit, row)
    level, target, tolerance = int(orbit.head[COUNT, LEVEL]), np.zeros(4), tolerance_of(oscillator)
    while status == col.GOOD and abs(row[col.CLOSURE]) > CLOSURE and level < FINEST:
        level += 1
        if not find_contacts(p, tables, orbit) or not lay(oscillator, tables, spare, orbit, level):
            break
        carry_over(tables, orbit, spare)
        orbit, spare = spare, orbit
        fine, _, orbit, spare = newton(
            oscillator, tables, orbit, spare, HOLD_AMPLITUDE, target, level, tolerance, MOST_STEPS
        )
        if fine != col.GOOD:
            break
        status = report(oscillator, tables, orbit, row)
    return status, orbit, spare
