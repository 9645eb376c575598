"""Orbits at which the detector shows the setpoint, where it does not see the position of the tip.

Which amplitude A of z the detector shows as the setpoint depends on the phase. Solvers hold what is seen itself
(`phasemap._kernels.engagement.at_detected_amplitude`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from phasemap._kernels import columns as col
from phasemap._shared.arrays import Array
from phasemap.experiment.lever import (
    in_proportion,
    offset_and_factor,
    rows_as_seen,
    tip_seen,
)
from phasemap.solvers.energy_balance import fill_energy_closure
from phasemap.solvers.problem import Work

SolvedRows = tuple[Array, NDArray[np.int8], NDArray[np.int8]]
"""Result rows, status and solver codes."""


def at_tip(work: Work) -> Work:
    """The work that solvers know: where the amplitude that is seen is that of z times a number, work of the tip."""
    if not in_proportion(work.lever):
        return work
    return replace(work, lever=tip_seen(work.lever), amplitudes=work.amplitudes / abs(offset_and_factor(work.lever)[1]))


def shown(rows: Array, work: Work) -> Array:
    """Result rows as the detector sees them, from those of `at_tip(work)`; with the energies that they lack."""
    fill_energy_closure(rows, work.lever)
    if in_proportion(work.lever):
        rows[:, [col.SLOPE, col.SPREAD_AMPLITUDE]] *= abs(offset_and_factor(work.lever)[1])
    return rows_as_seen(rows, work.lever)
