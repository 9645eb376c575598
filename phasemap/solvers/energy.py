"""Energy of one period of orbits whose solver knows the first harmonic only."""

from __future__ import annotations

import numpy as np

from phasemap._kernels import columns as col
from phasemap.experiment.lever import lost_in_air, supplied

Array = np.ndarray


def close(rows: Array, lever: Array) -> None:
    """Fill in the energy closure of orbits whose solver knows the first harmonic only: averaged and interpolated ones.

    `rows` (shape (..., COLUMNS)): result rows; those that have a closure keep it.
    `lever` (shape (n,)): as in `phasemap.solvers.problem.Work`.

    Examples
    --------
    >>> from phasemap.experiment.lever import one_mode
    >>> lever, rows = one_mode(1.0, 1e-3, 40.0, 4e-11), np.full((2, col.COLUMNS), np.nan)
    >>> rows[0, [col.AMPLITUDE, col.PHASE, col.DISSIPATION]] = 2e-8, 0.0, 0.0  # the free lever: u0 / (2 alpha0)
    >>> close(rows, lever)
    >>> np.abs(rows[:, col.CLOSURE]).round(12).tolist()
    [0.0, nan]
    """
    lacking = np.isnan(rows[..., col.CLOSURE])
    if not lacking.any():
        return
    amplitude, phase = rows[..., col.AMPLITUDE], rows[..., col.PHASE]
    given = supplied(lever, amplitude, phase)
    left = (given - rows[..., col.DISSIPATION] - lost_in_air(lever, amplitude)) / given
    rows[..., col.CLOSURE] = np.where(lacking, left, rows[..., col.CLOSURE])
