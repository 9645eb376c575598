"""Work in chunks on several threads, the same whatever their number."""

from __future__ import annotations

from functools import partial

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.rows.answers import Answers
from phasemap._shared.threads import Progress, bounds_of, chunk_of, spread, workers_of
from phasemap.experiment.accuracy import Accuracy
from phasemap.solvers.detected_setpoint import hold
from phasemap.solvers.energy import close
from phasemap.solvers.march import Remembering, check_marches
from phasemap.solvers.problem import Work
from phasemap.solvers.solver import Solver

Array = np.ndarray


def run(
    solver: Solver, work: Work, accuracy: Accuracy, *, threads: int | None = None, progress: Progress | None = None
) -> tuple[Array, Array, Array]:
    """Solve work in chunks on several threads.

    Returns `rows` (shape (n, COLUMNS)): as the detector sees them.
    Returns `status, solver` (shape (n,)).
    """
    if work.lever[col.SHAKER]:
        at_amplitudes = partial(run, solver, accuracy=accuracy, threads=threads, progress=progress)
        return hold(work, at_amplitudes, accuracy.periods)
    if work.law.memory and not isinstance(solver, Remembering):
        check_marches(solver.name)
        solver = Remembering(solver)
    count = len(work)
    rows = np.full((count, col.COLUMNS), np.nan)
    status, used = work.refused(), np.full(count, -1, np.int8)
    valid = np.flatnonzero(status == col.GOOD)
    if len(valid) < count:
        found = run(solver, work.part(valid), accuracy, threads=threads, progress=progress)
        rows[valid], status[valid], used[valid] = found
        return rows, status, used
    workers = workers_of(threads)

    def solve(first: int, last: int) -> None:
        solver.solve(work, accuracy, first, last, Answers(rows, status, used))

    spread(solve, bounds_of(count, chunk_of(count, workers, solver.rows_per_chunk)), workers, progress)
    close(rows, work.lever)
    return rows, status, used
