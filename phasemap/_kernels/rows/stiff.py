"""Loop over the pixels on which passes of the lever's response do not converge: Newton's method on the response."""

from __future__ import annotations

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.compilation import kernel
from phasemap._kernels.law import Law, Oscillator, parameters
from phasemap._kernels.lever import modes_of
from phasemap._kernels.orbits.response.newton import new_bench
from phasemap._kernels.orbits.response.nodes import MOST_PARTS, Nodes, parts_of
from phasemap._kernels.orbits.response.orbit import refine_stiff
from phasemap._kernels.orbits.response.passes import PassState
from phasemap._kernels.orbits.response.softened import Before
from phasemap._kernels.rows.answers import Answers
from phasemap._kernels.rows.fast import choose


@kernel
def stiff_rows(
    law: Law,
    rows: np.ndarray,
    lever: np.ndarray,
    limits: np.ndarray,
    average: bool,
    first: int,
    last: int,
    answers: Answers,
) -> None:
    """Orbit of every row in [first, last) that `cheap_rows` left STIFF.

    What it is not good enough for is PENDING, and holds `guess`.
    """
    out, status, solver = answers
    nodes, finer = Nodes(), Nodes()
    nodes.parts, finer.parts = (1, 2) if modes_of(lever) == 1 else (MOST_PARTS, MOST_PARTS)
    short, long, guess = new_bench(nodes, PassState()), new_bench(finer, PassState()), np.zeros(col.GUESS)
    before = Before()
    for i in range(first, last):
        if status[i] != col.STIFF:
            continue
        p, row = parameters(rows[i]), out[i]
        for j in range(6):
            guess[j] = row[j]
        parts = refine_stiff(Oscillator(law, p, lever), guess, limits, short, long, before)
        if parts == 0:
            status[i] = col.PENDING
            continue
        bench = short if parts == parts_of(short.nodes) else long
        status[i] = col.GOOD
        solver[i] = choose(lever, guess, bench.nodes, bench.state, average, limits, row)
