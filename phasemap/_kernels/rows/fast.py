"""Loops over pixels for what is cheap: averaged orbits, and orbits corrected by the lever's response.

Each loop works on a slice and can run in a thread of its own (nogil). Pixels that these methods cannot decide or not
solve well enough are left PENDING: for collocation, which is compiled only where there are some.
"""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.columns import ATTRACTING, ENGAGED, REPELLING
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.averaged import SURE, averaged_beside, engage_by_averaging
from phasemap._kernels.engagement.other_branch import orbit_on
from phasemap._kernels.engagement.response import cheap_orbit, choose
from phasemap._kernels.engagement.seen import EXACTLY_SEEN, MOST_SECANTS
from phasemap._kernels.excitation import next_amplitude, sees_tip, show
from phasemap._kernels.law import Oscillator
from phasemap._kernels.lever import phase_of
from phasemap._kernels.numerics import copy
from phasemap._kernels.orbits.averaged.orbits import averaged_orbits
from phasemap._kernels.orbits.averaged.sides import ATTRACTIVE, REPULSIVE, Maximum
from phasemap._kernels.orbits.orbit_nodes import FAINT_DRIVE, OrbitNodes, keep_nodes, nodes_from_response
from phasemap._kernels.orbits.response.orbit import Room, nodes_of_solution
from phasemap._kernels.orbits.result_row import averaged_row, nearest_averaged_orbit
from phasemap._kernels.rows.answers import Answers, Pixels, oscillator_of


@kernel
def cheap_rows(pixels: Pixels, limits: np.ndarray, average: bool, first: int, last: int, answers: Answers) -> int:
    """Orbit of every row in [first, last) after engagement, where the cheap path is good enough; returns how many wait.

    limits = (phase [rad], height [m]) are the largest errors that may be left; with `average` an averaged orbit may
    stand. Rows that wait hold `guess` where their averaged orbit is known. Rows with room keep the nodes of the orbit
    (`orbit_nodes`).
    """
    (out, status, solver), lever = answers, pixels.lever
    room, at, guess, waiting = Room(), OrbitNodes(), np.zeros(col.GUESS), 0
    for i in range(first, last):
        oscillator, amplitude, row = oscillator_of(pixels, i), pixels.amplitudes[i], out[i][: col.COLUMNS]
        row[:] = math.nan
        surety = engage_by_averaging(oscillator, amplitude, guess, room.top)
        status[i] = cheap_orbit(oscillator, amplitude, surety, limits, guess, room)
        if status[i] != col.GOOD:
            waiting += 1
            if status[i] == col.KNOWN:
                copy(guess, row)
                status[i] = col.PENDING
        else:
            solver[i] = choose(lever, guess, nodes_of_solution(room), room.state, average, limits, row)
            if out.shape[1] > col.COLUMNS:
                if solver[i] == col.CORRECTED and lever[col.DRIVE] < FAINT_DRIVE * amplitude:
                    f = nodes_of_solution(room)
                    nodes_from_response(f, amplitude, room.state.centre, at)
                    keep_nodes(at, out[i])
    return waiting


@kernel
def averaging_rows(pixels: Pixels, first: int, last: int, answers: Answers) -> int:
    """First-order averaged orbit of every row in [first, last) where averaging decides; returns how many wait."""
    out, status, solver = answers
    guess, top, waiting = np.zeros(col.GUESS), Maximum(), 0
    for i in range(first, last):
        out[i] = math.nan
        solver[i] = col.AVERAGING
        if engage_by_averaging(oscillator_of(pixels, i), pixels.amplitudes[i], guess, top) == SURE:
            status[i] = col.GOOD
            averaged_row(pixels.lever, guess, out[i])
        else:
            status[i] = col.PENDING
            waiting += 1
    return waiting


@kernel
def averaged_at_seen(oscillator: Oscillator, seen: float, row: np.ndarray, top: Maximum, guess: np.ndarray) -> int:
    """Fill `guess` with the averaged orbit next to an exact one that the detector sees with an amplitude [m]."""
    lever = oscillator.lever
    amplitude, before = seen if sees_tip(lever) else row[col.AMPLITUDE], (math.nan, math.nan)
    for _ in range(MOST_SECANTS):
        if not averaged_beside(oscillator, amplitude, row, top, guess):
            status = nearest_averaged_orbit(averaged_orbits(oscillator, amplitude), row, guess)
            if status != col.GOOD:
                return status
        phase = phase_of(lever, amplitude, guess[col.G_P], guess[col.G_S])
        miss = show(lever, amplitude, phase)[0] - seen
        if abs(miss) < EXACTLY_SEEN * seen:
            return col.GOOD
        following = next_amplitude(lever, seen, amplitude, phase, miss, before)
        before, amplitude = (amplitude, miss), following
        if not amplitude > 0.0:
            break
    return col.NO_AVERAGED_ORBIT


@kernel
def averaged_near_rows(pixels: Pixels, first: int, last: int, answers: Answers) -> None:
    """Replace exact orbits, which told the branch, by the averaged ones next to them."""
    out, status, solver = answers
    guess, top = np.zeros(col.GUESS), Maximum()
    for i in range(first, last):
        if status[i] == col.GOOD and solver[i] != col.AVERAGING:
            status[i] = averaged_at_seen(oscillator_of(pixels, i), pixels.amplitudes[i], out[i], top, guess)
            out[i] = math.nan
            if status[i] == col.GOOD:
                averaged_row(pixels.lever, guess, out[i])
        solver[i] = col.AVERAGING


@kernel
def other_rows(pixels: Pixels, limits: np.ndarray, allowed: np.ndarray, first: int, last: int, answers: Answers) -> int:
    """Stable orbits on both branches for every row in [first, last), from what engagement found; returns how many wait.

    `limits`: largest estimated errors of an exact orbit, phase [rad] and height [m]; `allowed`: those within which an
    averaged one may stand. Of the slots of `answers` ENGAGED is given, the other two are filled; what is PENDING has a
    harmonic orbit (z0, mean deflection, A, P, S) to start from, or NaN.
    """
    out, status, solver = answers
    room, guess, waiting = Room(), np.zeros(col.GUESS), 0
    for i in range(first, last):
        oscillator, left = oscillator_of(pixels, i), False
        here = REPELLING if out[ENGAGED, i, col.STIFFENING] > 0.0 else ATTRACTING
        for slot in range(ENGAGED):
            row = out[slot, i]
            if status[ENGAGED, i] == col.GOOD and slot == here:
                for j in range(col.COLUMNS):
                    row[j] = out[ENGAGED, i, j]
                status[slot, i], solver[slot, i] = col.GOOD, solver[ENGAGED, i]
                continue
            row[:] = math.nan
            side = REPULSIVE if slot == REPELLING else ATTRACTIVE
            done = status[slot, i] = orbit_on(oscillator, pixels.amplitudes[i], side, limits, guess, room)
            if done == col.GOOD:
                solver[slot, i] = choose(pixels.lever, guess, nodes_of_solution(room), room.state, True, allowed, row)
            elif done == col.PENDING:
                left = True
                for j in range(5):
                    row[j] = guess[j] if guess[col.G_A] > 0.0 else math.nan
        waiting += left
    return waiting
