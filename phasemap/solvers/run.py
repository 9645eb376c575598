"""Work in chunks on several threads, the same whatever their number."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from phasemap._kernels import columns as col
from phasemap._kernels.columns import WIDE
from phasemap._kernels.orbits.orbit_nodes import KEEPING, KEPT_COUNT
from phasemap._kernels.rows.answers import Answers
from phasemap._shared.threads import Progress, bounds_of, chunk_of, spread, workers_of
from phasemap.experiment.accuracy import Accuracy
from phasemap.solvers.detected_setpoint import at_tip, shown
from phasemap.solvers.problem import Work
from phasemap.solvers.solver import BothDrives, March, OnlyInTime, Solver, check_marches

Array = np.ndarray

Widen = Callable[[Work, Array, Array, Array], Array]
"""``widen(part, rows, used, at)``: result rows of a part of the work with what is asked for besides, shape (n, WIDE);
`rows` may have nodes behind them (`phasemap._kernels.orbits.orbit_nodes`), and `at` are the numbers of the part."""


def run(
    solver: Solver, work: Work, accuracy: Accuracy, *, threads: int | None = None, progress: Progress | None = None,
    widen: Widen | None = None,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Solve work in chunks on several threads.

    `widen`: adds to the rows of each chunk what their orbits are asked for besides.
    Returns `rows` (shape (n, COLUMNS), or (n, WIDE) with `widen`): as the detector sees them.
    Returns `status, solver` (shape (n,)).
    """
    if work.in_time and not isinstance(solver, OnlyInTime):
        check_marches(solver.name)
        solver = OnlyInTime(solver)
    if work.lever[col.SECOND_FREE] > 0.0 and isinstance(solver, March):
        solver = BothDrives(solver.eta)
    count = len(work)
    rows = np.full((count, col.COLUMNS if widen is None else WIDE), np.nan)
    status, used = work.refused(), np.full(count, -1, np.int8)
    valid = np.flatnonzero(status == col.GOOD)
    if len(valid) < count:
        further = None if widen is None else lambda part, some, by, at: widen(part, some, by, valid[at])
        found = run(solver, work.part(valid), accuracy, threads=threads, progress=progress, widen=further)
        rows[valid], status[valid], used[valid] = found
        return rows, status, used
    tip, workers = at_tip(work), workers_of(threads)
    chunk = chunk_of(count, workers, solver.rows_per_chunk)
    rooms: list[Array] = []  # for rows with nodes, each used again by the next chunk: fresh memory is slow

    def solve(first: int, last: int) -> None:
        some = slice(first, last)
        part = tip.part(some)
        if widen is None:
            solver.solve(part, accuracy, Answers(rows[some], status[some], used[some]))
            rows[some] = shown(rows[some], work)
            return
        room = rooms.pop() if rooms else np.empty((chunk, KEEPING))
        wide = room[: len(part)]
        wide[:, : col.COLUMNS] = np.nan
        wide[:, KEPT_COUNT] = 0
        solver.solve(part, accuracy, Answers(wide, status[some], used[some]))
        rows[some] = widen(work.part(some), shown(wide, work), used[some], np.arange(first, last))
        rooms.append(room)

    spread(solve, bounds_of(count, chunk), workers, progress)
    return rows, status, used
