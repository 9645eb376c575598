"""Work in chunks on several threads, the same whatever their number."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from functools import partial

import numpy as np

from phasemap._check import whole
from phasemap._kernels import columns as col
from phasemap.accuracy import Accuracy
from phasemap.energy import close
from phasemap.held import hold
from phasemap.solvers import Solver
from phasemap.work import Work

Array = np.ndarray
Progress = Callable[[int, int], None]


def workers_of(threads: int | None) -> int:
    """How many threads to start: as asked for, all cores by default.

    Raises
    ------
    InputError
        If `threads` is no whole number of at least 1.
    """
    return min(whole("threads", threads, 1), 64) if threads is not None else _cores()


def spread(task: Callable[[int, int], None], bounds: Sequence[int], workers: int, progress: Progress | None) -> None:
    """Run ``task(first, last)`` for all neighbours in `bounds`, and report how far one is from the calling thread."""
    parts = list(itertools.pairwise(bounds))
    total, done = (bounds[-1] if parts else 0), 0

    def solve(part: tuple[int, int]) -> int:
        task(*part)
        return part[1] - part[0]

    def report(more: int) -> None:
        nonlocal done
        done += more
        if progress is not None:
            progress(done, total)

    if workers == 1 or len(parts) <= 1:
        for part in parts:
            report(solve(part))
        return
    pool = ThreadPoolExecutor(workers)
    try:
        waiting = {pool.submit(solve, part) for part in parts}
        while waiting:
            finished, waiting = wait(waiting, return_when=FIRST_COMPLETED)
            report(sum(future.result() for future in finished))
    finally:
        pool.shutdown(wait=False, cancel_futures=True)  # an interrupt does not wait for what cannot be interrupted


def run(
    solver: Solver, work: Work, accuracy: Accuracy, *, threads: int | None = None, progress: Progress | None = None
) -> tuple[Array, Array, Array]:
    """Solve work in chunks on several threads.

    Returns
    -------
    rows : ndarray, shape (n, COLUMNS)
        As the detector sees them.
    status, solver : ndarray of int8, shape (n,)
    """
    if work.lever[col.SHAKER]:
        at_amplitudes = partial(run, solver, accuracy=accuracy, threads=threads, progress=progress)
        return hold(work, at_amplitudes, accuracy.periods)
    count = len(work)
    rows = np.full((count, col.COLUMNS), np.nan)
    status, used = work.refused(), np.full(count, -1, np.int8)
    valid = np.flatnonzero(status == col.GOOD)
    if len(valid) < count:
        found = run(solver, work.part(valid), accuracy, threads=threads, progress=progress)
        rows[valid], status[valid], used[valid] = found
        return rows, status, used
    workers = workers_of(threads)
    size = max(1, min(solver.rows_per_chunk, -(-count // (4 * workers))))

    def solve(first: int, last: int) -> None:
        solver.solve(work, accuracy, first, last, rows, status, used)

    spread(solve, [*range(0, count, size), count] if count else [], workers, progress)
    close(rows, work.lever)
    return rows, status, used


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
