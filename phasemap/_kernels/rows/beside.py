"""Exact orbits by collocation in place of approximate ones."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.arrays import copy
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law, Oscillator, parameters
from phasemap._kernels.orbits.collocation.estimate import estimate_errors
from phasemap._kernels.orbits.collocation.newton import begin_harmonic, solve_at_amplitude
from phasemap._kernels.orbits.collocation.polish import FINEST_LEVEL, feedback_status, refine_orbit, tolerance_of
from phasemap._kernels.orbits.collocation.system import new_orbit

MOST_BESIDE_STEPS = 15
SAME_ORBIT = 1e-4  # of the amplitude, and radians: nearer than this it is the same orbit


@kernel
def rows_beside(
    law: Law, rows: np.ndarray, lever: np.ndarray, tables: np.ndarray, amplitudes: np.ndarray, out: np.ndarray,
    done: np.ndarray,
) -> None:  # fmt: skip
    """Replace each result row by that of the exact orbit beside it; `done` says where there is one."""
    orbit, spare = new_orbit(lever), new_orbit(lever)
    guess, row = np.zeros(col.GUESS), np.zeros(col.COLUMNS)
    for i in range(len(rows)):
        p, amplitude, near = parameters(rows[i]), amplitudes[i], out[i]
        tolerance = tolerance_of(Oscillator(law, p, lever))
        guess[col.G_Z0], guess[col.G_MEAN], guess[col.G_A] = near[col.TIP_OFFSET], near[col.MEAN], amplitude
        guess[col.G_P] = near[col.STIFFENING] * amplitude
        guess[col.G_S] = -near[col.DISSIPATION] / (math.pi * lever[col.STIFFNESS] * amplitude)
        done[i] = False
        for level in range(FINEST_LEVEL + 1):
            if not begin_harmonic(Oscillator(law, p, lever), tables, orbit, guess, level):
                break
            status, _, orbit, spare = solve_at_amplitude(
                Oscillator(law, p, lever), tables, orbit, spare, level, tolerance, MOST_BESIDE_STEPS
            )
            if status == col.GOOD:
                status, orbit, spare = refine_orbit(Oscillator(law, p, lever), tables, orbit, spare, row)
            if status != col.GOOD or feedback_status(row) != col.GOOD:
                continue
            apart = abs(row[col.TIP_OFFSET] - near[col.TIP_OFFSET]) / amplitude
            if max(apart, abs(row[col.PHASE] - near[col.PHASE])) < SAME_ORBIT:
                estimate_errors(Oscillator(law, p, lever), tables, orbit, spare, row)
                copy(row, near)
                done[i] = True
                break
