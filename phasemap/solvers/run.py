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
from phasemap.solvers.problem import Work
from phasemap.solvers.seen_by_detector import at_tip, shown
from phasemap.solvers.solver import BothDrives, March, OnlyInTime, Solver, check_marches

Array = np.ndarray

Widen = Callable[[Work, Array, Array, Array], Array]
"""``widen(part, rows, used, at)``: result rows of a part of the work with what is asked for besides, shape (n, WIDE);
`rows` may have nodes behind them (`phasemap._kernels.orbits.orbit_nodes`), and `at` are the numbers of the part."""


def run(
    solver: Solver, work: Work, accuracy: Accuracy, *, threads: int | None = None, progress: Progress | None = None,
    widen: Widen | None = None,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Solve work in chunks on several threads: rows as the detector sees them, status and solver codes.

    `widen`: adds to the rows of each chunk what their orbits are asked for besides, shape (n, WIDE).
    """
    if work.in_time and not isinstance(solver, OnlyInTime):
        check_marches(solver.name)
        solver = OnlyInTime(solver)
    if work.lever[col.SECOND_FREE] > 0.0 and isinstance(solver, March):
        solver = BothDrives(solver.eta)
    rows = np.full((len(work), col.COLUMNS if widen is None else WIDE), np.nan)
    status, used = work.refused(), np.full(len(work), -1, np.int8)
    tip, valid, workers = at_tip(work), np.flatnonzero(status == col.GOOD), workers_of(threads)
    chunk = chunk_of(len(valid), workers, solver.rows_per_chunk)
    rooms: list[Array] = []  # each used again by the next chunk: fresh memory is slow

    def solve(first: int, last: int) -> None:
        at = valid[first:last]
        room = rooms.pop() if rooms else np.empty((chunk, col.COLUMNS if widen is None else KEEPING))
        solved = Answers(room[: len(at)], status[at], used[at])
        solved.rows[:, : col.COLUMNS] = np.nan
        solved.rows[:, KEPT_COUNT : KEPT_COUNT + 1] = 0  # where there is room for nodes
        solver.solve(tip.part(at), accuracy, solved)
        seen = shown(solved.rows, work)
        rows[at] = seen if widen is None else widen(work.part(at), seen, solved.solver, at)
        status[at], used[at] = solved.status, solved.solver
        rooms.append(room)

    spread(solve, bounds_of(len(valid), chunk), workers, progress)
    return rows, status, used
