"""The energy balance of orbits that were averaged or interpolated; kernels fill in that of the others."""

from __future__ import annotations

import numpy as np

from phasemap._kernels import columns as col
from phasemap._shared.arrays import Array
from phasemap.experiment.lever import energy_supplied, lost_in_air


def fill_energy_closure(rows: Array, lever: Array) -> None:
    """Fill in the energy closure of orbits whose solver knows the first harmonic only: averaged and interpolated ones.

    `rows` (shape (..., COLUMNS)): result rows; those that have a closure keep it.
    `lever` (shape (n,)): as in `phasemap.solvers.problem.Work`.
    """
    lacking = np.isnan(rows[..., col.CLOSURE])
    if not lacking.any():
        return
    amplitude, phase = rows[..., col.AMPLITUDE], rows[..., col.PHASE]
    given = energy_supplied(lever, amplitude, phase)
    left = (given - rows[..., col.DISSIPATION] - lost_in_air(lever, amplitude)) / given
    rows[..., col.CLOSURE] = np.where(lacking, left, rows[..., col.CLOSURE])
