"""Loops over pixels: parameter rows in, result rows and status codes out.

Each loop works on a slice and can run in a thread of its own (nogil). Which orbit the controller finds
is decided alike for all solvers: by the averaged curve where that is safe, by the curve of exact orbits elsewhere.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from phasemap._kernels import columns as col
from phasemap._kernels.approach import (
    DOUBTFUL,
    SURE,
    averaged_orbits,
    far_start,
    free_amplitude,
    question,
    scale_of,
)
from phasemap._kernels.approach import engage as engage_averaged
from phasemap._kernels.collocation import HOLD_AMPLITUDE, Orbit, new_orbit
from phasemap._kernels.corrected import ERR_HEIGHT, ERR_PHASE, HEIGHT, PHASE
from phasemap._kernels.corrected import report as report_corrected
from phasemap._kernels.law import OPTIONS, Law
from phasemap._kernels.march import approach, settle
from phasemap._kernels.mesh import carry_over, find_contacts, lay, reach_of
from phasemap._kernels.orbit import MOST_STEPS, begin, newton, report
from phasemap._kernels.quick import cheap_orbit, new_room
from phasemap._kernels.resonance import MAXIMUM
from phasemap._kernels.trace import collect, engage_near, seed
from phasemap._kernels.trace import engage as engage_exact

LOWEST_Q = 25.0  # below this averaging does not choose the branch
TOLERANCE = 2e-14  # [m], last change of an orbit; the error left is its square over the depth of the contact
FINEST = 2  # level of refinement
MOST_ORBITS = 40
MOST_PERIODS = 200_000  # that a march may take to settle
EXACT_PHASE, EXACT_HEIGHT = 2e-8, 1e-15  # [rad, m], errors left by collocation, found against independent orbits
Orbits = tuple[Orbit, Orbit, Orbit, Orbit]
CLOSURE = 1e-7  # largest energy imbalance accepted from a coarser level


@njit(**OPTIONS)
def parameters(row: np.ndarray) -> tuple[float, ...]:
    """A parameter row as numbers: passed by value, it costs no reference counts in the innermost calls."""
    return (
        row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7], row[8], row[9], row[10], row[11]
    )  # fmt: skip


@njit(**OPTIONS)
def tolerance_of(law: Law, p: np.ndarray, lever: np.ndarray) -> float:
    """Last change [m] of an orbit that is converged."""
    return min(TOLERANCE, 1e-3 * scale_of(law, p, lever, free_amplitude(lever)))


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
    level, target, tolerance = 0, np.zeros(4), tolerance_of(law, p, lever)
    while status == col.GOOD and abs(row[col.CLOSURE]) > CLOSURE and level < FINEST:
        level += 1
        if not find_contacts(tables, orbit) or not lay(law, p, lever, tables, spare, orbit, level):
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
def averaged_row(lever: np.ndarray, guess: np.ndarray, row: np.ndarray) -> None:
    """Fill a result row from an averaged orbit, guess = (z0, mean deflection, A, P, S)."""
    stiffness = lever[col.STIFFNESS]
    z0, mean, amplitude, push, drag = guess[0], guess[1], guess[2], guess[3], guess[4]
    row[:] = math.nan
    row[col.TIP_OFFSET], row[col.MEAN], row[col.AMPLITUDE] = z0, mean, amplitude
    row[col.PHASE] = phase_of(lever, guess)
    row[col.INDENTATION] = amplitude + mean - z0
    row[col.DISSIPATION] = -math.pi * stiffness * amplitude * drag
    row[col.VIRIAL] = stiffness * (mean * mean - 0.5 * amplitude * push)
    row[col.STIFFENING] = push / amplitude


@njit(**OPTIONS)
def phase_of(lever: np.ndarray, guess: np.ndarray) -> float:
    """Phase [rad] from (z0, mean deflection, A, P, S)."""
    omega = lever[col.OMEGA]
    return math.atan2(
        guess[3] + guess[2] * (1.0 - omega * omega), 2.0 * lever[col.ALPHA0] * omega * guess[2] - guess[4]
    )


@njit(**OPTIONS)
def averaging_suffices(
    lever: np.ndarray, guess: np.ndarray, state: np.ndarray, limits: np.ndarray, row: np.ndarray
) -> bool:
    """Whether the averaged orbit is within `limits` (phase [rad], height [m]) of the exact one; then fills its row."""
    phase_error = abs(phase_of(lever, guess) - state[PHASE]) + state[ERR_PHASE]
    height_error = abs(guess[0] - state[HEIGHT]) + state[ERR_HEIGHT]
    if not (phase_error < limits[0] and height_error < limits[1]):
        return False
    averaged_row(lever, guess, row)
    row[col.ERROR_PHASE], row[col.ERROR_HEIGHT] = phase_error, height_error
    return True


@njit(**OPTIONS)
def exact_orbit(
    law: Law, p: np.ndarray, lever: np.ndarray, tables: np.ndarray, amplitude: float, surety: int, guess: np.ndarray,
    orbits: Orbits, row: np.ndarray,
) -> tuple[int, Orbits]:  # fmt: skip
    """Exact orbit by collocation: from the averaged one where that is sure, else followed along the exact curve."""
    orbit, spare, saved, found = orbits
    target, tolerance = np.zeros(4), tolerance_of(law, p, lever)
    done = col.NOT_CONVERGED
    if surety == SURE and begin(law, p, lever, tables, orbit, guess, 0):
        done, _, orbit, spare = newton(law, p, lever, tables, orbit, spare, HOLD_AMPLITUDE, target, 0, tolerance, 12)
        if done == col.GOOD:
            done, orbit, spare = polish(law, p, lever, tables, orbit, spare, row)
        same = (row[col.STIFFENING] > 0.0) == (guess[3] > 0.0)
        if done == col.GOOD and same and judge(row) == col.GOOD:
            row[col.ERROR_PHASE], row[col.ERROR_HEIGHT] = EXACT_PHASE, EXACT_HEIGHT
            return col.GOOD, (orbit, spare, saved, found)
    done = col.NOT_CONVERGED
    if lever[col.ALPHA0] < 0.5 / LOWEST_Q:
        done, orbit, spare, found = engage_near(law, p, lever, tables, amplitude, tolerance, orbit, spare, saved, found)
    if done != col.GOOD:
        done, orbit, spare, found = engage_exact(
            law, p, lever, tables, amplitude, 0, tolerance, orbit, spare, saved, found
        )
    if done == col.GOOD:
        done, found, spare = polish(law, p, lever, tables, found, spare, row)
    if done == col.GOOD:
        done = judge(row)
    if done == col.GOOD:
        row[col.ERROR_PHASE], row[col.ERROR_HEIGHT] = EXACT_PHASE, EXACT_HEIGHT
    else:
        row[:] = math.nan
    return done, (orbit, spare, saved, found)


@njit(**OPTIONS)
def orbit_rows(
    law: Law,
    rows: np.ndarray,
    lever: np.ndarray,
    tables: np.ndarray,
    amplitudes: np.ndarray,
    limits: np.ndarray,
    average: bool,
    first: int,
    last: int,
    out: np.ndarray,
    status: np.ndarray,
    solver: np.ndarray,
) -> None:
    """Orbit of every row in [first, last) after engagement.

    limits = (phase [rad], height [m]) lets a cheaper orbit stand where its error is smaller, the averaged one with
    `average`; zeros ask for collocation. `solver` receives col.AVERAGING, col.CORRECTED or col.ORBIT.
    """
    orbits = (new_orbit(), new_orbit(), new_orbit(), new_orbit())
    room = new_room()
    guess = np.zeros(6)
    high_q = lever[col.ALPHA0] < 0.5 / LOWEST_Q
    for i in range(first, last):
        p, amplitude, row = parameters(rows[i]), amplitudes[i], out[i]
        row[:] = math.nan
        if high_q:
            averaged, surety = engage_averaged(law, p, lever, amplitude, guess, room.top)
            if averaged != col.GOOD:
                surety = DOUBTFUL
        else:
            surety = question(law, p, lever, amplitude, room.top)
        if limits[0] > 0.0 and cheap_orbit(law, p, lever, amplitude, surety, limits, guess, room):
            status[i] = col.GOOD
            if average and averaging_suffices(lever, guess, room.state, limits, row):
                solver[i] = col.AVERAGING
            else:
                report_corrected(lever, room.nodes, room.state, row)
                solver[i] = col.CORRECTED
            continue
        status[i], orbits = exact_orbit(law, p, lever, tables, amplitude, surety, guess, orbits, row)
        solver[i] = col.ORBIT


@njit(**OPTIONS)
def averaging_rows(
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
    """First-order averaged orbit of every row in [first, last), on the branch that engagement finds."""
    guess, top, exact = np.zeros(6), np.zeros(MAXIMUM), np.zeros(2)
    one, one_status, one_solver = np.zeros((1, col.COLUMNS)), np.zeros(1, np.int8), np.zeros(1, np.int8)
    high_q = lever[col.ALPHA0] < 0.5 / LOWEST_Q
    for i in range(first, last):
        p, amplitude = parameters(rows[i]), amplitudes[i]
        out[i] = math.nan
        solver[i] = col.AVERAGING
        done, surety = engage_averaged(law, p, lever, amplitude, guess, top)
        if not high_q or done != col.GOOD or surety != SURE:
            orbit_rows(
                law,
                rows[i : i + 1],
                lever,
                tables,
                amplitudes[i : i + 1],
                exact,
                False,
                0,
                1,
                one,
                one_status,
                one_solver,
            )
            done = one_status[0]
            if done == col.GOOD:
                done = nearest(averaged_orbits(law, p, lever, amplitude), one[0], guess)
        status[i] = done
        if done == col.GOOD:
            averaged_row(lever, guess, out[i])


@njit(**OPTIONS)
def nearest(candidates: np.ndarray, row: np.ndarray, guess: np.ndarray) -> int:
    """Fill `guess` with the averaged orbit nearest to the exact one of `row`, on the same side of free stiffness."""
    best = math.inf
    for i in range(len(candidates)):
        apart = abs(candidates[i, 0] - row[col.TIP_OFFSET])
        if (candidates[i, 3] > 0.0) == (row[col.STIFFENING] > 0.0) and apart < best:
            best = apart
            guess[:5] = candidates[i]
    return col.GOOD if best < math.inf else col.NO_AVERAGED_ORBIT


@njit(**OPTIONS)
def every_orbit(
    law: Law, row: np.ndarray, lever: np.ndarray, tables: np.ndarray, hold: int, value: float
) -> tuple[int, np.ndarray]:
    """Rows of every orbit found with this amplitude or tip offset, stable or not, far to near."""
    p = parameters(row)
    found = np.zeros((MOST_ORBITS, col.COLUMNS))
    level, tolerance = 1, 1e-3 * tolerance_of(law, p, lever)
    status, count = collect(law, p, lever, tables, hold, value, level, tolerance, found)
    if hold == HOLD_AMPLITUDE:
        for amplitude in (value, 0.97 * value, 1.03 * value, 0.88 * value, 1.12 * value):
            guesses = averaged_orbits(law, p, lever, amplitude)
            if amplitude == value or len(guesses) > count:
                count = seed(law, p, lever, tables, value, guesses, level, tolerance, found, count)
    return status, found[:count]


@njit(**OPTIONS)
def march_rows(
    law: Law,
    rows: np.ndarray,
    lever: np.ndarray,
    tables: np.ndarray,
    amplitudes: np.ndarray,
    eta: float,
    first: int,
    last: int,
    out: np.ndarray,
    status: np.ndarray,
    solver: np.ndarray,
) -> None:
    """Settled orbit of every row in [first, last) by time integration, started near the orbit that engagement finds.

    Where neither averaging nor the curve of exact orbits says which one that is, the tip is engaged from far in time.
    """
    guess, top, exact, start = np.zeros(6), np.zeros(MAXIMUM), np.zeros(2), np.zeros(4)
    one, one_status, one_solver = np.zeros((1, col.COLUMNS)), np.zeros(1, np.int8), np.zeros(1, np.int8)
    high_q = lever[col.ALPHA0] < 0.5 / LOWEST_Q
    free = free_amplitude(lever)
    for i in range(first, last):
        p, amplitude = parameters(rows[i]), amplitudes[i]
        solver[i] = col.MARCH
        done, surety = engage_averaged(law, p, lever, amplitude, guess, top)
        start[0], start[1], start[2], start[3] = guess[0], guess[1], amplitude, 0.5 * math.pi - phase_of(lever, guess)
        if not high_q or done != col.GOOD or surety != SURE:
            orbit_rows(
                law,
                rows[i : i + 1],
                lever,
                tables,
                amplitudes[i : i + 1],
                exact,
                False,
                0,
                1,
                one,
                one_status,
                one_solver,
            )
            done = one_status[0]
            start[0], start[1], start[3] = one[0, col.TIP_OFFSET], one[0, col.MEAN], 0.5 * math.pi - one[0, col.PHASE]
        if done == col.GOOD:
            done = settle(law, rows[i], lever, amplitude, start, eta, 1.0, MOST_PERIODS, out[i])
        elif done == col.NOT_CONVERGED or done == col.TOO_MANY_CONTACTS:
            far = free * far_start(law, p, lever, reach_of(law, p), free, amplitude)
            step = 0.1 * scale_of(law, p, lever, free) + 1e-3 * free
            done = approach(law, rows[i], lever, amplitude, far, step, eta, 1.0, MOST_PERIODS, out[i])
        if done != col.GOOD:
            out[i] = math.nan
        status[i] = done
