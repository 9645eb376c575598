"""Work on several processes, which end when they are no longer needed, whatever becomes of this one."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

from phasemap._shared.errors import PhasemapError
from phasemap._shared.interrupts import interruptible

if TYPE_CHECKING:
    from multiprocessing.connection import Connection
    from multiprocessing.context import SpawnProcess

T = TypeVar("T")
R = TypeVar("R")


def in_processes(task: Callable[[T], R], items: Iterable[T], workers: int) -> Generator[R, None, None]:
    """Yield ``task(item)`` of every item, in the order in which they are done; items are taken when a worker is free.

    With one worker the task is called in this process, else in fresh ones, which need the task, its items and results
    to be picklable, and a script that starts them to do so under ``if __name__ == "__main__"``. Ctrl-C reaches this
    process alone. The others are stopped at once when the generator raises or is closed, and stop by themselves, after
    the item at hand, if this process is killed. Raises PhasemapError if a worker ended before its task did.
    """
    if workers == 1:
        for item in items:
            yield interruptible(partial(task, item))
        return
    from multiprocessing.connection import wait

    waiting = iter(items)
    running: dict[Any, SpawnProcess] = {}  # by our end of the line to each
    try:
        with _ignoring_interrupts():
            for item in _first(workers, waiting):
                connection, process = _start(task, quiet=bool(running))
                running[connection] = process
                connection.send(item)
        busy = set(running)
        ready: Any
        while busy:
            for ready in wait(busy):
                yield _result(ready, running[ready])
                busy.discard(ready)
                for item in _first(1, waiting):
                    ready.send(item)
                    busy.add(ready)
    finally:
        for process in running.values():
            process.terminate()
        for process in running.values():
            process.join()


def _first(count: int, items: Iterator[T]) -> Iterator[T]:
    """Yield at most `count` of the items that are left."""
    for _, item in zip(range(count), items, strict=False):
        yield item


def _start(task: Callable[[T], R], quiet: bool) -> tuple[Connection, SpawnProcess]:
    """Start a process that serves the task, and return our end of the line to it."""
    from multiprocessing import get_context

    context = get_context("spawn")  # a fork would copy numba's and HDF5's locks in whatever state they are
    ours, theirs = context.Pipe()
    process = context.Process(target=_serve, args=(theirs, task, quiet), daemon=True)
    process.start()
    theirs.close()  # or its end would not be ours to notice
    return ours, process


def _serve(line: Connection, task: Callable[[T], R], quiet: bool) -> None:
    """Do the tasks that come over the line until there is nobody at the other end."""
    if quiet:  # one of them says that kernels are compiled
        os.environ["PHASEMAP_QUIET"] = "1"
    try:
        while True:
            item = line.recv()
            answer: tuple[R | None, Exception | None]
            try:
                answer = task(item), None
            except Exception as error:
                answer = None, error
            line.send(answer)
    except (EOFError, BrokenPipeError, ConnectionResetError):
        return


def _result(line: Connection, process: SpawnProcess) -> Any:
    """Result of the task; raise the error that it raised."""
    try:
        result, error = line.recv()
    except (EOFError, ConnectionResetError) as end:
        process.join()
        raise PhasemapError(
            f"a worker process ended early (exit code {process.exitcode}). If it was killed, there was not enough "
            "memory: use fewer workers. A script must start workers under if __name__ == '__main__'."
        ) from end
    if error is not None:
        raise error
    return result


@contextmanager
def _ignoring_interrupts() -> Iterator[None]:
    """Processes that are started meanwhile are not interrupted by Ctrl-C, which goes to a whole group of them."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
