"""Result rows of orbits: of an averaged one, and what a row of any orbit says of it."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.lever import forces_at_phase, phase_of

SAME_ORBIT = 1e-4  # of the amplitude, and radians: nearer than this it is the same orbit


@kernel
def averaged_row(lever: np.ndarray, guess: np.ndarray, row: np.ndarray) -> None:
    """Fill a result row from an averaged orbit, guess = (z0, mean deflection, A, P, S)."""
    stiffness = lever[col.STIFFNESS]
    z0, mean, amplitude, push, drag = guess[col.G_Z0], guess[col.G_MEAN], guess[col.G_A], guess[col.G_P], guess[col.G_S]
    row[:] = math.nan
    row[col.TIP_OFFSET], row[col.MEAN], row[col.AMPLITUDE] = z0, mean, amplitude
    row[col.PHASE] = phase_of(lever, amplitude, push, drag)
    row[col.INDENTATION] = amplitude + mean - z0
    row[col.DISSIPATION] = -math.pi * stiffness * amplitude * drag
    row[col.VIRIAL] = stiffness * (mean * mean - 0.5 * amplitude * push)
    row[col.STIFFENING] = push / amplitude


@kernel
def feedback_status(row: np.ndarray) -> int:
    """Status of an orbit under feedback: GOOD if it is stable and its tip offset rises with the amplitude."""
    if not row[col.FLOQUET] < 1.0:
        return col.UNSTABLE
    return col.GOOD if row[col.SLOPE] > 0.0 else col.NO_STABLE_ORBIT


@kernel
def guess_of_row(lever: np.ndarray, row: np.ndarray, guess: np.ndarray) -> None:
    """Fill in the harmonic orbit of a result row of the tip."""
    amplitude = row[col.AMPLITUDE]
    guess[col.G_Z0], guess[col.G_MEAN], guess[col.G_A] = row[col.TIP_OFFSET], row[col.MEAN], amplitude
    guess[col.G_P], guess[col.G_S] = forces_at_phase(lever, amplitude, row[col.PHASE])


@kernel
def same_orbit(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two result rows are of the same orbit."""
    apart = abs(one[col.TIP_OFFSET] - other[col.TIP_OFFSET]) / one[col.AMPLITUDE]
    return max(apart, abs(one[col.PHASE] - other[col.PHASE])) < SAME_ORBIT


@kernel
def has_periodic_orbit(row: np.ndarray) -> bool:
    """Whether a result row has a periodic orbit."""
    return math.isfinite(row[col.INDENTATION]) and row[col.AMPLITUDE] > 0.0 and not row[col.SPREAD_AMPLITUDE] > 0.0
