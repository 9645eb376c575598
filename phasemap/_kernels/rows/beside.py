"""Exact orbits by collocation in place of approximate ones."""

from __future__ import annotations

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.arrays import copy
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law, Oscillator, parameters
from phasemap._kernels.orbits.collocation.estimate import estimate_errors
from phasemap._kernels.orbits.collocation.near import guess_of_row, orbit_near, same_orbit
from phasemap._kernels.orbits.collocation.system import new_orbit


@kernel
def rows_beside(
    law: Law, rows: np.ndarray, lever: np.ndarray, tables: np.ndarray, amplitudes: np.ndarray, out: np.ndarray,
    done: np.ndarray,
) -> None:  # fmt: skip
    """Replace each result row of the tip by that of the exact orbit beside it; `done` says where there is one."""
    orbit, spare = new_orbit(lever), new_orbit(lever)
    guess, row = np.zeros(col.HARMONIC_ORBIT), np.zeros(col.COLUMNS)
    for i in range(len(rows)):
        oscillator, near = Oscillator(law, parameters(rows[i]), lever), out[i]
        guess_of_row(lever, near, guess)
        guess[col.G_A] = amplitudes[i]
        status, _, orbit, spare = orbit_near(oscillator, tables, guess, orbit, spare, row)
        done[i] = status == col.GOOD and same_orbit(row, near)
        if done[i]:
            estimate_errors(oscillator, tables, orbit, spare, row)
            copy(row, near)
