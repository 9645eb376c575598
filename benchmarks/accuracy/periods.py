"""Time of one period of the oscillation, the unit in which time integrators are compared."""

from __future__ import annotations

import math

import numpy as np

from benchmarks.accuracy.cases import Known
from benchmarks.timing import best_of
from phasemap._kernels.law import Oscillator
from phasemap.solvers.problem import Work

PERIODS = 10


def march_period_time(work: Work, known: Known, eta: float) -> float:
    """Seconds in which the march integrates one period of a reference orbit.

    `work`: holds the case in row ``known.index``.
    """
    from phasemap._kernels.law import parameters
    from phasemap._kernels.orbits.time.march import march_oscillator
    from phasemap._kernels.orbits.time.tip import PeriodResult

    reference, amplitude = known.reference, known.case.amplitude
    assert reference is not None
    omega, lag = float(work.lever[0]), math.radians(90 - reference.phase)
    # At drive phase 0; the higher harmonics are not there, but a tenth of a percent of the path costs no time.
    state = [reference.mean_deflection + amplitude * math.cos(lag), omega * amplitude * math.sin(lag)]
    y, acc = np.empty(2), PeriodResult()
    p = parameters(work.rows[known.index])  # as kernels have them, for which the march is compiled

    def several() -> None:
        y[:] = state
        for _ in range(PERIODS):
            march_oscillator(Oscillator(work.law, p, work.lever), reference.tip_offset, eta, y, acc)

    return best_of(several, 0.0)[0] / PERIODS
