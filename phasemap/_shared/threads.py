"""Work spread over threads, in chunks that end in any order."""

from __future__ import annotations

import itertools
import os
import threading
from collections import deque
from collections.abc import Callable, Sequence
from queue import SimpleQueue
from typing import TypeVar

from phasemap._shared.checks import whole
from phasemap._shared.interrupts import check_stopped

T = TypeVar("T")

Progress = Callable[[int, int], None]

SMALL = 8  # rows whose solution may take no longer than to begin with them


def workers_of(threads: int | None) -> int:
    """Number of threads to start: as asked for, all cores by default."""
    if threads is not None:
        return min(whole("threads", threads, 1), 64)
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def chunk_of(count: int, workers: int, most: int) -> int:
    """Size of the chunks of `count` items: four turns for each thread, or two if few, and at most `most` items.

    A thread that is alone waits for no other one, and takes as many as it may.
    """
    if workers == 1:
        return max(1, min(most, count))
    chunk = -(-count // (4 * workers))
    if chunk < SMALL:
        chunk = min(SMALL, -(-count // (2 * workers)))
    return max(1, min(most, chunk))


def bounds_of(count: int, chunk: int) -> list[int]:
    """Indices at which chunks of so many items begin, and the end of the last one, as `spread` takes them."""
    return [*range(0, count, chunk), count] if count else []


def spread(task: Callable[[int, int], None], bounds: Sequence[int], workers: int, progress: Progress | None) -> None:
    """Run ``task(first, last)`` for all neighbours in `bounds`, and report how far one is from the calling thread."""
    parts = list(itertools.pairwise(bounds))
    total, done = (bounds[-1] if parts else 0), 0

    def report(more: int) -> None:
        nonlocal done
        done += more
        check_stopped()
        if progress is not None:
            progress(done, total)

    if workers == 1 or len(parts) <= 1:
        for first, last in parts:
            task(first, last)
            report(last - first)
        return
    left = deque(parts)
    # A pool of futures would look at all parts that wait whenever one ends, which costs seconds for thousands.
    ended: SimpleQueue[int | BaseException] = SimpleQueue()

    def following() -> tuple[int, int] | None:
        try:
            return left.popleft()
        except IndexError:
            return None

    def work() -> None:
        try:
            for first, last in iter(following, None):
                task(first, last)
                ended.put(last - first)
        except BaseException as error:
            ended.put(error)

    try:
        for _ in range(min(workers, len(parts))):
            threading.Thread(target=work).start()
        for _ in parts:
            if isinstance(more := ended.get(), BaseException):
                raise more
            report(more)
    finally:
        left.clear()  # an interrupt does not wait for what cannot be interrupted


def found_in(task: Callable[[int, int], T], bounds: Sequence[int], workers: int) -> list[T]:
    """Results of ``task(first, last)`` for all neighbours in `bounds`, in their order."""
    results: dict[int, T] = {}

    def find(first: int, last: int) -> None:
        results[first] = task(first, last)

    spread(find, bounds, workers, None)
    return [results[first] for first in bounds[:-1]]
