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
from phasemap._kernels.orbits.collocation.near import MOST_STEPS_NEARBY, guess_of_row, orbit_near
from phasemap._kernels.orbits.collocation.newton import solve_at_amplitude
from phasemap._kernels.orbits.collocation.polish import feedback_status, refine_orbit, tolerance_of
from phasemap._kernels.orbits.collocation.system import head_of, new_orbit


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
        oscillator, row, z0 = Oscillator(law, parameters(rows[i]), lever), out[i], guesses.offsets[i]
        row[col.AMPLITUDE], row[col.TIP_OFFSET] = guesses.amplitudes[i], z0
        row[col.MEAN], row[col.PHASE] = guesses.means[i], guesses.phases[i]
        guess_of_row(lever, row, guess)
        done = col.NOT_CONVERGED
        for warm in (True, False):
            if warm and (i % group == 0 or status[i - 1] != col.GOOD):
                continue
            if warm:
                head = head_of(orbit)
                head.amplitude, head.tip_offset = guess[col.G_A], z0
                head.push, head.drag = guess[col.G_P], guess[col.G_S]
                if not relay_orbit(fixed_path(oscillator, tables), orbit, spare):
                    continue
                done, _, orbit, spare = solve_at_amplitude(
                    oscillator, tables, spare, orbit, 0, tolerance_of(oscillator), MOST_STEPS_NEARBY
                )
                if done == col.GOOD:
                    done, orbit, spare = refine_orbit(oscillator, tables, orbit, spare, row)
                if done == col.GOOD:
                    done = feedback_status(row)
            else:
                done, _, orbit, spare = orbit_near(oscillator, tables, guess, orbit, spare, row)
            if done == col.GOOD and abs(row[col.TIP_OFFSET] - z0) < guesses.away[i]:
                break
            done = col.NOT_CONVERGED
        if done != col.GOOD:
            row[:] = math.nan
        status[i] = done
