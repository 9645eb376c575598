"""Exact orbits near orbits that are known: no engagement, the branch is that of the guess."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.continuation.path import fixed_path
from phasemap._kernels.continuation.step import relay_orbit
from phasemap._kernels.law import Law, Oscillator, parameters
from phasemap._kernels.lever import is_thrown_back
from phasemap._kernels.orbits.collocation.impact import begin_impact
from phasemap._kernels.orbits.collocation.newton import begin_harmonic, solve_at_amplitude
from phasemap._kernels.orbits.collocation.polish import feedback_status, refine_orbit, tolerance_of
from phasemap._kernels.orbits.collocation.system import head_of, new_orbit

MOST_NEARBY_STEPS = 12  # of Newton's method from a guess


class NearbyGuesses(NamedTuple):
    """Where orbits of n materials are expected, shape (n,) each."""

    amplitudes: np.ndarray  # that are held [m]
    offsets: np.ndarray  # of the tip [m]
    means: np.ndarray  # deflection [m]
    phases: np.ndarray  # [rad]
    away: np.ndarray  # how far off the tip offset may be [m]


@kernel
def nearby_rows(
    law: Law, rows: np.ndarray, lever: np.ndarray, tables: np.ndarray, guesses: NearbyGuesses, group: int,
    out: np.ndarray, status: np.ndarray,
) -> None:  # fmt: skip
    """Fill in the orbit of every row next to its guess.

    An orbit farther away, or one that is not stable, gets the status NOT_CONVERGED.

    Parameters
    ----------
    guesses : NearbyGuesses
    group : int
        So many rows, one after another, are close to each other: each may start from the one before.
    """
    orbit, spare = new_orbit(lever), new_orbit(lever)
    guess = np.zeros(col.HARMONIC_ORBIT)
    for i in range(len(rows)):
        oscillator, row = Oscillator(law, parameters(rows[i]), lever), out[i]
        amplitude, z0, phase = guesses.amplitudes[i], guesses.offsets[i], guesses.phases[i]
        guess[col.G_Z0], guess[col.G_MEAN], guess[col.G_A] = z0, guesses.means[i], amplitude
        guess[col.G_P] = lever[col.DRIVE] * math.sin(phase) - amplitude * lever[col.DYNAMIC_STIFFNESS]
        guess[col.G_S] = lever[col.DYNAMIC_LOSS] * amplitude - lever[col.DRIVE] * math.cos(phase)
        tolerance = tolerance_of(oscillator)
        done, throws = col.NOT_CONVERGED, is_thrown_back(oscillator, amplitude, guess[col.G_P])
        for warm in (True, False):
            if warm and (i % group == 0 or status[i - 1] != col.GOOD):
                continue
            if warm:
                head = head_of(orbit)
                head.tip_offset, head.push, head.drag = z0, guess[col.G_P], guess[col.G_S]
                if not relay_orbit(fixed_path(oscillator, tables), orbit, spare):
                    continue
                orbit, spare = spare, orbit
            elif not (throws and begin_impact(oscillator, tables, orbit, amplitude, 0)):
                if not begin_harmonic(oscillator, tables, orbit, guess, 0):
                    continue
            done, _, orbit, spare = solve_at_amplitude(
                oscillator, tables, orbit, spare, 0, tolerance, MOST_NEARBY_STEPS
            )
            if done == col.GOOD:
                done, orbit, spare = refine_orbit(oscillator, tables, orbit, spare, row)
            near = abs(row[col.TIP_OFFSET] - z0) < guesses.away[i]
            if done == col.GOOD and near and feedback_status(row) == col.GOOD:
                break
            done = col.NOT_CONVERGED
        if done != col.GOOD:
            row[:] = math.nan
        status[i] = done
