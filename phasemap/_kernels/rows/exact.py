"""Orbits by collocation, for the pixels that the cheap path leaves, and every orbit of one pixel.

Which orbit the controller finds is decided alike for all solvers: by averaging where that is safe, by exact orbits near
the end of a branch, and along the whole curve of exact orbits where that is not enough.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.continuation.path import ENTRY_A, fixed_path
from phasemap._kernels.continuation.step import Wanted
from phasemap._kernels.engagement.averaged import LEAP, SURE
from phasemap._kernels.engagement.exact import Rooms, engage_along_exact_curve, engage_near
from phasemap._kernels.engagement.rebound import rebounds
from phasemap._kernels.engagement.resonance import Maximum
from phasemap._kernels.engagement.response import engage_by_response
from phasemap._kernels.engagement.rest import LINGERING
from phasemap._kernels.law import Law, Oscillator, parameters
from phasemap._kernels.lever import low_q
from phasemap._kernels.orbits.collocation.estimate import estimate_errors
from phasemap._kernels.orbits.collocation.impact import begin_impact
from phasemap._kernels.orbits.collocation.newton import begin_harmonic, solve_at_amplitude
from phasemap._kernels.orbits.collocation.polish import FINEST_LEVEL, feedback_status, refine_orbit, tolerance_of
from phasemap._kernels.orbits.collocation.system import head_of, new_orbit
from phasemap._kernels.orbits.response.orbit import largest_branch_distance
from phasemap._kernels.rows.answers import Answers


@kernel
def _orbit_near(
    oscillator: Oscillator, tables: np.ndarray, amplitude: float, guess: np.ndarray, rooms: Rooms, row: np.ndarray
) -> tuple[bool, Rooms]:
    """Exact orbit near the averaged one, in its row; True if it is found, on the same branch, and can be held."""
    orbit, spare, saved, found = rooms
    lever, tolerance = oscillator.lever, tolerance_of(oscillator)
    kicked = low_q(lever) and guess[col.G_P] > 0.0
    good = False
    for level in range(FINEST_LEVEL + 1):
        if not (kicked and level == 0 and begin_impact(oscillator, tables, orbit, amplitude, level)):
            if not begin_harmonic(oscillator, tables, orbit, guess, level):
                break
        start = head_of(orbit).tip_offset
        done, _, orbit, spare = solve_at_amplitude(oscillator, tables, orbit, spare, level, tolerance, 12)
        if done != col.GOOD:
            continue  # finer elements change less from pass to pass
        done, orbit, spare = refine_orbit(oscillator, tables, orbit, spare, row)
        same = (row[col.STIFFENING] > 0.0) == (guess[col.G_P] > 0.0)
        near = abs(row[col.TIP_OFFSET] - start) < largest_branch_distance(lever, amplitude)
        good = done == col.GOOD and same and near and feedback_status(row) == col.GOOD
        if good:
            estimate_errors(oscillator, tables, orbit, spare, row)
        break
    return good, Rooms(orbit, spare, saved, found)


@kernel
def _orbit_along_curve(oscillator: Oscillator, tables: np.ndarray, amplitude: float, rooms: Rooms) -> tuple[int, Rooms]:
    """Exact orbit at which a tip stops that is lowered, in `found` of the rooms; returns a status.

    On finer elements where it fails; where the tip lands nowhere, the curve itself may still come back.
    """
    path, wanted = fixed_path(oscillator, tables), Wanted(ENTRY_A, amplitude, tolerance_of(oscillator))
    if not low_q(oscillator.lever):
        done, rooms = engage_near(path, wanted, rooms)
        if done == col.GOOD:
            return done, rooms
    level, lingering = 0, LINGERING
    while True:
        done, rooms = engage_along_exact_curve(path, wanted, level, lingering, rooms)
        if done == col.NOT_SETTLED and lingering < math.inf:
            level, lingering = 0, math.inf
        elif done == col.NOT_CONVERGED and level == 0 and lingering < math.inf:
            level = 1
        else:
            return col.NOT_CONVERGED if done == col.NOT_SETTLED else done, rooms


@kernel
def exact_orbit(
    oscillator: Oscillator, tables: np.ndarray, amplitude: float, surety: int, guess: np.ndarray,
    rooms: Rooms, row: np.ndarray,
) -> tuple[int, Rooms]:  # fmt: skip
    """Exact orbit by collocation: from the averaged one where that is sure, else followed along the exact curve.

    Where a tip leaps and lands, or rebounds, no curve tells: NOT_CONVERGED.
    """
    if surety == LEAP:
        row[:] = math.nan
        return col.NOT_CONVERGED, rooms
    if surety == SURE:
        good, rooms = _orbit_near(oscillator, tables, amplitude, guess, rooms, row)
        if good:
            return col.GOOD, rooms
    done, rooms = _orbit_along_curve(oscillator, tables, amplitude, rooms)
    orbit, spare, saved, found = rooms
    if done == col.GOOD:
        done, found, spare = refine_orbit(oscillator, tables, found, spare, row)
    if done == col.GOOD:
        done = feedback_status(row)
    if done == col.GOOD and rebounds(oscillator, row[col.STIFFENING] * amplitude):
        done = col.NOT_CONVERGED
    if done == col.GOOD:
        estimate_errors(oscillator, tables, found, spare, row)
    else:
        row[:] = math.nan
    return done, Rooms(orbit, spare, saved, found)


@kernel
def exact_rows(
    law: Law,
    rows: np.ndarray,
    lever: np.ndarray,
    tables: np.ndarray,
    amplitudes: np.ndarray,
    first: int,
    last: int,
    answers: Answers,
) -> None:
    """Orbit by collocation of every row in [first, last) whose status is PENDING, near the guess it holds if any."""
    out, status, solver = answers
    rooms = Rooms(new_orbit(lever), new_orbit(lever), new_orbit(lever), new_orbit(lever))
    guess, top = np.zeros(col.GUESS), Maximum()
    for i in range(first, last):
        if status[i] != col.PENDING:
            continue
        p, amplitude, row, surety = parameters(rows[i]), amplitudes[i], out[i], SURE
        for j in range(len(guess)):
            guess[j] = row[j]
        if math.isnan(guess[0]):
            surety = engage_by_response(Oscillator(law, p, lever), amplitude, guess, top)
        row[:] = math.nan
        status[i], rooms = exact_orbit(Oscillator(law, p, lever), tables, amplitude, surety, guess, rooms, row)
        solver[i] = col.ORBIT
