"""Orbits by collocation, for the pixels that the cheap path leaves, and every orbit of one pixel.

Which orbit the controller finds is decided alike for all solvers: by averaging where that is safe, by exact orbits near
the end of a branch, and along the whole curve of exact orbits where that is not enough.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from phasemap._kernels import columns as col
from phasemap._kernels.approach import SURE, averaged_orbits
from phasemap._kernels.collect import collect, seed
from phasemap._kernels.collocation import COUNT, HOLD_AMPLITUDE, LEVEL, Orbit, new_orbit
from phasemap._kernels.estimate import state_errors
from phasemap._kernels.law import OPTIONS, Law, parameters
from phasemap._kernels.lever import free_amplitude, scale_of
from phasemap._kernels.mesh import carry_over, find_contacts, lay
from phasemap._kernels.orbit import MOST_STEPS, begin, newton, report
from phasemap._kernels.path import fixed
from phasemap._kernels.quick import LOWEST_Q, engage, farthest
from phasemap._kernels.resonance import MAXIMUM
from phasemap._kernels.snap import HANGING
from phasemap._kernels.trace import engage as engage_exact
from phasemap._kernels.trace import engage_near

TOLERANCE = 2e-14  # [m], last change of an orbit; the error left is its square over the depth of the contact
RELATIVE = 1e-4  # of the free amplitude, the same for amplitudes of picometres
FINEST = 2  # level of refinement
MOST_ORBITS = 40
THROWN = 0.08  # of the amplitude, by which a guess is lifted for orbits that a strong pull makes
Orbits = tuple[Orbit, Orbit, Orbit, Orbit]
CLOSURE = 1e-7  # largest energy imbalance accepted from a coarser level


@njit(**OPTIONS)
def tolerance_of(law: Law, p: np.ndarray, lever: np.ndarray) -> float:
    """Last change [m] of an orbit that is converged."""
    free = free_amplitude(lever)
    return min(min(TOLERANCE, RELATIVE * free), 1e-3 * scale_of(law, p, lever, free))


@njit(**OPTIONS)
def judge(row: np.ndarray) -> int:
    """Whether the controller can hold this orbit: it must be stable, and the feedback must have the right sign."""
    if not row[col.FLOQUET] < 1.0:
        return col.UNSTABLE
    return col.GOOD if row[col.SLOPE] > 0.0 else col.NO_STABLE_ORBIT


@njit(**OPTIONS)
def polish(
    law: Law, p: np.ndarray, lever: np.ndarray, tables: np.ndarray, orbit: Orbit, spare: Orbit, row: np.ndarray
) -> tuple[int, Orbit, Orbit]:
    """Fill the row of a converged orbit, on finer elements if the energy does not close."""
    status = report(law, p, lever, tables, orbit, row)
    level, target, tolerance = int(orbit.head[COUNT, LEVEL]), np.zeros(4), tolerance_of(law, p, lever)
    while status == col.GOOD and abs(row[col.CLOSURE]) > CLOSURE and level < FINEST:
        level += 1
        if not find_contacts(p, tables, orbit) or not lay(law, p, lever, tables, spare, orbit, level):
            break
        carry_over(tables, orbit, spare)
        orbit, spare = spare, orbit
        fine, _, orbit, spare = newton(
            law, p, lever, tables, orbit, spare, HOLD_AMPLITUDE, target, level, tolerance, MOST_STEPS
        )
        if fine != col.GOOD:
            break
        status = report(law, p, lever, tables, orbit, row)
    return status, orbit, spare


@njit(**OPTIONS)
def exact_orbit(
    law: Law, p: np.ndarray, lever: np.ndarray, tables: np.ndarray, amplitude: float, surety: int, guess: np.ndarray,
    orbits: Orbits, row: np.ndarray,
) -> tuple[int, Orbits]:  # fmt: skip
    """Exact orbit by collocation: from the averaged one where that is sure, else followed along the exact curve."""
    orbit, spare, saved, found = orbits
    target, tolerance = np.zeros(4), tolerance_of(law, p, lever)
    level = 0 if surety == SURE else FINEST + 1
    while level <= FINEST and begin(law, p, lever, tables, orbit, guess, level):
        done, _, orbit, spare = newton(
            law, p, lever, tables, orbit, spare, HOLD_AMPLITUDE, target, level, tolerance, 12
        )
        level += 1
        if done != col.GOOD:
            continue  # finer elements change less from pass to pass
        done, orbit, spare = polish(law, p, lever, tables, orbit, spare, row)
        same = (row[col.STIFFENING] > 0.0) == (guess[3] > 0.0)
        near = abs(row[col.TIP_OFFSET] - guess[0]) < farthest(lever, amplitude)
        if done == col.GOOD and same and near and judge(row) == col.GOOD:
            state_errors(law, p, lever, tables, orbit, spare, row)
            return col.GOOD, (orbit, spare, saved, found)
        break
    done, path = col.NOT_CONVERGED, fixed(law, p, lever)
    if lever[col.ALPHA0] < 0.5 / LOWEST_Q:
        done, orbit, spare, found = engage_near(
            law, fixed(law, p, lever), tables, amplitude, tolerance, orbit, spare, saved, found
        )
    # Finer elements where it fails; where the tip lands nowhere, the curve itself may still come back.
    level, hanging, done = 0, HANGING, done if done == col.GOOD else col.NOT_SETTLED
    while done != col.GOOD:
        done, orbit, spare, found = engage_exact(
            law, path, tables, amplitude, level, tolerance, hanging, orbit, spare, saved, found
        )
        if done == col.NOT_SETTLED and hanging < math.inf:
            level, hanging = 0, math.inf
        elif done == col.NOT_CONVERGED and level == 0 and hanging < math.inf:
            level = 1
        else:
            break
    if done == col.NOT_SETTLED:
        done = col.NOT_CONVERGED
    if done == col.GOOD:
        done, found, spare = polish(law, p, lever, tables, found, spare, row)
    if done == col.GOOD:
        done = judge(row)
    if done == col.GOOD:
        state_errors(law, p, lever, tables, found, spare, row)
    else:
        row[:] = math.nan
    return done, (orbit, spare, saved, found)


@njit(**OPTIONS)
def exact_rows(
    law: Law,
    rows: np.ndarray,
    lever: np.ndarray,
    tables: np.ndarray,
    amplitudes: np.ndarray,
    first: int,
    last: int,
    out: np.ndarray,
    status: np.ndarray,
    solver: np.ndarray,
) -> None:
    """Orbit by collocation of every row in [first, last) whose status is PENDING."""
    orbits = (new_orbit(), new_orbit(), new_orbit(), new_orbit())
    guess, top = np.zeros(6), np.zeros(MAXIMUM)
    for i in range(first, last):
        if status[i] != col.PENDING:
            continue
        p, amplitude, row = parameters(rows[i]), amplitudes[i], out[i]
        row[:] = math.nan
        surety = engage(law, p, lever, amplitude, guess, top)
        status[i], orbits = exact_orbit(law, p, lever, tables, amplitude, surety, guess, orbits, row)
        solver[i] = col.ORBIT


@njit(**OPTIONS)
def every_orbit(
    law: Law, row: np.ndarray, lever: np.ndarray, tables: np.ndarray, hold: int, value: float
) -> tuple[int, np.ndarray]:
    """Rows of every orbit found with this amplitude or tip offset, stable or not, far to near."""
    p = parameters(row)
    path = fixed(law, p, lever)
    found = np.zeros((MOST_ORBITS, col.COLUMNS))
    level, tolerance = 1, 1e-3 * tolerance_of(law, p, lever)
    status, count = collect(law, path, tables, hold, value, level, tolerance, found)
    if hold == HOLD_AMPLITUDE:
        for amplitude in (value, 0.97 * value, 1.03 * value, 0.88 * value, 1.12 * value):
            guesses = averaged_orbits(law, p, lever, amplitude)
            if amplitude == value or len(guesses) > count:
                count = seed(law, path, tables, value, guesses, level, tolerance, found, count)
        # A strong pull throws the tip out of its harmonic orbit, whose contact is then too deep to start from.
        guesses = averaged_orbits(law, p, lever, value)
        guesses[:, 0] += THROWN * value
        count = seed(law, path, tables, value, guesses, level, tolerance, found, count)
    return status, found[:count]
