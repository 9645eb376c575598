"""Loops over pixels for what is cheap: averaged orbits, and orbits corrected by the lever's response.

Each loop works on a slice and can run in a thread of its own (nogil). Pixels that these methods cannot decide or not
solve well enough are left PENDING: for collocation, which is compiled only where there are some.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.arrays import copy
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.averaged import SURE, engage_by_averaging
from phasemap._kernels.engagement.response import cheap_orbit
from phasemap._kernels.law import Law, Oscillator, parameters
from phasemap._kernels.lever import near_resonance, phase_of, reach_of
from phasemap._kernels.orbits.around import OrbitNodes
from phasemap._kernels.orbits.averaged.orbits import averaged_orbits
from phasemap._kernels.orbits.averaged.row import averaged_row, nearest
from phasemap._kernels.orbits.averaged.sides import (
    ATTRACTIVE,
    REPULSIVE,
    Maximum,
    fill_averaged_orbit_on_side,
    find_mismatch_maximum,
)
from phasemap._kernels.orbits.kept import FAINT_DRIVE, keep_nodes, nodes_from_response
from phasemap._kernels.orbits.response.nodes import Nodes
from phasemap._kernels.orbits.response.orbit import Room, largest_branch_distance, nodes_of_solution
from phasemap._kernels.orbits.response.passes import PassState, fill_row_from_passes
from phasemap._kernels.rows.answers import Answers


@kernel
def averaging_suffices(
    lever: np.ndarray, guess: np.ndarray, state: PassState, limits: np.ndarray, row: np.ndarray
) -> bool:
    """Whether the averaged orbit is within `limits` (phase [rad], height [m]) of the exact one; then fills its row."""
    phase_error = abs(phase_of(lever, guess[col.G_A], guess[col.G_P], guess[col.G_S]) - state.phase) + state.phase_error
    height_error = abs(guess[col.G_Z0] - state.tip_offset) + state.tip_offset_error
    if not (phase_error < limits[0] and height_error < limits[1]):
        return False
    averaged_row(lever, guess, row)
    row[col.ERROR_PHASE], row[col.ERROR_HEIGHT] = phase_error, height_error
    return True


@kernel
def choose(
    lever: np.ndarray, guess: np.ndarray, nodes: Nodes, state: PassState, average: bool, limits: np.ndarray,
    row: np.ndarray,
) -> int:  # fmt: skip
    """Fill a row with the averaged orbit if it may stand and suffices, else with the exact one; returns the solver."""
    if average and averaging_suffices(lever, guess, state, limits, row):
        return col.AVERAGING
    fill_row_from_passes(lever, nodes, state, row)
    return col.CORRECTED


@kernel
def cheap_rows(
    law: Law,
    rows: np.ndarray,
    lever: np.ndarray,
    amplitudes: np.ndarray,
    limits: np.ndarray,
    average: bool,
    first: int,
    last: int,
    answers: Answers,
) -> int:
    """Orbit of every row in [first, last) after engagement, where the cheap path is good enough; returns how many wait.

    limits = (phase [rad], height [m]) are the largest errors that may be left; with `average` an averaged orbit may
    stand. Rows that wait hold `guess` where their averaged orbit is known. Rows with room keep the nodes of the orbit
    (`kept`).
    """
    out, status, solver = answers
    room, at, guess, waiting = Room(), OrbitNodes(), np.zeros(col.GUESS), 0
    for i in range(first, last):
        p, amplitude, row = parameters(rows[i]), amplitudes[i], out[i][: col.COLUMNS]
        row[:] = math.nan
        surety = engage_by_averaging(Oscillator(law, p, lever), amplitude, guess, room.top)
        status[i] = cheap_orbit(Oscillator(law, p, lever), amplitude, surety, limits, guess, room)
        if status[i] != col.GOOD:
            waiting += 1
            if status[i] == col.KNOWN:
                copy(guess, row)
                status[i] = col.PENDING
        else:
            solver[i] = choose(lever, guess, nodes_of_solution(room), room.state, average, limits, row)
            if out.shape[1] > col.COLUMNS:
                if solver[i] == col.CORRECTED and lever[col.DRIVE] < FAINT_DRIVE * amplitude:
                    f, longrange = nodes_of_solution(room), p[col.LONGRANGE] != 0.0
                    nodes_from_response(f, amplitude, room.state.centre, longrange, at)
                    keep_nodes(at, out[i])
    return waiting


@kernel
def averaging_rows(
    law: Law, rows: np.ndarray, lever: np.ndarray, amplitudes: np.ndarray, first: int, last: int, answers: Answers
) -> int:
    """First-order averaged orbit of every row in [first, last) where averaging decides; returns how many wait."""
    out, status, solver = answers
    guess, top, waiting = np.zeros(col.GUESS), Maximum(), 0
    for i in range(first, last):
        out[i] = math.nan
        solver[i] = col.AVERAGING
        if engage_by_averaging(Oscillator(law, parameters(rows[i]), lever), amplitudes[i], guess, top) == SURE:
            status[i] = col.GOOD
            averaged_row(lever, guess, out[i])
        else:
            status[i] = col.PENDING
            waiting += 1
    return waiting


@kernel
def averaged_beside(oscillator: Oscillator, amplitude: float, row: np.ndarray, top: Maximum, guess: np.ndarray) -> bool:
    """Fill `guess` with the averaged orbit on the side of an exact one, if it is far from a fold and beside that."""
    law, p, lever = oscillator
    if p[col.LONGRANGE] == 0.0 or law.attracts == 0 or not near_resonance(lever):
        return False
    reach, side = reach_of(law, p), REPULSIVE if row[col.STIFFENING] > 0.0 else ATTRACTIVE
    find_mismatch_maximum(oscillator, reach, amplitude, 0.0 if side == ATTRACTIVE else math.inf, top)
    found = fill_averaged_orbit_on_side(oscillator, reach, amplitude, side, top, guess)
    return found and abs(guess[col.G_Z0] - row[col.TIP_OFFSET]) < largest_branch_distance(lever, amplitude)


@kernel
def averaged_near_rows(
    law: Law, rows: np.ndarray, lever: np.ndarray, amplitudes: np.ndarray, first: int, last: int, answers: Answers
) -> None:
    """Replace exact orbits, which told the branch, by the averaged ones next to them."""
    out, status, solver = answers
    guess, top = np.zeros(col.GUESS), Maximum()
    for i in range(first, last):
        if status[i] == col.GOOD and solver[i] != col.AVERAGING:
            p, amplitude = parameters(rows[i]), amplitudes[i]
            if not averaged_beside(Oscillator(law, p, lever), amplitude, out[i], top, guess):
                status[i] = nearest(averaged_orbits(Oscillator(law, p, lever), amplitude), out[i], guess)
            out[i] = math.nan
            if status[i] == col.GOOD:
                averaged_row(lever, guess, out[i])
        solver[i] = col.AVERAGING
