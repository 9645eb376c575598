"""Loop over pixels for solids that relax, by passes of the lever's response."""

from __future__ import annotations

import math

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.engagement.averaged import SURE, engage_by_averaging
from phasemap._kernels.law import Law, Oscillator, parameters
from phasemap._kernels.orbits.averaged.sides import Maximum
from phasemap._kernels.orbits.response.nodes import Nodes
from phasemap._kernels.orbits.response.passes import PassState, fill_row_from_passes
from phasemap._kernels.orbits.response.relaxing import ContactMemory
from phasemap._kernels.orbits.response.relaxing_orbit import Bench, refine_relaxing
from phasemap._kernels.rows.answers import Answers
from phasemap._kernels.rows.marched import has_one_orbit, only_orbit


@kernel
def relaxing_rows(
    law: Law, rows: np.ndarray, lever: np.ndarray, amplitudes: np.ndarray, limits: np.ndarray, answers: Answers
) -> None:
    """Orbit of every row after engagement where averaging is sure of it and passes find it; the others are PENDING.

    limits = (phase [rad], height [m]) are the largest errors that may be left.
    """
    out, status, solver = answers
    guess, top, bench = np.zeros(col.GUESS), Maximum(), Bench(Nodes(), ContactMemory(), PassState())
    for i in range(len(rows)):
        p = parameters(rows[i])
        status[i], out[i] = col.PENDING, math.nan
        if not p[col.RELAXATION] > 0.0 or p[col.SPECTRUM] != 0.0:
            continue
        if has_one_orbit(p, lever):
            sure = only_orbit(Oscillator(law, p, lever), amplitudes[i], top, guess)
        else:
            sure = engage_by_averaging(Oscillator(law, p, lever), amplitudes[i], guess, top) == SURE
        if sure and refine_relaxing(Oscillator(law, p, lever), guess, limits, bench):
            fill_row_from_passes(lever, bench.nodes, bench.state, out[i])
            status[i], solver[i] = col.GOOD, col.CORRECTED
