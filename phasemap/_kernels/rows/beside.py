"""Exact orbits by collocation beside orbits that are known nearly."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.arrays import copy
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law, Oscillator, parameters
from phasemap._kernels.orbits.collocation.estimate import state_errors
from phasemap._kernels.orbits.collocation.newton import begin, newton
from phasemap._kernels.orbits.collocation.polish import FINEST, judge, polish, tolerance_of
from phasemap._kernels.orbits.collocation.system import HOLD_AMPLITUDE, new_orbit

MOST_STEPS = 15
SAME = 1e-4  # of the amplitude, and radians: nearer than this it is the same orbit


@kernel
def rows_beside(
    law: Law, rows: np.ndarray, lever: np.ndarray, tables: np.ndarray, amplitudes: np.ndarray, out: np.ndarray,
    done: np.ndarray,
) -> None:  # fmt: skip
    """Replace each result row by that of the exact orbit beside it; `done` says where there is one."""
    orbit, spare, target = new_orbit(), new_orbit(), np.zeros(4)
    guess, row = np.zeros(col.GUESS), np.zeros(col.COLUMNS)
    for i in range(len(rows)):
        p, amplitude, near = parameters(rows[i]), amplitudes[i], out[i]
        tolerance = tolerance_of(Oscillator(law, p, lever))
        guess[col.G_Z0], guess[col.G_MEAN], guess[col.G_A] = near[col.TIP_OFFSET], near[col.MEAN], amplitude
        guess[col.G_P] = near[col.STIFFENING] * amplitude
        guess[col.G_S] = -near[col.DISSIPATION] / (math.pi * lever[col.STIFFNESS] * amplitude)
        done[i] = False
        for level in range(FINEST + 1):
            if not begin(Oscillator(law, p, lever), tables, orbit, guess, level):
                break
            status, _, orbit, spare = newton(
                Oscillator(law, p, lever), tables, orbit, spare, HOLD_AMPLITUDE, target, level, tolerance, MOST_STEPS
            )
            if status == col.GOOD:
                status, orbit, spare = polish(Oscillator(law, p, lever), tables, orbit, spare, row)
            if status != col.GOOD or judge(row) != col.GOOD:
                continue
            apart = abs(row[col.TIP_OFFSET] - near[col.TIP_OFFSET]) / amplitude
            if max(apart, abs(row[col.PHASE] - near[col.PHASE])) < SAME:
                state_errors(Oscillator(law, p, lever), tables, orbit, spare, row)
                copy(row, near)
                done[i] = True
                break
