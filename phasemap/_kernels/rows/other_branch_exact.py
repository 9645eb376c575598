"""Exact orbits on the branches that the cheap path leaves open, from harmonic orbits near them."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.columns import ENGAGED, REPELLING
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law, Oscillator, parameters
from phasemap._kernels.orbits.collocation.estimate import estimate_errors
from phasemap._kernels.orbits.collocation.near import orbit_near
from phasemap._kernels.orbits.collocation.system import new_orbit
from phasemap._kernels.rows.answers import Answers

MOST_STARTS, FARTHER_START = 6, 0.04  # harmonic orbits to start from, and how far from each other, over the amplitude


@kernel
def exact_near_rows(
    law: Law, rows: np.ndarray, lever: np.ndarray, tables: np.ndarray, amplitudes: np.ndarray,
    first: int, last: int, answers: Answers,
) -> int:  # fmt: skip
    """Exact orbits for what `other_branch.other_rows` left PENDING, where they are found; returns how many still wait.

    A strong pull throws the tip out of its harmonic orbit, whose contact then is too deep to start from: farther ones
    are tried too.
    """
    out, status, solver = answers
    orbit, spare, guess = new_orbit(lever), new_orbit(lever), np.zeros(col.HARMONIC_ORBIT)
    waiting = 0
    for i in range(first, last):
        oscillator, left = Oscillator(law, parameters(rows[i]), lever), False
        for slot in range(ENGAGED):
            if status[slot, i] != col.PENDING:
                continue
            row = out[slot, i]
            for j in range(len(guess)):
                guess[j] = row[j]
            for _ in range(MOST_STARTS):
                if math.isnan(guess[col.G_Z0]):
                    break
                done, _, orbit, spare = orbit_near(oscillator, tables, guess, orbit, spare, row)
                if done == col.GOOD and (row[col.STIFFENING] > 0.0) == (slot == REPELLING):
                    status[slot, i], solver[slot, i] = col.GOOD, col.ORBIT
                    estimate_errors(oscillator, tables, orbit, spare, row)
                    break
                guess[col.G_Z0] += FARTHER_START * amplitudes[i]
            if status[slot, i] == col.PENDING:
                row[:] = math.nan
                left = True
        waiting += left
    return waiting
