"""The result row of an averaged orbit."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.arrays import copy
from phasemap._kernels.compilation import kernel
from phasemap._kernels.lever import phase_of


@kernel
def averaged_row(lever: np.ndarray, guess: np.ndarray, row: np.ndarray) -> None:
    """Fill a result row from an averaged orbit, guess = (z0, mean deflection, A, P, S)."""
    stiffness = lever[col.STIFFNESS]
    z0, mean, amplitude, push, drag = guess[col.G_Z0], guess[col.G_MEAN], guess[col.G_A], guess[col.G_P], guess[col.G_S]
    row[:] = math.nan
    row[col.TIP_OFFSET], row[col.MEAN], row[col.AMPLITUDE] = z0, mean, amplitude
    row[col.PHASE] = phase_of(lever, guess[col.G_A], guess[col.G_P], guess[col.G_S])
    row[col.INDENTATION] = amplitude + mean - z0
    row[col.DISSIPATION] = -math.pi * stiffness * amplitude * drag
    row[col.VIRIAL] = stiffness * (mean * mean - 0.5 * amplitude * push)
    row[col.STIFFENING] = push / amplitude


@kernel
def nearest(candidates: np.ndarray, row: np.ndarray, guess: np.ndarray) -> int:
    """Fill `guess` with the averaged orbit nearest to the exact one of `row`, on the same side of free stiffness."""
    best = math.inf
    for i in range(len(candidates)):
        apart = abs(candidates[i, col.G_Z0] - row[col.TIP_OFFSET])
        if (candidates[i, col.G_P] > 0.0) == (row[col.STIFFENING] > 0.0) and apart < best:
            best = apart
            copy(candidates[i], guess)
    return col.GOOD if best < math.inf else col.NO_AVERAGED_ORBIT
