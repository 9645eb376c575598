"""Work spread over threads, in chunks that end in any order."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait

from phasemap._shared.checks import whole

Progress = Callable[[int, int], None]


def workers_of(threads: int | None) -> int:
    """How many threads to start: as asked for, all cores by default."""
    return min(whole("threads", threads, 1), 64) if threads is not None else _cores()


def chunk_of(count: int, workers: int, most: int) -> int:
    """How many of so many to solve in one go: four turns for each thread, and at most so many together.

    Examples
    --------
    >>> chunk_of(100, 2, 1000), chunk_of(100_000, 2, 1000)
    (13, 1000)
    """
    return max(1, min(most, -(-count // (4 * workers))))


def bounds_of(count: int, chunk: int) -> list[int]:
    """Where chunks of so many begin, and where the last one ends, as `spread` takes them.

    Examples
    --------
    >>> bounds_of(10, 4), bounds_of(0, 4)
    ([0, 4, 8, 10], [])
    """
    return [*range(0, count, chunk), count] if count else []


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


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
