"""Loop over the pixels on which passes of the lever's response do not converge: Newton's method on the response."""

from __future__ import annotations

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law, parameters
from phasemap._kernels.orbits.response.newton import new_bench
from phasemap._kernels.orbits.response.orbit import refine_stiff
from phasemap._kernels.orbits.response.passes import report
from phasemap._kernels.rows.fast import averaging_suffices


@kernel
def stiff_rows(
    law: Law,
    rows: np.ndarray,
    lever: np.ndarray,
    limits: np.ndarray,
    average: bool,
    first: int,
    last: int,
    out: np.ndarray,
    status: np.ndarray,
    solver: np.ndarray,
) -> None:
    """Orbit of every row in [first, last) that `cheap_rows` left STIFF.

    What it is not good enough for is PENDING, and holds `guess`.
    """
    short, long, guess = new_bench(1), new_bench(2), np.zeros(6)
    for i in range(first, last):
        if status[i] != col.STIFF:
            continue
        p, row = parameters(rows[i]), out[i]
        for j in range(6):
            guess[j] = row[j]
        parts = refine_stiff(law, p, lever, guess, limits, short, long)
        if parts == 0:
            status[i] = col.PENDING
            continue
        bench = short if parts == 1 else long
        status[i] = col.GOOD
        if average and averaging_suffices(lever, guess, bench.state, limits, row):
            solver[i] = col.AVERAGING
        else:
            report(lever, bench.nodes, bench.state, row)
            solver[i] = col.CORRECTED
