"""Orbits by collocation, for the pixels that the cheap path leaves, and every orbit of one pixel.

Which orbit the controller finds is decided alike for all solvers: by averaging where that is safe, by the fold at the
end of the attractive branch, and along the curve of exact orbits where that is not enough.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.continuation.path import ENTRY_A, Path, Point, fixed_path
from phasemap._kernels.continuation.step import Wanted, mark_point
from phasemap._kernels.engagement.averaged import LEAP, SURE, engage_by_averaging
from phasemap._kernels.engagement.exact import Rooms, engage_along_exact_curve, lower_along_curve
from phasemap._kernels.engagement.rebound import rebounds
from phasemap._kernels.law import Law, Oscillator, parameters
from phasemap._kernels.lever import free_amplitude, low_q
from phasemap._kernels.orbits.around import OrbitNodes
from phasemap._kernels.orbits.averaged.sides import Maximum
from phasemap._kernels.orbits.collocation.estimate import estimate_errors
from phasemap._kernels.orbits.collocation.impact import begin_impact
from phasemap._kernels.orbits.collocation.near import MOST_STEPS_NEARBY, orbit_near
from phasemap._kernels.orbits.collocation.newton import solve_at_amplitude
from phasemap._kernels.orbits.collocation.polish import feedback_status, refine_orbit, tolerance_of
from phasemap._kernels.orbits.collocation.system import head_of, new_orbit
from phasemap._kernels.orbits.kept import keep_nodes, nodes_from_collocation
from phasemap._kernels.orbits.response.orbit import largest_branch_distance
from phasemap._kernels.rows.answers import Answers

# Of the way from the setpoint to the free amplitude: where a short contact holds the lever, and its orbit is begun at.
NEARER = (0.2, 0.5, 0.8)


@kernel
def _orbit_near(
    oscillator: Oscillator, tables: np.ndarray, guess: np.ndarray, rooms: Rooms, row: np.ndarray
) -> tuple[bool, Rooms]:
    """Exact orbit near the averaged one, in `found` of the rooms: whether it is on its branch, and can be held."""
    orbit, spare, saved, found = rooms
    done, away, found, spare = orbit_near(oscillator, tables, guess, found, spare, row)
    same = (row[col.STIFFENING] > 0.0) == (guess[col.G_P] > 0.0)
    near = away < largest_branch_distance(oscillator.lever, guess[col.G_A])
    return done == col.GOOD and same and near, Rooms(orbit, spare, saved, found)


@kernel
def _orbit_from_nearer(path: Path, wanted: Wanted, rooms: Rooms) -> tuple[int, Rooms]:
    """Repulsive orbit at the setpoint of a lever of low Q, from one of larger amplitude that a short contact holds."""
    oscillator, tables, amplitude = Oscillator(path.law, path.p, path.lever), path.tables, wanted.value
    for share in NEARER:
        orbit, spare, saved, found = rooms
        higher = amplitude + share * (free_amplitude(path.lever) - amplitude)
        if not begin_impact(oscillator, tables, orbit, higher, 0):
            continue
        status, _, orbit, spare = solve_at_amplitude(
            oscillator, tables, orbit, spare, 0, wanted.tolerance, MOST_STEPS_NEARBY
        )
        point, rooms = Point(), Rooms(orbit, spare, saved, found)
        point.tangent_v = -1.0
        if status == col.GOOD and head_of(orbit).push > 0.0 and mark_point(path, orbit, point) and point.floquet < 1.0:
            return lower_along_curve(path, wanted, point, rooms)
    return col.NOT_CONVERGED, rooms


@kernel
def orbit_along_curve(
    oscillator: Oscillator, tables: np.ndarray, amplitude: float, repulsive: bool, rooms: Rooms, row: np.ndarray
) -> tuple[int, Rooms]:
    """Exact orbit at which a tip stops that is lowered, in `found` of the rooms and its row; returns a status.

    `repulsive`: whether it is known to be a repulsive one.
    """
    path, wanted = fixed_path(oscillator, tables), Wanted(ENTRY_A, amplitude, tolerance_of(oscillator))
    done = col.NOT_CONVERGED
    if repulsive and low_q(oscillator.lever):
        done, rooms = _orbit_from_nearer(path, wanted, rooms)
    if done != col.GOOD:
        done, rooms = engage_along_exact_curve(path, wanted, rooms)
    orbit, spare, saved, found = rooms
    if done == col.GOOD:
        done, found, spare = refine_orbit(oscillator, tables, found, spare, row)
    return feedback_status(row) if done == col.GOOD else done, Rooms(orbit, spare, saved, found)


@kernel
def exact_orbit(
    oscillator: Oscillator, tables: np.ndarray, amplitude: float, surety: int, guess: np.ndarray,
    rooms: Rooms, row: np.ndarray,
) -> tuple[int, Rooms]:  # fmt: skip
    """Exact orbit by collocation, in `found`: from the averaged one where that is sure, else along the exact curve.

    Where a tip leaps and lands, or rebounds, no curve tells: NOT_CONVERGED.
    """
    if surety == LEAP:
        row[:] = math.nan
        return col.NOT_CONVERGED, rooms
    if surety == SURE:
        good, rooms = _orbit_near(oscillator, tables, guess, rooms, row)
        if good:
            return col.GOOD, rooms
    repulsive = surety == SURE and guess[col.G_P] > 0.0
    done, rooms = orbit_along_curve(oscillator, tables, amplitude, repulsive, rooms, row)
    if done == col.GOOD and rebounds(oscillator, row[col.STIFFENING] * amplitude):
        done = col.NOT_CONVERGED
    return done, rooms


@kernel
def new_rooms(lever: np.ndarray) -> Rooms:
    """Room for orbits of this lever."""
    return Rooms(new_orbit(lever), new_orbit(lever), new_orbit(lever), new_orbit(lever))


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
    rooms = new_rooms(lever)
    guess, top, at = np.zeros(col.GUESS), Maximum(), OrbitNodes()
    for i in range(first, last):
        if status[i] != col.PENDING:
            continue
        p, amplitude, row, surety = parameters(rows[i]), amplitudes[i], out[i, : col.COLUMNS], SURE
        for j in range(len(guess)):
            guess[j] = row[j]
        if math.isnan(guess[0]):
            surety = engage_by_averaging(Oscillator(law, p, lever), amplitude, guess, top)
        row[:] = math.nan
        oscillator = Oscillator(law, p, lever)
        status[i], rooms = exact_orbit(oscillator, tables, amplitude, surety, guess, rooms, row)
        solver[i] = col.ORBIT
        if status[i] != col.GOOD:
            row[:] = math.nan
            continue
        estimate_errors(oscillator, tables, rooms.found, rooms.spare, row)
        if out.shape[1] > col.COLUMNS:
            nodes_from_collocation(oscillator, tables, rooms.found, at)
            keep_nodes(at, out[i])
